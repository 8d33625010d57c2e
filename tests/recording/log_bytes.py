"""Autopilot logs: ArduPilot's and PX4's written byte by byte from the formats' definitions, telemetry by pymavlink.

Source: ArduPilot, "Logging" (FMT messages); PX4, "ULog File Format".
"""

import struct
from pathlib import Path

HEAD = b"\xa3\x95"


def dataflash(path: Path, attitudes, positions) -> Path:
    """attitudes: time s, roll, pitch, yaw degrees; positions: time s, latitude, longitude degrees, altitude m."""

    def fmt(kind: int, length: int, name: str, types: str, columns: str) -> bytes:
        return HEAD + struct.pack("<BBB4s16s64s", 128, kind, length, name.encode(), types.encode(), columns.encode())

    text = fmt(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    text += fmt(129, 23, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw") + fmt(130, 23, "POS", "QLLf", "TimeUS,Lat,Lng,Alt")
    rows = [(t, HEAD + struct.pack("<BQfff", 129, round(t * 1e6), *angles)) for t, *angles in attitudes]
    for t, lat, lon, alt in positions:
        rows.append((t, HEAD + struct.pack("<BQiif", 130, round(t * 1e6), round(lat * 1e7), round(lon * 1e7), alt)))
    path.write_bytes(text + b"".join(row for _, row in sorted(rows, key=lambda row: row[0])))
    return path


def telemetry(path: Path, attitudes, positions) -> Path:
    """The same arguments; a second vehicle's attitudes are in the log too."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    one, other = mavlink.MAVLink(None, srcSystem=1), mavlink.MAVLink(None, srcSystem=2)
    rows = []
    for t, *angles in attitudes:
        roll, pitch, yaw = (angle * 3.141592653589793 / 180 for angle in angles)
        rows.append((t, one.attitude_encode(round(t * 1e3), roll, pitch, yaw, 0, 0, 0).pack(one)))
        rows.append((t, other.attitude_encode(round(t * 1e3), 1, 1, 1, 0, 0, 0).pack(other)))
    for t, lat, lon, alt in positions:
        values = (round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 0, 0, 0, 0, 0)
        rows.append((t, one.global_position_int_encode(round(t * 1e3), *values).pack(one)))
    rows.sort(key=lambda row: row[0])
    path.write_bytes(b"".join(struct.pack(">Q", round(1.7e15 + t * 1e6)) + packet for t, packet in rows))
    return path


def ulog(path: Path, attitudes, positions, local: bool = False) -> Path:
    """attitudes: time s and quaternion w, x, y, z; positions as above, or with `local` time s, x, y, z metres."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<Hc", len(body), kind) + body

    name, fields = "vehicle_global_position", "double lat;double lon;double alt;"
    if local:
        name, fields = "vehicle_local_position", "double x;double y;double z;"
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message(b"B", bytes(40))
    data += message(b"F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    data += message(b"F", f"{name}:uint64_t timestamp;{fields}".encode())
    data += message(b"A", struct.pack("<BH", 0, 0) + b"vehicle_attitude")
    data += message(b"A", struct.pack("<BH", 0, 1) + name.encode())
    data += b"".join(message(b"D", struct.pack("<HQ4f", 0, round(t * 1e6), *q)) for t, *q in attitudes)
    data += b"".join(message(b"D", struct.pack("<HQ3d", 1, round(t * 1e6), *at)) for t, *at in positions)
    path.write_bytes(data)
    return path
