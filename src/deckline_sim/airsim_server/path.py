"""A path of straight lines, and how far along it a vehicle is."""

import numpy as np

from deckline_sim.airsim_server.kinematics import Vector

CORNER_M = 0.05  # a later line of the path that is nearer than an earlier one, but for this, is the present one


class Path:
    """Straight lines through points (3,), at least two, which may repeat."""

    def __init__(self, points: list[Vector]) -> None:
        self._corners = np.array(points)
        steps = np.diff(self._corners, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        self._along = steps / np.maximum(lengths, 1e-9)[:, None]
        self._ends = np.concatenate([[0.0], np.cumsum(lengths)])

    @property
    def length_m(self) -> float:
        return float(self._ends[-1])

    @property
    def end(self) -> Vector:
        """The last point (3,)."""
        return np.asarray(self._corners[-1])

    def point_at(self, way_m: float) -> Vector:
        """The point (3,) at a way along the path; beyond its ends, they."""
        return np.array([np.interp(way_m, self._ends, column) for column in self._corners.T])

    def nearest_way(self, place: Vector, from_m: float, to_m: float) -> float:
        """The way between two others that is nearest to a place (3,); the later one where the path turns back."""
        first, last = (int(np.searchsorted(self._ends, way_m, side="right")) - 1 for way_m in (from_m, to_m))
        nearest, least_m = from_m, np.inf
        for k in range(first, min(last, len(self._along) - 1) + 1):
            way_m = self._ends[k] + float((place - self._corners[k]) @ self._along[k])
            way_m = min(max(way_m, from_m, self._ends[k]), to_m, self._ends[k + 1])
            off_m = float(np.linalg.norm(place - self.point_at(way_m)))
            if off_m <= least_m + CORNER_M:
                nearest, least_m = way_m, min(off_m, least_m)
        return float(nearest)
