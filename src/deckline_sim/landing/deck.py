"""The moving deck: where its runway is at a time, where an aircraft truly is relative to it, and what touches it."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline_sim.flight.viewpoints import ShipMotion, middle_m, ship_pose, steady_velocity, swing, swing_rates
from deckline_sim.ship.layout import Layout
from deckline_sim.ship.paint_shapes import axes

Float64 = NDArray[np.float64]


def rotation_matrix(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Float64:
    """(3, 3) of an attitude: world_from_body."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll_rad, pitch_rad, yaw_rad))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


@dataclass(frozen=True, eq=False)
class Deck:
    """A ship's landing area under way.

    Args:
        layout: the ship as it lies at time 0.
        motion: all its random choices made.
        touchdown_m: aim point beyond the beginning of the lines, along the centre line, m.
        wires_m: of the arresting wires beyond the beginning of the lines, m, the first one first.
    """

    layout: Layout
    motion: ShipMotion
    touchdown_m: float
    wires_m: tuple[float, ...]

    @cached_property
    def along(self) -> Float64:
        """(2,) unit vector of the centre line, ship frame."""
        return np.asarray(axes(*self.layout.centre_m)[0])

    @cached_property
    def right(self) -> Float64:
        """(2,) unit vector to the right of it, ship frame."""
        return np.asarray(axes(*self.layout.centre_m)[1])

    @cached_property
    def landing_direction(self) -> Float64:
        """(2,) unit vector of the centre line at time 0, world."""
        turned = self.layout.world_from_ship.rotation.apply([*self.along, 0.0])[:2]
        return np.asarray(turned / np.hypot(*turned))

    @cached_property
    def _ramp(self) -> Float64:
        """(2,) beginning of the centre line, ship frame."""
        return np.asarray(self.layout.centre_m[0])

    @cached_property
    def _at_rest(self) -> tuple[Float64, Float64, Float64, Float64]:
        """Turn (3, 3), place (3,) and velocity (3,) of the ship at time 0, and the point (3,) that it swings about."""
        pose = self.layout.world_from_ship
        velocity = steady_velocity(self.layout, self.motion)
        return pose.rotation.as_matrix(), np.array(pose.translation), velocity, middle_m(self.layout)

    def pose(self, time_s: float, steady: bool = False) -> tuple[Float64, Float64]:
        """Turn (3, 3) and place (3,) of the ship: world = turn @ ship + place.

        The same as `ship_pose`, a hundred times as fast: a landing asks for it some thousand times.

        Args:
            time_s: s.
            steady: without roll, pitch and heave.
        """
        turn, place, velocity, middle = self._at_rest
        place = place + velocity * time_s
        if steady:
            return turn, place
        (roll, pitch, heave), _ = swing(self.layout, self.motion, time_s)
        swung = rotation_matrix(float(roll), float(pitch), 0.0)
        return turn @ swung, place + turn @ (middle - swung @ middle) - [0.0, 0.0, float(heave)]

    def centre_line(self, time_s: float, steady: bool = False) -> Float64:
        """Beginning of the centre line and touchdown point (2, 3) in the world, m; arguments as for `pose`."""
        turn, place = self.pose(time_s, steady)
        return np.asarray(np.stack([self._ramp, self._ramp + self.touchdown_m * self.along]) @ turn[:, :2].T + place)

    def rise_m_s(self, time_s: float) -> float:
        """Upward speed of the touchdown point, m/s, of a ship that is level at rest; first order in the angles."""
        return self._upward(swing(self.layout, self.motion, time_s)[1])

    def acceleration_m_s2(self, time_s: float) -> float:
        """Upward acceleration of the touchdown point, m/s2, to the same order."""
        return self._upward(-(swing_rates(self.motion) ** 2) * swing(self.layout, self.motion, time_s)[0])

    def _upward(self, change: Float64) -> float:
        """Of the touchdown point, from a change (3,) of roll, pitch and heave."""
        roll, pitch, heave = change
        x, y = self._ramp + self.touchdown_m * self.along - self._at_rest[3][:2]
        return float(heave + pitch * x - roll * y)

    @property
    def velocity_m_s(self) -> Float64:
        """(3,) of the ship under way, world, m/s."""
        return self._at_rest[2]

    def moved_layout(self, time_s: float) -> Layout:
        """The ship as it lies at a time, with roll, pitch and heave."""
        return self.layout.at_pose(ship_pose(self.layout, self.motion, time_s))

    def in_ship_frame(self, points_m: ArrayLike, time_s: float) -> Float64:
        """World points (N, 3) in the ship's frame; z is positive below the deck's plane."""
        turn, place = self.pose(time_s)
        return np.asarray((np.asarray(points_m) - place) @ turn)

    def on_runway(self, ship_point_m: Float64) -> tuple[float, float]:
        """Of a point (3,) of the ship's frame: m beyond the beginning of the lines, m right of the centre line."""
        delta = ship_point_m[:2] - self._ramp
        return float(delta @ self.along), float(delta @ self.right)

    def is_over_deck(self, ship_point_m: Float64) -> bool:
        """Whether a point (3,) of the ship's frame lies within the outline of the deck, seen from above."""
        x, y = float(ship_point_m[0]), float(ship_point_m[1])
        if not 0.0 <= x <= self.layout.length_m:
            return False
        port, starboard = self.layout.edges_at(x)
        return bool(port <= y <= starboard)
