import json
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from airsim_serving import CONFIG, run_server
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.client import Connection
from deckline.adapters.airsim.source import AirSimSource
from deckline.cli.main import main
from deckline.geometry import attitude
from deckline.recording import open_recording
from deckline_sim import frames
from deckline_sim.airsim_server.structs import pose_struct

pytest.importorskip("cosysairsim")
SCRIPT = Path(__file__).parents[3] / "examples" / "03_airsim_landing.py"
START_M = 130.0
RAMP_M, COURSE_RAD = np.array([7.5, 27.1, 6.08]), np.deg2rad(170.93)  # as in the script


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    with run_server(tmp_path_factory.mktemp("flown"), replace(CONFIG, width=320, height=180), speed=1.0) as server:
        yield server


@pytest.fixture(scope="module")
def flown(running):
    """The recording that the example made with the published client, and the example's process."""
    words = [sys.executable, str(SCRIPT), str(START_M), str(running.port)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    (folder,) = running.out.iterdir()
    return folder


def test_the_script_flies_the_profile_and_its_recording_is_read(flown):
    recorded = list(open_recording(flown))
    assert len(recorded) >= 5
    for frame in recorded:
        north, east, down = frame.world_from_body.translation - RAMP_M
        range_m = -north * np.cos(COURSE_RAD) - east * np.sin(COURSE_RAD)
        assert 0.0 <= range_m <= START_M + 1e-3
        assert -down == pytest.approx(60.0 * (range_m + 70.0) / 870.0, abs=1e-3)  # the paper's last glide
        assert north * np.sin(COURSE_RAD) - east * np.cos(COURSE_RAD) == pytest.approx(0.0, abs=1e-3)
        nose = frame.world_from_body.rotation.apply([1.0, 0.0, 0.0])
        assert np.arctan2(nose[1], nose[0]) == pytest.approx(COURSE_RAD, abs=1e-6)
        assert np.arcsin(nose[2]) == pytest.approx(np.arctan2(-down, range_m + 70.0), abs=1e-6)  # looks at touchdown
    assert len({frame.world_from_body.translation[0] for frame in recorded}) >= 3


def test_the_chain_measures_the_recording_right(flown, tmp_path):
    words = ["run", str(flown), "--deck-z-m", "6.08", "--out", str(tmp_path), "--max-frames", "3", "--dehazer", "none"]
    assert main(words) == 0
    records = [json.loads(line) for line in (tmp_path / "guidance.jsonl").read_text().splitlines()]
    errors = [record["errors"]["guidance"] for record in records if record["seen"] == "both lines"]
    assert errors
    for error in errors:
        assert abs(error["height_above_deck_m"]) < 1.0
        assert abs(error["lateral_deviation_m"]) < 2.0  # 320x180 px from 130 m: 0.8 m a pixel


def test_live_frames_are_where_the_vehicle_was_put_and_show_what_is_there(running):
    body = attitude(0.02, -0.05, COURSE_RAD)
    place = np.add(RAMP_M, [200.0, -30.0, -35.0])
    tilt, offset = attitude(0.0, -0.1, 0.03), [2.0, 0.3, 0.5]
    with Connection("127.0.0.1", running.port) as connection:
        connection.call("simSetVehiclePose", pose_struct(RigidTransform.from_components(place, body)), True)
        mount = pose_struct(RigidTransform.from_components(offset, tilt))
        connection.call("simSetCameraPose", "front_center", mount)
        source = AirSimSource(f"airsim://127.0.0.1:{running.port}", "front_center", rate_hz=100.0, deck_z_m=6.08)
        (frame,) = islice(source, 1)
        connection.call("reset")
    assert source.notes == ()
    np.testing.assert_allclose(frame.world_from_body.translation, place, atol=1e-3)
    assert (frame.world_from_body.rotation.inv() * body).magnitude() < 1e-5
    np.testing.assert_allclose(frame.body_from_camera.translation, offset, atol=1e-3)
    view = frame.body_from_camera.rotation.apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(view, tilt.apply([1.0, 0.0, 0.0]), atol=1e-5)
    truth = next(iter(frames(replace(CONFIG, frames=1)))).truth  # the ship stands still
    points = np.array([truth.left.p0_m, truth.right.p0_m, truth.left.p1_m, truth.right.p1_m])
    along = (points[:2] + points[2:]) / 2
    seen = frame.world_from_camera.inv().apply(along)
    for (u, v), expected in zip(np.rint(frame.camera.project(seen)).astype(int), seen[:, 2], strict=True):
        assert frame.depth_m[v, u] == pytest.approx(expected, rel=0.03)  # a row is 2 % of the way
