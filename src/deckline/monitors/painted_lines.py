"""Whether the picture shows paint under the detected lines: edges and geometry, no network.

Every row between two lines is stretched so that the left line lies at 0 and the right line at 1. A marking parallel to
them is vertical there, at any range. Ridges of brightness are compared within a row, whose haze and light they share.
Two observations contradict the lines: paint under one of them alone, and a centre line that is not midway. The excess
over their limits is summed over the checks and flagged when the sum is large (CUSUM).
Source: Page, "Continuous inspection schemes", 1954.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from deckline.geometry import Camera, rectify, undistort
from deckline.types import (
    SIDES,
    Detection,
    Diagnostic,
    Diagnostics,
    EdgeKind,
    Frame,
    PixelLine,
    Reason,
    RunwayEstimate,
)

Array = NDArray[np.float64]
# Shares and limits were set on rendered approaches of presets paper, cvn, axial, small and train.
STEP, MARGIN = 0.01, 0.3  # of the width: sampling, and what is sampled beyond the lines
RIDGES = (3, 5, 9, 17)  # widths of a stripe, a ladder or a dashed line, in steps
MOST_ROWS, MIN_ROWS = 128, 8  # that are sampled; that must show paint
MIN_WIDTH_PX, MIN_CENTRE_PX = 12.0, 24.0  # of the runway in the middle row, for edges and for a centre line
SIDE = 0.1  # of the width: what of the deck beside both lines must be in the picture, in a row that is sampled
MIN_CONTRAST, NOISES = 4.0, 3.0  # of paint: grey levels, and over the deck between the lines
BESIDE, DECK = 0.235, 0.09  # from the middle to bare deck, and to each side of it, of the width
SAME_PLACE, SAME_PX = 0.02, 1.5  # of the width or px, that paint may lie beside its line
PAINTED = 0.3  # of the other line's contrast in the same row, from which a line is painted too
LEAST_PAINTED = 0.5  # of the rows
CENTRE, OTHERS = 0.17, 0.25  # a centre line may lie so far off the middle, of the width; other lines beside it
MIN_PROMINENCE = 0.2  # mean contrast of a centre line over that of its rivals, both over the edges'
RIVAL = 0.08  # from a centre line to what is another line
MIDWAY, MIDWAY_PX = 0.05, 0.7  # of the width and px, that a centre line may lie off the middle
LARGEST_EXCESS, FLAGGED, MOST = 0.45, 1.0, 2.0  # of one check, sum of the excess over the limits, in limits
FADING = 0.8  # of a sum below the flag, at a check that measures nothing
MESSAGES = {
    "left": "the picture shows no paint under the left line, though under the right one",
    "right": "the picture shows no paint under the right line, though under the left one",
    "centre left": "the painted centre line lies left of the middle between the lines",
    "centre right": "the painted centre line lies right of the middle between the lines",
}


@dataclass(frozen=True)
class PaintCheck:
    """The paint that one picture shows near two lines; None: not measurable."""

    left: float | None = None  # share of the rows with paint under the right line that have it under the left one too
    right: float | None = None  # the same of the right line
    centre: float | None = None  # where between the lines a centre line is painted: 0 left, 1 right
    width_px: float = 0.0  # of the runway in the middle row

    def excess(self) -> dict[str, float]:
        """By how much every measurement is beyond its limit, in limits; negative: it confirms the lines."""
        found = {}
        for side, share in (("left", self.left), ("right", self.right)):
            if share is not None:
                found[side] = 1.0 - share / LEAST_PAINTED
        if self.centre is not None:
            off = (self.centre - 0.5) / (MIDWAY + MIDWAY_PX / max(self.width_px, 1.0))
            found |= {"centre left": -off - 1.0, "centre right": off - 1.0}
        return found


class PaintMonitor:
    """Compares the paint in the picture with the detected lines; a `Monitor`.

    A check takes two milliseconds, within the frame, without lens distortion, which bends the lines. Only painted edges
    are checked.

    Args:
        every_s: from one check to the next; 0: none.
    """

    def __init__(self, every_s: float) -> None:
        self.every_s = every_s
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._flags: Diagnostics = ()
        self._sums = dict.fromkeys(MESSAGES, 0.0)
        self._last_s = -np.inf  # time of the last picture that was checked

    def close(self) -> None:
        """No threads to end."""

    def update(self, frame: Frame, estimate: RunwayEstimate, detection: Detection | None) -> Diagnostics:
        """Check the picture when it is time."""
        if detection is None:
            return self._flags
        lines = estimate.pixel_lines
        is_painted = detection.edge in (None, EdgeKind.PAINT)
        is_due = self.every_s > 0 and frame.time_s - self._last_s >= self.every_s
        if is_due and is_painted and set(SIDES) <= set(lines):
            self._last_s = frame.time_s
            left, right = (_straighten(lines[side], frame.camera) for side in SIDES)
            self._accumulate(find_paint(rectify(frame.image_rgb, frame.camera), left, right))
        return self._flags

    def _accumulate(self, found: PaintCheck) -> None:
        excess = found.excess()
        for what, before in self._sums.items():
            if what in excess:
                self._sums[what] = min(max(before + min(excess[what], LARGEST_EXCESS), 0.0), MOST)
            elif before < FLAGGED:
                self._sums[what] = FADING * before
        worst = max(self._sums, key=lambda what: self._sums[what])
        self._flags = (Diagnostic(Reason.PAINT, MESSAGES[worst]),) if self._sums[worst] >= FLAGGED else ()


def find_paint(image_rgb: NDArray[np.uint8], left: PixelLine, right: PixelLine) -> PaintCheck:
    """Find paint under both lines, and a centre line, in the rows that both have.

    Args:
        image_rgb: (H, W, 3).
        left, right: edge lines in its pixels.
    """
    height, width = image_rgb.shape[:2]
    top = max(left.ends_px[:, 1].min(), right.ends_px[:, 1].min(), 0.0)
    bottom = min(left.ends_px[:, 1].max(), right.ends_px[:, 1].max(), height - 1.0)
    if bottom - top < MIN_ROWS - 1:
        return PaintCheck()
    rows = np.unique(np.linspace(np.ceil(top), np.floor(bottom), MOST_ROWS).astype(np.int64))
    start, end = _u_at(left, rows), _u_at(right, rows)
    side = SIDE * (end - start)
    inside = (start >= side) & (end + side <= width - 1)
    rows, start, end = rows[inside], start[inside], end[inside]
    if len(rows) < MIN_ROWS or not (width_px := float(np.median(end - start))) >= MIN_WIDTH_PX:
        return PaintCheck()
    place = np.arange(-MARGIN, 1.0 + MARGIN + STEP / 2, STEP)
    u = start[:, None] + (end - start)[:, None] * place
    sizes = [size for size in RIDGES if size * STEP * width_px >= 1.0]
    ridges = np.maximum(ridge_response(_sample_rows(image_rgb, rows, u), sizes), 0.0)
    ridges[(u < 0) | (u > width - 1)] = 0.0
    return _measure_ridges(ridges, place, width_px)


def _straighten(line: PixelLine, camera: Camera) -> PixelLine:
    """The line with its ends where a camera without lens distortion sees them."""
    return replace(line, ends_px=undistort(line.ends_px, camera))


def _u_at(line: PixelLine, v: NDArray[np.int64]) -> Array:
    a, b, c = line.coefficients
    return np.asarray(-(b * v + c) / (a if abs(a) > 1e-9 else 1e-9))


def _sample_rows(image_rgb: NDArray[np.uint8], rows: NDArray[np.int64], u: Array) -> Array:
    """The darkest colour (N, M), as paint is white, at u (N, M) of rows (N,)."""
    red, green, blue = (image_rgb[rows, :, colour] for colour in range(3))
    level = np.minimum(np.minimum(red, green), blue)
    low = np.clip(np.floor(u), 0, level.shape[1] - 2).astype(np.int64)
    share = np.clip(u - low, 0.0, 1.0)
    row = np.arange(len(rows))[:, None]
    return np.asarray((1.0 - share) * level[row, low] + share * level[row, low + 1])


def ridge_response(level: NDArray[Any], sizes: Iterable[int], border: str = "reflect") -> NDArray[Any]:
    """How much every place (N, M) of rows is brighter than both its sides, at the best of the sizes of a ridge.

    Args:
        level: (N, M) grey levels.
        sizes: widths of a ridge, in places; wider ones than the rows are left out.
        border: how rows go on beyond their ends, as scipy.ndimage names it.

    Returns:
        (N, M) of the levels' type, negative where there is no ridge, -255 where no size fits.
    """
    best = np.full_like(level, -255.0)
    for size in sizes:
        reach = size + 1
        if level.shape[1] <= 2 * reach + size:
            continue
        mean = uniform_filter1d(level, size, axis=1, mode=border)
        inner = mean[:, reach:-reach] - np.maximum(mean[:, : -2 * reach], mean[:, 2 * reach :])
        np.maximum(best[:, reach:-reach], inner, out=best[:, reach:-reach])
    return best


def _measure_ridges(ridges: Array, place: Array, width_px: float) -> PaintCheck:
    beside = max(round(SAME_PLACE / STEP), round(SAME_PX / width_px / STEP))
    near = maximum_filter1d(ridges, 2 * beside + 1, axis=1)
    left, right = (near[:, int(np.argmin(np.abs(place - edge)))] for edge in (0.0, 1.0))
    decks = (np.abs(place - middle) < DECK for middle in (0.5 - BESIDE, 0.5 + BESIDE))
    noise = min(float(np.quantile(ridges[:, deck], 0.84)) for deck in decks)  # another line may lie on one side
    least = max(MIN_CONTRAST, NOISES * noise)
    shares = [_share_painted(own, other, least) for own, other in ((left, right), (right, left))]
    if all(share is not None and share < LEAST_PAINTED for share in shares):  # lights, noise
        shares = [None, None]
    edges = np.minimum(left, right)
    both = edges > least
    is_clear = both.sum() >= MIN_ROWS and width_px >= MIN_CENTRE_PX
    centre = _find_centre(near[both] / edges[both, None], place, beside * STEP) if is_clear else None
    return PaintCheck(shares[0], shares[1], centre, width_px)


def _share_painted(own: Array, other: Array, least: float) -> float | None:
    """Share of the rows with paint under the other line that have it under the own one; None with too few rows."""
    seen = other > least
    return float(np.mean(own[seen] > PAINTED * other[seen])) if seen.sum() >= MIN_ROWS else None


def _find_centre(contrast: Array, place: Array, beside: float) -> float | None:
    """Where the one line between the edges lies; None where there is none, or more than one."""
    mean = np.minimum(contrast, 1.0).mean(axis=0)
    middle = np.abs(place - 0.5)
    is_peak = (mean >= maximum_filter1d(mean, 2 * round(RIVAL / STEP) + 1)) & (middle < OTHERS)
    peaks = np.where(is_peak, mean, 0.0)
    best, first = float(peaks.max()), float(place[peaks.argmax()])
    near = np.abs(place - first) <= RIVAL + beside
    at = float(place[near & (mean >= 0.95 * best)].mean())
    is_prominent = best - float(peaks[~near].max()) >= MIN_PROMINENCE
    return at if is_prominent and abs(at - 0.5) < CENTRE else None
