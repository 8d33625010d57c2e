"""Fitted lines with their noise sensitivities; two of them as a runway: consistency, centre line, ramp."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import intersect_plane, rotation_matrix, wrap_angle
from deckline.localize.depth import DeckPoints
from deckline.types import (
    NO_POSE,
    SIDES,
    Diagnostic,
    Diagnostics,
    Frame,
    LineErrors,
    LinePoints,
    PixelLine,
    Reason,
    RunwayLine,
)

Array = NDArray[np.float64]
Region = tuple[float, float, float, float]
MIN_SPACING_M, MAX_SPACING_M = 5.0, 60.0  # of a runway's edge lines
MAX_ANGLE_RAD = float(np.deg2rad(4.0))  # between the lines, beside twice its own 1-sigma
MAX_AZIMUTH_SIGMA_RAD = float(np.deg2rad(2.0))  # of a line that is accepted
CLEARLY_BETTER = 3.0  # ratio of azimuth 1-sigmas from which the surer of two contradicting lines is accepted
MAX_END_STEP_M = 10.0  # between the near ends of the lines along the runway, beside three times its 1-sigma
# Between a line's near end and the edge of the searched part: detectors lose the end of a line that runs out of view.
MARGIN_STEPS = 2.0  # from point to point
MARGIN_SHARE = 0.15  # of the line's visible length


@dataclass(frozen=True, eq=False)
class LineFit:
    """A fitted line and its sensitivity to each noise source.

    Columns of the sensitivities are independent sources of 1-sigma each. Fits of one frame share them, so that their
    joint covariance is known. Rows are the offset to the right of the line, m; azimuth, rad; z, m.
    """

    point_m: Array
    """(3,) a point of the line, world."""
    azimuth_rad: float
    """Direction of landing, from world x (north) to y (east)."""
    own: Array
    """(3, M) noise of the points, and of the prior of the lines' geometry."""
    common: Array
    """(3, K) pose, calibration and deck, in the world."""
    relative: Array
    """(3, K) the same, relative to the aircraft."""
    errors: LineErrors | None = None
    """Sensitivity to errors that frames share; None: not known."""

    @property
    def runway_line(self) -> RunwayLine:
        """The line with its covariances, as an estimate holds it."""
        return RunwayLine(self.point_m, self.azimuth_rad, self.covariance, self.relative_covariance, self.errors)

    @cached_property
    def direction(self) -> Array:
        """(2,) unit vector along the line, world x and y."""
        return np.array([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)])

    @cached_property
    def right(self) -> Array:
        """(2,) unit vector to the right of the line, world x and y."""
        return np.array([-np.sin(self.azimuth_rad), np.cos(self.azimuth_rad)])

    @cached_property
    def covariance(self) -> Array:
        """(3, 3) of offset, azimuth and z in the world."""
        return self.own @ self.own.T + self.common @ self.common.T

    @cached_property
    def relative_covariance(self) -> Array:
        """(3, 3) of offset, azimuth and z relative to the aircraft."""
        return self.own @ self.own.T + self.relative @ self.relative.T


@dataclass(frozen=True, eq=False)
class NearEnds:
    """Where the left and the right line begin, along the centre line from its point."""

    along_m: Array
    """(2,)."""
    variance: Array
    """(2,) m2, of each end's own error."""
    common_m: Array
    """(K,) shift of their mean by common sources of 1-sigma."""
    distance_per_height: float
    """Shift of the ends along the deck per error of the height."""

    @property
    def separation_m(self) -> float:
        """Between both ends along the runway."""
        return float(abs(self.along_m[0] - self.along_m[1]))


def check_pixel_order(lines: dict[str, PixelLine]) -> Diagnostic | None:
    """Why the two image lines cannot be left and right of one runway.

    Compared at the near end of the line that ends farther up, where both were seen.
    """
    if set(lines) != set(SIDES):
        return None
    row = min(line.ends_px[0, 1] for line in lines.values())
    u = {side: _column_at(line, row) for side, line in lines.items()}
    if u["left"] < u["right"]:
        return None
    found = f"u {u['left']:.0f} and {u['right']:.0f} px"
    return Diagnostic(Reason.CROSSED, f"the left line passes right of the right line in the image ({found})")


def drop_contradictions(fits: dict[str, LineFit]) -> tuple[dict[str, LineFit], Diagnostics]:
    """The fits that do not contradict each other, and why others were dropped.

    Of two lines that contradict each other in spacing or direction, only the clearly surer one is accepted, or neither.
    Of two lines in the wrong order neither is accepted, since their names are in doubt. The fits must be independent of
    each other.
    """
    if not set(SIDES) <= set(fits):
        return fits, ()
    left, right = fits["left"], fits["right"]
    spacing, spacing_sigma = _measure_spacing(left, right)
    angle = abs(float(wrap_angle(left.azimuth_rad - right.azimuth_rad)))
    sigma = float(np.linalg.norm(left.own[1] - right.own[1]))
    if spacing <= 0:
        return {}, (Diagnostic(Reason.CROSSED, f"the left line lies {-spacing:.1f} m right of the right line"),)
    if not MIN_SPACING_M - 2 * spacing_sigma <= spacing <= MAX_SPACING_M + 2 * spacing_sigma:
        reason = Reason.LINE_SPACING
        message = f"the lines are {spacing:.1f} m apart, expected {MIN_SPACING_M:g} to {MAX_SPACING_M:g} m"
    elif angle > MAX_ANGLE_RAD + 2 * sigma:
        reason = Reason.LINE_ANGLE
        message = f"the lines differ by {np.rad2deg(angle):.1f} degrees in direction"
    else:
        return fits, ()
    azimuth_sigma = {side: float(np.linalg.norm(fits[side].own[1])) for side in SIDES}
    best = min(azimuth_sigma, key=lambda side: azimuth_sigma[side])
    if max(azimuth_sigma.values()) < CLEARLY_BETTER * azimuth_sigma[best]:
        return {}, (Diagnostic(reason, f"{message}; neither is clearly the better one"),)
    return {best: fits[best]}, (Diagnostic(reason, f"{message}; only the surer one, {best}, is used"),)


def drop_unsure(fits: dict[str, LineFit]) -> tuple[dict[str, LineFit], Diagnostics]:
    """The fits whose direction is certain enough, and which were dropped."""
    accepted = {side: fit for side, fit in fits.items() if np.sqrt(fit.covariance[1, 1]) <= MAX_AZIMUTH_SIGMA_RAD}
    dropped = (side for side in fits if side not in accepted)
    return accepted, tuple(
        Diagnostic(Reason.UNSURE, f"the direction of the {side} line is too uncertain") for side in dropped
    )


def average_lines(left: LineFit, right: LineFit) -> LineFit:
    """The line midway: directions and offsets averaged, both lines with equal weight (Li et al. 2024, section 3.2)."""
    difference = float(wrap_angle(right.azimuth_rad - left.azimuth_rad))
    azimuth = float(wrap_angle(left.azimuth_rad + difference / 2))
    direction = np.array([np.cos(azimuth), np.sin(azimuth)])
    middle = (left.point_m + right.point_m) / 2
    nearest, levers = [], []
    for fit in (left, right):
        along = (middle[:2] - fit.point_m[:2]) @ direction / (fit.direction @ direction)
        nearest.append(fit.point_m[:2] + along * fit.direction)
        levers.append(along)
    point = np.array([*(nearest[0] + nearest[1]) / 2, middle[2]])
    pairs = ((left.own, right.own), (left.common, right.common), (left.relative, right.relative))
    own, common, relative = (_average_sensitivities(*pair, levers) for pair in pairs)
    return LineFit(point, azimuth, own, common, relative)


def shift_line(fit: LineFit, right_m: float, sigma_m: float) -> LineFit:
    """The same line moved to its right by a distance, m, with its 1-sigma."""
    shift = np.array([[sigma_m], [0.0], [0.0]])
    point = fit.point_m + right_m * np.array([*fit.right, 0.0])
    return replace(fit, point_m=point, own=np.hstack([fit.own, shift]), errors=None)


def find_near_ends(
    frame: Frame,
    points: dict[str, LinePoints],
    deck_points: dict[str, DeckPoints],
    centre: LineFit,
    region_px: Region | None,
) -> NearEnds | Diagnostic:
    """Where both lines begin, or why it is not known. Both must end inside the region that the detector searched.

    Detectors give points by rows or columns of the image: the true end lies between the last point and the next row or
    column. The estimate is the middle of that gap, its 1-sigma the whole gap on the ground.
    """
    pose = frame.world_from_camera
    if pose is None:
        return NO_POSE
    origin, rotation, forward = pose.translation, rotation_matrix(pose), centre.direction
    ends, variances, shared, ratios = [], [], [], []
    for side in SIDES:
        line = deck_points[side]
        along_m = (line.points_m[:, :2] - centre.point_m[:2]) @ forward
        nearest, farthest = int(along_m.argmin()), int(along_m.argmax())
        pixels = points[side].points_px[line.index]
        nearer = pixels[nearest] - pixels[farthest]
        step = _point_step(pixels, nearer)
        margin = max(MARGIN_STEPS * step, MARGIN_SHARE * nearer, key=np.linalg.norm)
        if not _is_inside(pixels[nearest] + margin, frame, region_px):
            return Diagnostic(Reason.NO_RAMP, f"no ramp: the near end of the {side} line is not in view")
        rays = frame.camera.rays([pixels[nearest], pixels[nearest] + step]) @ rotation.T
        ground = intersect_plane(origin, rays, float(line.points_m[nearest, 2]))
        gap = float(abs((ground[0, :2] - ground[1, :2]) @ forward))
        if not np.isfinite(gap):
            return Diagnostic(Reason.NO_RAMP, f"no ramp: the near end of the {side} line cannot be placed on the deck")
        ends.append(float(along_m[nearest]) - gap / 2)
        variances.append(gap**2 + float((line.depth_m[nearest, :2] @ forward) ** 2))
        shared.append(line.common_m[:, nearest, :2] @ forward)
        offset = line.points_m[nearest] - origin
        ratios.append(float(offset[:2] @ forward / offset[2]))
    return NearEnds(np.array(ends), np.array(variances), (shared[0] + shared[1]) / 2, sum(ratios) / len(ratios))


def check_near_ends(ends: NearEnds, left: LineFit, right: LineFit) -> Diagnostic | None:
    """Why lines that begin there are not both edges of one runway.

    On a deck that rolls one line lies higher than assumed; the tolerance includes the fits' height difference.
    """
    higher = np.concatenate([left.own[2] - right.own[2], left.relative[2] - right.relative[2]])
    variance = ends.variance.sum() + ends.distance_per_height**2 * (higher @ higher)
    if ends.separation_m <= MAX_END_STEP_M + 3 * np.sqrt(variance):
        return None
    return Diagnostic(Reason.LINE_ENDS, f"the lines begin {ends.separation_m:.0f} m apart along the runway")


def ramp_from_ends(ends: NearEnds, centre: LineFit) -> tuple[Array, float]:
    """Where the centre line begins, (3,) world, and its 1-sigma along the deck."""
    variance = ends.variance.sum() / 4 + (ends.separation_m / 2) ** 2 + ends.common_m @ ends.common_m
    point = centre.point_m + ends.along_m.mean() * np.array([*centre.direction, 0.0])
    return point, float(np.sqrt(variance))


def _column_at(line: PixelLine, row: float) -> float:
    (u0, v0), (u1, v1) = line.ends_px
    return float(u0 + (row - v0) * (u1 - u0) / (v1 - v0)) if abs(v1 - v0) > 1e-9 else float(min(u0, u1))


def _measure_spacing(left: LineFit, right: LineFit) -> tuple[float, float]:
    """Distance from the left to the right line, positive to the right, across their mean direction, and 1-sigma, m."""
    across = left.right + right.right
    across /= np.linalg.norm(across)
    along = np.array([across[1], -across[0]])
    middle = (left.point_m[:2] + right.point_m[:2]) / 2
    offsets, sensitivities = [], []
    for fit in (left, right):
        step = (middle - fit.point_m[:2]) @ along / (fit.direction @ along)
        offsets.append((fit.point_m[:2] + step * fit.direction) @ across)
        sensitivities.append(fit.own[0] + step * fit.own[1])
    return float(offsets[1] - offsets[0]), float(np.linalg.norm(sensitivities[1] - sensitivities[0]))


def _average_sensitivities(left: Array, right: Array, levers: list[float]) -> Array:
    offset = (left[0] + levers[0] * left[1] + right[0] + levers[1] * right[1]) / 2
    return np.stack([offset, (left[1] + right[1]) / 2, (left[2] + right[2]) / 2])


def _point_step(points_px: Array, nearer_px: Array) -> Array:
    """Median step (2,) px from one point (N, 2) to the next nearer one, in the direction of `nearer_px`."""
    towards = nearer_px / max(float(np.linalg.norm(nearer_px)), 1e-9)
    steps = np.diff(np.unique(points_px @ towards))
    return towards * (float(np.median(steps)) if len(steps) else 1.0)


def _is_inside(pixel: Array, frame: Frame, region_px: Region | None) -> bool:
    u0, v0, u1, v1 = region_px or (0.0, 0.0, frame.camera.width - 1.0, frame.camera.height - 1.0)
    return bool(
        max(u0, 0) <= pixel[0] <= min(u1, frame.camera.width - 1)
        and max(v0, 0) <= pixel[1] <= min(v1, frame.camera.height - 1)
    )
