"""The aircraft's own motion from the poses of frames: velocity, turning, and whether the pose jumped."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deckline.track.state import Pose
from deckline.types import Frame

Array = NDArray[np.float64]
PUSH_M_S15 = 2.0  # how fast an aircraft's velocity changes; 0.2 g for a second
START_M_S = 30.0  # 1-sigma of a velocity of which nothing is known; aircraft that land fly 70 m/s at most
TURN_S = 0.2  # over which the turning is averaged
JUMP_M = 5.0  # a pose this far from where the aircraft was going has jumped, beside JUMP_SIGMAS
JUMP_SIGMAS = 6.0


@dataclass(frozen=True, eq=False)
class Aircraft:
    """Position and velocity, filtered alike along each axis, and attitude."""

    time_s: float
    position_m: Array  # (3,)
    velocity_m_s: Array  # (3,)
    covariance: Array  # (2, 2) of one axis: position, velocity
    attitude: Rotation
    turning_rad_s: Array  # (3,) world axes

    @property
    def velocity_sigma_m_s(self) -> float:
        return float(np.sqrt(self.covariance[1, 1]))


def first_seen(frame: Frame, sigma_m: float) -> Aircraft | None:
    """An aircraft of which one pose is known; None for a frame without."""
    pose = frame.world_from_body
    if pose is None:
        return None
    return Aircraft(
        frame.time_s, pose.translation, np.zeros(3), np.diag([sigma_m**2, START_M_S**2]), pose.rotation, np.zeros(3)
    )


def flown(before: Aircraft, frame: Frame, sigma_m: float) -> tuple[Aircraft | None, float]:
    """The aircraft one frame later, and by how much its pose jumped, m; 0: it did not.

    Args:
        before: at an earlier time.
        frame: None is returned for one without a pose.
        sigma_m: of a pose's white noise.
    """
    pose = frame.world_from_body
    if pose is None:
        return None, 0.0
    dt = frame.time_s - before.time_s
    move = np.array([[1.0, dt], [0.0, 1.0]])
    push = PUSH_M_S15**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    covariance = move @ before.covariance @ move.T + push
    away = pose.translation - before.position_m - dt * before.velocity_m_s
    spread = covariance[0, 0] + sigma_m**2
    far = float(np.linalg.norm(away))
    if far > JUMP_M + JUMP_SIGMAS * np.sqrt(spread):
        return first_seen(frame, sigma_m), far
    gain = covariance[:, 0] / spread
    rest = np.eye(2) - np.outer(gain, [1.0, 0.0])
    turned = (pose.rotation * before.attitude.inv()).as_rotvec() / dt
    share = 1.0 - np.exp(-dt / TURN_S)
    turning = before.turning_rad_s + share * (turned - before.turning_rad_s)
    position = before.position_m + dt * before.velocity_m_s + gain[0] * away
    velocity = before.velocity_m_s + gain[1] * away
    smoothed = rest @ covariance @ rest.T + sigma_m**2 * np.outer(gain, gain)
    return Aircraft(frame.time_s, position, velocity, smoothed, pose.rotation, turning), 0.0


def pose_of(aircraft: Aircraft, frame: Frame) -> Pose | None:
    """The frame's pose with the aircraft's motion."""
    camera = frame.world_from_camera
    if camera is None:
        return None
    return Pose(camera.translation, aircraft.velocity_m_s, aircraft.turning_rad_s)
