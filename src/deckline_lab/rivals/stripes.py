"""Bright stripes on darker ground, and the straight lines they make. No weights, no randomness."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from deckline.monitors.painted_lines import ridge_response

Array = NDArray[np.float64]
# Beside a stripe the wider windows respond too. A response below this share of the largest in this window is ignored.
ECHO_SHARE, ECHO_PX = 0.5, 17


@dataclass(frozen=True)
class StripeConfig:
    """What a stripe and a line are."""

    widths_px: tuple[int, ...] = (1, 3, 7, 15)  # of stripes along a row
    min_contrast: float = 6.0  # grey levels of a stripe over the brighter of its sides
    noise_factor: float = 3.0  # least response over the median response of the image
    min_rows: int = 14  # of a line
    min_fill: float = 0.7  # of a line's rows that show the stripe
    max_spread_px: float = 0.9  # 1-sigma of the stripe about its straight line, along u
    near_px: float = 2.0  # a row's stripe this close to a line belongs to it, along u
    max_gap_rows: int = 6  # a line ends where its stripe is missing on more rows
    steepness: float = 0.35  # smallest |dv / du| of a line; flatter ones have no profile along a row
    max_segments: int = 300  # of the Hough transform that are fitted, the longest first
    max_lines: int = 40


@dataclass(frozen=True, eq=False)
class StripeLine:
    """A straight bright stripe u = at_top + slope (v - top)."""

    top: float  # v of its upper end, px
    bottom: float  # v of its lower end, px
    at_top: float  # u at `top`, px
    slope: float  # du / dv
    points_px: Array  # (N, 2) where the stripe was seen, one point a row
    contrast: float  # grey levels, median
    spread_px: float  # 1-sigma along u

    @property
    def rows(self) -> float:
        return self.bottom - self.top + 1

    @property
    def fill(self) -> float:
        """Share of the rows that show the stripe."""
        return min(len(self.points_px) / self.rows, 1.0)

    @property
    def support(self) -> float:
        """Rows that show the stripe, weighted by the share of its rows that do."""
        return len(self.points_px) * self.fill

    def x_at(self, v: Any) -> Any:
        """u at a row or at rows v."""
        return self.at_top + self.slope * (v - self.top)


def find_stripes(image_rgb: NDArray[np.uint8], config: StripeConfig) -> list[StripeLine]:
    """Straight bright stripes in an image (H, W, 3), the best supported first."""
    import cv2  # here: training imports this package on machines without OpenCV

    if min(image_rgb.shape[:2]) < config.min_rows:
        return []
    response = stripe_response(image_rgb, config.widths_px)
    threshold = max(config.min_contrast, config.noise_factor * float(np.median(np.abs(response))))
    peaks = _peaks(response, threshold)
    segments = cv2.HoughLinesP(
        peaks.astype(np.uint8), 1.0, np.pi / 360, config.min_rows, None, config.min_rows, config.max_gap_rows
    )
    if segments is None:
        return []
    ends = np.asarray(segments, dtype=np.float64).reshape(-1, 4)
    order = np.argsort(-np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1]), kind="stable")
    index = _PeakIndex(response, peaks)
    lines: list[StripeLine] = []
    for u0, v0, u1, v1 in ends[order[: config.max_segments]]:
        if abs(v1 - v0) < config.steepness * abs(u1 - u0):
            continue
        line = _fit_stripe(index, v0, u0, (u1 - u0) / (v1 - v0), (min(v0, v1), max(v0, v1)), config)
        if line is not None and not any(_covers(known, line) for known in lines):
            lines.append(line)
    return sorted(lines, key=lambda line: -line.support)[: config.max_lines]


def midline(left: StripeLine, right: StripeLine) -> StripeLine:
    """The line halfway between two, with points on the rows on which both were seen."""
    top, bottom = max(left.top, right.top), min(left.bottom, right.bottom)
    _, at_left, at_right = np.intersect1d(left.points_px[:, 1], right.points_px[:, 1], return_indices=True)
    points = (left.points_px[at_left] + right.points_px[at_right]) / 2
    at_top = (left.x_at(top) + right.x_at(top)) / 2
    contrast, spread = min(left.contrast, right.contrast), max(left.spread_px, right.spread_px)
    return StripeLine(top, bottom, at_top, (left.slope + right.slope) / 2, points, contrast, spread)


def stripe_response(image_rgb: NDArray[np.uint8], widths_px: tuple[int, ...]) -> NDArray[np.float32]:
    """How many grey levels every pixel's neighbourhood along its row is brighter than both its sides, (H, W).

    The darkest colour counts, as paint is white, and the best of the widths. Negative where there is no stripe.
    """
    return ridge_response(image_rgb.min(axis=2).astype(np.float32), widths_px, "nearest")


def _peaks(response: NDArray[np.float32], threshold: float) -> NDArray[np.bool_]:
    """Where the response is a maximum along the row, large enough, and not a stripe's echo."""
    peaks = np.zeros(response.shape, dtype=bool)
    middle = response[:, 1:-1]
    peaks[:, 1:-1] = (middle > response[:, :-2]) & (middle >= response[:, 2:]) & (middle >= threshold)
    return peaks & (response >= ECHO_SHARE * maximum_filter1d(response, ECHO_PX, axis=1))


class _PeakIndex:
    """Peaks by row, with sub-pixel positions."""

    def __init__(self, response: NDArray[np.float32], peaks: NDArray[np.bool_]) -> None:
        v, u = np.nonzero(peaks)
        before, at, after = (response[v, u + step].astype(np.float64) for step in (-1, 0, 1))
        curvature = np.maximum(2 * at - before - after, 1e-6)
        self.u = u + np.clip((after - before) / (2 * curvature), -0.5, 0.5)
        self.v = v.astype(np.float64)
        self.level = at
        self.first = np.searchsorted(v, np.arange(peaks.shape[0] + 1))

    def near(self, u_at: NDArray, rows: NDArray[np.int64], reach: float) -> NDArray[np.int64]:
        """Indices of the nearest peak on each of `rows` within `reach` of u there; rows without one are left out."""
        found = []
        for u, row in zip(u_at, rows, strict=True):
            low, high = self.first[row], self.first[row + 1]
            if low == high:
                continue
            distance = np.abs(self.u[low:high] - u)
            closest = int(distance.argmin())
            if distance[closest] <= reach:
                found.append(low + closest)
        return np.array(found, dtype=np.int64)


def _fit_stripe(
    index: _PeakIndex, v_from: float, u_from: float, slope: float, extent: tuple[float, float], config: StripeConfig
) -> StripeLine | None:
    """The line through a segment's peaks, extended as far as they go; None where it is no line."""
    height = len(index.first) - 1
    low, high = extent
    for _ in range(3):
        reach = config.max_gap_rows + 0.25 * (high - low)
        rows = np.arange(int(max(low - reach, 0)), int(min(high + reach, height - 1)) + 1)
        found = index.near(u_from + slope * (rows - v_from), rows, config.near_px)
        found = _longest_run(found, index.v, (low + high) / 2, config.max_gap_rows)
        if len(found) < config.min_rows:
            return None
        v, u = index.v[found], index.u[found]
        slope, offset = np.polyfit(v - v.mean(), u, 1)
        v_from, u_from, low, high = float(v.mean()), float(offset), float(v.min()), float(v.max())
    spread = float(np.std(u - (u_from + slope * (v - v_from))))
    contrast = float(np.median(index.level[found]))
    at_top = u_from + slope * (low - v_from)
    line = StripeLine(low, high, at_top, float(slope), np.stack([u, v], axis=1), contrast, spread)
    return line if spread <= config.max_spread_px and line.fill >= config.min_fill else None


def _longest_run(found: NDArray[np.int64], v: Array, middle: float, max_gap: int) -> NDArray[np.int64]:
    """Of peaks in order of rows, the run around `middle` without gaps of more rows than `max_gap`."""
    if len(found) == 0:
        return found
    breaks = np.flatnonzero(np.diff(v[found]) > max_gap + 1)
    starts, ends = np.concatenate([[0], breaks + 1]), np.concatenate([breaks, [len(found) - 1]])
    rows = v[found]
    distance = np.maximum(rows[starts] - middle, 0) + np.maximum(middle - rows[ends], 0)
    best = int(distance.argmin())
    return found[starts[best] : ends[best] + 1]


def _covers(known: StripeLine, line: StripeLine) -> bool:
    """Whether a line is a part of one that is known, seen on the same pixels."""
    inside = line.top >= known.top - 3 and line.bottom <= known.bottom + 3
    return inside and all(abs(known.x_at(v) - line.x_at(v)) < 1.5 for v in (line.top, line.bottom))
