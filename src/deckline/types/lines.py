"""Where runway lines are, in the picture and in the world, as one frame shows them."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_shapes
from deckline.types.diagnostics import Diagnostics, LineVisibility, message_of


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
class PixelLine:
    """A straight line in the image: a u + b v + c = 0 with a^2 + b^2 = 1."""

    coefficients: NDArray[np.float64]
    """(3,) a, b, c, for u, v in px of a camera without lens distortion."""
    inliers: NDArray[np.bool_]
    """(N,) which of the detected points lie on it."""
    ends_px: NDArray[np.float64]
    """(2, 2) u, v, px, of its nearest (largest v) and farthest inlier, moved onto the line; as the lens shows them."""
    sigma_px: float
    """1-sigma of an inlier normal to the line, px."""

    def __post_init__(self) -> None:
        check_shapes(self, coefficients=(3,), ends_px=(2, 2))


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
        check_shapes(self, slopes_rad=(2,), own=(5, self.own.shape[-1]), effects=(5, 7))


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
        check_shapes(self, point_m=(3,), covariance=(3, 3))
        if self.relative_covariance is not None:
            check_shapes(self, relative_covariance=(3, 3))

    @property
    def aircraft_covariance(self) -> NDArray[np.float64]:
        """(3, 3) as seen from the aircraft; `covariance`, which bounds it, where that is not known."""
        return self.covariance if self.relative_covariance is None else self.relative_covariance

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector (3,) along the line in the direction of landing."""
        return np.array([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad), 0.0])

    @property
    def right(self) -> NDArray[np.float64]:
        """Unit vector (3,) to the right of the line."""
        return np.array([-np.sin(self.azimuth_rad), np.cos(self.azimuth_rad), 0.0])

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
        check_shapes(self, left_m=(2, 3), right_m=(2, 3))


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
