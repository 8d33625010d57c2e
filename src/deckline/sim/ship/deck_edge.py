"""The deck's edge: through given corner points, or drawn at random, and always wide enough for the runway lines.

Ship frame: x forward along the ship's axis, y to starboard, origin at the stern.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.plan import Point

STATION_M = 2.5  # spacing of the deck edge's corners
EDGE_MARGIN_M = 1.5  # deck that is always left outside a runway line's middle, beside half its marking
Edges = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]  # stations (N,), port and starboard y (N,)


def outline(
    length_m: float,
    port: Sequence[Point],
    starboard: Sequence[Point],
    left_m: NDArray[np.float64],
    right_m: NDArray[np.float64],
    margin_m: float = EDGE_MARGIN_M + 2.0,
) -> Edges:
    """Deck edge through corner points, widened where a runway line needs deck under it."""
    stations = np.linspace(0.0, length_m, round(length_m / STATION_M) + 1)
    edge_port = np.interp(stations, *np.transpose(port))
    edge_starboard = np.interp(stations, *np.transpose(starboard))
    for line in (left_m, right_m):
        on_line = (stations >= line[0, 0] - 6.0) & (stations <= line[1, 0] + 4.0)
        across = np.interp(stations[on_line], line[:, 0], line[:, 1])
        edge_port[on_line] = np.minimum(edge_port[on_line], across - margin_m)
        edge_starboard[on_line] = np.maximum(edge_starboard[on_line], across + margin_m)
    return stations, edge_port, edge_starboard


def random_outline(
    length_m: float, left_m: NDArray[np.float64], right_m: NDArray[np.float64], rng: np.random.Generator
) -> Edges:
    """A random deck edge around the lines."""
    margin = EDGE_MARGIN_M + (rng.uniform(1.0, 3.0) if length_m < 150.0 else rng.uniform(2.0, 7.0))
    shapes: tuple[Callable[..., list[Point]], ...] = (stepped_edge, sponson_edge, straight_edge, tapered_edge)
    same = shapes[rng.integers(4)] if rng.random() < 0.35 else None
    edges = []
    for side, stern in ((-1.0, left_m[0, 1]), (1.0, right_m[0, 1])):
        half = max(abs(stern) + margin, length_m * rng.uniform(0.05, 0.11))
        shape = shapes[rng.choice(4, p=[0.3, 0.4, 0.12, 0.18])] if same is None else same
        corners = shape(length_m, half, rng)
        if rng.random() < 0.4:  # stern corner cut away
            corners = [(0.0, corners[0][1] * rng.uniform(0.5, 0.95)), (rng.uniform(5.0, 18.0), half), *corners[1:]]
        edges.append([(x, side * y) for x, y in sorted(corners)])
    return outline(length_m, edges[0], edges[1], left_m, right_m, margin)


def stepped_edge(length_m: float, half_m: float, rng: np.random.Generator) -> list[Point]:
    """Wider amidships, with two slanted steps."""
    out, back = np.sort(rng.uniform(0.1, 0.85, 2)) * length_m
    step, wide = rng.uniform(2.0, 25.0), half_m * rng.uniform(1.0, 1.5)
    corners = [(0.0, half_m), (out, half_m), (min(out + step, back), wide), (back, wide)]
    corners.append((min(back + step, 0.9 * length_m), half_m))
    return [*corners, (0.93 * length_m, half_m), (length_m, half_m * rng.uniform(0.3, 1.0))]


def sponson_edge(length_m: float, half_m: float, rng: np.random.Generator) -> list[Point]:
    """One or two angled sponsons before a long narrowing bow, as on carriers with catapults."""
    corners = [(0.0, half_m)]
    count = rng.integers(1, 3)
    bounds = np.linspace(0.08, 0.78, count + 1) * length_m
    for begin, end in pairwise(bounds):
        a, b = np.sort(begin + (end - begin) * rng.uniform(0.05, 0.95, 2))
        wide = half_m * rng.uniform(1.1, 1.8)
        corners += [(a, half_m), (a + 0.15 * (b - a), wide), (b - rng.uniform(0.1, 0.5) * (b - a), wide), (b, half_m)]
    bow = half_m * rng.uniform(0.45, 0.85)
    return [*corners, (0.83 * length_m, (half_m + bow) / 2), (length_m, bow * rng.uniform(0.7, 1.0))]


def straight_edge(length_m: float, half_m: float, rng: np.random.Generator) -> list[Point]:
    """A rectangle, its bow corners perhaps cut."""
    return [
        (0.0, half_m),
        (length_m * rng.uniform(0.88, 0.99), half_m),
        (length_m, half_m * rng.uniform(0.4, 1.0)),
    ]


def tapered_edge(length_m: float, half_m: float, rng: np.random.Generator) -> list[Point]:
    """Widest somewhere amidships, narrowing to a pointed or ski-jump bow."""
    return [
        (0.0, half_m * rng.uniform(0.8, 1.0)),
        (length_m * rng.uniform(0.15, 0.45), half_m * rng.uniform(1.0, 1.3)),
        (length_m * rng.uniform(0.55, 0.75), half_m * rng.uniform(0.9, 1.1)),
        (length_m, half_m * rng.uniform(0.2, 0.6)),
    ]
