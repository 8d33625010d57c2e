"""`deckline demo` and `run`. Optional parts are imported inside the command that needs them."""

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from deckline.cli.dashboard import Address, open_dashboard
from deckline.cli.publish import open_publisher
from deckline.extras import needs_extra
from deckline.files import name_in_errors, print_line, printable, read_regular
from deckline.flight import Flight
from deckline.options import RunOptions
from deckline.recording import Source, Stream, open_recording, select_frames
from deckline.recording.airsim import RECORD_FILE
from deckline.report.records import View

SAMPLE = Path(__file__).parent.parent / "sample" / "approach.zip"
DEFAULTS = RunOptions()


def demo(out: Path = Path("demo-out")) -> int:
    """Fly the shipped sample approach through haze: writes report.html, overlay.mp4, guidance.csv, guidance.jsonl.

    Args:
        out: folder for the results.
    """
    recording = out / "approach"
    own = recording.exists()
    source = unpack_sample(recording)
    return _run(source, Flight.from_config(source.base_config), out, overwrite=own)


def unpack_sample(folder: Path) -> Source:
    """The shipped approach through haze, unpacked into a folder that is new, or holds it already."""
    with zipfile.ZipFile(SAMPLE) as archive:
        rows = folder / RECORD_FILE
        if folder.exists() and not (rows.is_file() and read_regular(rows) == archive.read(RECORD_FILE)):
            raise ValueError(f"{folder} is not the shipped approach and is not replaced: choose another --out")
        archive.extractall(folder)
    return open_recording(folder)


def run(
    source: tyro.conf.Positional[str],
    out: Path,
    camera: str | None = None,
    poses: Path | None = None,
    origin: Annotated[tuple[float, float, float] | None, tyro.conf.arg(metavar="LAT LON ALT")] = None,
    fov_deg: float | None = None,
    deck_z_m: float | None = None,
    sea_z_m: float | None = None,
    pose_offset_s: float | None = None,
    max_pose_gap_s: float | None = None,
    topic: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME...")] = (),
    every: int = 1,
    start: float = 0.0,
    duration: float | None = None,
    rate: float = 5.0,
    dashboard: Address = None,
    mcap: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    foxglove: Address = None,
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = DEFAULTS,
    max_frames: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
) -> int:
    """Find the runway lines in a recording, an image folder, a video, or live in a simulator.

    Args:
        source: AirSim recording, folder of images, video, ROS bag, or airsim://HOST:PORT[/VEHICLE] of a simulator.
        out: folder for report.html, overlay.mp4, guidance.csv and guidance.jsonl.
        camera: camera.toml, or YAML of OpenCV or ROS, when not beside the source; of a simulator the camera's name.
        poses: poses.csv, when not beside the source, or a log of ArduPilot (.bin, .tlog) or PX4 (.ulg).
        origin: of the world, degrees and metres, for poses that have these; their first position when not given.
        fov_deg: horizontal, without a camera file.
        deck_z_m: world z (down, metres) of the deck plane, for ranges beyond the depth camera.
        sea_z_m: world z (down, metres) of the water, for dehazing, where it is 20 m below the deck when not given, and
            to notice a pitched camera.
        pose_offset_s: the clock of the poses minus that of the pictures, for poses that go by time (0).
        max_pose_gap_s: between two poses, beyond which pictures have no pose (0.5).
        topic: of a ROS bag, where several are there.
        every: take one frame of so many.
        start: seconds after the first frame at which to begin.
        duration: seconds of the recording to take.
        rate: frames a second that are taken from a simulator, at most.
        dashboard: watch in a browser (127.0.0.1:8080), until Ctrl-C.
        mcap: for pictures and guidance as ROS 2 messages.
        foxglove: the same live, for Foxglove (127.0.0.1:8765).
        options: of the configuration.
        max_frames: stop after so many frames; a simulator's go on until Ctrl-C.
        resume: go on after the last whole frame of an interrupted run in `out`.
        overwrite: replace the results of an older run in `out`.
    """
    config = options.run_config()
    stated = {"offset_s": pose_offset_s, "max_gap_s": max_pose_gap_s, "origin": origin}
    navigation: Any = {name: value for name, value in stated.items() if value is not None}
    config = replace(config, navigation=replace(config.navigation, **navigation))
    opened: Stream
    if source.startswith("airsim:"):
        if poses is not None:
            raise ValueError(f"{source}: a simulator gives the poses itself; leave {poses} out")
        if (every, start, duration) != (1, 0.0, None):
            raise ValueError(f"{source}: a simulator runs live: leave --every, --start and --duration out, take --rate")
        with needs_extra("sim"):
            from deckline.adapters.airsim.source import AirSimSource
        opened = AirSimSource(source, camera or "0", rate, deck_z_m, sea_z_m)
    else:
        recording = open_recording(
            source,
            camera_file=camera,
            poses_file=poses,
            fov_deg=fov_deg,
            deck_z_m=deck_z_m,
            sea_z_m=sea_z_m,
            navigation=config.navigation,
            topics=topic,
        )
        opened = select_frames(recording, every, start, duration)
        config = replace(options.run_config(opened.base_config), navigation=config.navigation)
    flight = Flight.from_config(config)
    published = open_publisher(mcap, foxglove, source, config, False, overwrite)
    with open_dashboard(dashboard, source, config, False) as watching, published as views:
        return _run(opened, flight, out, max_frames, resume, overwrite, (*watching, *views))


def _run(
    source: Stream,
    flight: Flight,
    out: Path,
    max_frames: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    views: tuple[View, ...] = (),
) -> int:
    from deckline.report.run import run as run_flight

    for note in source.notes:
        print_line(f"note: {note}")
    with name_in_errors(out):
        summary = run_flight(
            source,
            flight,
            out,
            config=flight.config,
            max_frames=max_frames,
            resume=resume,
            overwrite=overwrite,
            views=views,
        )
    for path in summary.written:
        print(printable(path))
    return summary.exit_code


COMMANDS = {"demo": demo, "run": run}
EXAMPLES = {
    "deckline run": (
        "deckline run flights/first --out out --deck-z-m -18",
        "deckline run approach.mp4 --out out --camera camera.toml --poses poses.csv --every 3 --start 60 --duration 30",
    ),
}
