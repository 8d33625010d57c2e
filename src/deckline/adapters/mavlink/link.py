"""An autopilot on a MAVLink link over UDP."""

import socket
import threading
import time
from collections import Counter
from contextlib import suppress
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.adapters.mavlink.messages import (
    FIRMWARES,
    Origin,
    describe,
    landing_target,
    ship_beacon,
    status_text,
)
from deckline.adapters.mavlink.timesync import ClockOffset
from deckline.config import Navigation
from deckline.geometry import pose
from deckline.live.clock import WallClock
from deckline.live.datagrams import LARGEST, parse_host_port
from deckline.live.poses import WAIT_S, PoseBuffer
from deckline.live.tally import Log, Tally
from deckline.recording import RecordingError
from deckline.recording.geodesy import ned_from_geodetic
from deckline.report.records import Record

POLL_S = 0.05
HEARTBEAT_S, TIMESYNC_S, BEACON_S = 1.0, 0.2, 0.2  # between two messages
TEXT_S, REPEAT_S = 0.5, 5.0  # between two STATUSTEXT: at least, and at most while no target is sent
LEAST_SHARE = 0.5  # of the wanted rate, below which a message is requested again
POSE_US, ORIGIN_US = 20_000, 1_000_000  # requested intervals of the autopilot's messages
COMPANION, BEACON_SYSTEM = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER, 100
ATTITUDE, LOCAL = mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
GLOBAL, ORIGIN = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN


class Link:
    """Sends guidance to the first autopilot of a firmware on the link, and is a `PoseLookup` of its poses.

    Only `ok` guidance is sent as LANDING_TARGET, and as a ship's beacon where the world's origin is known; every change
    of status or flags is a STATUSTEXT. Other systems, other firmwares, and data that are not MAVLink are ignored.

    Args:
        address: udp:HOST:PORT waits there for the autopilot and answers it; udpout:HOST:PORT sends there.
        firmware: a key of `FIRMWARES`.
        navigation: longest gap of the poses, correction of the clock's offset, and the world's origin: with one,
            positions come from GLOBAL_POSITION_INT, else from LOCAL_POSITION_NED.
        wall: this machine's Unix time.
        log: receives one line for each autopilot that is served or refused.
        takes_poses: whether poses are requested from the autopilot.
        log_losses: receives a line about refused poses, at most every `REPORT_EVERY_S`; None: `log` does.

    Attributes:
        sent: LANDING_TARGET messages.
        refused: poses that were not used.

    Raises:
        ValueError: a wrong address or an unknown firmware.
        RecordingError: the address cannot be opened.
    """

    def __init__(
        self,
        address: str,
        firmware: str,
        navigation: Navigation,
        wall: WallClock,
        log: Log,
        takes_poses: bool,
        log_losses: Log | None = None,
    ) -> None:
        if firmware not in FIRMWARES:
            raise ValueError(f"unknown autopilot {firmware!r}: use {' or '.join(FIRMWARES)}")
        self.sent, self.refused = 0, Tally("poses of the autopilot refused", log_losses or log)
        self._firmware, self._navigation, self._wall, self._log = firmware, navigation, wall, log
        self._needed = _needed_messages(navigation, takes_poses)
        self._socket, self._peer = _open_socket(address)
        self._lock = threading.Lock()  # of sending
        self._system: int | None = None  # the autopilot that is served
        self._refused_systems: set[tuple[int, int]] = set()  # system, autopilot: not served
        self._mav, self._ship = mavlink.MAVLink(self, 1, COMPANION), mavlink.MAVLink(self, BEACON_SYSTEM, 1)
        self._clock = ClockOffset()
        self._attitudes, self._positions = PoseBuffer(navigation.max_gap_s), PoseBuffer(navigation.max_gap_s)
        self._origin: Origin | None = navigation.origin
        self._counts: Counter[int] = Counter()  # messages of each kind since they were looked at
        self._counted_s = -np.inf
        self._heartbeat_s = self._timesync_s = self._target_s = self._beacon_s = self._text_s = -np.inf
        self._text = ""
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="mavlink", daemon=True)
        self._thread.start()

    def __call__(self, time_s: float) -> RigidTransform | None:
        """world_from_body at a Unix time; None before the first TIMESYNC answer, and where `PoseBuffer` has none."""
        offset_s = self._clock.offset_s
        if offset_s is None:
            return None
        wanted_s = time_s + offset_s + (self._navigation.offset_s or 0.0)
        end_s = time.monotonic() + WAIT_S
        attitude = self._attitudes.at(wanted_s)
        position = self._positions.at(wanted_s, max(end_s - time.monotonic(), 0.0))
        if attitude is None or position is None:
            return None
        return RigidTransform.from_components(position.translation, position.rotation * attitude.rotation)

    def send(self, record: Record) -> None:
        """Send a live record to the autopilot that is served, if there is one."""
        if self._system is None:
            return
        now_s, target = time.monotonic(), landing_target(record, self._firmware)
        silent_s = now_s - self._target_s
        if target is not None:
            self._send(target)
            self.sent, self._target_s = self.sent + 1, now_s
            origin = self._origin
            if origin is not None and now_s - self._beacon_s >= BEACON_S:
                self._beacon_s = now_s
                self._send(ship_beacon(record, origin), self._ship)
        text, quiet_s = describe(record, self._firmware), now_s - self._text_s
        if quiet_s >= (TEXT_S if text != self._text else REPEAT_S if target is None else np.inf):
            self._text, self._text_s = text, now_s
            self._send(status_text(record, silent_s if np.isfinite(silent_s) else None, self._firmware))

    def close(self) -> None:
        self._stopped.set()
        self._thread.join()
        self._socket.close()
        self.refused.close()

    def write(self, data: bytes) -> None:
        """Send one message as one datagram, for pymavlink; ignore a network that refuses it."""
        if self._peer is not None:
            with suppress(OSError):
                self._socket.sendto(data, self._peer)

    def _send(self, message: Any, mav: Any = None) -> None:
        if message is not None:
            with self._lock:
                (mav or self._mav).send(message)

    def _now_ns(self) -> int:
        return round(1e9 * self._wall.at(time.monotonic()))

    def _listen(self) -> None:
        while not self._stopped.is_set():
            try:
                data, sender = self._socket.recvfrom(LARGEST)
            except OSError:  # no datagram in time, or a sent one reached nobody
                data, sender = b"", ("", 0)
                self._stopped.wait(0.001)
            for message in parse_datagram(data):
                if message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
                    self._handle(message, sender)
            self._send_periodic(time.monotonic())

    def _send_periodic(self, now_s: float) -> None:
        """Heartbeat, requests of missing messages, and TIMESYNC."""
        if now_s - self._heartbeat_s >= HEARTBEAT_S:
            self._heartbeat_s = now_s
            kind, none = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID
            self._send(mavlink.MAVLink_heartbeat_message(kind, none, 0, 0, mavlink.MAV_STATE_ACTIVE, 3))
            for message, interval_us in self._slow_messages(now_s) if self._system is not None else ():
                command = (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message, interval_us, 0, 0, 0, 0, 0)
                self._send(mavlink.MAVLink_command_long_message(self._system, 1, *command))
        if self._system is not None and now_s - self._timesync_s >= TIMESYNC_S:
            self._timesync_s = now_s
            self._send(mavlink.MAVLink_timesync_message(0, self._clock.request(self._now_ns())))

    def _slow_messages(self, now_s: float) -> list[tuple[int, int]]:
        """Messages that came at less than half of the wanted rate since the last call -> their wanted interval, us."""
        passed_s = now_s - self._counted_s
        slow = [
            (kind, interval_us)
            for kind, interval_us in self._needed.items()
            if self._counts[kind] < LEAST_SHARE * 1e6 * passed_s / interval_us
        ]
        self._counted_s = now_s
        self._counts.clear()
        return slow

    def _handle(self, message: Any, sender: tuple[str, int]) -> None:
        """Use a message of an autopilot; of one that is not served, its heartbeat alone."""
        kind, system = message.get_msgId(), message.get_srcSystem()
        if kind == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self._choose_system(system, message.autopilot, sender)
        if system != self._system:
            return
        self._counts[kind] += 1
        if kind == mavlink.MAVLINK_MSG_ID_TIMESYNC and message.tc1 == 0:
            self._send(mavlink.MAVLink_timesync_message(self._now_ns(), message.ts1))
        elif kind == mavlink.MAVLINK_MSG_ID_TIMESYNC:
            self._clock.add_answer(message.tc1, message.ts1, self._now_ns())
        elif kind == ORIGIN and kind in self._needed:
            self._origin = (1e-7 * message.latitude, 1e-7 * message.longitude, 1e-3 * message.altitude)
        elif kind in self._needed:
            try:
                self._add_pose(kind, message)
            except ValueError as error:
                self.refused.add(str(error))

    def _choose_system(self, system: int, autopilot: int, sender: tuple[str, int]) -> None:
        """Serve the first system of the firmware that sends a heartbeat, from whatever address."""
        if autopilot != FIRMWARES[self._firmware] or self._system not in (None, system):
            if (system, autopilot) not in self._refused_systems:
                self._refused_systems.add((system, autopilot))
                wanted = self._firmware if self._system is None else f"system {self._system}"
                self._log(f"mavlink: system {system} (autopilot {autopilot}) is not served: {wanted} is")
            return
        self._peer = sender
        if self._system is None:
            self._mav.srcSystem = self._system = system
            self._ship.srcSystem = BEACON_SYSTEM + (system == BEACON_SYSTEM)
            self._log(f"mavlink: serving system {system}, {self._firmware} at {sender[0]}:{sender[1]}")

    def _add_pose(self, kind: int, message: Any) -> None:
        """Store an attitude or a position; the two are interpolated separately and joined in `__call__`."""
        time_s = 1e-3 * message.time_boot_ms
        if kind == ATTITUDE:
            turned = pose(np.zeros(3), [message.q1, message.q2, message.q3, message.q4])
            return self._attitudes.add(time_s, turned)
        if kind == LOCAL:
            return self._positions.add(time_s, pose([message.x, message.y, message.z], [1.0, 0.0, 0.0, 0.0]))
        origin = self._navigation.origin
        if origin is None or message.lat == message.lon == 0:
            raise ValueError("a position without an origin or a fix")
        geodetic = np.array([[1e-7 * message.lat, 1e-7 * message.lon, 1e-3 * message.alt]])
        positions, rotations = ned_from_geodetic(geodetic, Rotation.identity(1), origin)
        self._positions.add(time_s, RigidTransform.from_components(positions[0], rotations[0]))


def parse_datagram(data: bytes) -> list[Any]:
    """The MAVLink messages of a datagram; other bytes are ignored."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    messages = parser.parse_buffer(data) if data else None
    return [message for message in messages or () if message.get_type() != "BAD_DATA"]


def _needed_messages(navigation: Navigation, takes_poses: bool) -> dict[int, int]:
    """Messages to request from the autopilot -> their interval, microseconds."""
    if not takes_poses:
        return {}
    if navigation.origin is not None:
        return {ATTITUDE: POSE_US, GLOBAL: POSE_US}
    return {ATTITUDE: POSE_US, LOCAL: POSE_US, ORIGIN: ORIGIN_US}


def _open_socket(address: str) -> tuple[socket.socket, tuple[str, int] | None]:
    """A socket and its peer; None: the peer is the first autopilot on the link."""
    scheme, _, rest = address.partition(":")
    if scheme not in ("udp", "udpin", "udpout"):
        raise ValueError(f"{address}: expected udp:HOST:PORT or udpout:HOST:PORT, such as udp:0.0.0.0:14540")
    try:
        host, port = parse_host_port(f"udp://{rest.removeprefix('//')}")
    except ValueError:
        raise ValueError(f"{address}: expected {scheme}:HOST:PORT, such as {scheme}:127.0.0.1:14540") from None
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        peer = (socket.gethostbyname(host), port)
        if scheme != "udpout":
            opened.bind(peer)
    except OSError as error:
        opened.close()
        raise RecordingError(f"{address}: cannot be opened: {error.strerror or error}") from None
    opened.settimeout(POLL_S)
    return opened, peer if scheme == "udpout" else None
