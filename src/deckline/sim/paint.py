"""Paint on the deck, as triangles in deck metres.

A coat is float32 (N, 7): x, y (ship frame, metres), red, green, blue (0..1), opacity (0..1) and wear (0: even,
1: as worn as the deck's wear says) of three vertices per triangle. Later coats cover earlier ones.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Coat = NDArray[np.float32]
# Seven-segment figures: which of (top, upper left, upper right, middle, lower left, lower right, bottom) are painted.
SEGMENTS = (
    "1110111",
    "0010010",
    "1011101",
    "1011011",
    "0111010",
    "1101011",
    "1101111",
    "1010010",
    "1111111",
    "1111011",
)


def fill(polygon_m: ArrayLike, rgb: ArrayLike, opacity: ArrayLike = 1.0, wear: float = 1.0) -> Coat:
    """A convex polygon (N, 2); opacity may differ from corner to corner, (N,)."""
    corners = np.asarray(polygon_m, dtype=np.float64)
    n = len(corners)
    if corners.shape != (n, 2) or n < 3:
        raise ValueError(f"a painted polygon needs shape (N >= 3, 2), got {corners.shape}")
    vertices = np.empty((n, 7), dtype=np.float32)
    vertices[:, :2] = corners
    vertices[:, 2:5] = np.asarray(rgb, dtype=np.float32)
    vertices[:, 5] = opacity
    vertices[:, 6] = wear
    fan = [index for k in range(1, n - 1) for index in (0, k, k + 1)]
    return vertices[fan]


def axes(start_m: ArrayLike, end_m: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Unit vector from start to end (2,), the unit vector to its right (2,), and the length."""
    delta = np.asarray(end_m, dtype=np.float64) - np.asarray(start_m, dtype=np.float64)
    length = float(np.hypot(*delta))
    if length == 0:
        raise ValueError(f"a painted line needs two different ends, got {np.asarray(start_m).tolist()} twice")
    along = delta / length
    return along, np.array([-along[1], along[0]]), length


def quad(
    start_m: ArrayLike, end_m: ArrayLike, span_m: tuple[float, float], across_m: tuple[float, float]
) -> NDArray[np.float64]:
    """Corners (4, 2) of a rectangle along a line: `span` from its start, `across` to its right."""
    along, right, _ = axes(start_m, end_m)
    origin = np.asarray(start_m, dtype=np.float64)
    (a, b), (c, d) = span_m, across_m
    return np.array([origin + s * along + t * right for s, t in ((a, c), (b, c), (b, d), (a, d))])


def stripe(start_m: ArrayLike, end_m: ArrayLike, width_m: float, rgb: ArrayLike, offset_m: float = 0.0) -> Coat:
    """A solid stripe whose middle lies `offset` to the right of the line."""
    length = axes(start_m, end_m)[2]
    sides = (offset_m - width_m / 2, offset_m + width_m / 2)
    return fill(quad(start_m, end_m, (0.0, length), sides), rgb)


def dashes(
    start_m: ArrayLike, end_m: ArrayLike, width_m: float, rgbs: Sequence[ArrayLike], dash_m: float, gap_m: float
) -> Coat:
    """A dashed stripe whose colours take turns."""
    length = axes(start_m, end_m)[2]
    coats = []
    for k, s in enumerate(np.arange(0.0, length, dash_m + gap_m)):
        span = (float(s), min(float(s) + dash_m, length))
        coats.append(fill(quad(start_m, end_m, span, (-width_m / 2, width_m / 2)), rgbs[k % len(rgbs)]))
    return layers(coats)


def ladder(
    start_m: ArrayLike, end_m: ArrayLike, width_m: float, rail_m: float, bar_m: float, pitch_m: float, rgb: ArrayLike
) -> Coat:
    """Two stripes (`rail` wide, `width` from outside to outside) joined by bars every `pitch`."""
    length = axes(start_m, end_m)[2]
    offset = (width_m - rail_m) / 2
    coats = [stripe(start_m, end_m, rail_m, rgb, -offset), stripe(start_m, end_m, rail_m, rgb, offset)]
    inner = width_m / 2 - rail_m
    for s in np.arange(0.0, length - bar_m, pitch_m):
        coats.append(fill(quad(start_m, end_m, (float(s), float(s) + bar_m), (-inner, inner)), rgb))
    return layers(coats)


def soft_stripe(start_m: ArrayLike, end_m: ArrayLike, width_m: float, rgb: ArrayLike, opacity: float) -> Coat:
    """A stain that fades from its middle line to its sides."""
    length = axes(start_m, end_m)[2]
    coats = []
    for side in (-1.0, 1.0):
        corners = quad(start_m, end_m, (0.0, length), (0.0, side * width_m / 2))
        coats.append(fill(corners, rgb, [opacity, opacity, 0.0, 0.0], wear=0.4))
    return layers(coats)


def figures(text: str, start_m: ArrayLike, end_m: ArrayLike, height_m: float, rgb: ArrayLike) -> Coat:
    """Digits in blocks, read along start -> end, their feet to the right of that line."""
    wide, stroke = 0.6 * height_m, 0.14 * height_m
    half, full = height_m / 2, height_m
    spans = (
        ((0, wide), (0, stroke)), ((0, stroke), (0, half)), ((wide - stroke, wide), (0, half)),
        ((0, wide), (half - stroke / 2, half + stroke / 2)), ((0, stroke), (half, full)),
        ((wide - stroke, wide), (half, full)), ((0, wide), (full - stroke, full)),
    )  # fmt: skip
    coats = []
    for k, figure in enumerate(text):
        shift = 1.35 * wide * k
        for painted, (span, across) in zip(SEGMENTS[int(figure)], spans, strict=True):
            if painted == "1":
                corners = quad(start_m, end_m, (span[0] + shift, span[1] + shift), across)
                coats.append(fill(corners, rgb))
    return layers(coats)


def layers(coats: Sequence[Coat]) -> Coat:
    """One coat of many, in order; empty for none."""
    return np.concatenate(coats) if coats else np.zeros((0, 7), dtype=np.float32)
