"""What may come over the air and from simulators, and is no picture, pose, message or call: left out or refused."""

import json
import struct

import pytest

from deckline.live.poses import parse_pose_line
from deckline.live.transport import PACKET, Demultiplexer, transport_packets

POSE = {"time_s": 1.0, "x_m": 0.0, "y_m": 0.0, "z_m": -3.0, "qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
TABLES, PICTURES = 0x100, 0x101  # packet identifiers


def packet(identifier: int, payload: bytes, begins: bool = True, field: bytes = b"", count: int = 0) -> bytes:
    """A transport packet, an adaptation field before its payload, and stuffing of 0xff behind it."""
    flags = 0x10 | 0x20 * bool(field) | count
    head = struct.pack(">BHB", 0x47, 0x4000 * begins | identifier, flags) + field
    return (head + payload).ljust(PACKET, b"\xff")[:PACKET]


def section(body: bytes, length: int | None = None) -> bytes:
    size = len(body) + 4 if length is None else length
    return b"\0\0" + struct.pack(">H", 0xB000 | size) + body + bytes(4)


ASSOCIATIONS = section(bytes(5) + struct.pack(">HH", 1, 0xE000 | TABLES))
PROGRAM = section(bytes(5) + struct.pack(">HHBHH", 0xE100, 0xF000, 0x1B, 0xE000 | PICTURES, 0xF000))
TUNED = packet(0, ASSOCIATIONS) + packet(TABLES, PROGRAM)
PES = b"\0\0\1\xe0\0\0\x80\x80\x05\x21\0\1\0\1"
DATAGRAMS = {
    "one byte": b"G",
    "a sync byte alone": b"G" + bytes(187),
    "half a packet": packet(0, ASSOCIATIONS)[:94],
    "no sync byte": bytes(PACKET),
    "a second packet without sync byte": packet(0, ASSOCIATIONS) + bytes(PACKET),
    "RTP without packets": b"\x80\x21" + bytes(10),
    "RTP with 15 sources and none there": b"\x8f\x21" + bytes(11),
    "RTP of another payload": b"\x80\x60" + bytes(10) + TUNED,
    "adaptation field beyond the packet": packet(0, b"", field=b"\xff" + bytes(10)),
    "adaptation field of all flags": packet(PICTURES, PES, field=b"\x07\xff"),
    "transport error": b"\x47\x80" + packet(0, ASSOCIATIONS)[2:],
    "pointer beyond the packet": packet(0, b"\xff" + ASSOCIATIONS),
    "section longer than its packet": packet(0, section(bytes(9), 4095)),
    "section of no length": packet(0, section(bytes(9), 0)),
    "association of the network alone": packet(0, section(bytes(5) + struct.pack(">HH", 0, 0xE000 | TABLES))),
    "half an association": packet(0, section(bytes(7))),
    "program information beyond its table": packet(0, ASSOCIATIONS)
    + packet(TABLES, section(bytes(5) + struct.pack(">HH", 0xE100, 0xFFFF))),
    "stream information beyond its table": packet(0, ASSOCIATIONS)
    + packet(TABLES, section(bytes(5) + struct.pack(">HHBHH", 0xE100, 0xF000, 0x02, 0xE000, 0xFFFF))),
    "program of sound alone": packet(0, ASSOCIATIONS)
    + packet(TABLES, section(bytes(5) + struct.pack(">HHBHH", 0xE100, 0xF000, 0x0F, 0xE000 | PICTURES, 0xF000))),
    "pictures before their tables": packet(PICTURES, PES),
    "picture without a start code": TUNED + packet(PICTURES, bytes(40)),
    "picture whose header ends the packet": TUNED + packet(PICTURES, PES[:9], field=bytes([174]) + bytes(174)),
    "picture header beyond its packet": TUNED + packet(PICTURES, PES[:8] + b"\xff"),
    "picture that begins in its middle": TUNED + packet(PICTURES, bytes(40), begins=False),
    "tables that change on the way": TUNED + packet(0, section(bytes(5) + struct.pack(">HH", 1, 0xE000))) + TUNED,
    "a line of text": b"GET / HTTP/1.1\r\n\r\n",
    "65,000 bytes": 65_000 * b"G",
}
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


@pytest.mark.parametrize("name", DATAGRAMS)
def test_bad_datagrams_of_a_stream_give_no_picture(name):
    demultiplexer = Demultiplexer()
    assert not list(demultiplexer.feed(transport_packets(DATAGRAMS[name]), 0.0))
    follows = [packet(PICTURES, PES, count=count) for count in (4, 5, 6)]
    assert list(demultiplexer.feed(transport_packets(TUNED + b"".join(follows)), 0.0))


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
