"""An autopilot over the loopback that takes LANDING_TARGET by its firmware's rules; a wire that loses and swaps."""

import math
import socket
import threading
import time

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from approach_scene import frame

BOOT_S = time.monotonic() - 5000.0  # when it started, on the monotonic clock
FIRMWARES = {"px4": mavlink.MAV_AUTOPILOT_PX4, "ardupilot": mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA}


def boot_time_s() -> float:
    return time.monotonic() - BOOT_S


class Px4:
    """PX4-Autopilot src/modules/mavlink/mavlink_receiver.cpp, handle_message_landing_target, commit d96ba2d88a75; and
    src/modules/mavlink/mavlink_timesync.cpp, commit 023e61346713: its offset is (ts1 + now - 2 tc1) / 2."""

    def __init__(self):
        self.targets, self.errors, self.offset_us = [], [], None

    def take(self, message):
        if message.position_valid and message.frame == mavlink.MAV_FRAME_LOCAL_NED:
            now_us = round(1e6 * boot_time_s())
            stamp_us = now_us if self.offset_us is None else message.time_usec + self.offset_us
            self.targets.append((np.array([message.x, message.y, message.z]), now_us - stamp_us))
        else:
            self.errors.append(message)


class ArduPilot:
    """ArduPilot libraries/AC_PrecLand/AC_PrecLand_MAVLink.cpp, handle_msg, commit 2b30683d193f: it keeps a unit vector
    in the body's frame and a distance; and libraries/AP_RTC/JitterCorrection.cpp, commit 19351d4b5aeb."""

    def __init__(self):
        self.targets, self.errors, self.link_us = [], [], math.inf

    def take(self, message):
        sight = np.array([message.x, message.y, message.z])
        if message.position_valid == 1 and message.frame == mavlink.MAV_FRAME_BODY_FRD and message.distance > 0:
            now_us = round(1e6 * boot_time_s())
            self.link_us = min(self.link_us, now_us - message.time_usec)
            assert abs(np.linalg.norm(sight / message.distance) - 1.0) < 1e-6
            self.targets.append((sight, now_us - (message.time_usec + self.link_us)))
        else:
            self.errors.append(message)


class Autopilot:
    """Hovers where `frame(0, 120.0)` is. A context manager.

    Args:
        port: of the link.
        firmware: its name.
        lost: share of datagrams that are lost either way; as many are swapped with the next one.
        slow: positions at 4 Hz until it is asked for more after its first 1.2 s.
    """

    def __init__(self, port, firmware, system=7, lost=0.0, seed=0, slow=False):
        self.firmware, self.system = firmware, system
        self.receiver = {"px4": Px4, "ardupilot": ArduPilot}[firmware]()
        self.texts, self.heartbeats, self.beacons, self.commands, self.answers = [], [], [], [], 0
        self.slow, self._start_s = slow, time.monotonic()
        self._lost, self._rng, self._held = lost, np.random.default_rng(seed), None
        self._address, self._stopped = ("127.0.0.1", port), threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.002)
        self._mav = mavlink.MAVLink(self, system, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._stopped.set()
        self._thread.join()
        self._socket.close()

    def write(self, data):
        """Loses, holds back or sends a datagram."""
        chance = self._rng.random()
        if chance < self._lost:
            return
        if chance < 2 * self._lost and self._held is None:
            self._held = data
            return
        self._socket.sendto(data, self._address)
        if self._held is not None:
            self._socket.sendto(self._held, self._address)
            self._held = None

    def _run(self):
        parser, ticks = mavlink.MAVLink(None), 0
        while not self._stopped.is_set():
            if ticks % 25 == 0:
                self._mav.heartbeat_send(mavlink.MAV_TYPE_FIXED_WING, FIRMWARES[self.firmware], 0, 0, 4)
                self._mav.gps_global_origin_send(480000000, 110000000, 0)
            self._send_pose(with_position=not self.slow or ticks % 12 == 0)
            if ticks % 5 == 0:
                self._mav.timesync_send(0, round(1e9 * boot_time_s()))
            ticks, end_s = ticks + 1, time.monotonic() + 0.02
            while time.monotonic() < end_s:
                try:
                    data = self._socket.recv(65536)
                except OSError:
                    continue
                if self._rng.random() >= self._lost:
                    for message in parser.parse_buffer(data) or []:
                        self._take(message)

    def _send_pose(self, with_position):
        at, time_ms = frame(0, 120.0).world_from_body, round(1e3 * boot_time_s())
        w, x, y, z = at.rotation.as_quat(scalar_first=True)
        self._mav.attitude_quaternion_send(time_ms, w, x, y, z, 0, 0, 0)
        if with_position:
            self._mav.local_position_ned_send(time_ms + 3, *at.translation, 0, 0, 0)

    def _take(self, message):
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.heartbeats.append((message, message.get_srcSystem(), message.get_srcComponent(), time.monotonic()))
        elif kind == "TIMESYNC" and message.tc1 == 0:
            self._mav.timesync_send(round(1e9 * boot_time_s()), message.ts1)
        elif kind == "TIMESYNC":
            self.answers += 1
            now_us = 1e6 * boot_time_s()
            self.receiver.offset_us = round((message.ts1 / 1e3 + now_us - 2 * message.tc1 / 1e3) / 2)
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)
        elif kind == "GLOBAL_POSITION_INT":
            self.beacons.append(message)
        elif kind == "COMMAND_LONG":
            self.commands.append((int(message.param1), message.param2))
            if message.param1 == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED and time.monotonic() > self._start_s + 1.2:
                self.slow = False
        elif kind == "LANDING_TARGET":
            self.receiver.take(message)
