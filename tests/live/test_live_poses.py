"""Poses over UDP: interpolated, and none rather than a wrong one."""

import json
import socket
import time
from contextlib import closing

import numpy as np
import pytest
from loopback import free_port, pose_line, wait_until

from deckline.config import Navigation
from deckline.live.clock import WallClock
from deckline.live.poses import UdpPoses, parse_pose_line

T = 1000.0
POSE = {"time_s": 1.0, "x_m": 0.0, "y_m": 0.0, "z_m": -3.0, "qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
LINES = {
    "nothing": "",
    "text": "pose",
    "half an object": json.dumps(POSE)[:40],
    "a list": "[1, 2, 3]",
    "a number": "7",
    "null": "null",
    "brackets without end": 50_000 * "[",
    "a number of 5000 digits": json.dumps(POSE).replace("1.0", 5000 * "1", 1),
    "a number of 400 digits": json.dumps(POSE).replace("1.0", 400 * "1", 1),
    "infinite time": json.dumps(POSE | {"time_s": float("inf")}),
    "no number of time": json.dumps(POSE | {"time_s": float("nan")}),
    "time of text": json.dumps(POSE | {"time_s": "1.0"}),
    "a true position": json.dumps(POSE | {"x_m": True}),
    "a position of a list": json.dumps(POSE | {"z_m": [1]}),
    "no position": json.dumps({name: value for name, value in POSE.items() if name != "y_m"}),
    "infinite position": json.dumps(POSE | {"y_m": float("-inf")}),
    "a position as far as numbers go": json.dumps(POSE | {"y_m": 1e300}),
    "a quaternion of zeros": json.dumps(POSE | {"qw": 0.0}),
    "a quaternion of length 2": json.dumps(POSE | {"qx": 3.0**0.5}),
    "a quaternion beyond numbers": json.dumps(POSE | {"qw": 1e308, "qx": 1e308}),
    "a line of replaced bytes": b"\xff\xfe{}".decode(errors="replace"),
}


@pytest.fixture
def poses():
    with closing(UdpPoses(f"udp://127.0.0.1:{free_port()}", Navigation(), WallClock(), print)) as opened:
        yield opened


def line(time_s, x_m, yaw_rad=0.0):
    values = {"time_s": time_s, "x_m": x_m, "y_m": 2.0, "z_m": -30.0, "qx": 0.0, "qy": 0.0}
    return json.dumps(values | {"qw": np.cos(yaw_rad / 2), "qz": np.sin(yaw_rad / 2)})


def test_a_pose_lies_between_the_two_around_it(poses):
    for index in range(5):
        poses.add(line(T + 0.1 * index, 6.0 * index, 0.01 * index), T + 0.1 * index)
    found = poses(T + 0.25)
    np.testing.assert_allclose(found.translation, [15.0, 2.0, -30.0])
    assert found.rotation.as_euler("ZYX")[0] == pytest.approx(0.025)
    assert poses(T - 0.1) is None  # before the first
    assert poses(T + 0.5) is None  # after the last: nothing is extrapolated


def test_a_gap_has_no_pose(poses):
    for time_s in (T, T + 0.1, T + 0.7):
        poses.add(line(time_s, 0.0), time_s)
    assert poses(T + 0.05) is not None
    assert poses(T + 0.4) is None


LATE = [line(T + ahead_s, 1.0) for ahead_s in (5.0, 0.1, 0.05)]  # from the future, or not later than the last pose


@pytest.mark.parametrize("text", ["garbage", *LATE])
def test_what_is_no_pose_of_now_is_refused_and_changes_nothing(poses, text):
    for time_s in (T, T + 0.1):
        poses.add(line(time_s, 0.0), time_s)
    poses.add(text, T + 0.2)
    assert poses.refused.count == 1 and poses.refused.reason
    assert poses(T + 0.05) is not None
    assert poses(T + 0.2) is None


def test_copies_over_a_redundant_link_are_no_losses(poses):
    for index in range(5):
        poses.add(line(T + 0.1 * index, 6.0 * index), T + 0.1 * index)
        poses.add(line(T + 0.1 * max(index - 2, 0), 6.0 * max(index - 2, 0)), T + 0.1 * index)
    assert poses.refused.count == 0
    assert poses(T + 0.25).translation[0] == pytest.approx(15.0)
    poses.add(line(T + 0.2, 12.1), T + 0.4)  # the same time, another pose
    assert poses.refused.count == 1


def test_a_clock_that_jumps_back_begins_anew(poses):
    for time_s in (T, T + 0.1):
        poses.add(line(time_s, 0.0), time_s)
    for time_s in (T - 60.0, T - 59.9):
        poses.add(line(time_s, 5.0), T + 0.2)
    assert poses(T + 0.05) is None
    assert poses(T - 59.95).translation[0] == 5.0


def test_an_offset_moves_the_poses_clock():
    navigation = Navigation(offset_s=100.0)
    with closing(UdpPoses(f"udp://127.0.0.1:{free_port()}", navigation, WallClock(), print)) as poses:
        for time_s in (T, T + 0.1):
            poses.add(line(time_s, 10 * (time_s - T)), time_s - 100.0)
        assert poses.refused.count == 0
        assert poses(T - 100.0 + 0.05).translation[0] == pytest.approx(0.5)


def test_only_the_first_of_two_senders_is_heard_and_a_pose_to_come_is_waited_for():
    port = free_port()
    with (
        closing(UdpPoses(f"udp://127.0.0.1:{port}", Navigation(max_gap_s=30.0), WallClock(), print)) as poses,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
    ):
        start_s = time.time()
        first.sendto(pose_line(start_s).encode(), ("127.0.0.1", port))
        wait_until(lambda: poses._poses)
        second.sendto(pose_line(start_s + 0.001).encode(), ("127.0.0.1", port))
        wait_until(lambda: poses._receiver.foreign.count)
        assert len(poses._poses) == 1
        first.sendto(pose_line(start_s + 0.002).encode(), ("127.0.0.1", port))
        wait_until(lambda: poses(start_s + 0.001) is not None)


@pytest.mark.parametrize("name", LINES)
def test_bad_lines_are_no_pose(name):
    with pytest.raises(ValueError, match=r"\w"):
        parse_pose_line(LINES[name])
