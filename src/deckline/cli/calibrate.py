"""`deckline calibrate`."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from deckline.calibrate import describe, observe_approach, solve, write_calibration
from deckline.cli.sources import SourceOptions
from deckline.files import is_there, name_in_errors, print_notes, printable
from deckline.flight import Flight
from deckline.options import RunOptions
from deckline.recording import select_frames

DEFAULTS, SOURCE = RunOptions(), SourceOptions()
Quantity = Literal["roll", "pitch", "yaw", "focal", "cx", "cy", "delay"]


def calibrate(
    recording: tyro.conf.Positional[str],
    out: Path,
    opening: Annotated[SourceOptions, tyro.conf.arg(name="")] = SOURCE,
    poses: str | None = None,
    start: float = 0.0,
    duration: float | None = None,
    hold: tuple[Quantity, ...] = (),
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = DEFAULTS,
) -> int:
    """Estimate mounting, focal length, principal point and the delay of the poses from one approach.

    What the approach determines is written as camera.toml and calibration.toml, for --camera and --config of `deckline
    run`; the rest stays as stated and is named. calibration.json has all estimates, 1-sigmas and correlations.

    Args:
        recording: of one approach with poses: AirSim recording, folder of images, video or ROS bag.
        out: new folder for the three files.
        opening: of the recording.
        poses: poses.csv, when not beside the recording, or a log of ArduPilot (.bin, .tlog) or PX4 (.ulg).
        start: seconds after the first frame at which to begin.
        duration: seconds of the recording to take.
        hold: quantities that stay as stated.
        options: of the configuration; --config with deck.ship_velocity_m_s, or --ramp-m with --heading-deg, determines
            the yaw.
    """
    if is_there(out):
        raise ValueError(f"{out} is there already: choose another --out")
    config = opening.place_poses(options.run_config())
    source = select_frames(opening.open_recording(recording, config, poses), 1, start, duration)
    config = opening.place_poses(options.run_config(source.base_config))
    print_notes(source.notes)
    with Flight.from_config(config) as flight:
        view = observe_approach(source, flight)
    calibration = solve(view, config, tuple("focal length" if name == "focal" else name for name in hold))
    offset_s = None if source.pose_track is None else source.pose_track.offset_s
    with name_in_errors(out):
        written = write_calibration(out, view, calibration, config, offset_s)
    for line in (*describe(calibration, offset_s), *written):
        print(printable(line))
    return 0


COMMANDS = {"calibrate": calibrate}
EXAMPLES = {
    "deckline calibrate": (
        "deckline calibrate flights/first --out calibration --config deck.toml",
        "deckline run flights/second --camera calibration/camera.toml --config calibration/calibration.toml --out out",
    ),
}
