"""Paint on the deck, as triangles in deck metres.

A coat is float32 (N, 7): x, y (ship frame, metres), red, green, blue (0..1), opacity (0..1) and wear (0: even,
1: worn as much as the deck is) of three vertices per triangle. Later coats cover earlier ones.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline_sim.ship.mesh import Array, strip

Coat = NDArray[np.float32]
# Seven-segment figures: which of (top, upper left, upper right, middle, lower left, lower right, bottom) are painted.
SEGMENTS = (0x77, 0x12, 0x5D, 0x5B, 0x3A, 0x6B, 0x6F, 0x52, 0x7F, 0x7B)  # a bit each, the top one first


def polygons(corners_m: ArrayLike, rgb: ArrayLike, opacity: ArrayLike = 1.0, wear: float = 1.0) -> Coat:
    """Convex polygons (N, K, 2), or one, (K, 2); wear is that of all.

    Colour (3,) of all, or (N, 1, 3) of each; opacity of all, each (N, 1), each corner (K,), or all of them (N, K).
    """
    corners = np.asarray(corners_m, dtype=np.float64)
    corners = corners.reshape(-1, *corners.shape[-2:])
    sides = corners.shape[1]
    vertices = np.empty((len(corners), sides, 7), dtype=np.float32)
    vertices[..., :2] = corners
    vertices[..., 2:5] = np.asarray(rgb, dtype=np.float32)
    vertices[..., 5] = opacity
    vertices[..., 6] = wear
    fan = [index for k in range(1, sides - 1) for index in (0, k, k + 1)]
    return vertices[:, fan].reshape(-1, 7)


def axes(start_m: ArrayLike, end_m: ArrayLike) -> tuple[Array, Array, float]:
    """Unit vector from start to end (2,), the unit vector to its right (2,), and the length.

    Raises:
        ValueError: both ends are the same point.
    """
    delta = np.asarray(end_m, dtype=np.float64) - np.asarray(start_m, dtype=np.float64)
    length = float(np.hypot(*delta))
    if length == 0:
        raise ValueError(f"a painted line needs two different ends, got {np.asarray(start_m).tolist()} twice")
    along = delta / length
    return along, np.array([-along[1], along[0]]), length


def bars(
    line_m: ArrayLike,
    spans_m: ArrayLike,
    across_m: ArrayLike,
    rgb: ArrayLike,
    opacity: ArrayLike = 1.0,
    wear: float = 1.0,
) -> Coat:
    """Rectangles along a line (2, 2): `spans` (N, 2) from its start, `across` (2,) or (N, 2) to its right.

    Colours and opacities are those of `polygons`.
    """
    start, end = np.asarray(line_m)
    along, right, _ = axes(start, end)
    spans = np.asarray(spans_m, dtype=np.float64).reshape(-1, 2)
    across = np.broadcast_to(np.asarray(across_m, dtype=np.float64), spans.shape)
    s, t = spans[:, [0, 1, 1, 0], None], across[:, [0, 0, 1, 1], None]
    return polygons(start + s * along + t * right, rgb, opacity, wear)


def stripe(line_m: ArrayLike, width_m: float, rgb: ArrayLike, offset_m: float = 0.0) -> Coat:
    """A solid stripe whose middle lies `offset` to the right of the line (2, 2)."""
    length = axes(*np.asarray(line_m))[2]
    return bars(line_m, (0.0, length), (offset_m - width_m / 2, offset_m + width_m / 2), rgb)


def dashes(line_m: ArrayLike, width_m: float, rgbs: Sequence[ArrayLike], dash_m: float, gap_m: float) -> Coat:
    """A dashed stripe along a line (2, 2) whose colours take turns."""
    length = axes(*np.asarray(line_m))[2]
    first = np.arange(0.0, length, dash_m + gap_m)
    colours = np.asarray(rgbs, dtype=np.float64)[np.arange(len(first)) % len(rgbs)]
    spans = np.column_stack([first, np.minimum(first + dash_m, length)])
    return bars(line_m, spans, (-width_m / 2, width_m / 2), colours[:, None])


def ring(middle_m: ArrayLike, radius_m: float, width_m: float, rgb: ArrayLike, sides: int = 28) -> Coat:
    """A circle whose line, `width` wide, has its middle at the radius."""
    angle = np.arange(sides + 1) * 2 * np.pi / sides
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inner, outer = (radius_m - width_m / 2) * unit, (radius_m + width_m / 2) * unit
    return polygons(strip(inner, outer) + np.asarray(middle_m), rgb)


def streaks(starts_m: ArrayLike, ends_m: ArrayLike, widths_m: ArrayLike, rgbs: ArrayLike, opacities: ArrayLike) -> Coat:
    """Stains of widths (N,) that fade from their middle line, between points (N, 2), to their sides and ends.

    Colours (N, 3), opacities (N,).
    """
    start, end = (np.asarray(x, dtype=np.float64).reshape(-1, 2) for x in (starts_m, ends_m))
    delta = end - start
    right = np.stack([-delta[:, 1], delta[:, 0]], axis=1) / np.hypot(*delta.T)[:, None]
    half = right * (np.asarray(widths_m, dtype=np.float64) / 2)[:, None]
    spine = np.stack([start, start + 0.2 * delta, end - 0.25 * delta, end], axis=1)
    strong = np.asarray(opacities, dtype=np.float64)[:, None] * [0.0, 1.0, 1.0, 0.0]
    coats = []
    for k in range(3):
        for side in (-1.0, 1.0):
            sides = spine[:, [k, k + 1]] + side * half[:, None]
            corners = np.concatenate([spine[:, [k, k + 1]], sides[:, ::-1]], axis=1)
            faded = np.concatenate([strong[:, [k, k + 1]], np.zeros((len(start), 2))], axis=1)
            coats.append(polygons(corners, np.asarray(rgbs)[:, None], faded, wear=0.4))
    return np.stack([coat.reshape(len(start), 6, 7) for coat in coats], axis=1).reshape(-1, 7)


def blots(middles_m: ArrayLike, radii_m: ArrayLike, rgbs: ArrayLike, opacities: ArrayLike) -> Coat:
    """Round stains (N, 2) of radii (N,) in colours (N, 3) that fade from their middle (N,) to the rim."""
    angle = np.arange(13) * np.pi / 6
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    middle = np.asarray(middles_m, dtype=np.float64).reshape(-1, 1, 1, 2)
    radius = np.asarray(radii_m, dtype=np.float64).reshape(-1, 1, 1, 1)
    rim = np.stack([np.zeros((12, 2)), unit[:-1], unit[1:]], axis=1)
    corners = (middle + radius * rim).reshape(-1, 3, 2)
    strong = np.repeat(np.asarray(opacities, dtype=np.float64), 12)[:, None] * [1.0, 0.0, 0.0]
    return polygons(corners, np.repeat(np.asarray(rgbs), 12, axis=0)[:, None], strong, wear=0.3)


def figures(text: str, line_m: ArrayLike, height_m: float, rgb: ArrayLike) -> Coat:
    """Digits in blocks, read along a line (2, 2) from its start, their feet to its right."""
    wide, stroke, half = 0.6 * height_m, 0.14 * height_m, height_m / 2
    columns = ((0, wide), (0, stroke), (wide - stroke, wide))
    middle = (half - stroke / 2, half + stroke / 2)
    rows = ((0, stroke), (0, half), middle, (half, height_m), (height_m - stroke, height_m))
    segments = [(columns[c], rows[r]) for c, r in ((0, 0), (1, 1), (2, 1), (0, 2), (1, 3), (2, 3), (0, 4))]
    spans, across = [], []
    for shift, figure in zip(1.35 * wide * np.arange(len(text)), text, strict=True):
        for bit, (column, row) in enumerate(segments):
            if SEGMENTS[int(figure)] & 64 >> bit:
                spans.append((column[0] + shift, column[1] + shift))
                across.append(row)
    return bars(line_m, spans, across, rgb)


def layers(coats: Sequence[Coat]) -> Coat:
    """One coat of many, in order; empty for none."""
    return np.concatenate(coats) if coats else np.zeros((0, 7), dtype=np.float32)
