"""What each `deckline` command does. Heavy or optional parts are imported inside the command that needs them."""

import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Literal

import tyro

from deckline.detect.prior import RunwaySurvey
from deckline.extras import needs_extra
from deckline.flight import USUAL_SEA_STATE, Flight, open_flight
from deckline.guide import GuideConfig
from deckline.localize import LocalizeConfig
from deckline.pipeline import Picture, Pipeline, PipelineConfig
from deckline.recording import Stream, open_recording
from deckline.track import TrackConfig

SAMPLE = Path(__file__).parent.parent / "sample" / "approach.zip"
NO_SURVEY = RunwaySurvey()
USUAL_APPROACH = GuideConfig()


def demo(out: Path = Path("demo-out")) -> int:
    """Fly the shipped sample approach through haze: writes report.html, overlay.mp4, guidance.csv, guidance.jsonl.

    Args:
        out: folder for the results.
    """
    recording = out / "approach"
    own = recording.exists()  # only an earlier demo has unpacked its recording there
    with zipfile.ZipFile(SAMPLE) as archive:
        archive.extractall(recording)
    return _run(open_recording(recording), Flight(Pipeline()), out, overwrite=own)


def run(
    source: tyro.conf.Positional[str],
    out: Path,
    camera: str | None = None,
    poses: Path | None = None,
    fov_deg: float = 90.0,
    deck_z_m: float | None = None,
    sea_z_m: float | None = None,
    rate: float = 5.0,
    dehazer: str = PipelineConfig.dehazer,
    detector: str = PipelineConfig.detector,
    mode: Literal["auto", "fine", "coarse"] = "auto",
    runway: RunwaySurvey = NO_SURVEY,
    detect_in: Picture = PipelineConfig.detect_in,
    track: bool = True,
    sea_state: float = USUAL_SEA_STATE,
    runway_width_m: float | None = None,
    guide: GuideConfig = USUAL_APPROACH,
    max_frames: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    seed: int = 0,
) -> int:
    """Find the runway lines in a recording, an image folder, a video, or live in a simulator.

    Args:
        source: AirSim recording folder, folder of images, video file, or airsim://HOST:PORT[/VEHICLE] of a simulator.
        out: folder for report.html, overlay.mp4, guidance.csv and guidance.jsonl.
        camera: camera.toml, when it does not lie beside the images or the video; of a simulator the camera's name.
        poses: poses.csv, when it does not lie beside the images or the video.
        fov_deg: horizontal field of view of an AirSim recording without a camera file.
        deck_z_m: world z (down, metres) of the deck plane, for ranges beyond the depth camera.
        sea_z_m: world z (down, metres) of the water, for dehazing by geometry; without it 20 m below the deck.
        rate: frames a second that are taken from a simulator, at most.
        dehazer: name (see `deckline info`) or an .onnx file.
        detector: name (see `deckline info`) or an .onnx file.
        mode: where distances come from: depth camera (fine), deck plane (coarse), or the better per frame (auto).
        runway: where it is, if that is known: looked at closely where a search of the whole image misses it.
        detect_in: the picture that lines are looked for in; for a detector that never saw haze, dehazed.
        track: frames are one flight in their order: filter over them, look closely where the last ones saw the runway,
            bridge two seconds without lines, watch for faults. Unrelated frames are handled one by one all the same.
        sea_state: 0 to 6: how much the deck moves, of which the ship reports only its height at rest; 0 for a runway
            on land.
        runway_width_m: between the middles of both lines, known to 0.1 m; without it, it is learned.
        guide: the wanted approach.
        max_frames: stop after so many frames; a simulator's go on until Ctrl-C.
        resume: go on after the last whole frame of an interrupted run in `out`.
        overwrite: replace the results of an older run in `out`.
        seed: of RANSAC's draws.
    """
    opened: Stream
    if source.startswith("airsim:"):
        if poses is not None:
            raise ValueError(f"{source}: a simulator gives the poses itself; leave {poses} out")
        with needs_extra("sim"):
            from deckline.adapters.airsim.source import LiveSource
        opened = LiveSource(source, camera or "0", rate, deck_z_m, sea_z_m)
    else:
        opened = open_recording(
            source, camera_file=camera, poses_file=poses, fov_deg=fov_deg, deck_z_m=deck_z_m, sea_z_m=sea_z_m
        )
    # A tracker that is told the width must see what the lines say of it, not what localization was told as well.
    lines = replace(LocalizeConfig(), mode=mode, runway_width_m=None if track else runway_width_m)
    config = PipelineConfig(dehazer, detector, lines, seed, runway, detect_in)
    flight = open_flight(config, TrackConfig(runway_width_m=runway_width_m) if track else None, guide, sea_state)
    return _run(opened, flight, out, max_frames, resume, overwrite)


def convert(
    recording: tyro.conf.Positional[Path],
    out: Path,
    plain: bool = False,
    camera: Path | None = None,
    fov_deg: float = 90.0,
    mount_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    mount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    deck_z_m: float | None = None,
) -> int:
    """Copy an AirSim recording into deckline's layout with scene.json, or back with --plain.

    Args:
        recording: folder with airsim_rec.txt and images.
        out: new folder.
        plain: leave scene.json and the clear images out, for AirSim's own tools.
        camera: camera.toml with intrinsics and mount; goes before the options below.
        fov_deg: horizontal field of view.
        mount_m: where the camera sits on the vehicle: forward, right, down of its centre.
        mount_deg: how the camera is turned on the vehicle: roll, pitch (up is positive), yaw.
        deck_z_m: world z (down, metres) of the deck plane.
    """
    from deckline.cli.convert import convert_recording

    done = convert_recording(recording, out, plain, camera, fov_deg, mount_m, mount_deg, deck_z_m)
    for note in done.notes:
        print(f"note: {note}", file=sys.stderr)
    print(f"{out}: {done.rows} rows, {done.files} image files")
    return 0


def _run(
    source: Stream,
    pipeline: Flight,
    out: Path,
    max_frames: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
) -> int:
    from deckline.report.run import run as run_pipeline

    for note in source.notes:
        print(f"note: {note}", file=sys.stderr)
    summary = run_pipeline(source, pipeline, out, max_frames=max_frames, resume=resume, overwrite=overwrite)
    for path in summary.written:
        print(path)
    return summary.exit_code


def info() -> int:
    """Print versions, inference providers and the shipped weights with their measured figures."""
    from deckline.cli.info import print_info

    print_info(sys.stdout)
    return 0
