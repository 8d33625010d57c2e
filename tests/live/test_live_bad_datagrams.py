"""Lines and datagrams that are no pose and no MAVLink message: refused, or left out."""

import json

import pytest

from deckline.live.poses import parse_pose_line

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

BEAT = bytes.fromhex("fd0900000001010000000000000002030400")  # a HEARTBEAT without its checksum
MESSAGES = {
    "nothing": b"",
    "a mark of MAVLink 1": b"\xfe",
    "a mark of MAVLink 2": b"\xfd",
    "a head alone": BEAT[:10],
    "a head of 255 bytes and none there": b"\xfd\xff" + BEAT[2:10],
    "a wrong checksum": BEAT + b"\0\0\0",
    "a flag of a later version": BEAT[:2] + b"\xff" + BEAT[3:] + bytes(3),
    "a signature that is not there": BEAT[:2] + b"\x01" + BEAT[3:] + bytes(3),
    "a payload of nothing": b"\xfd\0" + BEAT[2:10] + bytes(2),
    "marks alone": 300 * b"\xfd",
    "marks of both versions": 150 * b"\xfd\xfe",
    "every byte": bytes(range(256)),
    "a line of text": b"HEARTBEAT\n",
    "65,000 bytes": 65_000 * b"\xfe",
}


@pytest.mark.parametrize("name", LINES)
def test_bad_lines_are_no_pose(name):
    with pytest.raises(ValueError, match=r"\w"):
        parse_pose_line(LINES[name])


def test_the_line_without_a_fault_is_a_pose():
    assert parse_pose_line(json.dumps(POSE))[0] == 1.0


@pytest.mark.parametrize("name", MESSAGES)
def test_bad_datagrams_of_an_autopilot_hold_no_message(name):
    link = pytest.importorskip("deckline.adapters.mavlink.link")
    assert link.parse_datagram(MESSAGES[name]) == []
