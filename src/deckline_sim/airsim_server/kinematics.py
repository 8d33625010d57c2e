"""The vehicle's motion, and the geometry of kinematic flight.

Vectors (3,) are in the world, North-East-Down, m, m/s, m/s^2.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

VELOCITY_S, YAW_RATE_S, LEAN_S = 0.3, 0.2, 0.2  # time constants
POSITION_PER_S = 1.0 / (4.0 * VELOCITY_S)  # wanted speed for each metre of distance: critically damped
BRAKING_M_S2 = 3.0  # planned for, so that some acceleration is left
GRAVITY_M_S2 = 9.80665
LEAST_DOWN = 0.3  # of the body's down axis along the world's: a lean of 73 deg

Vector = NDArray[np.float64]


class Ground(NamedTuple):
    """The surface below a point."""

    name: str  # Deck, or Sea or Ground beside it
    height_m: float  # of the point above it; inside the hull below zero


@dataclass(frozen=True, eq=False)
class VehicleMotion:
    """Pose and motion of the vehicle at one time."""

    time_s: float
    pose: RigidTransform  # world_from_body
    velocity: Vector
    acceleration: Vector
    rates: Vector  # (3,) about the body's axes, rad/s
    landed: bool
    ground: Ground


@dataclass(frozen=True, eq=False)
class Collision:
    """The last contact."""

    name: str
    time_s: float
    position: Vector
    normal: Vector


@dataclass(frozen=True)
class Yaw:
    """A demanded heading, rad, or yaw rate, rad/s; `along`: the heading is relative to the direction of flight."""

    is_rate: bool = True
    value: float = 0.0
    along: bool = False


NO_TURN = Yaw()


def towards(offset: Vector, speed_m_s: float) -> Vector:
    """Velocity (3,) along an offset (3,), at most `speed_m_s`, from which the vehicle stops at the offset's end."""
    distance = float(np.linalg.norm(offset))
    if distance < 1e-9:
        return np.zeros(3)
    return offset * (min(speed_m_s, braking_speed(distance)) / distance)


def braking_speed(distance_m: float) -> float:
    """The speed, m/s, from which the vehicle stops within a distance."""
    return min(POSITION_PER_S * distance_m, math.sqrt(2.0 * BRAKING_M_S2 * distance_m))


def limit(vector: Vector, most: float) -> Vector:
    """A vector, shortened to at most a length."""
    length = float(np.linalg.norm(vector))
    return vector if length <= most else vector * (most / length)


def wrap(angle_rad: float) -> float:
    """An angle between -pi and pi."""
    return math.remainder(angle_rad, 2.0 * math.pi)


def attitude_of(yaw_rad: float, lean_m_s2: Vector) -> Rotation:
    """world_from_body whose thrust holds the weight and gives a horizontal acceleration (2,), nose to the heading."""
    down = np.array([-lean_m_s2[0], -lean_m_s2[1], GRAVITY_M_S2])
    down /= np.linalg.norm(down)
    level = np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
    nose = np.array([*level, -(level @ down[:2]) / down[2]])
    nose /= np.linalg.norm(nose)
    return Rotation.from_matrix(np.column_stack([nose, np.cross(down, nose), down]))


def lean_of(attitude: Rotation) -> Vector:
    """The horizontal acceleration (2,) of a thrust that holds the weight: the inverse of `attitude_of`.

    Zero for attitudes on the side and upside down, whose thrust cannot hold it.
    """
    down = attitude.apply([0.0, 0.0, 1.0])
    lean: Vector = -GRAVITY_M_S2 * down[:2] / down[2] if down[2] > LEAST_DOWN else np.zeros(2)
    return lean
