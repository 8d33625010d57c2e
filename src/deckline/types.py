"""What flows through deckline. Shapes, units and frames are beside each field; nobody writes into an input."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera, camera_mount

SIDES = ("left", "right")  # line 0 and line 1, seen in the landing direction


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
    """Both lines in a fresh picture, no flag, and something besides the stated deck height confirms the scale."""
    UNVERIFIED = "unverified"
    """Both lines, but nothing confirms the scale, the track has doubts, or a flag is up."""
    ONE_LINE = "one line"
    """One line is seen, or one line passes the innovation gate."""
    COASTING = "coasting"
    """Predicted from earlier pictures; this one adds nothing."""
    STALE = "stale"
    """The picture is not new."""
    NOT_SEEN = "not seen"
    """No line is trustworthy."""


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
    """The frame's time is no number, or before the track's."""
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


def message_of(diagnostics: Diagnostics) -> str:
    """The messages in one line, each once."""
    return "; ".join(dict.fromkeys(diagnostic.message for diagnostic in diagnostics))


class EdgeKind(StrEnum):
    """What an edge line of a runway is."""

    PAINT = "paint"
    """The middle of the painted edge marking."""
    PAVEMENT = "pavement"
    """The edge of the surface, where no stripe is painted."""
    LIGHTS = "lights"
    """The row of edge lights, at night."""


class DepthMode(StrEnum):
    """Where the distance of the line points came from."""

    FINE = "fine"
    """From a depth camera."""
    COARSE = "coarse"
    """Where the ray meets the deck plane."""
    WIDTH = "width"
    """From how far apart the lines are in the picture, for a stated width or in widths."""
    NONE = "none"
    """None of these was possible; a `Diagnostic` has the reason."""


@dataclass(frozen=True, eq=False)
class Segment:
    """A true line: the middle of one runway marking, world frame."""

    p0_m: NDArray[np.float64]
    """(3,) its end at the ramp, world, m."""
    p1_m: NDArray[np.float64]
    """(3,) its far end, world, m."""

    def __post_init__(self) -> None:
        _check(self, p0_m=(3,), p1_m=(3,))


@dataclass(frozen=True, eq=False)
class Truth:
    """What a simulator or a survey knows about a frame. The pipeline never reads it."""

    left: Segment | None = None
    """The left edge line; None with `right` None: the scene has no runway."""
    right: Segment | None = None
    """The right edge line."""
    visibility_m: float | None = None
    """Range at which 2 % of a contrast is left, m; inf: clear air."""
    airlight_rgb: tuple[float, float, float] | None = None
    """Red, green, blue of the airlight, 0..255."""
    clear_rgb: NDArray[np.uint8] | None = None
    """(H, W, 3) RGB, the same view without haze."""
    world_from_body: RigidTransform | None = None
    """The aircraft's true pose, where the frame's is a measured one."""
    world_from_ship: RigidTransform | None = None
    """The ship's pose: x forward, y starboard, z down, origin at the stern end of the deck."""
    conditions: Mapping[str, Any] = field(default_factory=dict)
    """Plain values: air, light and camera of the scene."""
    centre_painted: bool | None = None
    """Whether a line is painted midway between left and right; None: not known."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant of an approach."""

    file: str
    """Name of the image, or `<video>#<frame number>`."""
    time_s: float
    """Time of exposure, on the source's clock, s."""
    image_rgb: NDArray[np.uint8]
    """(H, W, 3) RGB."""
    camera: Camera = None  # type: ignore[assignment]
    """Intrinsics of the picture. None becomes `Camera.unknown` of the image's size: lines in pixels, no metres."""
    body_from_camera: RigidTransform = field(default_factory=camera_mount)
    """The camera's mounting: optical frame to body (forward, right, down)."""
    depth_m: NDArray[np.float32] | None = None
    """(H, W) along the optical axis, m; NaN where unknown."""
    world_from_body: RigidTransform | None = None
    """Pose, North-East-Down; None: not known. Needs a known camera."""
    deck_z_m: float | None = None
    """World z (down) of the deck plane as the ship reports it, m; None: not known."""
    sea_z_m: float | None = None
    """World z (down) of the water, m; None: not known."""
    truth: Truth | None = None
    """What a simulator or survey knows; the chain never reads it."""
    level_from_body: Rotation | None = None
    """Roll and pitch of a sensor that knows no position; its heading is not used. For frames without a pose."""
    pose_source: PoseSource = PoseSource.NAVIGATION
    """Where `world_from_body` comes from; of the picture, the world is the runway's frame: x along the landing from the
    ramp, y to the right, z down from the deck."""
    in_widths: bool = False
    """Lengths of the world are runway widths, not metres: a picture's pose without a stated width."""

    def __post_init__(self) -> None:
        size, dtype = self.image_rgb.shape, self.image_rgb.dtype
        if dtype != np.uint8 or len(size) != 3 or size[2] != 3:
            raise ValueError(f"{self.file}: image_rgb must be (H, W, 3) of uint8, got {size} of {dtype}")
        if self.camera is None:
            object.__setattr__(self, "camera", Camera.unknown(size[1], size[0]))
        shape = (self.camera.height, self.camera.width)
        if size[:2] != shape:
            raise ValueError(
                f"{self.file}: the camera is {shape[1]}x{shape[0]} px but the image is {size[1]}x{size[0]} px"
            )
        if self.depth_m is not None and self.depth_m.shape != shape:
            raise ValueError(
                f"{self.file}: depth is {self.depth_m.shape[1]}x{self.depth_m.shape[0]} px "
                f"but the image is {shape[1]}x{shape[0]} px"
            )
        if self.world_from_body is not None and not self.camera.known:
            raise ValueError(f"{self.file}: world_from_body needs a known camera; {CAMERA_REMEDY}")

    @property
    def missing(self) -> Diagnostic | None:
        """What it lacks to place lines in the world; None with camera and pose."""
        if not self.camera.known:
            return NO_CAMERA
        return NO_POSE if self.world_from_body is None else None

    @cached_property
    def world_from_camera(self) -> RigidTransform | None:
        """Pose of the optical frame; None without a pose."""
        return None if self.world_from_body is None else self.world_from_body * self.body_from_camera

    @property
    def true_world_from_body(self) -> RigidTransform | None:
        """The aircraft's true pose in truth's world where truth knows it, else the frame's.

        A pose of the picture is none: its world is the runway's own frame.
        """
        known = None if self.truth is None else self.truth.world_from_body
        if known is None and self.pose_source is PoseSource.PICTURE:
            return None
        return self.world_from_body if known is None else known

    @property
    def true_world_from_camera(self) -> RigidTransform | None:
        return None if self.true_world_from_body is None else self.true_world_from_body * self.body_from_camera


@dataclass(frozen=True, eq=False)
class LinePoints:
    """Detected points on the middle of one runway line, near (large v) or far, in no promised order."""

    points_px: NDArray[np.float64]
    """(N, 2) u, v in the full image, px; N may be 0."""
    confidence: NDArray[np.float64]
    """(N,) of each point, 0..1."""
    sigma_px: NDArray[np.float64]
    """(N,) 1-sigma of u, px."""

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
    """Points of the left edge line."""
    right: LinePoints
    """Points of the right edge line."""
    region_px: tuple[float, float, float, float] | None = None
    """u0, v0, u1, v1 of the part that the network saw at full resolution, px."""
    centre: LinePoints = field(default_factory=lambda: LinePoints.empty())
    """Points of the painted centre line; only some networks detect it."""
    edge: EdgeKind | None = None
    """What the edge lines are; None: not known."""
    frames: int = 1
    """How many pictures were averaged for it, this frame's included."""


@dataclass(frozen=True, eq=False)
class PixelLine:
    """A straight line in the image: a u + b v + c = 0 with a^2 + b^2 = 1."""

    coefficients: NDArray[np.float64]
    """(3,) a, b, c, for u, v in px."""
    inliers: NDArray[np.bool_]
    """(N,) which of the detected points lie on it."""
    ends_px: NDArray[np.float64]
    """(2, 2) u, v, px, of its nearest (largest v) and farthest inlier, moved onto the line."""
    sigma_px: float
    """1-sigma of an inlier normal to the line, px."""

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

    slopes_rad: NDArray[np.float64]
    """(2,) slope of the deck's z along the lines and to their right, rad."""
    own: NDArray[np.float64]
    """(5, M) what is new in every frame: independent columns of 1-sigma, shared by all lines of a frame."""
    effects: NDArray[np.float64]
    """(5, 7) what a unit of each common error adds to offset, azimuth, z and slopes."""

    def __post_init__(self) -> None:
        _check(self, slopes_rad=(2,), own=(5, self.own.shape[-1]), effects=(5, 7))


@dataclass(frozen=True, eq=False)
class RunwayLine:
    """A horizontal line in the world: through `point_m`, along `azimuth_rad`.

    Equivalent to the paper's w0 + w1 x + w2 y = 0, z = w3.
    """

    point_m: NDArray[np.float64]
    """(3,) world, m; on the line, in the middle of what was measured."""
    azimuth_rad: float
    """Direction of landing, from world x towards world y, rad."""
    covariance: NDArray[np.float64]
    """(3, 3) of [offset across the line to its right, m; azimuth, rad; z, m] at point_m."""
    relative_covariance: NDArray[np.float64] | None = None
    """(3, 3) the same numbers seen from the aircraft: what an error of its own position and heading moves along with
    the aircraft is taken out. None: not known, `covariance` bounds it."""
    errors: LineErrors | None = None
    """The parts of `relative_covariance`; None: not known."""

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

    left_m: NDArray[np.float64]
    """(2, 3) near and far end of the left line, world, m."""
    right_m: NDArray[np.float64]
    """(2, 3) near and far end of the right line, world, m."""
    sigma_m: float
    """1-sigma of its position along each axis, seen from the aircraft, m."""
    azimuth_sigma_rad: float
    """1-sigma of its direction, seen from the aircraft, rad."""

    def __post_init__(self) -> None:
        _check(self, left_m=(2, 3), right_m=(2, 3))


@dataclass(frozen=True, eq=False)
class RunwayEstimate:
    """Where the lines are, from one frame."""

    seen: LineVisibility
    """Which edge lines are seen."""
    mode: DepthMode
    """Where distances come from."""
    pixel_lines: dict[str, PixelLine]
    """The lines in the image: "left" and "right", those that are seen."""
    lines: dict[str, RunwayLine]
    """The lines in the world: "left", "right" and "centre", those that could be localized."""
    ramp_m: NDArray[np.float64] | None = None
    """(3,) nearest visible end of the centre line, world, m."""
    ramp_sigma_m: float | None = None
    """1-sigma of `ramp_m` along the deck, m."""
    diagnostics: Diagnostics = ()
    """Why something is missing."""
    flags: Diagnostics = ()
    """What seems wrong with the stated values of the frame."""
    depth_confirms_height: bool = False
    """In coarse mode: the depth camera agrees with the deck height at 6 points of each line or more."""

    @property
    def reason(self) -> str:
        """Why something is missing, for people."""
        return message_of(self.diagnostics)


@dataclass(frozen=True, eq=False)
class Value:
    """A measured number with its 1-sigma, in the same unit."""

    value: float
    """The measurement."""
    sigma: float
    """Its 1-sigma."""


class TrackState(StrEnum):
    """Whether the runway is followed over frames."""

    TRACKING = "tracking"
    """Lines of this frame updated the track."""
    COASTING = "coasting"
    """No line is measured, for a short time."""
    LOST = "lost"
    """There is no track."""


@dataclass(frozen=True)
class Protection:
    """Errors larger than these, without a flag, have a probability of `risk`."""

    lateral_m: float
    """Bound on the error of the lateral deviation, m."""
    vertical_m: float
    """Bound on the error of the height above deck, m."""
    heading_rad: float | None
    """Bound on the error of the heading error, rad; None: nothing bounds the yaw of a turned camera."""
    distance_m: float | None
    """Bound on the error of the distance to the ramp, m; None: no ramp is known."""
    risk: float
    """Probability that an error without a flag exceeds its bound, per frame and direction."""


@dataclass(frozen=True, eq=False)
class Track:
    """Where the lines are, from all frames so far."""

    time_s: float
    """Of the frame, s."""
    state: TrackState
    """Whether this frame updated the track."""
    lines: dict[str, RunwayLine]
    """Of "left", "right" and "centre", world, as the frame's pose has it, at the touchdown point; {} when lost."""
    protection: Protection | None = None
    """None when lost, or without a pose."""
    flags: Diagnostics = ()
    """What contradicts the track; empty: nothing is known to be wrong."""
    excluded: Diagnostics = ()
    """Measurements of this frame that were left out: LEFT, RIGHT, HEIGHT."""
    ramp_m: NDArray[np.float64] | None = None
    """(3,) near end of the centre line, world, m."""
    ramp_sigma_m: float | None = None
    """1-sigma of `ramp_m` along the deck, m."""
    lateral_rate_m_s: Value | None = None
    """Rate of the lateral deviation, m/s; positive: to the right."""
    height_rate_m_s: Value | None = None
    """Rate of the height above deck, m/s; positive: climbing."""
    closing_m_s: Value | None = None
    """Closing speed, m/s; positive: the aircraft comes nearer to the ramp."""
    diagnostics: Diagnostics = ()
    """Why a frame was not used or the track began again."""
    age_s: float = 0.0
    """Since the track began, s; 0: this frame began it."""
    scale_sources: tuple[Scale, ...] = ()
    """What confirms the scale in all its frames."""
    doubts: Diagnostics = ()
    """Why it is not `ok` though nothing is flagged."""


@dataclass(frozen=True, eq=False)
class InWidths:
    """Where the aircraft is in runway widths: what a picture gives whose runway's width is not stated."""

    lateral_deviation: Value
    """Runway widths; positive: right of the centre line."""
    height_above_deck: Value
    """Runway widths."""
    distance_to_ramp: Value | None = None
    """Runway widths along the centre line; positive: the ramp is ahead; None: the ramp is not seen."""


@dataclass(frozen=True, eq=False)
class Guidance:
    """Where the aircraft is relative to the centre line and the glideslope."""

    time_s: float
    """Of the frame, s."""
    status: Status
    """What it is worth."""
    mode: DepthMode
    """Where distances come from."""
    lateral_deviation_m: Value | None = None
    """m; positive: the aircraft is right of the centre line, looking along the landing."""
    heading_error_rad: Value | None = None
    """rad; positive: the nose points right of the centre line."""
    height_above_deck_m: Value | None = None
    """m; above the touchdown point with a track, else above what this frame shows."""
    distance_to_ramp_m: Value | None = None
    """m along the centre line; positive: the ramp is ahead."""
    diagnostics: Diagnostics = ()
    """Why something is missing."""
    vertical_deviation_m: Value | None = None
    """m; positive: above the glideslope."""
    lateral_deviation_rad: Value | None = None
    """rad at the aim point, as a localizer shows it; positive: right."""
    vertical_deviation_rad: Value | None = None
    """rad at the aim point; positive: above."""
    distance_to_touchdown_m: Value | None = None
    """m along the centre line; positive: the aim point is ahead."""
    lateral_rate_m_s: Value | None = None
    """Rate of the lateral deviation, m/s; positive: to the right."""
    height_rate_m_s: Value | None = None
    """Rate of the height above deck, m/s; negative in a descent."""
    closing_m_s: Value | None = None
    """Closing speed, m/s; positive: the ramp comes nearer."""
    protection: Protection | None = None
    """Bounds on its errors; None: not known."""
    track: TrackState | None = None
    """State of the track; None: from this frame alone."""
    flags: Diagnostics = ()
    """What is found wrong; empty: nothing is known to be wrong."""
    glideslope_rad: float | None = None
    """The wanted glideslope above the deck, rad."""
    scale_sources: tuple[Scale, ...] = ()
    """What confirms the scale."""
    pose_source: PoseSource | None = None
    """Where the pose comes from; None: there is none."""
    in_widths: InWidths | None = None
    """Lengths in runway widths, where metres are not known; the lengths in metres are then None."""

    @property
    def reason(self) -> str:
        """Why something is missing, for people."""
        return message_of(self.diagnostics)


def _check(owner: Any, **shapes: tuple[int, ...]) -> None:
    for name, shape in shapes.items():
        if np.shape(getattr(owner, name)) != shape:
            raise ValueError(
                f"{type(owner).__name__}.{name} must have shape {shape}, got {np.shape(getattr(owner, name))}"
            )
