"""Estimates of the filter against what was stated: flags, and why a track without a flag is not verified.

The filter estimates the errors that all frames share from how lines change on the approach: with a wrong deck height,
for example, lines drift apart as the aircraft descends. An estimate farther from zero than its variance allows is a
fault.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.probability import chi2_tail, normal_tail
from deckline.track.stated_width import spacing_contradiction
from deckline.track.states import (
    KNOWN_DRIFT_SIGMA_M_S,
    RAMP_SIGMA_M,
    FilterState,
    States,
    drift_sigma,
    error_sigmas,
    width_sigma_m,
)
from deckline.trackers import OBSERVED_SHARE, YOUNG
from deckline.types import Diagnostic, Diagnostics, Reason

Array = NDArray[np.float64]
MESSAGES = {
    States.ATTITUDE_X: (Reason.BORESIGHT, "degrees", "the camera seems rolled by {:+.2f} degrees against its mounting"),
    States.ATTITUDE_Y: (
        Reason.BORESIGHT,
        "degrees",
        "the camera seems pitched by {:+.2f} degrees against its mounting",
    ),
    States.HEAVE: (Reason.HEIGHT, "m", "the deck seems {:+.1f} m below its rest, farther than its sea state moves it"),
    States.SCALE: (Reason.DEPTH, "percent", "depths seem {:+.1f} % wrong"),
    States.FOCAL: (Reason.FOCAL, "percent", "the focal length seems {:+.2f} % wrong"),
    States.DELAY: (Reason.DELAY, "s", "the pose seems {:+.2f} s older than the picture"),
    States.LEFT: (Reason.LEFT, "m", "the left line seems to be another marking, {:+.1f} m beside it"),
    States.RIGHT: (Reason.RIGHT, "m", "the right line seems to be another marking, {:+.1f} m beside it"),
    States.SPACING: (Reason.SPACING, "m", "the lines' spacing is {:+.1f} m off what was stated"),
    States.ANGLE: (Reason.ANGLE, "degrees", "the angle between the lines is {:+.1f} degrees off what was stated"),
    States.DRIFT: (
        Reason.DRIFT,
        "m",
        "the lines drift sideways at {:+.1f} m/s, which neither ship nor heading explain",
    ),
}
UNLIKELY = Diagnostic(
    Reason.UNLIKELY_ERRORS, "the errors of sensors and paint that would explain the lines are unlikely together"
)
UNBOUNDED_YAW = Diagnostic(
    Reason.YAW, "at this closing speed the lines' drift does not show a camera that is turned in yaw"
)
SCALES = {"degrees": float(np.rad2deg(1.0)), "percent": 100.0, "m": 1.0, "s": 1.0}


def stated_priors(config: RunConfig) -> dict[int, tuple[float, float]]:
    """Prior mean and variance of every state that is tested against what was stated."""
    shared = range(States.SIZE)[States.SHARED_ERRORS]
    priors = {index: (0.0, float(sigma**2)) for index, sigma in zip(shared, error_sigmas(config), strict=True)}
    priors[States.HEAVE] = 0.0, config.deck.motion.heave_m**2
    priors[States.ANGLE] = config.deck.angle_rad, config.deck.angle_sigma_rad**2
    if config.deck.width_m is not None:
        priors[States.SPACING] = config.deck.width_m, width_sigma_m(config) ** 2
    if config.deck.ship_velocity_m_s is not None:
        priors[States.DRIFT] = 0.0, drift_sigma(config) ** 2
    return priors


def spacing_row(near_m: float) -> Array:
    """Row (20,) that gives the spacing of the lines where the runway begins."""
    row = np.zeros(States.SIZE)
    row[[States.SPACING, States.ANGLE]] = 1.0, near_m
    return row


def drift_share(state: FilterState, config: RunConfig) -> float:
    """Share of the prior variance of the lines' sideways speed that frames have removed: the gain of its estimate."""
    return 1.0 - float(state.covariance[States.DRIFT, States.DRIFT]) / drift_sigma(config) ** 2


def is_drift_known(state: FilterState, config: RunConfig) -> bool:
    """Whether frames have measured the lines' sideways speed well enough for `drift_flag` and `undetected_yaw`."""
    share, variance = drift_share(state, config), float(state.covariance[States.DRIFT, States.DRIFT])
    return share > 0.0 and variance / share <= KNOWN_DRIFT_SIGMA_M_S**2


def is_young(state: FilterState, age_s: float, config: RunConfig) -> bool:
    """Whether a track is too young to show contradictions."""
    return age_s < config.integrity.persist_s or not is_drift_known(state, config)


def drift_flag(state: FilterState, config: RunConfig) -> Diagnostic | None:
    """A flag for lines that move sideways faster than a ship can, as they seem to where the camera is turned in yaw."""
    drift, sigma = float(state.mean[States.DRIFT]), float(np.sqrt(state.covariance[States.DRIFT, States.DRIFT]))
    if abs(drift) - config.integrity.alarm_sigma * sigma <= config.integrity.max_drift_m_s:
        return None
    message = f"the lines drift sideways at {drift:+.1f} m/s, faster than a ship's: is the camera turned in its mount?"
    return Diagnostic(Reason.DRIFT, message)


@dataclass(frozen=True, eq=False)
class PriorTests:
    """Estimates of K states against what was stated of them."""

    indices: NDArray[np.int64]  # (K,) of the states
    rows: Array  # (K, 20) that give the estimates
    biases: Array  # (K,) estimated minus stated
    sigmas: Array  # (K,) of these, if what was stated is true


def prior_tests(state: FilterState, near_m: float, config: RunConfig) -> PriorTests:
    """The tests of all states that frames have observed well enough.

    Args:
        near_m: where the runway begins, m along the line from the state's point: there it has its stated spacing.
    """
    priors = stated_priors(config)
    indices, (expected, variances) = np.array(list(priors)), np.array(list(priors.values())).T
    rows = np.eye(States.SIZE)[indices]
    is_spacing = indices == States.SPACING
    rows[is_spacing] = spacing_row(near_m)
    place = is_spacing * config.deck.angle_sigma_rad * RAMP_SIGMA_M  # stated where the runway truly begins
    observed = variances - np.einsum("ki,ij,kj->k", rows, state.covariance, rows)
    biases = rows @ state.mean - expected
    known = observed > OBSERVED_SHARE * variances
    return PriorTests(indices[known], rows[known], biases[known], np.sqrt(observed[known] + place[known] ** 2))


def bias_flag(state: FilterState, near_m: float, config: RunConfig, camera_m: Array | None = None) -> Diagnostic | None:
    """The state that is most significantly off its prior, if any is.

    Args:
        near_m: as in `prior_tests`.
        camera_m: (3,) world, for the message; None: not known.
    """
    tests = prior_tests(state, near_m, config)
    errors = np.abs(tests.biases / tests.sigmas)
    if not len(errors) or errors.max() <= config.integrity.alarm_sigma:
        return None
    worst = int(errors.argmax())
    index, bias = int(tests.indices[worst]), float(tests.biases[worst])
    if index in (States.HEAVE, States.SPACING) and config.deck.width_m is not None and camera_m is not None:
        return spacing_contradiction(_spacing_by_height(state, near_m, camera_m), config.deck.width_m)
    if index == States.DECK:
        by_lines, stated = state.point_m[2], state.point_m[2] + state.mean[States.DECK]
        return Diagnostic(Reason.HEIGHT, f"the deck is at z {by_lines:.1f} m by the lines; {stated:.1f} m is stated")
    reason, unit, message = MESSAGES[index]
    return Diagnostic(reason, message.format(SCALES[unit] * bias))


def _spacing_by_height(state: FilterState, near_m: float, camera_m: Array) -> float:
    """Spacing of the lines where the runway begins, as the stated height of the deck at rest scales it."""
    stated_m = state.point_m[2] + state.mean[States.DECK] - camera_m[2]
    return float(spacing_row(near_m) @ state.mean * stated_m / (state.deck_z_m - camera_m[2]))


def unverified_reasons(
    state: FilterState, age_s: float, tests: PriorTests, yaw_rad: float | None, config: RunConfig
) -> Diagnostics:
    """Why a track that no test flags is not verified.

    Several errors that are each just possible are unlikely together: the overall model test, which sums the squares of
    all prior tests. They count as independent, which they are not quite: one in 2,000 `ok` frames of modelled nominal
    flights is doubted by a risk of one in 1,000. Source: Teunissen, "Distributional theory for the DIA method", 2018.

    Args:
        tests: by `prior_tests`.
        yaw_rad: by `undetected_yaw`.
    """
    young = is_young(state, age_s, config)
    errors = tests.biases / tests.sigmas
    unlikely = bool(len(errors)) and _joint_significance(errors) < config.integrity.doubt_risk
    is_unbounded = yaw_rad is None and not young
    return tuple(
        doubt for doubt, holds in ((YOUNG, young), (UNLIKELY, unlikely), (UNBOUNDED_YAW, is_unbounded)) if holds
    )


def _joint_significance(errors: Array) -> float:
    """Probability of errors (n,), in sigmas, at least as unlikely: by their sum of squares or by the largest alone.

    A sum of n squares hides one large error. The largest counts with the n tests that could have had it (Bonferroni).
    """
    largest = 2 * len(errors) * normal_tail(np.max(np.abs(errors)))
    return float(min(chi2_tail(np.sum(errors**2), len(errors)), largest))
