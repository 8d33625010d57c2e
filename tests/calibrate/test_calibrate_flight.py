"""`deckline calibrate` on a rendered approach, and guidance before and after it."""

import csv
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.cli.main import main
from deckline.flight import Flight
from deckline.geometry import attitude
from deckline.options import read_run_config
from deckline.recording import open_recording
from deckline.recording.camera_file import format_camera
from deckline.truth import true_guidance
from deckline.types import Status
from deckline_sim import SimConfig
from deckline_sim.config import FlightConfig
from deckline_sim.record import simulate

DELAY_S = 0.1  # of the poses behind the pictures
DECK = "[deck]\nsea_state = 0.0\nship_velocity_m_s = [0.0, 0.0]\nwidth_m = 14.85\n"


@pytest.fixture(scope="module")
def approach(tmp_path_factory):
    """A rendered approach as a folder of images with late poses by time, without a camera file; and its frames."""
    base = tmp_path_factory.mktemp("approach")
    air = SimConfig(frames=30, seed=7, width=960, height=540, visibility_m=(3000.0, 3000.0), keep_clear=False)
    air = replace(air, start_m=400.0, flight=FlightConfig(speed_m_s=60.0))
    simulate(air, base / "true", "png", 1)
    frames = list(open_recording(base / "true"))
    folder = base / "stated"
    folder.mkdir()
    with (folder / "times.csv").open("w", newline="") as times, (folder / "poses.csv").open("w", newline="") as poses:
        pictures, placed = csv.writer(times), csv.writer(poses)
        pictures.writerow(["file", "time_s"])
        placed.writerow(["time_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"])
        for frame in frames:
            cv2.imwrite(str(folder / frame.file), frame.image_rgb[..., ::-1])
            body = frame.world_from_body
            pictures.writerow([frame.file, frame.time_s])
            placed.writerow([frame.time_s + DELAY_S, *body.translation, *body.rotation.as_quat(scalar_first=True)])
        before, last = frames[-2:]  # a pose after all pictures, whatever delay is estimated
        beyond_m = 2 * last.world_from_body.translation - before.world_from_body.translation
        turn = last.world_from_body.rotation.as_quat(scalar_first=True)
        placed.writerow([2 * last.time_s - before.time_s + DELAY_S, *beyond_m, *turn])
    (base / "deck.toml").write_text(DECK)
    return base, folder, frames


def state_mount(approach, off_deg):
    """Write a camera file whose mount is off by roll, pitch and yaw, degrees; returns its path."""
    base, _, (frame, *_) = approach
    turned = attitude(*np.deg2rad(off_deg)) * frame.body_from_camera.rotation
    stated = RigidTransform.from_components(frame.body_from_camera.translation, turned)
    heights = {"deck_z_m": frame.deck_z_m, "sea_z_m": frame.sea_z_m}
    (base / "stated.toml").write_text(format_camera(frame.camera, stated, heights))
    return base / "stated.toml"


def fly(approach, camera_file, config_file, count):
    """Guidance less truth (N, 3) of the `ok` frames of the first ones: lateral, height, m; heading, degrees."""
    _, folder, frames = approach
    config = read_run_config(config_file)
    recording = open_recording(folder, camera_file=camera_file, navigation=config.navigation)
    errors = []
    with Flight.from_config(config, dehazer=lambda image: image) as flight:
        for index, frame in enumerate(frames[:count]):
            answer, exact = flight(recording.load(index)).guidance, true_guidance(frame, config.approach)
            if answer.status is Status.OK:
                names = ("lateral_deviation_m", "height_above_deck_m", "heading_error_rad")
                errors.append([getattr(answer, name).value - getattr(exact, name).value for name in names])
    return np.array(errors).reshape(-1, 3) * [1.0, 1.0, np.rad2deg(1.0)]


def test_guidance_is_right_after_calibration_and_was_not_before(approach, capsys, tmp_path):
    base, folder, frames = approach
    stated, out = state_mount(approach, (2.0, -2.0, 2.0)), tmp_path / "out"
    options = ["--camera", str(stated), "--config", str(base / "deck.toml")]
    assert main(["calibrate", str(folder), "--out", str(out), *options]) == 0
    printed = capsys.readouterr().out
    assert "cx stays as stated: it cannot be told from yaw" in printed
    offset_s = read_run_config(out / "calibration.toml").navigation.offset_s
    assert offset_s == pytest.approx(DELAY_S, abs=0.02)
    before = fly(approach, stated, base / "deck.toml", len(frames) // 2)
    after = fly(approach, out / "camera.toml", out / "calibration.toml", len(frames))
    assert (np.abs(before[:, 2]) > 1.5).all()  # of as many as are `ok`
    assert len(after) >= 0.8 * len(frames)
    assert (np.abs(after) < [2.0, 0.3, 0.5]).all()


def test_an_older_result_is_not_replaced(approach, capsys):
    base, folder, _ = approach
    (base / "old").mkdir(exist_ok=True)
    assert main(["calibrate", str(folder), "--out", str(base / "old")]) == 2
    assert "old is there already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("picture_count", "with_poses", "named"),
    [(3, False, "a camera and a pose"), (1, True, "at 4 times"), (5, True, "0 of 5 frames")],
)
def test_bad_input_is_one_line(tmp_path, capsys, picture_count, with_poses, named):
    """No poses; one frame; pictures without lines."""
    rows = ["file,time_s,x_m,y_m,z_m,qw,qx,qy,qz"]
    for number in range(picture_count):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((90, 160, 3), 120, np.uint8))
        rows.append(f"{number}.png,{number / 5},{10 * number},0,-30,1,0,0,0")
    if with_poses:
        (tmp_path / "poses.csv").write_text("\n".join(rows) + "\n")
    options = ["--fov-deg", "80", "--deck-z-m", "-10"]
    assert main(["calibrate", str(tmp_path), "--out", str(tmp_path / "out"), *options]) == 2
    (line,) = [row for row in capsys.readouterr().err.splitlines() if not row.startswith("note: ")]
    assert named in line
    assert not (tmp_path / "out").exists()
