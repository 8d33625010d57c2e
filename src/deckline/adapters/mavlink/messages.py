"""A live record as MAVLink messages.

Source: PX4-Autopilot, src/modules/mavlink/mavlink_receiver.cpp, handle_message_landing_target (d96ba2d88a75): a valid
position is used in MAV_FRAME_LOCAL_NED alone, as an absolute one. ArduPilot,
libraries/AC_PrecLand/AC_PrecLand_MAVLink.cpp (2b30683d193f): a position is used in MAV_FRAME_BODY_FRD
alone, divided by a distance that must be its length.

A pose of the picture has no place in LOCAL_NED: ArduPilot gets its target in the body's frame, PX4 gets none. Without a
stated width guidance is never `ok`, so an angle alone is never sent: it would steer by a scale that nobody knows.
"""

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from deckline.recording.geodesy import geodetic_from_ned
from deckline.report.records import Record
from deckline.types import Status

Origin = tuple[float, float, float]  # latitude, longitude, degrees, altitude, m
PX4 = "px4"
FIRMWARES = {PX4: mavlink.MAV_AUTOPILOT_PX4, "ardupilot": mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA}
TEXT_LENGTH = 50  # bytes of a STATUSTEXT
LONGEST_AGE_S = 99  # a text states no longer silence
SEVERITIES = {
    Status.OK: mavlink.MAV_SEVERITY_INFO,
    Status.UNVERIFIED: mavlink.MAV_SEVERITY_NOTICE,
    Status.ONE_LINE: mavlink.MAV_SEVERITY_NOTICE,
}


def touchdown_of(record: Record, firmware: str) -> Record | None:
    """The touchdown point of a record whose guidance is `ok`, in the frame that the firmware takes; None without it."""
    touchdown: Record | None = record["live"]["touchdown"] if record["status"] == Status.OK else None
    if touchdown is None or (firmware == PX4 and touchdown["world_m"] is None):
        return None
    return touchdown


def landing_target(record: Record, firmware: str) -> Any:
    """LANDING_TARGET at a record's time of sending, in the clock that answers TIMESYNC; None: nothing to send."""
    touchdown = touchdown_of(record, firmware)
    if touchdown is None:
        return None
    is_px4, body = firmware == PX4, touchdown["body_m"]
    x, y, z = touchdown["world_m"] if is_px4 else body
    return mavlink.MAVLink_landing_target_message(
        time_usec=round(1e6 * record["live"]["sent_s"]),
        target_num=0,
        frame=mavlink.MAV_FRAME_LOCAL_NED if is_px4 else mavlink.MAV_FRAME_BODY_FRD,
        angle_x=0.0,
        angle_y=0.0,
        distance=math.hypot(*body),
        size_x=0.0,
        size_y=0.0,
        x=x,
        y=y,
        z=z,
        type=mavlink.LANDING_TARGET_TYPE_VISION_OTHER,
        position_valid=1,
    )


def ship_beacon(record: Record, origin: Origin) -> Any:
    """GLOBAL_POSITION_INT of the touchdown point, heading along the landing; None: nothing to send.

    Args:
        origin: of the world, North-East-Down.
    """
    touchdown = touchdown_of(record, PX4)  # in the world, as the beacon is
    if touchdown is None or touchdown["velocity_m_s"] is None:
        return None
    latitude, longitude, altitude = geodetic_from_ned(np.array(touchdown["world_m"]), origin)
    return mavlink.MAVLink_global_position_int_message(
        round(1e3 * record["live"]["sent_s"]) % 2**32,
        round(1e7 * latitude),
        round(1e7 * longitude),
        round(1e3 * altitude),
        round(-1e3 * touchdown["world_m"][2]),
        *(max(min(round(100 * speed), 32767), -32767) for speed in touchdown["velocity_m_s"]),
        round(100 * touchdown["azimuth_deg"]) % 36000,
    )


def describe(record: Record, firmware: str) -> str:
    """Text of STATUSTEXT: the status, with its flags or else its reasons, or why `ok` has no target."""
    status, flags = record["status"], [flag["name"] for flag in record["flags"]]
    if status == Status.OK:
        if touchdown_of(record, firmware) is not None:
            return "ok"
        return "ok: pose of the picture, no target" if record["live"]["touchdown"] else "ok: no touchdown point"
    names = dict.fromkeys(flags or (reason for reason in record["reasons"] if reason != status))
    return f"{status}: {', '.join(names)}" if names and list(names) != [status] else str(status)


def shorten(text: str, length: int) -> str:
    """Text with as many of its comma-separated names as `length` characters hold, and how many names are left out."""
    names = text.split(", ")
    for left_out in range(len(names)):
        short = ", ".join(names[: len(names) - left_out]) + (f" +{left_out}" if left_out else "")
        if len(short) <= length:
            break
    return short


def status_text(record: Record, silent_s: float | None, firmware: str) -> Any:
    """STATUSTEXT of a record, whole words within `TEXT_LENGTH`.

    Args:
        silent_s: since the last LANDING_TARGET; None: there was none.
    """
    age = ""
    if silent_s is not None and touchdown_of(record, firmware) is None:
        age = f" {silent_s:.1f} s" if silent_s < LONGEST_AGE_S else f" >{LONGEST_AGE_S} s"
    text = shorten(f"deckline {describe(record, firmware)}", TEXT_LENGTH - len(age)) + age
    warning = mavlink.MAV_SEVERITY_WARNING
    severity = warning if record["flags"] else SEVERITIES.get(record["status"], warning)
    return mavlink.MAVLink_statustext_message(severity, text.encode("ascii"))
