"""What a line, an estimate and guidance are worth, and why something is missing or doubted."""

from dataclasses import dataclass
from enum import StrEnum


class LineVisibility(StrEnum):
    """Which edge lines one picture shows."""

    BOTH = "both lines"
    """Both edge lines are seen."""
    ONE = "one line"
    """One edge line is seen."""
    NONE = "none"
    """No edge line is seen."""


class Status(StrEnum):
    """What guidance is worth."""

    OK = "ok"
    """Both lines of a track in a fresh picture, no flag or doubt, and more than the stated deck height for scale."""
    UNVERIFIED = "unverified"
    """Both lines, but nothing confirms the scale, the track has doubts, or a flag is up."""
    ONE_LINE = "one line"
    """One line is seen, or one line passes the innovation gate."""
    COASTING = "coasting"
    """Predicted from earlier pictures; this one adds nothing."""
    STALE = "stale"
    """The picture is not new."""
    NOT_SEEN = "not seen"
    """No line is trustworthy, or the frame's time cannot be used."""


class Scale(StrEnum):
    """What confirms the scale of guidance besides the stated deck height."""

    DEPTH = "depth"
    """A depth camera, in this frame."""
    WIDTH = "width"
    """The stated runway width: it agrees with the track, or is the only scale of a picture without a pose."""


class PoseSource(StrEnum):
    """Where the aircraft's pose relative to the runway comes from."""

    NAVIGATION = "navigation"
    """The pose that the frame came with."""
    PICTURE = "picture"
    """The lines, the horizon and the camera alone: the world is then the runway's own frame."""


class Reason(StrEnum):
    """Why something is missing, left out, not trusted or flagged, for code; a `Diagnostic` has the text for people."""

    NO_CAMERA = "no camera"
    """The frame has no intrinsics."""
    NO_POSE = "no pose"
    """The frame has no pose."""
    NO_DEPTH = "no depth"
    """Fine mode was asked for, and the frame has no depth on the lines."""
    NO_DECK_HEIGHT = "no deck height"
    """The frame has no deck height, and no depth that replaces it."""
    NO_LINE = "no line"
    """The picture shows no line."""
    NO_VANISHING_POINT = "no vanishing point"
    """The lines do not meet in a point that gives the camera's direction."""
    NO_HORIZON = "no horizon"
    """Neither a horizon nor an attitude confirms the pose that the picture gives."""
    NO_WIDTH = "no width"
    """The picture alone gives runway widths, no metres: the width is not stated."""
    ASSUMED_CAMERA = "assumed camera"
    """The focal length is assumed or of EXIF, not stated."""
    NO_POINTS = "no points"
    """A line has too few points on the deck."""
    NO_CENTRE_LINE = "no centre line"
    """One edge line and no runway width give no centre line."""
    NO_RAMP = "no ramp"
    """The ramp is not in the picture."""
    NO_HEADING = "no heading"
    """The heading of the lines is not known."""
    NOT_LOCALIZED = "not localized"
    """Lines are seen but could not be placed in the world."""
    NO_SCALE = "no scale"
    """Nothing confirms the scale."""
    YOUNG_TRACK = "young track"
    """The track is too young to show contradictions."""
    UNLIKELY_ERRORS = "unlikely errors"
    """The estimated errors of sensors and paint are unlikely together."""
    CROSSED = "crossed"
    """The left line lies right of the right one."""
    LINE_SPACING = "line spacing"
    """The lines of one frame are too near or too far apart."""
    LINE_ANGLE = "line angle"
    """The lines of one frame are not nearly parallel."""
    LINE_ENDS = "line ends"
    """The near ends of the lines lie too far apart along the runway."""
    UNSURE = "unsure"
    """A line's direction is too uncertain."""
    CENTRE_LINE = "centre line"
    """The painted centre line is not midway between the edge lines."""
    DEPTH_HEIGHT = "depth and height"
    """The depth camera contradicts the reported deck height."""
    ABOVE_CAMERA = "above camera"
    """The reported deck lies above the camera."""
    HORIZON = "horizon"
    """A line lies along the horizon."""
    BAD_TIME = "bad time"
    """The frame's time is no number, or not after the time of the frame before."""
    RESTARTED = "restarted"
    """The track began anew."""
    BORESIGHT = "boresight"
    """The camera seems turned against its stated mounting."""
    HEIGHT = "height"
    """The deck's height contradicts the track, or seems wrong."""
    DEPTH = "depth"
    """Depths seem wrong."""
    FOCAL = "focal"
    """The focal length seems wrong."""
    DELAY = "delay"
    """The pose seems older or newer than the picture."""
    LEFT = "left"
    """The left line contradicts the track, or seems to be another marking."""
    RIGHT = "right"
    """The right line contradicts the track, or seems to be another marking."""
    SPACING = "spacing"
    """The lines' spacing is not what was stated."""
    ANGLE = "angle"
    """The angle between the lines is not what was stated."""
    DRIFT = "drift"
    """The lines move sideways as neither ship nor heading explain."""
    YAW = "yaw"
    """A camera that is turned in yaw, or a wrong principal point, would not show at this closing speed."""
    RESIDUALS = "residuals"
    """Residuals are too large for too long."""
    FROZEN = "frozen"
    """The camera shows the same picture while time goes on."""
    SWAPPED = "swapped"
    """Left and right are exchanged in the track."""
    RESUMED = "resumed"
    """The run was interrupted before this frame."""
    OTHER_LINES = "other lines"
    """A search of the whole picture, or a new track, has other lines than the track."""
    STALE = "stale"
    """There is no frame, or the answer came too late to be used."""
    PAINT = "paint"
    """The picture shows no paint under a line, or a centre line elsewhere than midway."""
    ATTITUDE = "attitude"
    """The horizon in the picture contradicts the attitude."""
    DECK_SIGN = "deck sign"
    """The reported deck height seems to have the wrong sign."""


@dataclass(frozen=True)
class Diagnostic:
    """A reason with its message."""

    reason: Reason
    """For code."""
    message: str
    """For people."""


Diagnostics = tuple[Diagnostic, ...]
CAMERA_REMEDY = "pass Camera(...), camera.toml beside the recording, or --fov-deg"
NO_CAMERA = Diagnostic(Reason.NO_CAMERA, f"camera not known: lines in pixels, no metres; {CAMERA_REMEDY}")
ASSUMED_CAMERA = Diagnostic(Reason.ASSUMED_CAMERA, f"the camera's focal length is assumed: {CAMERA_REMEDY}")
MAX_FOCAL_SIGMA = 0.02  # share; of a camera whose focal length counts as stated
NO_POSE = Diagnostic(Reason.NO_POSE, "pose not known: give --poses; in Python, world_from_body")


def focal_doubts(focal_sigma: float | None, assumed: float = MAX_FOCAL_SIGMA) -> Diagnostics:
    """That a camera's focal length is assumed, or less certain than protection levels assume.

    Args:
        focal_sigma: of the camera; None: as stated for the sensors.
        assumed: 1-sigma that the levels rest on, as a share.
    """
    stated = focal_sigma or 0.0
    if stated > MAX_FOCAL_SIGMA:
        return (ASSUMED_CAMERA,)
    if stated <= assumed:
        return ()
    message = f"the camera's focal length is known to {stated:.2%}, levels assume {assumed:.2%}: give --focal-sigma"
    return (Diagnostic(Reason.ASSUMED_CAMERA, message),)


def message_of(diagnostics: Diagnostics) -> str:
    """The messages in one line, each once."""
    return "; ".join(dict.fromkeys(diagnostic.message for diagnostic in diagnostics))
