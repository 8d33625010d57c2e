"""Fault tests of the filter's bias states, and protection levels against what these tests miss.

The filter estimates the errors that all frames share from how lines change on the approach: with a wrong deck height,
for example, lines drift apart as the aircraft descends. An estimate farther from zero than its variance allows is a
fault. A fault of size m that no test shows moves the estimate by P_xb / P_bb(0) m (the posterior of a Gaussian with a
wrong prior mean). The protection level adds the largest of these, over faults up to the smallest size that is surely
detected, or the largest size that is possible.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from deckline.config import RunConfig
from deckline.track.filter import (
    ANGLE,
    ATTITUDE_X,
    ATTITUDE_Y,
    DECK,
    DELAY,
    DRIFT,
    FOCAL,
    LEFT,
    RIGHT,
    SCALE,
    SIZE,
    SPACING,
    State,
    drift_sigma,
    error_sigmas,
    width_sigma_m,
)
from deckline.track.measurement import GatedMeasurement
from deckline.track.motion import Pose
from deckline.track.output import delay_effect, line_rows
from deckline.types import Notice, Protection, Reason

Array = NDArray[np.float64]
OBSERVED_SHARE = 0.1  # of a prior's variance that must be gone before its estimate is tested
MIN_RESIDUALS = 10
MESSAGES = {
    ATTITUDE_X: (Reason.BORESIGHT, "degrees", "the camera seems rolled by {:+.2f} degrees against its mounting"),
    ATTITUDE_Y: (Reason.BORESIGHT, "degrees", "the camera seems pitched by {:+.2f} degrees against its mounting"),
    DECK: (Reason.HEIGHT, "m", "the deck's height or the aircraft's seems {:+.1f} m wrong"),
    SCALE: (Reason.DEPTH, "percent", "depths seem {:+.1f} % wrong"),
    FOCAL: (Reason.FOCAL, "percent", "the focal length seems {:+.2f} % wrong"),
    DELAY: (Reason.DELAY, "s", "the pose seems {:+.2f} s older than the picture"),
    LEFT: (Reason.LEFT, "m", "the left line seems to be another marking, {:+.1f} m beside it"),
    RIGHT: (Reason.RIGHT, "m", "the right line seems to be another marking, {:+.1f} m beside it"),
    SPACING: (Reason.SPACING, "m", "the lines' spacing is {:+.1f} m off what was stated"),
    ANGLE: (Reason.ANGLE, "degrees", "the angle between the lines is {:+.1f} degrees off what was stated"),
    DRIFT: (Reason.DRIFT, "m", "the lines drift sideways at {:+.1f} m/s, which neither ship nor heading explain"),
}
SCALES = {"degrees": float(np.rad2deg(1.0)), "percent": 100.0, "m": 1.0, "s": 1.0}


@dataclass(frozen=True)
class Residuals:
    """Exponentially fading sums of squared normalised residuals and of their number."""

    squares: float = 0.0
    number: float = 0.0

    def update(self, gated: GatedMeasurement | None, step_s: float, window_s: float) -> "Residuals":
        fade = float(np.exp(-step_s / window_s))
        squares, degrees = (0.0, 0) if gated is None or gated.kept is None else (gated.distance2, gated.degrees)
        return Residuals(fade * self.squares + squares, fade * self.number + degrees)


def prior_variances(config: RunConfig) -> dict[int, float]:
    """Prior variance of every state that is tested against what was stated."""
    variances = dict(zip(range(ATTITUDE_X, SIZE), (error_sigmas(config) ** 2).tolist(), strict=True))
    variances[ANGLE] = config.deck.angle_sigma_rad**2
    if config.deck.width_m is not None:
        variances[SPACING] = width_sigma_m(config) ** 2
    if config.deck.ship_velocity_m_s is not None:
        variances[DRIFT] = drift_sigma(config) ** 2
    return variances


def prior_means(config: RunConfig) -> Array:
    """What the states are expected to be, (20,)."""
    expected = np.zeros(SIZE)
    expected[ANGLE] = config.deck.angle_rad
    expected[SPACING] = config.deck.width_m or 0.0
    return expected


def bias_flag(state: State, near_m: float, config: RunConfig) -> Notice | None:
    """The state that is most significantly off its prior, if any is.

    Args:
        near_m: where the runway begins, m along the line from the state's point: there it has its stated spacing.
    """
    worst, found = config.integrity.alarm_sigma, None
    expected = prior_means(config)
    for index, variance in prior_variances(config).items():
        row = np.zeros(SIZE)
        row[index] = 1.0
        if index == SPACING:
            row[ANGLE] = near_m
        observed = variance - float(row @ state.covariance @ row)
        if observed <= OBSERVED_SHARE * variance:
            continue
        bias = float(row @ state.mean - expected[index])
        if abs(bias) / np.sqrt(observed) > worst:
            worst, found = float(abs(bias) / np.sqrt(observed)), (index, bias)
    if found is None:
        return None
    reason, unit, message = MESSAGES[found[0]]
    return Notice(reason, message.format(SCALES[unit] * found[1]))


def residual_flag(residuals: Residuals, config: RunConfig) -> Notice | None:
    """Residuals that are too large for too long, each of them small enough to pass the gate."""
    if residuals.number < MIN_RESIDUALS or residuals.squares < config.integrity.excess * residuals.number:
        return None
    excess = float(np.sqrt(residuals.squares / residuals.number))
    return Notice(Reason.RESIDUALS, f"measurements scatter {excess:.1f} times as much as they should")


def protection_levels(state: State, pose: Pose, touchdown_m: float | None, config: RunConfig) -> Protection:
    """Bounds on the error of the lateral deviation beside the aircraft, and of the deck's height at touchdown.

    Both are as seen from the aircraft: an error of its own position moves them with it. They hold for one fault at a
    time of those that `Integrity` names.

    Args:
        touchdown_m: touchdown point, m along the line from the state's point; None: not known, the point itself.
    """
    x = float(state.local(pose.position_m)[0])
    delay = delay_effect(state, pose, 0.0)
    lateral = line_rows(state, 0.0, x, delay)[0]
    height = line_rows(state, 0.0, touchdown_m or 0.0, delay)[2]
    bounds = []
    for row in (lateral, height):
        variance = float(row @ state.covariance @ row + config.sensors.position_white_m**2)
        nominal = float(norm.isf(config.integrity.risk / 2) * np.sqrt(variance))
        bounds.append(nominal + _undetected_error(state, row, config))
    return Protection(bounds[0], bounds[1], config.integrity.risk)


def _undetected_error(state: State, row: Array, config: RunConfig) -> float:
    """The largest error of `row` @ state by one fault that may stay undetected."""
    test = config.integrity
    boresight = float(np.deg2rad(test.max_boresight_deg))
    largest = [boresight, boresight, test.max_deck_z_m, test.max_depth_scale, test.max_focal_fraction]
    largest += [test.max_delay_s, test.max_line_m, test.max_line_m]
    variances = error_sigmas(config) ** 2
    observed = np.maximum(variances - np.diag(state.covariance)[ATTITUDE_X:], 0.0)
    tested = observed > OBSERVED_SHARE * variances
    detectable = np.full(len(observed), np.inf)
    detectable[tested] = (test.alarm_sigma + test.missed_sigma) * variances[tested] / np.sqrt(observed[tested])
    effect = np.abs(row @ state.covariance[:, ATTITUDE_X:]) / variances
    return float(np.max(effect * np.minimum(detectable, largest)))
