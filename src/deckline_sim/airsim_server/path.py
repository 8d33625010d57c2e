"""Paths of straight legs between points, and the steering that follows them."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deckline_sim.airsim_server.kinematics import NO_TURN, Vector, Yaw, braking_speed, towards
from deckline_sim.airsim_server.vehicle import Vehicle, VehicleCommand

ARRIVED_M = 0.2
LOOKAHEAD_S, LEAST_LOOKAHEAD_M = 0.6, 0.75  # in time at the wanted speed: AirSim's own
SHARP_COS = math.cos(math.radians(100.0))  # a leg that turns by more begins where the vehicle has reached its corner


@dataclass(frozen=True, eq=False)
class Polyline:
    """Straight legs between corners.

    `corners`: (N, 3), N >= 1, m, world; no two successive ones are equal. `ways`: (N,), their distances from the first
    one along the legs, m.
    """

    corners: NDArray[np.float64]
    ways: NDArray[np.float64]

    @classmethod
    def through(cls, points: NDArray[np.float64]) -> Self:
        return cls(points, np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]))

    @property
    def length_m(self) -> float:
        return float(self.ways[-1])

    def point_at(self, way_m: float) -> Vector:
        """The point (3,) at a distance along the legs; beyond an end, the end."""
        return np.array([np.interp(way_m, self.ways, column) for column in self.corners.T])

    def closest_way(self, position: Vector, least_m: float, most_m: float) -> float:
        """The distance along the legs, between two, of the point closest to a position (3,)."""
        if len(self.ways) == 1:
            return 0.0
        first, last = np.minimum(np.searchsorted(self.ways, [least_m, most_m], side="right"), len(self.ways) - 1)
        starts = np.arange(first - 1, max(last, first))
        legs, lengths = np.diff(self.corners, axis=0)[starts], np.diff(self.ways)[starts]
        along = np.einsum("ij,ij->i", position - self.corners[starts], legs) / lengths
        ways = np.clip(self.ways[starts] + np.clip(along, 0.0, lengths), least_m, most_m)
        points = self.corners[starts] + legs * ((ways - self.ways[starts]) / lengths)[:, None]
        return float(ways[np.argmin(np.linalg.norm(points - position, axis=1))])


def split_at_sharp_corners(points: NDArray[np.float64]) -> list[Polyline]:
    """The path through points (N, 3) without repeated ones, cut at each corner that turns by more than SHARP_COS."""
    points = points[np.concatenate([[True], np.any(np.diff(points, axis=0) != 0.0, axis=1)])]
    legs = np.diff(points, axis=0)
    legs /= np.linalg.norm(legs, axis=1)[:, None]
    sharp = np.flatnonzero(np.einsum("ij,ij->i", legs[:-1], legs[1:]) < SHARP_COS) + 1
    ends = [0, *sharp.tolist(), len(points) - 1]
    return [Polyline.through(points[first : last + 1]) for first, last in pairwise(ends)]


def follow(
    body: Vehicle, points: list[Vector], speed: float, timeout_s: float, yaw: Yaw = NO_TURN, lookahead_m: float = -1.0
) -> VehicleCommand:
    """Fly along straight legs through points (3,), steering to a point `lookahead_m` ahead on them; -1: AirSim's.

    Corners are cut, but sharp ones are reached to ARRIVED_M, as the last point is: the point ahead does not pass them,
    since the way to it leads back from the corner.
    """
    sections = split_at_sharp_corners(np.array([body.position, *points]))
    ahead = lookahead_m if lookahead_m > 0.0 else max(LOOKAHEAD_S * speed, LEAST_LOOKAHEAD_M)
    number, done_m = 0, 0.0  # present section, and way along it

    def has_reached_end(body: Vehicle) -> bool:
        left_m = float(np.linalg.norm(sections[number].corners[-1] - body.position))
        return done_m + ahead >= sections[number].length_m and left_m <= ARRIVED_M

    def steer(body: Vehicle) -> Vector:
        nonlocal number, done_m
        if number < len(sections) - 1 and has_reached_end(body):
            number, done_m = number + 1, 0.0
        section = sections[number]
        reach_m = ahead + float(np.linalg.norm(body.position - section.point_at(done_m)))  # with the cross-track error
        done_m = section.closest_way(body.position, done_m, done_m + reach_m)
        if done_m + ahead >= section.length_m:
            return towards(section.corners[-1] - body.position, speed)
        aim = section.point_at(done_m + reach_m) - body.position
        return aim * (min(speed, braking_speed(section.length_m - done_m)) / max(float(np.linalg.norm(aim)), 1e-9))

    def is_done(body: Vehicle) -> bool:
        return number == len(sections) - 1 and has_reached_end(body)

    return VehicleCommand(steer, is_done, yaw, timeout_s)
