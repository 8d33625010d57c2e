import json
import os
import signal
import threading
import time
from itertools import islice

import numpy as np
import pytest
from airsim_stand_in import BGR, DEPTH, HALF, StandIn, pose, quaternion, response, vector

from deckline.adapters.airsim.client import Connection
from deckline.adapters.airsim.source import (
    AirSimSource,
    MountMeasurement,
    Pace,
    measure_still_mount,
    read_frame,
    update_mount,
)
from deckline.cli.main import main
from deckline.geometry import Camera, attitude, camera_mount
from deckline.recording import BadFrame, RecordingError
from deckline.types import Frame

LEVEL = camera_mount()


def read(scene, depth, mount=LEVEL):
    return read_frame("front#1", scene, depth, mount, np.pi / 2, -18.0, 2.0)


def test_a_frame_is_picture_depth_camera_and_pose_of_its_image():
    frame = read(response(0), response(1))
    assert frame.time_s == 1_700_000_000.25
    np.testing.assert_array_equal(frame.image_rgb, BGR[:, :, ::-1], strict=True)
    np.testing.assert_array_equal(frame.depth_m, DEPTH)
    assert frame.camera.__dict__ == Camera.from_fov(4, 3, np.pi / 2).__dict__
    assert (frame.deck_z_m, frame.sea_z_m) == (-18.0, 2.0)
    # AirSim's camera looks along its own x; the optical frame's z is the same direction
    np.testing.assert_allclose(frame.world_from_camera.apply([0.0, 0.0, 5.0]), [6.0, 2.0, -3.0], atol=1e-12)
    np.testing.assert_allclose(frame.world_from_body.translation, [1.0, 2.0, -3.0])


def test_the_body_stands_where_the_mount_says_while_the_camera_is_where_the_image_was_taken():
    mount = camera_mount([2.0, 0.0, 0.5], attitude(0.0, -0.2, 0.0))
    east = {"camera_position": vector(10, 20, -30), "camera_orientation": quaternion(HALF, 0, 0, HALF)}
    frame = read(response(0, **east), response(1, **east), mount)
    np.testing.assert_allclose(frame.world_from_camera.translation, [10.0, 20.0, -30.0], atol=1e-9)
    np.testing.assert_allclose(frame.world_from_camera.apply([0.0, 0.0, 1.0]), [10.0, 21.0, -30.0], atol=1e-9)
    np.testing.assert_allclose(frame.world_from_body.apply([2.0, 0.0, 0.5]), [10.0, 20.0, -30.0], atol=1e-9)
    nose = frame.world_from_body.rotation.apply([1.0, 0.0, 0.0])  # 0.2 rad above the camera's level view
    np.testing.assert_allclose(nose, [0.0, np.cos(0.2), -np.sin(0.2)], atol=1e-9)


def test_half_precision_far_depth_and_no_distance_are_unknown():
    numbers = DEPTH.ravel().tolist()
    numbers[:4] = [65504.0, float("inf"), 0.0, float("nan")]
    frame = read(response(0), response(1, image_data_float=numbers))
    np.testing.assert_array_equal(np.isnan(frame.depth_m), [[True] * 4, [False] * 4, [False] * 4])


@pytest.mark.parametrize(
    ("scene", "depth", "text"),
    [
        ({"image_data_uint8": BGR.tobytes()[:-1]}, {}, r"Scene of 4x3 px.*36.*35 bytes"),
        ({"image_data_uint8": "text"}, {}, "Scene.*str"),
        ({"width": 0, "height": 0, "message": "camera is not set"}, {}, r"Scene.*\(camera is not set\)"),
        ({"width": -4}, {}, "Scene"),
        ({"time_stamp": None}, {}, "time stamp.*None"),
        ({"camera_position": vector(float("nan"), 0, 0)}, {}, "Scene: position.*nan"),
        ({"camera_orientation": quaternion(0, 0, 0, 0)}, {}, "Scene: quaternion.*0"),
        ({"camera_orientation": None}, {}, "Scene: orientation.*None"),
        ({}, {"image_data_float": [0.0], "image_data_uint8": BGR.tobytes()}, "DepthPlanar of 4x3 px.*grey"),
        ({}, {"image_data_float": [1.0] * 11}, "DepthPlanar.*12.*11"),
        ({}, {"image_data_float": ["x"] * 12}, "DepthPlanar"),
        ({}, {"width": 3, "height": 4}, "DepthPlanar.*3x4.*4x3"),
        ({}, {"width": 0}, "DepthPlanar"),
    ],
)
def test_broken_answers_name_the_broken_part(scene, depth, text):
    with pytest.raises(ValueError, match=text):
        read(response(0, **scene), response(1, **depth))


@pytest.mark.parametrize(
    ("turn", "position", "apart"),
    [((1, 0, 0, 0), (1.33, 2, -3), r"0\.33 m .*\b0 deg"), ((HALF, 0, 0, HALF), (1, 2, -3), r"\b0 m .*90 deg")],
)
def test_picture_and_depth_of_two_instants_are_refused(turn, position, apart):
    later = {"camera_position": vector(*position), "camera_orientation": quaternion(*turn)}
    with pytest.raises(ValueError, match=apart):
        read(response(0), response(1, **later))


def test_single_precision_of_a_pose_far_from_the_origin_is_no_difference():
    at = {"camera_position": vector(5000.0001, 2, -3), "camera_orientation": quaternion(1, 1e-7, 0, 0)}
    near = response(0, camera_position=vector(5000, 2, -3))
    assert read(near, response(1, **at)).world_from_body is not None


def measure(**methods):
    with StandIn(**methods) as server, Connection("127.0.0.1", server.port) as connection:
        return measure_still_mount(connection, "0", ""), len(server.calls)


def test_the_mount_of_a_vehicle_that_stands_still_is_exact_at_once():
    turned = (HALF, 0.0, 0.0, HALF)  # vehicle and camera look east; the camera sits 2 m ahead and 0.5 m below
    found, calls = measure(
        simGetVehiclePose=lambda *_params: pose((10, 20, -30), turned),
        simGetCameraInfo=lambda *_params: {"pose": pose((10, 22, -29.5), turned), "fov": 60.0},
    )
    assert calls == 3
    assert (found.motion_m, found.rotation_rad) == (0.0, 0.0)
    np.testing.assert_allclose(found.fov_rad, np.pi / 3)
    np.testing.assert_allclose(found.body_from_camera.translation, [2.0, 0.0, 0.5], atol=1e-9)
    np.testing.assert_allclose(found.body_from_camera.rotation.apply([0.0, 0.0, 1.0]), [1.0, 0.0, 0.0], atol=1e-9)


def move_ahead(steps_m):
    """Answers of a vehicle that moves so far north between two questions, its camera 1.5 m ahead of it."""
    place = iter(np.cumsum(steps_m))
    return {
        "simGetVehiclePose": lambda *_params: pose((next(place), 0, 0)),
        "simGetCameraInfo": lambda *_params: {"pose": pose((next(place) + 1.5, 0, 0)), "fov": 90.0},
    }


def test_of_a_moving_vehicle_the_calmest_measurement_counts_half_way():
    found, calls = measure(**move_ahead([0.4] * 6 + [0.1] * 3 + [0.4] * 90))
    assert calls == 60
    np.testing.assert_allclose(found.motion_m, 0.2)
    np.testing.assert_allclose(found.body_from_camera.translation, [1.5, 0.0, 0.0], atol=1e-9)


def test_only_a_sharp_enough_part_of_a_new_measurement_is_taken():
    before = camera_mount([1.0, 0.0, 0.0])
    after = camera_mount([1.2, 0.0, 0.0], attitude(0.0, -0.3, 0.0))
    still = update_mount(before, MountMeasurement(after, 1.0, 0.0, 0.0))
    np.testing.assert_allclose(still.as_matrix(), after.as_matrix(), atol=1e-12)
    fast = update_mount(before, MountMeasurement(after, 1.0, 0.3, 0.0))
    np.testing.assert_allclose(fast.translation, [1.0, 0.0, 0.0])
    assert (fast.rotation.inv() * after.rotation).magnitude() < 1e-12
    turning = update_mount(before, MountMeasurement(after, 1.0, 0.3, 0.01))
    np.testing.assert_allclose(turning.as_matrix(), before.as_matrix())


def live(server, vehicle="", **options):
    """A source as fast as the server answers, and its log."""
    log = []
    address = f"airsim://127.0.0.1:{server.port}/{vehicle}"
    return AirSimSource(address, **({"rate_hz": 1000.0, "log": log.append} | options)), log


def number_images():
    """simGetImages whose pictures come one second after each other, from 0."""
    count = iter(range(1000))

    def images(*_params):
        stamp = next(count) * 1_000_000_000
        return [response(0, time_stamp=stamp), response(1, time_stamp=stamp)]

    return images


def test_frames_come_until_the_source_is_stopped():
    with StandIn(simGetImages=number_images()) as server:
        source, log = live(server, camera="front", vehicle="Drone1", deck_z_m=-18.0, sea_z_m=2.0)
        assert source.length is None
        assert source.name == f"airsim://127.0.0.1:{server.port}/Drone1 camera front"
        frames = []
        for frame in source:
            frames.append(frame)
            if len(frames) == 5:
                source.stop()
        asked = {method: params for method, params in server.calls}
    assert [frame.time_s for frame in frames] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert len({frame.file for frame in frames}) == 5
    assert all((frame.deck_z_m, frame.sea_z_m) == (-18.0, 2.0) for frame in frames)
    assert asked["simGetCameraInfo"] == ["front", "Drone1"]
    assert asked["simGetVehiclePose"] == ["Drone1"]
    assert log == []


def test_a_broken_frame_is_passed_on_as_such_and_the_next_is_asked_for():
    good, bad = [response(0), response(1)], [response(0, image_data_uint8=BGR.tobytes()[:5]), response(1)]
    answers = iter([good, bad, [], good])
    with StandIn(simGetImages=lambda *_params: next(answers)) as server:
        source, _ = live(server)
        items = list(islice(source.items(), 4))
    assert [type(item) for item in items] == [Frame, BadFrame, BadFrame, Frame]
    assert "got 5 bytes" in items[1].reason
    assert items[1].file == "0#1700000000250000000"
    assert items[2].file == "0"


def test_live_frames_are_numbered_and_captured_when_they_arrive():
    with StandIn(simGetImages=number_images()) as server:
        source, _ = live(server)
        start_s = time.monotonic()
        captures = list(islice(source.captures(), 3))
    assert [taken.frame.file for taken in captures] == [f"frame_{number:08d}.png" for number in (1, 2, 3)]
    times_s = [start_s, *(taken.at_s for taken in captures), time.monotonic()]
    assert times_s == sorted(times_s)


def test_a_lost_simulator_is_waited_for_and_reported_once():
    with StandIn() as server:
        source, log = live(server)
        port = server.port
        frames = iter(source)
        assert isinstance(next(frames), Frame)
    timer = threading.Timer(0.6, lambda: revived.append(StandIn(port)))
    revived = []
    timer.start()
    assert isinstance(next(frames), Frame)
    frames.close()
    timer.join()
    with revived[0]:
        pass
    lost, _ = log
    assert f"127.0.0.1:{port}" in lost


def test_a_stop_ends_the_wait_for_a_simulator_and_for_the_next_frame():
    with StandIn() as server:
        source, _ = live(server)
        frames = iter(source)
        next(frames)
        slow, _ = live(server, rate_hz=0.001)
        waiting = iter(slow)
        next(waiting)
        timer = threading.Timer(0.1, slow.stop)
        timer.start()
        assert list(waiting) == []
        timer.join()
    timer = threading.Timer(0.3, source.stop)
    timer.start()
    assert list(frames) == []
    timer.join()


def test_nobody_there_or_no_such_camera_is_one_line_at_once():
    with StandIn() as server:
        port = server.port
    with pytest.raises(RecordingError, match=f"127.0.0.1:{port}"):
        AirSimSource(f"airsim://127.0.0.1:{port}")

    def unknown(*_params):
        raise ValueError("no camera 'left'")

    with StandIn(simGetCameraInfo=unknown) as server, pytest.raises(RecordingError, match="'left'"):
        AirSimSource(f"airsim://127.0.0.1:{server.port}", camera="left")
    with pytest.raises(RecordingError, match=r"rate.*0 and 1000.*0\.0"):
        AirSimSource("airsim://127.0.0.1:1", rate_hz=0.0)


def test_a_moving_vehicles_mount_is_noted_with_its_bound():
    with StandIn(**move_ahead([0.4] * 1000)) as server:
        source, _ = live(server)
    (note,) = source.notes
    assert "0.8 m" in note


def test_a_camera_that_turns_and_zooms_on_its_vehicle_is_followed():
    turn, fov = [(1.0, 0.0, 0.0, 0.0)], [90.0]

    def images(*_params):
        at = {"camera_orientation": pose(turn=turn[0])["orientation"]}
        return [response(0, **at), response(1, **at)]

    info = {"simGetCameraInfo": lambda *_params: {"pose": pose(turn=turn[0]), "fov": fov[0]}}
    with StandIn(simGetImages=images, **info) as server:
        frames = iter(live(server)[0])
        assert next(frames).camera.fx == pytest.approx(2.0)  # 4 px wide
        turn[0] = (HALF, 0.0, 0.0, HALF)  # the camera looks east, the vehicle still north
        fov[0] = 2 * np.degrees(np.arctan(0.5))
        frame = next(frames)
        frames.close()
    assert frame.camera.fx == pytest.approx(4.0)
    np.testing.assert_allclose(frame.world_from_body.rotation.apply([1.0, 0.0, 0.0]), [1.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(frame.world_from_camera.rotation.apply([0.0, 0.0, 1.0]), [0.0, 1.0, 0.0], atol=1e-9)


def test_the_wanted_rate_is_kept_and_missed_frames_are_not_made_up_for():
    pace = Pace(4.0)
    assert pace.next_wait(100.0) == 0.0
    assert pace.next_wait(100.1) == pytest.approx(0.15)
    assert pace.next_wait(100.25) == pytest.approx(0.25)
    assert pace.next_wait(102.0) == 0.0  # late by far ...
    assert pace.next_wait(102.0) == pytest.approx(0.25)  # ... and not three at once


def test_slow_frames_are_reported_once_with_the_reason():
    pace = Pace(5.0)
    lines = [pace.count_frame(0.5 * n - 0.4, 0.5 * n) for n in range(60)]
    (line,) = [line for line in lines if line]
    assert all(number in line for number in ("2 a second", "5", "0.4 s", "0.1 s"))
    assert [line for line in (pace.count_frame(100 + 0.2 * n - 0.1, 100 + 0.2 * n) for n in range(60)) if line] == []
    assert len([line for n in range(30) if (line := pace.count_frame(200.0 + n, 200.5 + n))]) == 1  # slow once more


def test_run_takes_frames_live_and_writes_whole_results(tmp_path, capsys):
    with StandIn(simGetImages=number_images()) as server:
        address = f"airsim://127.0.0.1:{server.port}"
        words = ["run", address, "--out", str(tmp_path), "--camera", "0", "--rate", "1000", "--max-frames", "3"]
        assert main([*words, "--dehazer", "none"]) == 0
        assert main([*words, "--resume"]) == 2
    records = [json.loads(line) for line in (tmp_path / "guidance.jsonl").read_text().splitlines()]
    assert [record["time_s"] for record in records] == [0.0, 1.0, 2.0]
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"dehazing.jsonl", "guidance.csv", "guidance.jsonl", "overlay.mp4", "report.html", "run.toml"}
    shown = capsys.readouterr()
    assert address in shown.err and "resume" in shown.err
    assert str(tmp_path / "report.html") in shown.out


def test_ctrl_c_ends_a_live_run_with_everything_whole_also_while_it_waits(tmp_path, capsys):
    images = number_images()
    asked = []

    def two_then_silence(*params):
        asked.append(1)
        if len(asked) == 3:
            threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
            silence.wait(20)
        return images(*params)

    silence = threading.Event()
    with StandIn(simGetImages=two_then_silence) as server:
        words = ["run", f"airsim://127.0.0.1:{server.port}", "--out", str(tmp_path), "--rate", "1000"]
        assert main([*words, "--dehazer", "none"]) == 0
        silence.set()
    assert len((tmp_path / "guidance.jsonl").read_text().splitlines()) == 2
    assert not (tmp_path / ".unfinished").exists()
    assert "2 frames" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["airsim:x"], ["airsim://127.0.0.1:1", "--poses", "p.csv"]])
def test_wrong_words_for_a_live_run_are_one_line(words, tmp_path, capsys):
    assert main(["run", *words, "--out", str(tmp_path)]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
