"""Measurement model: what a belief expects of a picture, as residuals with their derivatives.

A runway line is the ray's plane: n . r = 0 for a ray r to it and the normal n of the plane through camera and line.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import cross
from deckline.picture_pose.sights import HorizonSight, LineSight
from deckline.picture_pose.states import DIP_RAD, Belief, States

Array = NDArray[np.float64]
SIGN = {"left": -1.0, "right": 1.0}
BIAS = {"left": States.LEFT, "right": States.RIGHT}


class Mount(NamedTuple):
    """The camera's mounting as plain arrays: a scipy transform costs more than all else here."""

    rotation: Array  # (3, 3) body_from_camera
    translation: Array  # (3,) camera from body, body, m

    @classmethod
    def of(cls, body_from_camera: RigidTransform) -> "Mount":
        translation, rotation = body_from_camera.as_components()
        return cls(rotation.as_matrix(), np.asarray(translation))


@dataclass(frozen=True, eq=False)
class Innovation:
    """Measured minus expected, with how it depends on the states."""

    residuals: Array  # (m,)
    design: Array  # (m, 25)
    variance: Array  # (m,) of the measurement alone

    def __add__(self, other: "Innovation") -> "Innovation":
        return Innovation(
            np.concatenate([self.residuals, other.residuals]),
            np.vstack([self.design, other.design]),
            np.concatenate([self.variance, other.variance]),
        )

    def inflate(self, times: float) -> "Innovation":
        """The same with so many times the variance."""
        return Innovation(self.residuals, self.design, times * self.variance)


NOTHING = Innovation(np.zeros(0), np.zeros((0, States.SIZE)), np.zeros(0))


def line_innovation(belief: Belief, side: str, sight: LineSight, mount: Mount) -> Innovation:
    """Of one edge line: how far off its expected place it lies, at two points, normalised image coordinates."""
    mean, sign = belief.mean, SIGN[side]
    rotation = belief.rotation @ mount.rotation
    arm = belief.rotation @ mount.translation  # camera from body, runway frame
    local = _correct(sight.rays, mean)
    rays = local @ rotation.T
    distance, slope = mean[States.DISTANCE] - arm[0], mean[States.SLOPE]
    half, turn = sign / 2 * (mean[States.WIDTH] - mean[States.ANGLE] * distance), sign / 2 * mean[States.ANGLE]
    aside = half - mean[States.LATERAL] - arm[1] + mean[BIAS[side]]
    below = mean[States.HEIGHT] - arm[2] + slope * arm[0] + mean[States.CANT] * half
    normal = np.array([aside * slope - below * turn, below, -aside])
    by_aside = slope * rays[:, 0] - rays[:, 2]
    by_below = rays[:, 1] - turn * rays[:, 0]
    design = np.zeros((2, States.SIZE))
    design[:, States.LATERAL] = -by_aside
    design[:, BIAS[side]] = by_aside
    design[:, States.HEIGHT] = by_below
    by_half = by_aside + mean[States.CANT] * by_below
    design[:, States.WIDTH] = sign / 2 * by_half
    design[:, States.DISTANCE] = -turn * by_half
    design[:, States.ANGLE] = sign / 2 * (-distance * by_half - below * rays[:, 0])
    design[:, States.SLOPE] = aside * rays[:, 0] + arm[0] * by_below
    design[:, States.CANT] = half * by_below
    design[:, States.ATTITUDE] = cross(rays, normal)
    by_ray = normal @ rotation  # (3,) change of n . r with the ray, optical frame
    design[:, [States.FOCAL, States.CX, States.CY]] = _by_camera(local, mean, by_ray)
    scale = 1 / float(by_ray[:2] @ sight.across)
    return Innovation(-scale * (rays @ normal), scale * design, sight.sigma**2)


def ramp_innovation(belief: Belief, ray: Array, sigma_m: float, mount: Mount) -> Innovation:
    """Of the lines' near end: where a ray (3,) of the optical frame to it meets the deck, against the ramp, m."""
    mean = belief.mean
    rotation = belief.rotation @ mount.rotation
    arm = belief.rotation @ mount.translation
    local = _correct(ray[None], mean)
    x, _, z = rotation @ local[0]
    distance, slope = mean[States.DISTANCE] - arm[0], mean[States.SLOPE]
    below = mean[States.HEIGHT] - arm[2] + slope * mean[States.DISTANCE]  # of the deck at the ramp
    normal = np.array([below, 0.0, -distance])
    by_distance = slope * x - z
    design = np.zeros((1, States.SIZE))
    design[0, States.DISTANCE], design[0, States.HEIGHT] = by_distance, x
    design[0, States.SLOPE] = x * mean[States.DISTANCE]
    design[0, States.ATTITUDE] = cross(rotation @ local[0], normal)
    design[:, [States.FOCAL, States.CX, States.CY]] = _by_camera(local, mean, normal @ rotation)
    scale = 1 / by_distance
    return Innovation(np.array([-scale * (below * x - distance * z)]), scale * design, np.array([sigma_m**2]))


def horizon_innovation(belief: Belief, sight: HorizonSight, mount: Mount) -> Innovation:
    """Of the horizon's height, rad, and of its tilt, rad."""
    mean = belief.mean
    rotation = belief.rotation @ mount.rotation
    local = _correct(sight.middle[None], mean)
    ray, step = rotation @ local[0], rotation @ np.array([1.0, sight.slope, 0.0])
    length, along = float(np.linalg.norm(ray)), float(np.linalg.norm(step))
    down = np.array([0.0, 0.0, 1.0])
    design = np.zeros((2, States.SIZE))
    design[0, States.ATTITUDE], design[1, States.ATTITUDE] = cross(ray, down) / length, cross(step, down) / along
    design[:1, [States.FOCAL, States.CX, States.CY]] = _by_camera(local, mean, rotation[2]) / length
    design[0, States.HORIZON_UP] = design[1, States.HORIZON_TILT] = 1.0
    expected = ray[2] / length - DIP_RAD + mean[States.HORIZON_UP], step[2] / along + mean[States.HORIZON_TILT]
    variance = np.array([sight.sigma / length, sight.slope_sigma / along]) ** 2
    return Innovation(-np.array(expected), design, variance)


def attitude_innovation(belief: Belief, level_from_body: Array, white_rad: float) -> Innovation:
    """Of roll and pitch as a sensor has them, rad: how far its vertical is off the belief's.

    Args:
        level_from_body: (3, 3) of the sensor; its heading does not matter.
        white_rad: 1-sigma of its noise that is new in every frame.
    """
    down = belief.rotation @ level_from_body[2]  # the sensor's vertical in the runway's frame
    design = np.zeros((2, States.SIZE))
    design[:, States.ATTITUDE] = [[0.0, down[2], -down[1]], [-down[2], 0.0, down[0]]]
    design[[0, 1], [States.LEVEL_Y, States.LEVEL_X]] = 1.0, -1.0
    return Innovation(-down[:2], design, np.full(2, white_rad**2))


def _correct(rays: Array, mean: Array) -> Array:
    """Rays (N, 3) of the stated camera as those of the true one."""
    return (rays - [mean[States.CX], mean[States.CY], 0.0]) / [1 + mean[States.FOCAL], 1 + mean[States.FOCAL], 1.0]


def _by_camera(local: Array, mean: Array, by_ray: Array) -> Array:
    """Change (N, 3) of by_ray . ray with the errors of the focal length and of the principal point."""
    share = 1 + mean[States.FOCAL]
    by_point = np.broadcast_to(-by_ray[:2] / share, (len(local), 2))
    return np.column_stack([-(local[:, :2] @ by_ray[:2]) / share, by_point])


def lines_innovation(belief: Belief, sights: dict[str, LineSight], mount: Mount) -> Innovation:
    """Of some edge lines together."""
    total = NOTHING
    for side, sight in sights.items():
        total = total + line_innovation(belief, side, sight, mount)
    return total


def update(belief: Belief, innovation: Innovation) -> Belief:
    """Kalman update in Joseph's form, `States.CONSIDERED` left as stated."""
    gain = gain_of(belief.covariance, innovation)
    return belief.move(gain @ innovation.residuals, updated_covariance(belief.covariance, gain, innovation))


def gain_of(covariance: Array, innovation: Innovation) -> Array:
    """Gain (25, m) of a filter that takes `States.CONSIDERED` as stated, and leaves them alone.

    Their error is in the covariance all the same: `updated_covariance` holds for any gain. Source: Schmidt,
    "Application of state-space methods to navigation problems", 1966.
    """
    known = covariance.copy()
    known[States.CONSIDERED], known[:, States.CONSIDERED] = 0.0, 0.0
    across = known @ innovation.design.T
    variance = innovation.design @ across + np.diag(innovation.variance)
    return np.asarray(np.linalg.solve(variance, across.T).T, dtype=np.float64)


def updated_covariance(covariance: Array, gain: Array, innovation: Innovation) -> Array:
    """Covariance (25, 25) after an update with a gain, in Joseph's form, which holds for any gain."""
    rest = np.eye(States.SIZE) - gain @ innovation.design
    return rest @ covariance @ rest.T + (gain * innovation.variance) @ gain.T


def distance2(belief: Belief, innovation: Innovation) -> float:
    """Squared Mahalanobis distance of an innovation."""
    variance = innovation.design @ belief.covariance @ innovation.design.T + np.diag(innovation.variance)
    return float(innovation.residuals @ np.linalg.solve(variance, innovation.residuals))
