"""From single lines to a runway: do they agree, the centre line, the ramp."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import intersect_plane, wrap_angle
from deckline.localize.config import AgreementConfig
from deckline.localize.depth import DeckPoints
from deckline.localize.line_fit import LineFit
from deckline.types import SIDES, Frame, LinePoints, PixelLine, RunwayLine

Array = NDArray[np.float64]
Region = tuple[float, float, float, float]
RAMP_MARGIN_ROWS = 2.0  # of the detector's rows, between a line's near end and the edge of what was looked at


def runway_line(fit: LineFit) -> RunwayLine:
    return RunwayLine(fit.point_m, fit.azimuth_rad, fit.covariance, fit.relative_covariance, fit.errors)


def pixel_contradiction(lines: dict[str, PixelLine]) -> str:
    """Why the two image lines cannot be left and right of one runway, or an empty string.

    Compared at the near end of the line that ends farther up, where both were seen.
    """
    if set(lines) != set(SIDES):
        return ""
    row = min(line.ends_px[0, 1] for line in lines.values())
    u = {side: _u_at(line, row) for side, line in lines.items()}
    if u["left"] < u["right"]:
        return ""
    return f"the left line passes right of the right line in the image (u {u['left']:.0f} and {u['right']:.0f} px)"


def drop_contradictions(fits: dict[str, LineFit], config: AgreementConfig) -> tuple[dict[str, LineFit], str]:
    """The fits that do not contradict each other, and why others were dropped.

    Of two lines that contradict each other in spacing or direction, the clearly surer one stays, or neither; of two
    whose order is wrong neither stays, as the names are in doubt. The fits must not know of each other.
    """
    if not set(SIDES) <= set(fits):
        return fits, ""
    left, right = fits["left"], fits["right"]
    spacing, spacing_sigma = _spacing(left, right)
    angle = abs(float(wrap_angle(left.azimuth_rad - right.azimuth_rad)))
    sigma = float(np.linalg.norm(left.own[1] - right.own[1]))
    if spacing <= 0:
        return {}, f"the left line lies {-spacing:.1f} m right of the right line"
    if not config.min_spacing_m - 2 * spacing_sigma <= spacing <= config.max_spacing_m + 2 * spacing_sigma:
        reason = f"the lines are {spacing:.1f} m apart, expected {config.min_spacing_m:g} to {config.max_spacing_m:g} m"
    elif angle > config.max_angle_rad + 2 * sigma:
        reason = f"the lines differ by {np.rad2deg(angle):.1f} degrees in direction"
    else:
        return fits, ""
    sure = {side: float(np.linalg.norm(fits[side].own[1])) for side in SIDES}
    best = min(sure, key=lambda side: sure[side])
    if max(sure.values()) < config.clearly_better * sure[best]:
        return {}, f"{reason}; neither is clearly the better one"
    return {best: fits[best]}, f"{reason}; only the surer one, {best}, is kept"


def drop_unsure(fits: dict[str, LineFit], config: AgreementConfig) -> tuple[dict[str, LineFit], str]:
    """The fits whose direction is of use, and which were dropped."""
    kept = {side: fit for side, fit in fits.items() if np.sqrt(fit.covariance[1, 1]) <= config.max_azimuth_sigma_rad}
    return kept, "; ".join(f"the direction of the {side} line is too uncertain" for side in fits if side not in kept)


def centre_line(left: LineFit, right: LineFit) -> LineFit:
    """The line midway: directions and offsets averaged (SPEC section 4.5).

    What the lines know of each other they know already, so both count alike.
    """
    difference = float(wrap_angle(right.azimuth_rad - left.azimuth_rad))
    azimuth = float(wrap_angle(left.azimuth_rad + difference / 2))
    direction = np.array([np.cos(azimuth), np.sin(azimuth)])
    middle = (left.point_m + right.point_m) / 2
    beside, levers = [], []
    for fit in (left, right):
        along = (middle[:2] - fit.point_m[:2]) @ direction / (fit.direction @ direction)
        beside.append(fit.point_m[:2] + along * fit.direction)
        levers.append(along)
    point = np.array([*(beside[0] + beside[1]) / 2, middle[2]])
    own, common, relative = (
        _mix(getattr(left, name), getattr(right, name), levers) for name in ("own", "common", "relative")
    )
    return LineFit(point, azimuth, own, common, relative)


def shifted_line(fit: LineFit, right_m: float, sigma_m: float) -> LineFit:
    """The same line moved to its right, m, give or take a 1-sigma."""
    shift = np.array([[sigma_m], [0.0], [0.0]])
    point = fit.point_m + right_m * np.array([*fit.right, 0.0])
    return replace(fit, point_m=point, own=np.hstack([fit.own, shift]), errors=None)


def ramp(
    frame: Frame,
    points: dict[str, LinePoints],
    pixel_lines: dict[str, PixelLine],
    located: dict[str, DeckPoints],
    centre: LineFit,
    region_px: Region | None,
    max_step_m: float,
) -> tuple[Array, float] | str:
    """Where the centre line begins, (3,) world, and its 1-sigma along the deck; or why it is not known.

    Both lines must end inside what the detector looked at. Points come row by row, so a true end lies anywhere
    between the last row with the line and the next one: the middle of that gap is taken, and the whole gap on the
    ground is its 1-sigma, as a detector may lose the last row.
    """
    ends, variances, shared = [], [], []
    for side in SIDES:
        seen = points[side].points_px[pixel_lines[side].inliers]
        step = _row_step(seen)
        beyond = _beyond(pixel_lines[side], step)
        if not _inside(beyond, frame, region_px):
            return f"the near end of the {side} line is not in view"
        line = located[side]
        nearest = int(np.argmax(points[side].points_px[line.index, 1]))
        gap = _row_gap(frame, points[side].points_px[line.index[nearest]], step, line.points_m[nearest], centre)
        if not np.isfinite(gap):
            return f"the near end of the {side} line cannot be placed on the deck"
        ends.append(float((line.points_m[nearest, :2] - centre.point_m[:2]) @ centre.direction) - gap / 2)
        variances.append(gap**2 + float((line.depth_m[nearest, :2] @ centre.direction) ** 2))
        shared.append(line.common_m[:, nearest, :2] @ centre.direction)
    apart = abs(ends[0] - ends[1])
    if apart > max_step_m + 3 * np.sqrt(sum(variances)):
        return f"the lines begin {apart:.0f} m apart"
    along = (ends[0] + ends[1]) / 2
    common = (shared[0] + shared[1]) / 2
    variance = sum(variances) / 4 + (apart / 2) ** 2 + common @ common
    point = centre.point_m + along * np.array([*centre.direction, 0.0])
    return point, float(np.sqrt(variance))


def _u_at(line: PixelLine, row: float) -> float:
    (u0, v0), (u1, v1) = line.ends_px
    return float(u0 + (row - v0) * (u1 - u0) / (v1 - v0)) if abs(v1 - v0) > 1e-9 else float(min(u0, u1))


def _spacing(left: LineFit, right: LineFit) -> tuple[float, float]:
    """Distance from the left to the right line, positive to the right, across their mean direction, and 1-sigma, m."""
    across = left.right + right.right
    across /= np.linalg.norm(across)
    along = np.array([across[1], -across[0]])
    middle = (left.point_m[:2] + right.point_m[:2]) / 2
    offsets, moved = [], []
    for fit in (left, right):
        step = (middle - fit.point_m[:2]) @ along / (fit.direction @ along)
        offsets.append((fit.point_m[:2] + step * fit.direction) @ across)
        moved.append(fit.own[0] + step * fit.own[1])
    return float(offsets[1] - offsets[0]), float(np.linalg.norm(moved[1] - moved[0]))


def _mix(left: Array, right: Array, levers: list[float]) -> Array:
    offset = (left[0] + levers[0] * left[1] + right[0] + levers[1] * right[1]) / 2
    return np.stack([offset, (left[1] + right[1]) / 2, (left[2] + right[2]) / 2])


def _row_step(seen_px: Array) -> float:
    """Typical distance between neighbouring rows with a point, px."""
    rows = np.unique(seen_px[:, 1])
    return float(np.median(np.diff(rows))) if len(rows) > 1 else 1.0


def _beyond(line: PixelLine, step: float) -> Array:
    """Where the line would be some rows below its near end, (2,) px."""
    near, far = line.ends_px
    row = near[1] + RAMP_MARGIN_ROWS * step
    return np.array([near[0] + (row - near[1]) * (near[0] - far[0]) / max(near[1] - far[1], 1e-9), row])


def _inside(pixel: Array, frame: Frame, region_px: Region | None) -> bool:
    u0, v0, u1, v1 = region_px or (0.0, 0.0, frame.camera.width - 1.0, frame.camera.height - 1.0)
    return bool(
        max(u0, 0) <= pixel[0] <= min(u1, frame.camera.width - 1)
        and max(v0, 0) <= pixel[1] <= min(v1, frame.camera.height - 1)
    )


def _row_gap(frame: Frame, pixel: Array, step: float, point_m: Array, centre: LineFit) -> float:
    """Ground covered along the centre line by the next row towards the aircraft, m; NaN off the deck plane."""
    pose = frame.world_from_camera
    if pose is None:
        return float("nan")
    rays = pose.rotation.apply(frame.camera.rays(np.stack([pixel, pixel + np.array([0.0, step])])))
    ground = intersect_plane(pose.translation, rays, float(point_m[2]))
    return float(abs((ground[0, :2] - ground[1, :2]) @ centre.direction))
