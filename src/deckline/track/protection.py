"""Protection levels against what the fault tests miss.

A fault of size m that no test shows moves the estimate by P_xb / P_bb(0) m (the posterior of a Gaussian with a wrong
prior mean). The protection level adds the largest of these, over faults up to the smallest size that one of the tests
surely shows, or the largest size that is possible.
"""

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.probability import two_sided_quantile
from deckline.track.extent import Extent
from deckline.track.filter import delay_effect, line_rows
from deckline.track.motion import Pose
from deckline.track.prior_tests import PriorTests, drift_share, is_drift_known, spacing_row
from deckline.track.states import FAULTS, FilterState, States, drift_sigma, error_sigmas, width_sigma_m
from deckline.types import Protection, Value

Array = NDArray[np.float64]


def fault_gains(state: FilterState, near_m: float, config: RunConfig) -> Array:
    """What a unit of each possible fault moves the estimated states by, (20, 9): P_xb / P_bb(0).

    The faults are the shared errors, each in its own unit, and the stated width, m; `near_m` as in `prior_tests`.
    """
    gains = np.zeros((States.SIZE, FAULTS))
    gains[:, :-1] = state.covariance[:, States.SHARED_ERRORS] / error_sigmas(config) ** 2
    if config.deck.width_m is not None:
        gains[:, -1] = state.covariance @ spacing_row(near_m) / width_sigma_m(config) ** 2
    return gains


def least_closing_speed(state: FilterState, pose: Pose, closing: Value | None, config: RunConfig) -> float:
    """Lower bound on the closing speed, m/s: over a ship whose velocity is stated, else over the fastest that is
    possible, or over the ramp as it moves in the pictures.

    Args:
        closing: measured by the ramp's motion; None: not known.
    """
    along = float(pose.velocity_m_s @ state.along)
    if config.deck.ship_velocity_m_s is not None:
        return along - float(np.array(config.deck.ship_velocity_m_s) @ state.along[:2])
    slowest = along - config.integrity.max_ship_m_s
    if closing is None:
        return slowest
    return max(slowest, closing.value - two_sided_quantile(config.integrity.risk) * closing.sigma)


def undetected_yaw(state: FilterState, closing_m_s: float, config: RunConfig) -> float | None:
    """Bound on the yaw of a turned camera, rad, by the lines' drift or as its builder states; None: nothing bounds it.

    Args:
        closing_m_s: the least that is possible.
    """
    stated, shown = config.integrity.mount_yaw_deg, _yaw_by_drift(state, closing_m_s, config)
    if stated is None:
        return shown
    bound = float(np.deg2rad(stated))
    return bound if shown is None else min(bound, shown)


def _yaw_by_drift(state: FilterState, closing_m_s: float, config: RunConfig) -> float | None:
    """Bound on the yaw by the drift of the lines, rad; None: there is none.

    A camera that is turned by psi sees the lines drift at closing speed times sin(psi), and no picture shows more of
    it. The drift that a ship explains is its largest, or, where its velocity is stated, that velocity's error. What
    is left of the estimate, with its quantile, may be yaw.
    """
    if not is_drift_known(state, config):
        return None
    test, share = config.integrity, drift_share(state, config)
    quantile = two_sided_quantile(test.risk)
    drift = abs(float(state.mean[States.DRIFT])) / share  # as frames measured it, without the prior
    if config.deck.ship_velocity_m_s is None:
        noise = float(state.covariance[States.DRIFT, States.DRIFT]) / share
        drift += test.max_drift_m_s + quantile * float(np.sqrt(noise))
    else:
        drift += quantile * drift_sigma(config) / float(np.sqrt(share))
    if drift > closing_m_s * np.sin(np.deg2rad(test.max_yaw_deg)):
        return None
    return float(np.arcsin(drift / closing_m_s))


def protection_levels(
    state: FilterState,
    pose: Pose,
    touchdown_m: float | None,
    ramp: Extent | None,
    tests: PriorTests,
    yaw_rad: float | None,
    far: float,
    config: RunConfig,
) -> Protection:
    """Bounds on errors of the lateral deviation beside the aircraft, of the deck's height at touchdown, of the heading
    and of the distance to the ramp.

    All are as seen from the aircraft: an error of its own position or heading moves them with it. They hold for one
    fault at a time of those that `Integrity` names.

    Args:
        touchdown_m: touchdown point, m along the line from the state's point; None: not known, the point itself.
        ramp: None: not known.
        tests: by `prior_tests`.
        yaw_rad: by `undetected_yaw`.
        far: times by which 1-sigmas of place and direction are too small from so far away.
    """
    x = float(state.local(pose.position_m)[0])
    delay, sensors = delay_effect(state, pose, 0.0), config.sensors
    near_m = 0.0 if touchdown_m is None else touchdown_m - config.approach.touchdown_m
    gains, quantile = fault_gains(state, near_m, config), two_sided_quantile(config.integrity.risk)
    faults = _undetected_faults(tests, gains, config)

    def bound(row: Array, white: float, times: float) -> tuple[float, float]:
        """Of the filter's own error, and of one undetected fault."""
        sigma = float(np.sqrt(row @ state.covariance @ row + white**2))
        return quantile * times * sigma, float(np.max(np.abs(row @ gains) * faults))

    at_touchdown = line_rows(state, 0.0, touchdown_m or 0.0, delay)
    chance, fault = bound(at_touchdown[1], sensors.attitude_white_rad, far)
    distance_m = None
    if ramp is not None:
        distance_m = quantile * far * float(np.hypot(ramp.sigma_m, sensors.position_white_m))
        distance_m += float(np.max(np.abs(ramp.response[0]) * faults))
    return Protection(
        lateral_m=sum(bound(line_rows(state, 0.0, x, delay)[0], sensors.position_white_m, far)),
        vertical_m=sum(bound(at_touchdown[2], sensors.position_white_m, 1.0)),
        heading_rad=None if yaw_rad is None else chance + max(fault, yaw_rad),
        distance_m=distance_m,
        risk=config.integrity.risk,
    )


def _undetected_faults(tests: PriorTests, gains: Array, config: RunConfig) -> Array:
    """The largest size (9,) of each possible fault that may stay undetected by any test, in its own unit.

    An error of size m moves another state's estimate by P_xb / P_bb(0) m, and its own by 1 - P_bb / P_bb(0).
    """
    test = config.integrity
    boresight = float(np.deg2rad(test.max_boresight_deg))
    largest = [boresight, boresight, test.max_deck_z_m, test.max_depth_scale, test.max_focal_fraction]
    width = 0.0 if config.deck.width_m is None else test.max_width_fraction * config.deck.width_m
    undetected = np.array([*largest, test.max_delay_s, test.max_line_m, test.max_line_m, width])
    estimated = np.zeros((States.SIZE, FAULTS))  # which state estimates which fault itself
    estimated[States.SHARED_ERRORS, :-1], estimated[States.SPACING, -1] = np.eye(FAULTS - 1), 1.0
    responses = np.abs(tests.rows @ gains - estimated[tests.indices])
    surely = (test.alarm_sigma + test.missed_sigma) * tests.sigmas
    return np.minimum(undetected, (surely[:, None] / np.maximum(responses, 1e-12)).min(axis=0, initial=np.inf))
