"""Poses from an autopilot's log: ArduPilot .bin and .tlog through pymavlink, PX4 .ulg through pyulog.

Times are seconds since the autopilot's start. Attitudes are body (forward-right-down) in North-East-Down; positions are
latitude, longitude and altitude, or without them the autopilot's own local North-East-Down frame.
Source: ArduPilot, "Onboard Message Log Messages" (ATT, POS, XKF1); MAVLink common messages; PX4, "uORB message
reference" (vehicle_attitude, vehicle_global_position, vehicle_local_position).
"""

import io
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.config import Navigation
from deckline.extras import needs_extra
from deckline.files import open_regular
from deckline.recording.pose_track import PoseTrack, join_tracks, make_track
from deckline.recording.poses import quaternions_from_angles
from deckline.recording.source import RecordingError

Array = NDArray[np.float64]
Wanted = Mapping[str, tuple[str, ...]]  # message -> fields


@dataclass(frozen=True)
class Message:
    """A message of a log: its time and three or four numbers."""

    name: str
    fields: tuple[str, ...]
    units: tuple[float, ...]  # of one count of each field: s, then rad, 1, deg or m
    geodetic: bool = False  # latitude, longitude, altitude; else North, East, Down


@dataclass(frozen=True, eq=False)
class LogFormat:
    """What a kind of log holds and how it is read."""

    magic: Callable[[bytes], bool]  # whether a file begins as such a log
    read: Callable[[Path, Wanted], dict[str, list[list[float]]]]
    attitude: Message
    positions: tuple[Message, ...]  # the first that is there


def _read_dataflash(path: Path, wanted: Wanted) -> dict[str, list[list[float]]]:
    with needs_extra("logs"):
        from pymavlink.DFReader import DFReader_binary

    class Reader(DFReader_binary):
        """One that leaves no bad log open, and does not read a message without bytes over and over."""

        def __init__(self, name: str) -> None:
            try:
                super().__init__(name)
            except Exception:
                self.filehandle.close()
                raise

        def _parse_next(self) -> Any:
            before = self.offset
            message = super()._parse_next()
            if message is not None and self.offset <= before:
                raise ValueError(f"a message without bytes at byte {before}")
            return message

    with closing(Reader(str(path))) as log:
        return _collect(log, wanted, lambda message: getattr(message, "C", 0))


def _read_telemetry(path: Path, wanted: Wanted) -> dict[str, list[list[float]]]:
    with needs_extra("logs"):
        from pymavlink.mavutil import mavlogfile
    with closing(mavlogfile(str(path), robust_parsing=True)) as log:
        return _collect(log, wanted, lambda message: message.get_srcSystem())


def _collect(log: Any, wanted: Wanted, sender: Callable[[Any], int]) -> dict[str, list[list[float]]]:
    """Fields of messages by name, of the estimator or vehicle that wrote the first one."""
    rows: dict[str, list[list[float]]] = {name: [] for name in wanted}
    first: dict[str, int] = {}
    while (message := log.recv_match(type=list(wanted))) is not None:
        name = message.get_type()
        if sender(message) == first.setdefault(name, sender(message)):
            rows[name].append([float(getattr(message, field)) for field in wanted[name]])
    return rows


class _WholeMessages(io.BufferedReader):
    """A file in which steps back from a read that met the end count from where that read should have ended.

    pyulog steps back so after a damaged message; from the end itself it would read the same messages for ever.
    """

    missing = 0  # bytes of the last read

    def read(self, size: int | None = -1) -> bytes:
        data = super().read(size)
        self.missing = max(0, (size or 0) - len(data))
        return data

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        missing, self.missing = self.missing, 0
        return super().seek(offset + (missing if whence == io.SEEK_CUR else 0), whence)


def _read_ulog(path: Path, wanted: Wanted) -> dict[str, list[list[float]]]:
    with needs_extra("logs"):
        from pyulog import ULog
    rows: dict[str, list[list[float]]] = {name: [] for name in wanted}
    with _WholeMessages(io.FileIO(path)) as file:
        parts = ULog(file, list(wanted)).data_list
    for part in parts:
        if part.multi_id == 0:
            rows[part.name] = np.column_stack([part.data[field] for field in wanted[part.name]]).astype(float).tolist()
    return rows


DEG = float(np.pi / 180)
ANGLES, MICRO, MILLI, METRES = ("Roll", "Pitch", "Yaw"), 1e-6, 1e-3, (1.0, 1.0, 1.0)
FORMATS = {
    ".bin": LogFormat(
        lambda head: head[:3] == b"\xa3\x95\x80",
        _read_dataflash,
        Message("ATT", ("TimeUS", "Roll", "Pitch", "Yaw"), (MICRO, DEG, DEG, DEG)),
        (
            Message("POS", ("TimeUS", "Lat", "Lng", "Alt"), (MICRO, *METRES), geodetic=True),
            Message("XKF1", ("TimeUS", "PN", "PE", "PD"), (MICRO, *METRES)),
        ),
    ),
    ".tlog": LogFormat(
        lambda head: len(head) > 8 and head[8] in (0xFD, 0xFE),
        _read_telemetry,
        Message("ATTITUDE", ("time_boot_ms", "roll", "pitch", "yaw"), (MILLI, *METRES)),
        (
            Message("GLOBAL_POSITION_INT", ("time_boot_ms", "lat", "lon", "alt"), (MILLI, 1e-7, 1e-7, 1e-3), True),
            Message("LOCAL_POSITION_NED", ("time_boot_ms", "x", "y", "z"), (MILLI, *METRES)),
        ),
    ),
    ".ulg": LogFormat(
        lambda head: head[:7] == b"ULog\x01\x12\x35",
        _read_ulog,
        Message("vehicle_attitude", ("timestamp", "q[0]", "q[1]", "q[2]", "q[3]"), (MICRO, 1.0, *METRES)),
        (
            Message("vehicle_global_position", ("timestamp", "lat", "lon", "alt"), (MICRO, *METRES), geodetic=True),
            Message("vehicle_local_position", ("timestamp", "x", "y", "z"), (MICRO, *METRES)),
        ),
    ),
}


def read_log_track(path: Path, navigation: Navigation) -> PoseTrack:
    """The track of an autopilot's log: attitude and position at the times of both, in the world of `place_in_world`.

    Raises:
        RecordingError: no `offset_s`, missing or damaged file, no attitude or position in it, or as `make_track`.
        ImportError: the extra `logs` is not installed.
    """
    log, own_clock = FORMATS[path.suffix.lower()], replace(navigation, offset_s=0.0)
    rows, notes = _read_rows(path, log)
    if navigation.offset_s is None:
        raise RecordingError(
            f"{path} counts seconds since the autopilot's start: give --pose-offset-s, its clock minus the pictures' "
            f"clock, s (0 where both are the same)"
        )
    position = next((message for message in log.positions if len(rows[message.name])), None)
    if position is None or not len(rows[log.attitude.name]):
        names = " or ".join(message.name for message in log.positions)
        raise RecordingError(f"{path}: a log needs {log.attitude.name} and {names}")
    turns, places = rows[log.attitude.name], rows[position.name]
    if position.geodetic:
        places[(places[:, 1:3] == 0.0).all(axis=1)] = np.nan  # what autopilots write without a fix
    quaternions = turns[:, 1:]
    if quaternions.shape[1] == 3:
        turns = turns[np.isfinite(turns).all(axis=1)]
        quaternions = quaternions_from_angles(turns[:, 1:])
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(places), 1))
    attitudes = make_track(f"{path}: {log.attitude.name}", turns[:, 0], turns[:, 1:4], quaternions, own_clock)
    positions = make_track(f"{path}: {position.name}", places[:, 0], places[:, 1:], level, own_clock)
    joined = join_tracks(attitudes, positions, position.geodetic, navigation)
    return replace(joined, name=str(path), notes=(*notes, *joined.notes))


@contextmanager
def _count_lines() -> Iterator[list[int]]:
    """Count the lines that parsers print on damaged messages, in Python and in C, and show none of them."""
    lines, (reader, writer), stderr = [0], os.pipe(), os.dup(2)
    os.dup2(writer, 2)

    def count() -> None:
        with os.fdopen(reader, "rb") as printed:
            lines[0] = sum(1 for _ in printed)

    thread = threading.Thread(target=count, daemon=True)
    thread.start()
    try:
        with os.fdopen(writer, "w", errors="replace") as stream, redirect_stdout(stream), redirect_stderr(stream):
            yield lines
    finally:
        os.dup2(stderr, 2)  # the last end of the pipe that is written to
        os.close(stderr)
        thread.join()


def _read_rows(path: Path, log: LogFormat) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Rows of time, s, and values of each message of a log, and a note on its damage."""
    messages = (log.attitude, *log.positions)
    try:
        with open_regular(path) as file:
            begins_well = log.magic(file.read(16))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    if not begins_well:
        raise RecordingError(f"{path}: not a {path.suffix} log: it begins with other bytes")
    try:
        with _count_lines() as printed:
            rows = log.read(path, {message.name: message.fields for message in messages})
        note = f"{path}: damaged: its parser printed {printed[0]:,} lines on what it left out"
        arrays = {m.name: np.reshape(rows[m.name], (-1, len(m.fields))) * m.units for m in messages}
        return arrays, (note,) if printed[0] else ()
    except ImportError:
        raise
    except Exception as error:  # the parsers raise what they like, Exception itself too
        raise RecordingError(f"{path}: damaged log: {' '.join(str(error).split()) or type(error).__name__}") from None
