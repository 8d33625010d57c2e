"""What a navigation unit says of the aircraft's true pose: drifting bias and white noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

STEP_SHARE = 0.1  # of the time constant between two drawn values of a bias; linear between them
POSITION, ATTITUDE, WHITE = 11, 12, 13  # random streams
LEAST_DRIFT_S = 1.0  # an error that changes faster is noise


@dataclass(frozen=True)
class NavigationConfig:
    """The navigation unit. The defaults are exact.

    A good unit (satellite carrier phase aided, navigation grade): position_bias_m 0.1, position_sigma_m 0.02,
    attitude_bias_deg 0.02, attitude_sigma_deg 0.005. A tactical one (satellite code aided): 1.5, 0.1, 0.1, 0.02.

    Args:
        position_sigma_m: 1-sigma of white noise on each axis.
        attitude_sigma_deg: 1-sigma of white noise about each body axis.
        position_bias_m: 1-sigma of a slowly drifting error on each axis.
        attitude_bias_deg: the same about each body axis.
        drift_s: time constant of the drift (first-order Gauss-Markov), at least 1.

    Raises:
        ValueError: a number out of its range.
    """

    position_sigma_m: float = 0.0
    attitude_sigma_deg: float = 0.0
    position_bias_m: float = 0.0
    attitude_bias_deg: float = 0.0
    drift_s: float = 60.0

    def __post_init__(self) -> None:
        for name in ("position_sigma_m", "attitude_sigma_deg", "position_bias_m", "attitude_bias_deg"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if not LEAST_DRIFT_S <= self.drift_s < np.inf:
            raise ValueError(f"drift_s must be at least {LEAST_DRIFT_S:g}, got {self.drift_s}")

    @property
    def exact(self) -> bool:
        return not any((self.position_sigma_m, self.attitude_sigma_deg, self.position_bias_m, self.attitude_bias_deg))


def measured_pose(
    world_from_body: RigidTransform, time_s: float, config: NavigationConfig, seed: int
) -> RigidTransform:
    """The pose as the unit measures it; its error follows from the time and the seed alone.

    Raises:
        ValueError: a negative time.
    """
    if config.exact:
        return world_from_body
    white = np.random.default_rng([seed, WHITE, round(time_s * 1e6)]).standard_normal((2, 3))
    shift = (
        config.position_bias_m * drift(time_s, config.drift_s, [seed, POSITION]) + config.position_sigma_m * white[0]
    )
    turn = config.attitude_bias_deg * drift(time_s, config.drift_s, [seed, ATTITUDE])
    turn = np.deg2rad(turn + config.attitude_sigma_deg * white[1])
    return RigidTransform.from_components(
        world_from_body.translation + shift, world_from_body.rotation * Rotation.from_rotvec(turn)
    )


def drift(time_s: float, constant_s: float, seed: list[int]) -> NDArray[np.float64]:
    """Three independent first-order Gauss-Markov processes (3,) of unit variance at a time from their start on.

    Raises:
        ValueError: a negative time.
    """
    if not 0 <= time_s < np.inf:
        raise ValueError(f"time must not be negative, got {time_s} s")
    step_s = STEP_SHARE * constant_s
    last = int(time_s // step_s) + 1
    keep = np.exp(-STEP_SHARE)
    noise = np.random.default_rng(seed).standard_normal((last + 1, 3))
    noise[1:] *= np.sqrt(1.0 - keep**2)
    values = noise[0]
    for fresh in noise[1:]:
        before, values = values, keep * values + fresh
    share = time_s / step_s - (last - 1)
    mixed = (1 - share) * before + share * values
    return np.asarray(mixed / np.sqrt(1 - 2 * share * (1 - share) * (1 - keep)))  # mixing would lessen the variance
