"""Shapes on a layer: (H, W, 4) red, green, blue and cover, 0..255, its colours weighted by the cover."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

SHIFT = 3  # fractional bits of OpenCV's coordinates

Layer = NDArray[Any]  # uint8
Points = NDArray[np.float64]
Place = Callable[[ArrayLike], Points]
Rng = np.random.Generator


def fill(layer: Layer, points: ArrayLike, colour: ArrayLike, cover: float = 255) -> None:
    """A polygon, (N, 2) px."""
    corners = np.rint(np.asarray(points) * (1 << SHIFT)).astype(np.int32)
    cv2.fillPoly(layer, [corners], (*to_scalar(colour), cover), cv2.LINE_AA, SHIFT)


def stroke(layer: Layer, points: ArrayLike, colour: ArrayLike, width_px: float = 1, closed: bool = False) -> None:
    """A line through points (N, 2) px."""
    corners = np.rint(np.asarray(points) * (1 << SHIFT)).astype(np.int32)
    cv2.polylines(layer, [corners], closed, (*to_scalar(colour), 255), max(1, round(width_px)), cv2.LINE_AA, SHIFT)


def to_scalar(colour: ArrayLike) -> list[float]:
    """A colour, or a grey, as OpenCV takes it."""
    values: list[float] = np.add(colour, np.zeros(3)).tolist()  # OpenCV clips them
    return values


def round_off(points: ArrayLike, first: float = 0.25) -> Points:
    """A closed polygon with its corners cut three times. Source: Chaikin 1974."""
    corners = np.asarray(points, dtype=np.float64)
    for share in (first, 0.25, 0.25):
        after = np.roll(corners, -1, axis=0)
        pair = np.stack([corners + share * (after - corners), after + share * (corners - after)], axis=1)
        corners = pair.reshape(-1, 2)
    return corners


def ellipse(centre: ArrayLike, radii: ArrayLike, start: float = 0.0, end: float = 2 * np.pi) -> Points:
    """Points of an ellipse, or of a part of it."""
    angle = np.linspace(start, end, 28)
    return np.add(centre, np.column_stack([np.cos(angle), np.sin(angle)]) * np.asarray(radii, dtype=np.float64))


def rectangle(u0: float, v0: float, u1: float, v1: float) -> Points:
    """Its corners."""
    return np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]], dtype=np.float64)


def bar(start: ArrayLike, end: ArrayLike, widths_px: ArrayLike, bend_px: float = 0.0, aside_px: float = 0.0) -> Points:
    """Outline of a bent bar, moved across by `aside_px`."""
    first, step = np.asarray(start, dtype=np.float64), np.subtract(end, start)
    wide, along = np.broadcast_to(widths_px, 2), np.linspace(0.0, 1.0, 9)[:, None]
    across = np.array([-step[1], step[0]]) / max(float(np.hypot(*step)), 1e-6)
    half = (wide[0] + (wide[1] - wide[0]) * along) / 2
    middle = first + step * along + across * (4 * along * (1 - along) * bend_px + aside_px)
    return np.vstack([middle - across * half, (middle + across * half)[::-1]])


def fill_below(layer: Layer, v: NDArray[np.float64], colour: ArrayLike) -> Points:
    """Fill what lies below rows `v`, equally spaced past both sides; returns that edge."""
    tall, width = layer.shape[:2]
    edge = np.column_stack([np.linspace(-0.1, 1.1, len(v)) * width, v])
    fill(layer, np.vstack([edge, [[1.2 * width, 2 * tall], [-0.2 * width, 2 * tall]]]), colour)
    return edge


def placer(centre: ArrayLike, size_px: float, turn_rad: float = 0.0, shear: float = 0.0) -> Place:
    """Maps a part's own coordinates to the picture."""
    axes = size_px * np.array([[np.cos(turn_rad), np.sin(turn_rad)], [shear - np.sin(turn_rad), np.cos(turn_rad)]])
    return lambda points: np.asarray(centre) + np.asarray(points) @ axes


def draw_tone(rng: Rng) -> NDArray[np.float64]:
    """Colour of a part: mostly dark, now and then grey, light or painted."""
    level = rng.choice([rng.uniform(4, 45), rng.uniform(40, 130), rng.uniform(140, 235)], p=[0.6, 0.27, 0.13])
    tint = 1 + (0.4 if rng.random() < 0.08 else 0.06) * rng.standard_normal(3)
    return np.asarray(np.clip(level * tint, 0, 250))


def log_uniform(low: float, high: float, rng: Rng) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def write(
    layer: Layer, words: str, origin: ArrayLike, size_px: float, colour: ArrayLike, font: int, stroke_px: int
) -> None:
    """A line of text from its lower left corner, px."""
    u, v = np.rint(np.asarray(origin)).astype(int).tolist()
    cv2.putText(layer, words, (u, v), font, size_px / 21, (*to_scalar(colour), 255), stroke_px, cv2.LINE_AA)
