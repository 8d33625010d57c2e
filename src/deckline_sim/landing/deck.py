"""The moving deck: where its runway is at a time, where an aircraft truly is relative to it, and what touches it."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline_sim.flight.viewpoints import ShipMotion, middle_m, steady_pose, steady_velocity, swing
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
class DeckPosition:
    """Where a point of the aircraft is relative to the runway, in its true place at that time."""

    to_touchdown_m: float
    """Along the centre line, horizontal, m; positive: the touchdown point is ahead."""
    lateral_m: float
    """To the right of the centre line, horizontal, m."""
    height_m: float
    """Above the touchdown point, m."""
    heading_rad: float
    """Direction of landing, world, rad."""


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

    def pose(self, time_s: float) -> tuple[Float64, Float64]:
        """Turn (3, 3) and place (3,) of the ship with roll, pitch and heave: world = turn @ ship + place.

        The same as `ship_pose`, a hundred times as fast: a landing asks for it some thousand times.
        """
        turn, place, velocity, middle = self._at_rest
        (roll, pitch, heave), _ = swing(self.layout, self.motion, time_s)
        swung = rotation_matrix(float(roll), float(pitch), 0.0)
        moved = place + velocity * time_s + turn @ (middle - swung @ middle) - [0.0, 0.0, float(heave)]
        return turn @ swung, moved

    def ramp_at_rest(self, time_s: float) -> Float64:
        """Beginning of the centre line (3,), world, m, without roll, pitch and heave."""
        return np.asarray(steady_pose(self.layout, self.motion, time_s).apply([*self.layout.centre_m[0], 0.0]))

    def position(self, point_m: ArrayLike, time_s: float) -> DeckPosition:
        """Where a point (3,) of the world is relative to the runway at a time."""
        turn, place = self.pose(time_s)
        touchdown = turn[:, :2] @ (self._ramp + self.touchdown_m * self.along) + place
        direction = turn[:, :2] @ self.along
        heading = math.atan2(direction[1], direction[0])
        delta = np.asarray(point_m) - touchdown
        cosine, sine = math.cos(heading), math.sin(heading)
        return DeckPosition(
            -float(delta[0] * cosine + delta[1] * sine),
            float(delta[1] * cosine - delta[0] * sine),
            -float(delta[2]),
            heading,
        )

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
