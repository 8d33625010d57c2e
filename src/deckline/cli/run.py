"""`deckline demo` and `run`. Optional parts are imported inside the command that needs them."""

import zipfile
from pathlib import Path
from typing import Annotated, Any

import tyro

from deckline.cli.sources import SIMULATOR, SourceOptions
from deckline.cli.views import ViewOptions
from deckline.config import RunConfig
from deckline.files import name_in_errors, print_notes, printable, read_regular
from deckline.flight import Flight
from deckline.options import RunOptions
from deckline.recording import Recording, Source, open_recording, select_frames
from deckline.recording.airsim import RECORD_FILE

SAMPLE = Path(__file__).parent.parent / "sample" / "approach.zip"
DEFAULTS, SOURCE, VIEWS = RunOptions(), SourceOptions(), ViewOptions()


def demo(out: Path = Path("demo-out")) -> int:
    """Fly the shipped sample approach through haze: writes report.html, overlay.mp4, guidance.csv, guidance.jsonl.

    Args:
        out: folder for the results.
    """
    recording = out / "approach"
    own = recording.exists()
    source = unpack_sample(recording)
    with Flight.from_config(source.base_config or RunConfig()) as flight:
        return _run(source, flight, out, overwrite=own)


def unpack_sample(folder: Path) -> Recording:
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
    opening: Annotated[SourceOptions, tyro.conf.arg(name="")] = SOURCE,
    poses: str | None = None,
    every: int = 1,
    start: float = 0.0,
    duration: float | None = None,
    rate: float = 5.0,
    watching: Annotated[ViewOptions, tyro.conf.arg(name="")] = VIEWS,
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = DEFAULTS,
    max_frames: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
) -> int:
    """Find the runway lines in a recording, an image folder, a video, or live in a simulator.

    Args:
        source: AirSim recording, folder of images, video, ROS bag, or airsim://HOST:PORT[/VEHICLE] of a simulator.
        out: folder for report.html, overlay.mp4, guidance.csv and guidance.jsonl.
        opening: of the source.
        poses: poses.csv, when not beside the source, or a log of ArduPilot (.bin, .tlog) or PX4 (.ulg).
        every: take one frame of so many.
        start: seconds after the first frame at which to begin.
        duration: seconds of the recording to take.
        rate: frames a second that are taken from a simulator, at most.
        watching: of the views.
        options: of the configuration.
        max_frames: stop after so many frames; a simulator's go on until Ctrl-C.
        resume: go on after the last whole frame of an interrupted run in `out`.
        overwrite: replace the results of an older run in `out`.
    """
    config = opening.place_poses(options.run_config())
    opened: Source
    if source.startswith(SIMULATOR):
        if (every, start, duration) != (1, 0.0, None):
            raise ValueError(f"{source}: a simulator runs live: leave --every, --start and --duration out, take --rate")
        opened = opening.open_simulator(source, rate, poses)
    else:
        recording = opening.open_recording(source, config, poses)
        opened = select_frames(recording, every, start, duration)
        config = opening.place_poses(options.run_config(opened.base_config))
    with (
        Flight.from_config(config) as flight,
        watching.open(source, config, is_live=False, overwrite=overwrite) as views,
    ):
        return _run(opened, flight, out, max_frames=max_frames, resume=resume, overwrite=overwrite, views=views)


def _run(source: Source, flight: Flight, out: Path, **how: Any) -> int:
    """Run, as `report.run.run` takes it, and print the files that it writes."""
    from deckline.report.run import run as run_flight

    print_notes(source.notes)
    with name_in_errors(out):
        summary = run_flight(source, flight, out, **how)
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
