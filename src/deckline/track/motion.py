"""Motion between frames: the aircraft's velocity from its poses, and the deck as damped oscillations."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deckline.types import Frame

Array = NDArray[np.float64]
ACCELERATION_M_S15 = 2.0  # noise density of the aircraft's velocity; 0.2 g for a second
INITIAL_SPEED_SIGMA_M_S = 30.0  # of an unknown velocity; aircraft that land fly 70 m/s at most
TURN_RATE_WINDOW_S = 0.2  # over which the turn rate is averaged
JUMP_M, JUMP_SIGMA = 5.0, 6.0  # a pose farther from its prediction than both together has jumped
PITCH_PERIOD_S, ROLL_PERIOD_S = 12.0, 22.0  # of a large carrier; heave, 18 s, is covered by pitch
DAMPING = 0.3  # share of the critical damping: how little one oscillation resembles the next


@dataclass(frozen=True, eq=False)
class Pose:
    """The camera in one frame and how it moves; world frame, as the aircraft's navigation has it."""

    position_m: Array  # (3,)
    velocity_m_s: Array  # (3,)
    turn_rate_rad_s: Array  # (3,) about x, y and z of the world


@dataclass(frozen=True, eq=False)
class Aircraft:
    """Position and velocity, each axis filtered with the same covariance, and attitude."""

    time_s: float
    position_m: Array  # (3,)
    velocity_m_s: Array  # (3,)
    covariance: Array  # (2, 2) of one axis: position, velocity
    attitude: Rotation
    turn_rate_rad_s: Array  # (3,) world axes

    @property
    def velocity_sigma_m_s(self) -> float:
        return float(np.sqrt(self.covariance[1, 1]))

    def camera_pose(self, frame: Frame) -> Pose | None:
        """The frame's camera position with the aircraft's motion; None for a frame without a pose."""
        camera = frame.world_from_camera
        if camera is None:
            return None
        return Pose(camera.translation, self.velocity_m_s, self.turn_rate_rad_s)


def start_aircraft(frame: Frame, sigma_m: float) -> Aircraft | None:
    """An aircraft of which one pose is known; None for a frame without."""
    pose = frame.world_from_body
    if pose is None:
        return None
    covariance = np.diag([sigma_m**2, INITIAL_SPEED_SIGMA_M_S**2])
    return Aircraft(frame.time_s, pose.translation, np.zeros(3), covariance, pose.rotation, np.zeros(3))


def predict_aircraft(aircraft: Aircraft, time_s: float) -> Aircraft:
    """The aircraft at a later time without another pose: its velocity and turn rate stay."""
    dt = time_s - aircraft.time_s
    return replace(
        aircraft,
        time_s=time_s,
        position_m=aircraft.position_m + dt * aircraft.velocity_m_s,
        covariance=_predict_covariance(aircraft, dt),
        attitude=Rotation.from_rotvec(dt * aircraft.turn_rate_rad_s) * aircraft.attitude,
    )


def _predict_covariance(aircraft: Aircraft, dt: float) -> Array:
    """Covariance (2, 2) of one axis after a time, s."""
    transition = np.array([[1.0, dt], [0.0, 1.0]])
    process = ACCELERATION_M_S15**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return np.asarray(transition @ aircraft.covariance @ transition.T + process)


def advance_aircraft(aircraft: Aircraft, frame: Frame, sigma_m: float) -> tuple[Aircraft | None, float]:
    """The aircraft at a later frame, and by how much its pose jumped, m; 0: it did not.

    Args:
        frame: None is returned for one without a pose.
        sigma_m: of a pose's white noise.
    """
    pose = frame.world_from_body
    if pose is None:
        return None, 0.0
    dt = frame.time_s - aircraft.time_s
    predicted_m, covariance = aircraft.position_m + dt * aircraft.velocity_m_s, _predict_covariance(aircraft, dt)
    attitude, innovation = pose.rotation, pose.translation - predicted_m
    variance = covariance[0, 0] + sigma_m**2
    jump = float(np.linalg.norm(innovation))
    if jump > JUMP_M + JUMP_SIGMA * np.sqrt(variance):
        return start_aircraft(frame, sigma_m), jump
    gain = covariance[:, 0] / variance
    rest = np.eye(2) - np.outer(gain, [1.0, 0.0])
    turn_rate = (attitude * aircraft.attitude.inv()).as_rotvec() / dt
    share = 1.0 - np.exp(-dt / TURN_RATE_WINDOW_S)
    return Aircraft(
        frame.time_s,
        predicted_m + gain[0] * innovation,
        aircraft.velocity_m_s + gain[1] * innovation,
        rest @ covariance @ rest.T + sigma_m**2 * np.outer(gain, gain),
        attitude,
        aircraft.turn_rate_rad_s + share * (turn_rate - aircraft.turn_rate_rad_s),
    ), 0.0


def oscillate(dt_s: float, period_s: float) -> tuple[Array, Array]:
    """Transition (2, 2) of deflection and rate over a time, and its process noise (2, 2), for deflection of 1-sigma 1.

    With the noise, deflection and rate have their stationary covariance.
    """
    omega = 2 * np.pi / period_s
    decay, frequency = DAMPING * omega, omega * math.sqrt(1 - DAMPING**2)
    cos, sin = math.cos(frequency * dt_s), math.sin(frequency * dt_s) / frequency
    shape = np.array([[cos + decay * sin, sin], [-(omega**2) * sin, cos - decay * sin]])
    transition = math.exp(-decay * dt_s) * shape
    covariance = stationary_covariance(period_s)
    return transition, covariance - transition @ covariance @ transition.T


def expected_acceleration(period_s: float) -> Array:
    """Row (2,) that gives an oscillation's expected acceleration from its deflection and rate."""
    omega = 2 * np.pi / period_s
    return -np.array([omega**2, 2 * DAMPING * omega])


def stationary_covariance(period_s: float) -> Array:
    """Covariance (2, 2) of deflection and rate of an oscillation of 1-sigma deflection 1."""
    return np.diag([1.0, (2 * np.pi / period_s) ** 2])
