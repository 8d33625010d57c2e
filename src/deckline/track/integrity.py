"""What contradicts the track, and how wrong it can be without anything contradicting it.

The filter estimates the errors that all frames have in common from how lines change while the aircraft comes nearer:
on a wrong deck height, for example, lines drift apart as the aircraft descends. An estimate farther from zero than its
spread allows is a fault. Sources of error that cannot be seen in this way are bounded: a fault of size m moves the
filter's estimate by P_xb / P_bb(0) m (the posterior of a Gaussian with a wrong prior mean), so that the protection
level adds the largest of these over faults up to the smallest size that is surely noticed, or the largest possible.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from deckline.track.config import TrackConfig
from deckline.track.gate import Gated
from deckline.track.output import delayed, line_rows
from deckline.track.state import (
    ANGLE,
    DECK,
    DELAY,
    DRIFT,
    FOCAL,
    KNOWN_DRIFT_M_S,
    LEFT,
    PITCH,
    RIGHT,
    ROLL,
    SCALE,
    SIZE,
    SPACING,
    Pose,
    State,
    error_sigmas,
    width_sigma_m,
)
from deckline.types import Flag, Protection

Array = NDArray[np.float64]
OBSERVED = 0.1  # share of a prior's variance that must be gone before its estimate says anything
WORDS = {
    ROLL: ("boresight", "degrees", "the camera seems rolled by {:+.2f} degrees against its mounting"),
    PITCH: ("boresight", "degrees", "the camera seems pitched by {:+.2f} degrees against its mounting"),
    DECK: ("height", "m", "the deck's height or the aircraft's seems {:+.1f} m wrong"),
    SCALE: ("depth", "percent", "depths seem {:+.1f} % wrong"),
    FOCAL: ("focal", "percent", "the focal length seems {:+.2f} % wrong"),
    DELAY: ("delay", "s", "the pose seems {:+.2f} s older than the picture"),
    LEFT: ("left", "m", "the left line seems to be another marking, {:+.1f} m beside it"),
    RIGHT: ("right", "m", "the right line seems to be another marking, {:+.1f} m beside it"),
    SPACING: ("spacing", "m", "the lines' spacing is {:+.1f} m off what was stated"),
    ANGLE: ("angle", "degrees", "the angle between the lines is {:+.1f} degrees off what was stated"),
    DRIFT: ("drift", "m", "the lines drift sideways at {:+.1f} m/s, which neither ship nor heading explain"),
}
SCALES = {"degrees": float(np.rad2deg(1.0)), "percent": 100.0, "m": 1.0, "s": 1.0}


@dataclass(frozen=True)
class Residuals:
    """Sum of squared residuals and of their number over the last seconds, older ones fading."""

    squares: float = 0.0
    number: float = 0.0

    def after(self, gate: Gated | None, step_s: float, window_s: float) -> "Residuals":
        fade = float(np.exp(-step_s / window_s))
        taken = (0.0, 0) if gate is None or gate.kept is None else (gate.distance2, gate.degrees)
        return Residuals(fade * self.squares + taken[0], fade * self.number + taken[1])


def prior_variances(config: TrackConfig) -> dict[int, float]:
    """Variance at first of every state that is tested against what was stated."""
    variances = dict(zip(range(ROLL, SIZE), (error_sigmas(config) ** 2).tolist(), strict=True))
    variances[ANGLE] = config.angle_sigma_rad**2
    if config.runway_width_m is not None:
        variances[SPACING] = width_sigma_m(config) ** 2
    if config.motion.ship_velocity_m_s is not None:
        variances[DRIFT] = min(config.motion.drift_m_s, KNOWN_DRIFT_M_S) ** 2
    return variances


def stated(config: TrackConfig) -> Array:
    """What the states are expected to be, (20,)."""
    expected = np.zeros(SIZE)
    expected[ANGLE] = config.angle_rad
    expected[SPACING] = config.runway_width_m or 0.0
    return expected


def biased(state: State, near_m: float, config: TrackConfig) -> Flag | None:
    """The state that is farthest from what was stated, if that is no chance.

    Args:
        near_m: where the runway begins, m along the line from the state's point: there it has its stated spacing.
    """
    worst, place, found = config.integrity.alarm, -1, 0.0
    expected = stated(config)
    for index, variance in prior_variances(config).items():
        row = np.zeros(SIZE)
        row[index] = 1.0
        if index == SPACING:
            row[ANGLE] = near_m
        gone = variance - float(row @ state.covariance @ row)
        if gone <= OBSERVED * variance:
            continue
        away = float(row @ state.mean - expected[index])
        if abs(away) / np.sqrt(gone) > worst:
            worst, place, found = float(abs(away) / np.sqrt(gone)), index, away
    if place < 0:
        return None
    name, unit, words = WORDS[place]
    return Flag(name, words.format(SCALES[unit] * found))


def restless(residuals: Residuals, config: TrackConfig) -> Flag | None:
    """Residuals that are too large for too long, each of them small enough to pass."""
    if residuals.number < 10 or residuals.squares < config.integrity.excess * residuals.number:
        return None
    excess = float(np.sqrt(residuals.squares / residuals.number))
    return Flag("residuals", f"measurements scatter {excess:.1f} times as much as they should")


def protection(state: State, pose: Pose, touchdown_m: float | None, config: TrackConfig) -> Protection:
    """Bounds on the error of the lateral deviation beside the aircraft, and of the deck's height at touchdown.

    Both are as seen from the aircraft: an error of its own position moves them along. They hold for one fault at a
    time of those that `IntegrityConfig` names.

    Args:
        touchdown_m: touchdown point, m along the line from the state's point; None: not known, the point itself.
    """
    x = float(state.local(pose.position_m)[0])
    beside = line_rows(state, 0.0, x, delayed(state, pose, 0.0))[0]
    below = line_rows(state, 0.0, touchdown_m or 0.0, delayed(state, pose, 0.0))[2]
    bounds = []
    for row in (beside, below):
        variance = float(row @ state.covariance @ row + config.errors.position_white_m**2)
        chance = float(norm.isf(config.integrity.risk / 2) * np.sqrt(variance))
        bounds.append(chance + _unnoticed(state, row, config))
    return Protection(bounds[0], bounds[1], config.integrity.risk)


def _unnoticed(state: State, row: Array, config: TrackConfig) -> float:
    """The largest error of `row` @ state by one fault that need not be noticed."""
    test = config.integrity
    largest = [test.boresight_rad, test.boresight_rad, test.deck_z_m, test.depth_scale, test.focal_fraction]
    largest += [test.delay_s, test.line_m, test.line_m]
    variances = error_sigmas(config) ** 2
    gone = np.maximum(variances - np.diag(state.covariance)[ROLL:], 0.0)
    seen = gone > OBSERVED * variances
    surely = np.full(len(gone), np.inf)
    surely[seen] = (test.alarm + test.missed) * variances[seen] / np.sqrt(gone[seen])
    effect = np.abs(row @ state.covariance[:, ROLL:]) / variances
    return float(np.max(effect * np.minimum(surely, largest)))
