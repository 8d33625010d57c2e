"""What to do about a status, a flag or a reason, for the person who flies and for the one who reads a run's end."""

from deckline.guide.deviations import NOT_FRESH
from deckline.report.records import Record
from deckline.types import Reason, Status

TO_DO = {
    Status.UNVERIFIED: "compare with other instruments",
    Status.ONE_LINE: "compare with other instruments; be ready to go around",
    Status.COASTING: "be ready to go around",
    Status.STALE: "go around; check camera and link",
    Status.NOT_SEEN: "fly by other instruments",
}
CHECK = {
    Reason.BORESIGHT: "how the camera is mounted",
    Reason.HEIGHT: "the deck height",
    Reason.DEPTH: "the depth camera's scale",
    Reason.FOCAL: "the calibration",
    Reason.DELAY: "the clocks (--pose-offset-s)",
    Reason.LEFT: "whether the left line is the runway's edge",
    Reason.RIGHT: "whether the right line is the runway's edge",
    Reason.SPACING: "the runway's width, or whether these are its edges",
    Reason.ANGLE: "whether these lines are the runway's edges",
    Reason.DRIFT: "whether the camera turned in its mount",
    Reason.RESIDUALS: "the stated accuracies (--grade)",
    Reason.SWAPPED: "whether this is the right end of the runway",
    Reason.OTHER_LINES: "which runway is meant",
    Reason.PAINT: "whether these lines are the runway's edges",
    Reason.ATTITUDE: "how the camera is mounted, and the attitude of the poses",
    Reason.DECK_SIGN: "the sign of --deck-z-m (z is down)",
    Reason.RESUMED: "nothing: the track is new",
}
OTHERWISE = "do not follow the numbers until the cause is found"
REMEDIES = {
    **dict.fromkeys(NOT_FRESH, TO_DO[Status.STALE]),
    Reason.NO_SCALE: "state --runway-width-m, or use a depth camera",
    Reason.YAW: "state --ship-velocity-m-s NORTH EAST (0 0 on land), or integrity.mount_yaw_deg of a checked mounting",
    Reason.YOUNG_TRACK: "take more frames of the flight, without --no-track",
    Reason.NO_WIDTH: "state --runway-width-m: metres in place of runway widths",
    Reason.NO_HORIZON: "keep the horizon in the picture, or give poses (--poses)",
    Reason.NO_VANISHING_POINT: "show more of the lines: fly lower or nearer; or give poses (--poses)",
    Reason.ASSUMED_CAMERA: "state --fov-deg, or give --camera FILE",
    Reason.UNLIKELY_ERRORS: "state how accurate the sensors are (--grade)",
}


def advise(record: Record) -> list[Record]:
    """What a record calls for, most urgent first: `words`, and `do`, what to do about them.

    That it is stale; else its flags; without one the reason of a status that is not ok.
    """
    flags = record["flags"]
    late = [flag["reason"] for flag in flags if flag["name"] in NOT_FRESH]
    status = Status.STALE if late else Status(record["status"])
    if status is Status.STALE or not flags:
        do = TO_DO.get(status)
        return [] if do is None else [{"words": "; ".join(late) or record["reason"] or str(status), "do": do}]
    return [{"words": flag["reason"], "do": remedy_of(Reason(flag["name"])) or OTHERWISE} for flag in flags]


def remedy_of(reason: Reason) -> str:
    """What ends a reason that lasts, for the terminal; empty: nothing that a user states."""
    if reason in CHECK:
        return f"check {CHECK[reason]}"
    return REMEDIES.get(reason, "")
