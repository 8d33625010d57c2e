"""Batch least squares of camera, delay and runway over one approach, and which of them it determines.

Generalized least squares on correlated residuals; the covariance of the residuals is linearized anew at each solution.
What the approach does not determine is held as stated, one quantity at a time, and the rest is estimated again.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular
from scipy.optimize import least_squares

from deckline.calibrate.model import (
    CAMERA_NAMES,
    CX,
    CY,
    DELAY,
    FOCAL,
    NAMES,
    PITCH,
    ROLL,
    SCALES,
    YAW,
    Prior,
    Reference,
    jacobian_px,
    residuals_px,
    start_state,
)
from deckline.calibrate.noise import disturbance_kernels, own_covariance, shared_covariance
from deckline.calibrate.observations import ApproachView
from deckline.config import RunConfig

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MIN_FRAMES = 10  # with both lines
MIN_TRAVEL_M = 30.0  # of the aircraft; a hovering one shows the same lines in every frame
MOST_ROUNDS = 8  # of covariance, fit and outliers in turn; two or three are usual
TOLERANCE = 1e-6  # relative, of cost and of step, that ends a fit; far below 1-sigma
SETTLED = 0.1  # relative change of the noise's dispersion that ends the rounds
MASKING_SHARE = 0.5  # of the largest residual
OUTLIER_SIGMA = 5.0  # of a residual against all others, beyond which its line or horizon is left out
MEDIAN_TO_SIGMA = 1.4826  # of a normal distribution's sizes
JITTER = 1e-9  # of the residuals' variance, added to their own: interpolated kernels are not exactly definite
DETERMINED_SHARE = 0.2  # of the prior's 1-sigma, up to which the posterior's counts as determined; our choice
CONTRADICTED_SIGMA = 3.0  # of a less certain estimate, from which it is better than a stated value all the same
AGREEING_SIGMA = 2.0  # between a stated and an estimated value, within which the stated one stays
INSEPARABLE = 0.95  # correlation from which two quantities are named as not separable
HELD_SHARE = 1e-6  # of the prior's 1-sigma: of a quantity that is held exactly
HOLD_ORDER = (CX, CY, FOCAL, DELAY, ROLL, PITCH, YAW)  # intrinsics first: a mount's turn explains what they would


class Outcome(StrEnum):
    """What became of a quantity of the camera."""

    ESTIMATED = "estimated"
    """The approach determines it."""
    UNDETERMINED = "not determined"
    """The approach does not determine it; it stays as stated."""
    AGREES = "agrees"
    """The stated value lies within its uncertainty and stays."""
    HELD = "held"
    """It stays as stated because the user asked for it."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A solution: state (13,), its covariance (13, 13), and what the residuals are like."""

    state: Array
    covariance: Array
    used: Mask
    """(R,) residuals that are no outliers."""
    point_scale: float
    """Dispersion of the points over their stated 1-sigma, at least 1."""
    horizon_scale: float
    """The same of the horizons."""

    @property
    def sigma(self) -> Array:
        """(13,) 1-sigma."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """(13, 13)."""
        return np.asarray(self.covariance / np.outer(self.sigma, self.sigma))


@dataclass(frozen=True, eq=False)
class Pair:
    """Two quantities that an approach hardly separates."""

    first: str
    second: str
    correlation: float


@dataclass(frozen=True, eq=False)
class Calibration:
    """Errors of what is stated of a camera, from one approach.

    Mount angles turn the stated mounting about the body's axes: roll to the right, pitch up, yaw to the right.
    """

    fit: Fit
    """With the held quantities as stated."""
    free_sigma: Array
    """(13,) 1-sigma with nothing held."""
    outcomes: dict[str, Outcome]
    """By name of `CAMERA_NAMES`."""
    held_by: dict[str, Pair]
    """Of each quantity that is not determined: what it is most correlated with, before it is held."""
    inseparable: tuple[Pair, ...]
    """With nothing but the user's holds, then those that remain; the most correlated first."""
    frames: int
    """That show a line."""
    horizons: int
    """That were used."""

    @property
    def state(self) -> Array:
        """(13,) with the held quantities at 0, as stated."""
        state = self.fit.state.copy()
        for number, name in enumerate(CAMERA_NAMES):
            if self.outcomes[name] is not Outcome.ESTIMATED:
                state[number] = 0.0
        return state


def solve(view: ApproachView, config: RunConfig, hold: tuple[str, ...] = ()) -> Calibration:
    """Estimate the camera's errors from an approach.

    Args:
        hold: names of CAMERA_NAMES that stay as stated.

    Raises:
        ValueError: the recording is no approach with both lines, or determines nothing.
    """
    _check_approach(view)
    reference, prior, state = start_state(view, config)
    outcomes = {name: Outcome.HELD if name in hold else Outcome.ESTIMATED for name in CAMERA_NAMES}
    asked = prior
    for name in hold:
        asked = _hold(asked, NAMES.index(name), config)
    kernels = disturbance_kernels(view, config)
    fit = free = _fit(view, reference, asked, kernels, state)
    held_by: dict[str, Pair] = {}
    while (number := _choose_held(fit, prior, outcomes)) is not None:
        is_determined = _is_determined(fit, prior, number)
        outcomes[NAMES[number]] = Outcome.AGREES if is_determined else Outcome.UNDETERMINED
        if not is_determined:
            held_by[NAMES[number]] = _find_partner(fit, number)
        asked = _hold(asked, number, config)
        fit = _fit(view, reference, asked, kernels, fit.state)
    if Outcome.ESTIMATED not in outcomes.values() and Outcome.AGREES not in outcomes.values():
        raise ValueError("this recording determines nothing of the camera; calibrate needs an approach with both lines")
    count = len(view.frame)
    horizons = int(fit.used[count : count + len(view.horizon_frame)].sum())
    pairs = {(pair.first, pair.second): pair for each in (fit, free) for pair in _find_pairs(each, prior)}
    inseparable = tuple(sorted(pairs.values(), key=lambda pair: -abs(pair.correlation)))
    return Calibration(fit, free.sigma, outcomes, held_by, inseparable, len(np.unique(view.frame)), horizons)


def _check_approach(view: ApproachView) -> None:
    """Refuse a recording without enough frames of both lines, or without motion."""
    sides = [set(view.frame[view.side == number]) for number in (0, 1)]
    both = sides[0] & sides[1]
    if len(both) < MIN_FRAMES:
        raise ValueError(
            f"both edge lines are seen in {len(both)} of {len(view.times_s)} frames; calibrate needs {MIN_FRAMES}"
        )
    travelled = view.poses.at(view.times_s[sorted(both)])[0]
    travel_m = float(np.linalg.norm(np.ptp(travelled, axis=0)))
    if travel_m < MIN_TRAVEL_M:
        raise ValueError(
            f"the aircraft moves {travel_m:.1f} m while both lines are seen; calibrate needs an approach of "
            f"{MIN_TRAVEL_M:g} m: a hovering aircraft sees the same lines in every frame"
        )


def _hold(prior: Prior, number: int, config: RunConfig) -> Prior:
    """The prior with one quantity as accurate as the configuration states it."""
    stated = {FOCAL: config.sensors.focal_fraction, DELAY: config.sensors.delay_s}
    sigma = prior.sigma.copy()
    sigma[number] = max(stated.get(number, 0.0), HELD_SHARE * SCALES[number])
    return replace(prior, sigma=sigma)


def _is_determined(fit: Fit, prior: Prior, number: int) -> bool:
    """Whether a quantity is certain enough to replace what is stated."""
    sigma = fit.sigma[number]
    return bool(sigma <= max(DETERMINED_SHARE * prior.sigma[number], abs(fit.state[number]) / CONTRADICTED_SIGMA))


def _choose_held(fit: Fit, prior: Prior, outcomes: dict[str, Outcome]) -> int | None:
    """The next quantity to hold as stated: one that is not determined, then the one that agrees best; None: no more."""
    free = [number for number in HOLD_ORDER if outcomes[NAMES[number]] is Outcome.ESTIMATED]
    for number in free:
        if not _is_determined(fit, prior, number):
            return number
    score = {number: abs(fit.state[number]) / fit.sigma[number] for number in free}
    least = min(score, key=lambda number: score[number], default=None)
    return least if least is not None and score[least] < AGREEING_SIGMA else None


def _find_pairs(fit: Fit, prior: Prior) -> list[Pair]:
    """Pairs of free quantities, at least one of the camera, that are hardly separable."""
    correlation, found = fit.correlation, []
    free = fit.sigma > np.sqrt(HELD_SHARE) * prior.sigma
    for first in range(len(CAMERA_NAMES)):
        for second in range(first + 1, len(NAMES)):
            if abs(correlation[first, second]) >= INSEPARABLE and free[first] and free[second]:
                found.append(Pair(NAMES[first], NAMES[second], float(correlation[first, second])))
    return found


def _find_partner(fit: Fit, number: int) -> Pair:
    """A quantity with the one that it is most correlated with."""
    row = fit.correlation[number].copy()
    row[number] = 0.0
    partner = int(np.argmax(np.abs(row)))
    return Pair(NAMES[number], NAMES[partner], float(row[partner]))


def _fit(view: ApproachView, reference: Reference, prior: Prior, kernels: Array, state: Array) -> Fit:
    """Robust fit with independent residuals, then rounds of covariance, fit and outliers."""
    used: Mask = np.ones(kernels.shape[1], dtype=bool)
    scales = np.ones(2)
    sigma = np.sqrt(np.diag(_covariance(view, reference, state, kernels, scales)))
    state = _minimize(view, reference, prior, np.diag(sigma), used, state, "soft_l1")
    sigma = np.sqrt(np.diag(_covariance(view, reference, state, kernels, scales)))
    used = ~_find_outliers(view, residuals_px(view, reference, state[None])[0] / sigma)
    for number in range(MOST_ROUNDS):
        covariance = _covariance(view, reference, state, kernels, scales)[np.ix_(used, used)]
        factor: Array = np.linalg.cholesky(covariance).astype(np.float64)
        state = _minimize(view, reference, prior, factor, used, state, "linear")
        posterior, score = _posterior(view, reference, prior, factor, used, state)
        outliers = _find_outliers(view, score)
        updated = np.maximum(1.0, scales * _dispersions(view, score, used & ~outliers))
        is_settled = not outliers.any() and np.allclose(updated, scales, rtol=SETTLED)
        if number == MOST_ROUNDS - 1 or (number > 0 and is_settled):
            break
        scales, used = updated, used & ~outliers
    return Fit(state, posterior, used, *(float(scale) for scale in scales))


def _covariance(view: ApproachView, reference: Reference, state: Array, kernels: Array, scales: Array) -> Array:
    """Covariance (R, R) of all residuals, linearized at a state; `scales` (2,) of points and of horizons."""
    total = own_covariance(view, *scales) + shared_covariance(view, reference, state, kernels)
    return np.asarray(total + JITTER * np.diag(np.diag(total)))


def _minimize(
    view: ApproachView, reference: Reference, prior: Prior, factor: Array, used: Mask, state: Array, loss: str
) -> Array:
    def weighed(scaled: Array) -> Array:
        at = scaled * SCALES
        white = solve_triangular(factor, residuals_px(view, reference, at[None])[0, used], lower=True)
        return np.concatenate([white, (at - prior.mean) / prior.sigma])

    def derive(scaled: Array) -> Array:
        white = solve_triangular(factor, jacobian_px(view, reference, scaled * SCALES)[used], lower=True)
        return np.concatenate([white, np.diag(1 / prior.sigma)]) * SCALES

    options = {"loss": loss, "x_scale": "jac", "ftol": TOLERANCE, "xtol": TOLERANCE}
    return np.asarray(least_squares(weighed, state / SCALES, derive, **options).x * SCALES)


def _posterior(
    view: ApproachView, reference: Reference, prior: Prior, factor: Array, used: Mask, state: Array
) -> tuple[Array, Array]:
    """Covariance (13, 13) of the state, and each residual's (R,) deletion statistic, 0 where it is not used.

    Source: Cook and Weisberg, "Residuals and Influence in Regression", 1982, chapter 2.
    """
    jacobian = jacobian_px(view, reference, state)[used]
    white = solve_triangular(factor, jacobian, lower=True)
    scaled = white * SCALES
    information = scaled.T @ scaled + np.diag((SCALES / prior.sigma) ** 2)
    posterior = np.linalg.inv(information) * np.outer(SCALES, SCALES)
    inverse = cho_solve((factor, True), np.eye(len(factor)))
    gain = inverse @ jacobian
    residual_weights = inverse - gain @ posterior @ gain.T
    score = np.zeros(len(used))
    rest = residuals_px(view, reference, state[None])[0, used]
    score[used] = (residual_weights @ rest) / np.sqrt(np.maximum(np.diag(residual_weights), 1e-12))
    return posterior, score


def _dispersions(view: ApproachView, score: Array, used: Mask) -> Array:
    """Dispersion (2,) of points and of horizons over their assumed 1-sigma."""
    is_point = np.arange(len(score)) < len(view.frame)
    parts = [np.abs(score[used & is_point]), np.abs(score[used & ~is_point])]
    return np.array([MEDIAN_TO_SIGMA * float(np.median(part)) if len(part) else 1.0 for part in parts])


def _find_outliers(view: ApproachView, score: Array) -> Mask:
    """Outliers (R,): both points of a line with one that is far off, both numbers of such a horizon.

    A large outlier makes others of good residuals: those below half of the largest wait for the next round.
    """
    count, searched = len(view.frame), len(view.horizon_frame)
    size = np.abs(score)
    far = size > max(OUTLIER_SIGMA, MASKING_SHARE * float(size.max()))
    lines = np.repeat(far[:count].reshape(-1, 2).any(axis=1), 2)
    horizons = far[count : count + searched] | far[count + searched :]
    return np.concatenate([lines, horizons, horizons])
