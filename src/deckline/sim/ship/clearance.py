"""Room on deck: how far things are from the runway and from the deck's edge."""

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import Mesh
from deckline.sim.ship.paint import axes

FLUSH_M = 0.03  # what rises less than this above the deck hides nothing
BEYOND_M = 6.0  # the runway stays clear this far beyond the end of its longer line
CLEAR_M = 3.5  # nothing above the deck comes closer to a runway line's middle than this


def runway_distance(layout: Layout, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far deck points (..., 2) lie outside the strip between the runway lines; negative inside.

    The strip goes on beyond both ends of the lines.
    """
    distances = []
    for line, side in ((layout.left_m, -1.0), (layout.right_m, 1.0)):
        _, right, _ = axes(*line)
        distances.append(side * ((points_m - line[0]) @ right))
    return np.maximum(distances[0], distances[1])


def edge_distance(layout: Layout, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far deck points (..., 2) lie inside the deck's edge, measured across and along the ship; negative outside."""
    x, y = points_m[..., 0], points_m[..., 1]
    port, starboard = (np.interp(x, layout.stations_m, edge) for edge in (layout.port_m, layout.starboard_m))
    return np.minimum.reduce([y - port, starboard - y, x, layout.length_m - x])


def has_room(layout: Layout, runway: bool, polygon_m: NDArray[np.float64], edge_m: float = 0.0) -> bool:
    """Whether a footprint (N, 2) lies on the deck, `edge` inside its edge, and clear of the runway if there is one."""
    if np.min(edge_distance(layout, polygon_m)) < edge_m:
        return False
    return not runway or bool(np.min(runway_distance(layout, polygon_m)) >= CLEAR_M)


def before_end(layout: Layout, points_m: NDArray[np.float64], beyond_m: float = BEYOND_M) -> NDArray[np.bool_]:
    """Which deck points (..., 2) lie astern of a cross line so far beyond the runway's end."""
    along, _, length = axes(*layout.centre_m)
    far = max(length, *(axes(*line)[2] for line in (layout.left_m, layout.right_m))) + beyond_m
    return (points_m - layout.centre_m[0]) @ along < far


def clear_of_runway(layout: Layout, mesh: Mesh) -> Mesh:
    """A mesh without the faces above the deck that reach too close to the runway: a yard's end, a rail's corner."""
    points = mesh[:, :2].astype(np.float64)
    close = (mesh[:, 2] < -FLUSH_M) & (runway_distance(layout, points) < CLEAR_M) & before_end(layout, points)
    return mesh[np.repeat(~close.reshape(-1, 3).any(axis=1), 3)]
