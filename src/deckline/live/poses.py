"""Poses of the aircraft in flight.

A `PoseLookup` is any callable from a time to a pose, such as an autopilot's link.
"""

import json
import threading
import time
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import Navigation
from deckline.files import parse_plain
from deckline.geometry import pose
from deckline.live.clock import WallClock
from deckline.live.datagrams import POLL_S, Receiver
from deckline.live.tally import Log, Tally
from deckline.recording.pose_track import PoseTrack
from deckline.recording.poses import NUMBERS
from deckline.recording.source import check_number

PoseLookup = Callable[[float], RigidTransform | None]  # Unix time, s -> world_from_body; None: not known
CAPACITY = 4000  # poses: ten seconds at 400 a second
FUTURE_S = 0.1  # of a pose's or picture's time after its arrival, beyond which its clock is wrong
WAIT_S = 0.1  # for the pose after a picture, at most


class PoseBuffer:
    """The last poses of one clock, interpolated; one thread adds, another one reads.

    Args:
        max_gap_s: longest interval between two poses that is interpolated.
    """

    def __init__(self, max_gap_s: float) -> None:
        self._gap_s = max_gap_s
        self._poses: deque[tuple[float, RigidTransform]] = deque(maxlen=CAPACITY)  # ascending times
        self._changed = threading.Condition()

    def __len__(self) -> int:
        return len(self._poses)

    def add(self, time_s: float, world_from_body: RigidTransform, now_s: float = np.inf) -> None:
        """Append a pose; a clock that steps back by more than the longest gap begins a new track.

        A copy of a pose that is here already, as a redundant link delivers it, changes nothing.

        Args:
            now_s: the present by the poses' clock; infinite: not known.

        Raises:
            ValueError: another pose that is not later than the last one, or one from the future.
        """
        if time_s - now_s > FUTURE_S:
            hint = "set the clocks, or navigation.offset_s (--pose-offset-s)"
            raise ValueError(f"a pose from {time_s - now_s:.3f} s in the future: {hint}")
        with self._changed:
            back_s = self._poses[-1][0] - time_s if self._poses else -1.0
            if back_s > self._gap_s:
                self._poses.clear()
            elif back_s >= 0.0:
                if any(at_s == time_s and _is_same(held, world_from_body) for at_s, held in reversed(self._poses)):
                    return
                raise ValueError(f"a pose that is {back_s:.3f} s older than the one before")
            self._poses.append((time_s, world_from_body))
            self._changed.notify()

    def at(self, time_s: float, wait_s: float = WAIT_S) -> RigidTransform | None:
        """The pose at a time of the poses' clock; waits so long for the next pose, at most, while poses arrive."""
        with self._changed:
            if self._poses and time_s - self._gap_s <= self._poses[-1][0] < time_s:
                self._changed.wait_for(lambda: bool(self._poses) and self._poses[-1][0] >= time_s, wait_s)
            poses = list(self._poses)
        after = min(bisect_left(poses, time_s, key=lambda item: item[0]), len(poses) - 1)
        if after < 1:
            return None
        times, pair = zip(*poses[after - 1 : after + 1], strict=True)
        positions = np.array([one.translation for one in pair])
        rotations = Rotation.concatenate([one.rotation for one in pair])
        return PoseTrack("", np.array(times), positions, rotations, self._gap_s, 0.0).at(time_s)


def _is_same(first: RigidTransform, second: RigidTransform) -> bool:
    return np.array_equal(first.as_matrix(), second.as_matrix())


class UdpPoses:
    """A `PoseLookup`: JSON lines over UDP, interpolated as the poses of a recording are; a context manager.

    A line is an object with the keys of poses.csv: time_s (Unix time), x_m, y_m, z_m, qw, qx, qy, qz. Poses from the
    future, of a second sender, or not later than the last one are refused, copies ignored; a clock that steps back by
    more than the longest gap begins a new track. One thread may call it.

    Args:
        address: udp://HOST:PORT that receives them.
        navigation: offset of the poses' clock, and the longest gap.
        wall: this machine's Unix time.
        log: receives a line about poses that are refused, at most every `REPORT_EVERY_S`.

    Attributes:
        refused: lines that were refused.

    Raises:
        ValueError: a wrong address.
        RecordingError: the address cannot be opened.
    """

    def __init__(self, address: str, navigation: Navigation, wall: WallClock, log: Log) -> None:
        self.refused = Tally("poses refused", log)
        self._navigation = navigation
        self._wall = wall
        self._poses = PoseBuffer(navigation.max_gap_s)
        self._stopped = threading.Event()
        self._receiver = Receiver(address, self._stopped, log)
        self._thread = threading.Thread(target=self._listen, name="poses", daemon=True)
        self._thread.start()

    def __call__(self, time_s: float) -> RigidTransform | None:
        """world_from_body at a Unix time; waits up to `WAIT_S` for the next pose while poses arrive."""
        return self._poses.at(time_s + (self._navigation.offset_s or 0.0))

    def add(self, line: str, arrival_s: float) -> None:
        """Use a line that arrived at a Unix time; refuse one that is no pose."""
        try:
            time_s, world_from_body = parse_pose_line(line)
            self._poses.add(time_s, world_from_body, arrival_s + (self._navigation.offset_s or 0.0))
        except ValueError as error:
            self.refused.add(str(error))

    def close(self) -> None:
        self._stopped.set()
        self._thread.join()
        self._receiver.close()
        self.refused.close()

    def _listen(self) -> None:
        while not self._stopped.is_set():
            received = self._receiver.receive(POLL_S)
            if received is not None:
                arrival_s = self._wall.at(time.monotonic())
                for line in received[0].decode(errors="replace").splitlines():
                    self.add(line, arrival_s)


def parse_pose_line(line: str) -> tuple[float, RigidTransform]:
    """Time, s, and world_from_body of a JSON line; a ValueError for one that is no pose."""
    try:
        values: Any = parse_plain(json.loads, line)
    except ValueError as error:
        raise ValueError(f"a line of the poses is not JSON: {error}") from None
    if not isinstance(values, Mapping):
        raise ValueError(f"a pose must be a JSON object with {', '.join(NUMBERS)}")
    numbers = [check_number(values.get(name), name) for name in NUMBERS]
    return numbers[0], pose(numbers[1:4], numbers[4:])
