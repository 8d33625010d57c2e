"""What flows through deckline. Shapes, units and frames stand beside each field; nobody writes into an input."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera, camera_mount

SIDES = ("left", "right")  # line 0 and line 1, seen in the landing direction


class Seen(StrEnum):
    """Which edge lines one picture shows."""

    BOTH = "both lines"
    ONE = "one line"
    NONE = "none"


class Status(StrEnum):
    """What guidance is worth."""

    OK = "ok"  # both lines in a fresh picture, no flag, and something besides the stated deck height confirms the scale
    UNVERIFIED = "unverified"  # both lines, but nothing confirms the scale, the track has doubts, or a flag is up
    ONE_LINE = "one line"  # one line is seen, or kept
    COASTING = "coasting"  # from earlier pictures alone
    STALE = "stale"  # the picture is not new
    NOT_SEEN = "not seen"  # no line is trustworthy


class Scale(StrEnum):
    """What confirms the scale of guidance besides the stated deck height."""

    DEPTH = "depth"  # of a depth camera, in this frame
    WIDTH = "width"  # stated, and in agreement with the track


class Reason(StrEnum):
    """Why something is missing, left out, not trusted or flagged; for code. A `Notice` carries the text for people."""

    # what a frame lacks
    NO_CAMERA = "no camera"
    NO_POSE = "no pose"
    NO_DEPTH = "no depth"  # fine mode was asked for
    NO_DECK_HEIGHT = "no deck height"
    NO_LINE = "no line"
    NO_POINTS = "no points"  # a line with too few points on the deck
    NO_CENTRE_LINE = "no centre line"
    NO_RAMP = "no ramp"
    NO_HEADING = "no heading"
    NOT_LOCALIZED = "not localized"
    NO_SCALE = "no scale"  # nothing confirms it
    YOUNG_TRACK = "young track"
    UNLIKELY_ERRORS = "unlikely errors"  # of sensors and paint, as the track estimates them
    # what contradicts itself in a frame
    CROSSED = "crossed"  # the left line lies right of the right one
    LINE_SPACING = "line spacing"
    LINE_ANGLE = "line angle"
    LINE_ENDS = "line ends"
    UNSURE = "unsure"  # of a line's direction
    CENTRE_LINE = "centre line"  # not midway between the edge lines
    DEPTH_HEIGHT = "depth and height"  # the depth camera against the reported deck height
    ABOVE_CAMERA = "above camera"  # the reported deck
    HORIZON = "horizon"  # a line along it
    # what a track cannot use
    BAD_TIME = "bad time"
    RESTARTED = "restarted"
    # flags, and measurements that are left out
    BORESIGHT = "boresight"
    HEIGHT = "height"
    DEPTH = "depth"
    FOCAL = "focal"
    DELAY = "delay"
    LEFT = "left"
    RIGHT = "right"
    SPACING = "spacing"
    ANGLE = "angle"
    DRIFT = "drift"
    RESIDUALS = "residuals"
    FROZEN = "frozen"
    SWAPPED = "swapped"
    RESUMED = "resumed"
    OTHER_LINES = "other lines"  # in a search of the whole picture, or in a new track than in the one before
    STALE = "stale"  # no frame, or an answer too late to be used
    PAINT = "paint"  # the picture shows no paint under a line, or a centre line elsewhere than midway
    ATTITUDE = "attitude"  # the horizon in the picture lies otherwise
    DECK_SIGN = "deck sign"  # the reported deck height seems to have the wrong sign


@dataclass(frozen=True)
class Notice:
    """A reason with its message."""

    reason: Reason  # for code
    message: str  # for people


Notices = tuple[Notice, ...]
NO_CAMERA = Notice(Reason.NO_CAMERA, "no camera: lines in pixels, no metres (give camera.toml)")
NO_POSE = Notice(Reason.NO_POSE, "no pose: give poses.csv with this time")


def message_of(notices: Notices) -> str:
    """The messages in one line, each once."""
    return "; ".join(dict.fromkeys(notice.message for notice in notices))


class EdgeKind(StrEnum):
    """What a runway's edge line was seen on."""

    PAINT = "paint"  # the middle of the painted edge marking
    PAVEMENT = "pavement"  # the edge of the surface, where no stripe is painted
    LIGHTS = "lights"  # the row of edge lights, at night


class DepthMode(StrEnum):
    """Where the distance of the line points came from."""

    FINE = "fine"  # depth camera
    COARSE = "coarse"  # ray and deck plane
    NONE = "none"  # neither was possible; the reason is carried beside it


@dataclass(frozen=True, eq=False)
class Segment:
    """A true line: the middle of one runway marking, world frame."""

    p0_m: NDArray[np.float64]  # (3,) its ramp end
    p1_m: NDArray[np.float64]  # (3,) its far end

    def __post_init__(self) -> None:
        _check(self, p0_m=(3,), p1_m=(3,))


@dataclass(frozen=True, eq=False)
class Truth:
    """What a simulator or a survey knows about a frame. The pipeline never reads it."""

    left: Segment | None = None  # None with right None: there is no runway in this scene
    right: Segment | None = None
    visibility_m: float | None = None  # 2 % contrast; inf is clear air
    airlight_rgb: tuple[float, float, float] | None = None  # 0..255
    clear_rgb: NDArray[np.uint8] | None = None  # (H, W, 3) the same view without haze
    world_from_body: RigidTransform | None = None  # where the aircraft is, if the frame's pose is a measured one
    world_from_ship: RigidTransform | None = None  # ship: x forward, y starboard, z down, origin on the deck's stern
    conditions: Mapping[str, Any] = field(default_factory=dict)  # plain values: what air, light and camera were like
    centre_painted: bool | None = None  # whether a line is painted midway between left and right; None: not known


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant of an approach."""

    file: str  # name of the image, or "<video>#<frame number>"
    time_s: float
    image_rgb: NDArray[np.uint8]  # (H, W, 3)
    camera: Camera
    body_from_camera: RigidTransform = field(default_factory=camera_mount)
    depth_m: NDArray[np.float32] | None = None  # (H, W) along the optical axis, NaN where unknown
    world_from_body: RigidTransform | None = None  # None where the camera is not known
    deck_z_m: float | None = None  # world z (down) of the deck plane, as the ship reports it
    sea_z_m: float | None = None  # world z (down) of the water
    truth: Truth | None = None

    def __post_init__(self) -> None:
        shape = (self.camera.height, self.camera.width)
        if self.image_rgb.dtype != np.uint8:
            raise ValueError(f"{self.file}: image must be uint8, got {self.image_rgb.dtype}")
        if self.image_rgb.shape != (*shape, 3):
            raise ValueError(
                f"{self.file}: the camera is {shape[1]}x{shape[0]} px but the image has shape {self.image_rgb.shape}"
            )
        if self.depth_m is not None and self.depth_m.shape != shape:
            raise ValueError(
                f"{self.file}: depth is {self.depth_m.shape[1]}x{self.depth_m.shape[0]} px "
                f"but the image is {shape[1]}x{shape[0]} px"
            )
        if self.world_from_body is not None and not self.camera.known:
            raise ValueError(f"{self.file}: a pose of a camera that is not known; give the camera, or no pose")

    @property
    def missing(self) -> Notice | None:
        """What it lacks to place lines in the world; None with camera and pose."""
        if not self.camera.known:
            return NO_CAMERA
        return NO_POSE if self.world_from_body is None else None

    @property
    def world_from_camera(self) -> RigidTransform | None:
        return None if self.world_from_body is None else self.world_from_body * self.body_from_camera

    @property
    def true_world_from_body(self) -> RigidTransform | None:
        """The aircraft's true pose where truth knows it, else the frame's."""
        known = None if self.truth is None else self.truth.world_from_body
        return self.world_from_body if known is None else known

    @property
    def true_world_from_camera(self) -> RigidTransform | None:
        return None if self.true_world_from_body is None else self.true_world_from_body * self.body_from_camera


@dataclass(frozen=True, eq=False)
class LinePoints:
    """Detected points on the middle of one runway line, near (large v) or far, in no promised order."""

    points_px: NDArray[np.float64]  # (N, 2) u, v in the full image; N may be 0
    confidence: NDArray[np.float64]  # (N,) in 0..1
    sigma_px: NDArray[np.float64]  # (N,) 1-sigma of u, px

    def __post_init__(self) -> None:
        n = len(self.points_px)
        _check(self, points_px=(n, 2), confidence=(n,), sigma_px=(n,))

    def __len__(self) -> int:
        return len(self.points_px)

    @classmethod
    def empty(cls) -> "LinePoints":
        return cls(np.zeros((0, 2)), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Detection:
    """Points of the lines in one image. A line that was not seen has no points."""

    left: LinePoints
    right: LinePoints
    region_px: tuple[float, float, float, float] | None = None  # u0, v0, u1, v1 of the part looked at closely
    centre: LinePoints = field(default_factory=lambda: LinePoints.empty())  # painted between them; few networks see it
    edge: EdgeKind | None = None  # what the edge lines are; None: not known


@dataclass(frozen=True, eq=False)
class PixelLine:
    """A straight line in the image: a u + b v + c = 0 with a^2 + b^2 = 1."""

    coefficients: NDArray[np.float64]  # (3,) a, b, c
    inliers: NDArray[np.bool_]  # (N,) which of the line's detected points it keeps
    ends_px: NDArray[np.float64]  # (2, 2) its nearest (largest v) and farthest inlier, moved onto the line
    sigma_px: float  # 1-sigma of an inlier normal to the line

    def __post_init__(self) -> None:
        _check(self, coefficients=(3,), ends_px=(2, 2))


@dataclass(frozen=True, eq=False)
class LineErrors:
    """Where a line's error comes from, as seen from the aircraft; rows as in `RunwayLine.covariance`, then the slopes.

    What frames have in common must not be averaged over them: a filter needs it apart from what is each frame's own.

    Columns of `effects`: the pose's attitude turned about world x and y, per rad; the deck reported too low, per m;
    focal length and depths too large, per share; the deck's z growing along the lines and to their right, per rad,
    about the middle between the lines' points.
    """

    slopes_rad: NDArray[np.float64]  # (2,) how the deck's z was found to grow along the lines and to their right
    # (5, M) what is new in every frame: columns are independent and of 1-sigma, the same ones for all lines of a frame
    own: NDArray[np.float64]
    effects: NDArray[np.float64]  # (5, 7) what each common error adds to offset, azimuth, z and slopes

    def __post_init__(self) -> None:
        _check(self, slopes_rad=(2,), own=(5, self.own.shape[-1]), effects=(5, 7))


@dataclass(frozen=True, eq=False)
class RunwayLine:
    """A horizontal line in the world: through `point_m`, along `azimuth_rad`.

    Equivalent to the paper's w0 + w1 x + w2 y = 0, z = w3.
    """

    point_m: NDArray[np.float64]  # (3,) world; on the line, in the middle of what was measured
    azimuth_rad: float  # direction of landing, from world x towards world y
    covariance: NDArray[np.float64]  # (3, 3) of [offset across the line to its right, m; azimuth, rad; z, m] at point_m
    # (3, 3) the same numbers seen from the aircraft: what an error of its own position and heading moves along with
    # the aircraft is taken out. None: not known, `covariance` bounds it.
    relative_covariance: NDArray[np.float64] | None = None
    errors: LineErrors | None = None  # what `relative_covariance` is made of; None: not known

    def __post_init__(self) -> None:
        _check(self, point_m=(3,), covariance=(3, 3))
        if self.relative_covariance is not None:
            _check(self, relative_covariance=(3, 3))

    @property
    def aircraft_covariance(self) -> NDArray[np.float64]:
        """(3, 3) as seen from the aircraft; `covariance`, which bounds it, where that is not known."""
        return self.covariance if self.relative_covariance is None else self.relative_covariance

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector (3,) along the line in the direction of landing."""
        return np.array([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad), 0.0])

    @property
    def slope(self) -> float:
        """k of y = k x + b (paper: -w1 / w2); infinite for a line along y."""
        return float(np.tan(self.azimuth_rad))

    @property
    def intercept_m(self) -> float:
        """b of y = k x + b (paper: -w0 / w2), metres."""
        return float(self.point_m[1] - self.slope * self.point_m[0])

    @property
    def height_m(self) -> float:
        """World z of the line (paper: w3), metres, down positive."""
        return float(self.point_m[2])


@dataclass(frozen=True, eq=False)
class RunwayPrior:
    """Where the runway is believed to be before looking, world frame, and how wrong that may be."""

    left_m: NDArray[np.float64]  # (2, 3) near and far end of the left line
    right_m: NDArray[np.float64]  # (2, 3) the same of the right line
    sigma_m: float  # 1-sigma of its position, on every axis, seen from the aircraft
    azimuth_sigma_rad: float  # 1-sigma of its direction, seen from the aircraft

    def __post_init__(self) -> None:
        _check(self, left_m=(2, 3), right_m=(2, 3))


@dataclass(frozen=True, eq=False)
class RunwayEstimate:
    """Where the lines are, from one frame."""

    seen: Seen
    mode: DepthMode
    pixel_lines: dict[str, PixelLine]  # "left" and "right", those that were seen
    lines: dict[str, RunwayLine]  # "left", "right", "centre", those that could be localized
    ramp_m: NDArray[np.float64] | None = None  # (3,) world: nearest visible end of the centre line
    ramp_sigma_m: float | None = None  # 1-sigma along the deck
    notices: Notices = ()  # why something is missing
    flags: Notices = ()  # what seems to be wrong with what the frame was told
    depth_agrees: bool = False  # in coarse mode: with the deck height, at 6 points of each line or more

    @property
    def reason(self) -> str:
        """Why something is missing, for people."""
        return message_of(self.notices)


@dataclass(frozen=True, eq=False)
class Value:
    """A measured number with its 1-sigma, in the same unit."""

    value: float
    sigma: float


class TrackState(StrEnum):
    """Whether the runway is followed over frames."""

    TRACKING = "tracking"
    COASTING = "coasting"  # no line now, but not for long
    LOST = "lost"


@dataclass(frozen=True)
class Protection:
    """Errors larger than these, without a flag, are as rare as `risk` says."""

    lateral_m: float  # of the lateral deviation
    vertical_m: float  # of the height above deck
    heading_rad: float | None  # of the heading error; None: the lines' drift, which shows a turned camera, is not known
    distance_m: float | None  # of the distance to the ramp; None: no ramp is known
    risk: float  # probability per frame and direction


@dataclass(frozen=True, eq=False)
class Track:
    """Where the lines are, from all frames so far."""

    time_s: float
    state: TrackState
    # "left", "right", "centre", world, as measured with the frame's pose, at the touchdown point; {} when lost
    lines: dict[str, RunwayLine]
    protection: Protection | None = None  # None when lost, or without a pose
    flags: Notices = ()  # what contradicts the track; empty: nothing is known to be wrong
    excluded: Notices = ()  # measurements of this frame that were left out: LEFT, RIGHT, HEIGHT
    ramp_m: NDArray[np.float64] | None = None  # (3,) world: nearest end of the centre line
    ramp_sigma_m: float | None = None  # 1-sigma along the deck
    lateral_rate_m_s: Value | None = None  # + : the lateral deviation grows to the right
    height_rate_m_s: Value | None = None  # + : the height above deck grows
    closing_m_s: Value | None = None  # + : the aircraft comes nearer to the ramp
    notices: Notices = ()  # why a frame was not used or the track began again
    age_s: float = 0.0  # since the track began; 0: it knows no more than this frame
    scale_from: tuple[Scale, ...] = ()  # what confirms the scale in all its frames
    doubts: Notices = ()  # what keeps it from being trusted though nothing is flagged


@dataclass(frozen=True, eq=False)
class Guidance:
    """Where the aircraft is relative to the centre line and the glideslope."""

    time_s: float
    status: Status
    mode: DepthMode
    lateral_deviation_m: Value | None = None  # + : aircraft is right of the centre line, looking along the landing
    heading_error_rad: Value | None = None  # + : nose points right of the centre line
    height_above_deck_m: Value | None = None  # + : above; over the touchdown point in a track, else over what was seen
    distance_to_ramp_m: Value | None = None  # + : the ramp is still ahead, along the centre line
    notices: Notices = ()  # why something is missing
    vertical_deviation_m: Value | None = None  # + : above the glideslope
    lateral_deviation_rad: Value | None = None  # + : right; angle at the aim point, as a localizer shows it
    vertical_deviation_rad: Value | None = None  # + : above; angle at the aim point
    distance_to_touchdown_m: Value | None = None  # + : the aim point is still ahead, along the centre line
    lateral_rate_m_s: Value | None = None  # + : the lateral deviation grows to the right
    height_rate_m_s: Value | None = None  # + : the height above deck grows; negative in a descent
    closing_m_s: Value | None = None  # + : the ramp comes nearer
    protection: Protection | None = None  # bounds on errors of lateral deviation and height above deck
    track: TrackState | None = None  # None: from this frame alone
    flags: Notices = ()  # what integrity found wrong; empty: nothing is known to be wrong
    glideslope_rad: float | None = None  # the wanted one
    scale_from: tuple[Scale, ...] = ()  # what confirms the scale

    @property
    def reason(self) -> str:
        """Why something is missing, for people."""
        return message_of(self.notices)


def _check(owner: Any, **shapes: tuple[int, ...]) -> None:
    for name, shape in shapes.items():
        if np.shape(getattr(owner, name)) != shape:
            raise ValueError(
                f"{type(owner).__name__}.{name} must have shape {shape}, got {np.shape(getattr(owner, name))}"
            )
