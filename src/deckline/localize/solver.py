"""The joint fit: lines, deck height and the errors of camera and attitude, estimated together in the image.

Robust Gauss-Newton on normalised residuals: pixels of points and logarithms of depth, with priors of the deck, the
pose and the calibration. The last step gives the sensitivity of the estimate to every noise source, and from these
its covariance.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.config import Deck, FrameNoise
from deckline.localize.model import (
    NUISANCES,
    DeckPlane,
    FitState,
    Terms,
    concatenate,
    linearize_deck_prior,
    linearize_measurements,
    linearize_state_prior,
)
from deckline.localize.observations import Observations

Array = NDArray[np.float64]
Fit = tuple[FitState, Terms, Terms]  # a state with its measurements and priors
Blocks = list[slice]  # of measurements that share a noise inflation: each line's pixels, all depths
STEPS = 12  # of Gauss-Newton at most; three or four are usual
CONVERGED = 1e-2  # 1-sigma; a smaller step ends the iteration
HUBER = 2.5  # 1-sigma; cost of larger residuals grows linearly: 99 % efficient without outliers
CUTOFF = 5.0  # 1-sigma; larger residuals are outliers of weight 0
MIN_COMMON_DIRECTION = 1e-6  # length of the sum of the lines' unit vectors; 0 for opposite directions
MEDIAN_TO_SIGMA = 1.4826  # of a normal distribution's sizes
DEPTH = "depth"  # key of all depths in `Solution.inflation`
DAMPING = 10.0  # factor on the damping after a step that raises the cost
# Noise inflation
SIGNIFICANT_SIGMA = 2.5  # a dispersion within so many 1-sigma of chance is not counted
MIN_POINTS = 4  # of a line whose residuals show anything beside the fitted line
# Prior of the correlation of neighbouring points' errors. The shipped detector's residuals on rendered frames have 0.2
# nearer than 100 m, -0.5 from 100 to 200 m, 0.4 to 0.7 beyond.
CORRELATION, CORRELATION_SIGMA = 0.2, 0.3
MAX_CORRELATION = 0.9  # either way
SCORES = np.linspace(-3.0, 3.0, 31)  # grid of correlations, in 1-sigma of the prior
# Grid of the true dispersion over the stated one. The shipped detector states three times its errors far away, and the
# fit removes their slow part: residuals far smaller than stated must not look like correlated errors.
LOG_DISPERSIONS = np.linspace(np.log(0.2), 0.0, 17)
AS_STATED = 0.8  # prior probability that the stated dispersion is right, the others sharing the rest; our choice


@dataclass(frozen=True, eq=False)
class Solution:
    """The estimated state and its sensitivities: each column is the change by one source of 1-sigma."""

    names: tuple[str, ...]
    state: FitState
    plane: DeckPlane
    points: Array  # (P, M) to the points' noise and the prior of the lines' geometry
    height: Array  # (P,) to the error of the reported deck height less the aircraft's own; 0 without a report
    nuisances: Array  # (P, 6) to the nuisances
    height_score: float  # normalised innovation of the reported deck height
    inflation: dict[str, float]  # noise inflation of each line's points, and DEPTH of all depths


def solve(
    observations: Observations,
    start: FitState,
    noise: FrameNoise,
    deck: Deck,
    deck_z_m: float | None,
    inflation: dict[str, float] | None = None,
) -> Solution:
    """The most probable state.

    Args:
        noise: 1-sigma of pose, calibration and depth.
        deck_z_m: the reported deck height; None: it is not used.
        inflation: of an earlier solution; the prior of the lines' geometry is then used too. None: a fit without
            that prior measures it.
    """
    plane = _orient_plane(start, noise)
    blocks = _split_blocks(observations)

    def terms(state: FitState) -> tuple[Terms, Terms]:
        measurement = linearize_measurements(observations, state, plane, noise)
        prior = linearize_state_prior(state, deck_z_m, noise)
        if inflation is not None:
            prior = concatenate(linearize_deck_prior(observations.names, state, deck), prior)
        return measurement, prior

    keys = (*observations.names, DEPTH)
    scale = np.array([1.0 if inflation is None else inflation[key] for key in keys])
    fit = _minimize(terms, (start, *terms(start)), blocks, scale)
    if inflation is None:
        scale = _measure_inflation(fit[1], blocks, observations)
        fit = _minimize(terms, fit, blocks, scale) if (scale > 1.0).any() else fit
    factors = dict(zip(keys, scale.tolist(), strict=True))
    return _derive_solution(factors, fit, plane, blocks, scale, deck_z_m is not None)


def _split_blocks(observations: Observations) -> Blocks:
    """Where each line's pixels lie among the measurements, and all depths after them."""
    ends = np.searchsorted(observations.line, np.arange(len(observations.names)), side="right").tolist()
    ends.append(len(observations.line) + int(observations.has_depth.sum()))
    return [slice(start, end) for start, end in zip([0, *ends], ends, strict=False)]


def _orient_plane(start: FitState, noise: FrameNoise) -> DeckPlane:
    """The plane of the deck through the lines, its axes along and across their mean direction."""
    along = np.array([np.cos(start.azimuths_rad).sum(), np.sin(start.azimuths_rad).sum()])
    length = float(np.linalg.norm(along))
    if length < MIN_COMMON_DIRECTION:  # lines in opposite directions
        along, length = np.array([np.cos(start.azimuths_rad[0]), np.sin(start.azimuths_rad[0])]), 1.0
    forward, right = along / length, np.array([-along[1], along[0]]) / length
    return DeckPlane(start.points_m.mean(axis=0), np.stack([forward, right]), np.full(2, noise.slope_rad))


def _minimize(terms: Callable[[FitState], tuple[Terms, Terms]], start: Fit, blocks: Blocks, scale: Array) -> Fit:
    (state, measurement, prior), damping, precision = start, 0.0, 1 / _spread(scale, blocks) ** 2
    for _ in range(STEPS):
        weights = _robust_weights(measurement.residuals, blocks) * precision
        cost = _cost(measurement, prior, weights)
        normal = _normal_matrix(measurement, prior, weights)
        gradient = measurement.jacobian.T @ (weights * measurement.residuals) + prior.jacobian.T @ prior.residuals
        damped = normal + damping * np.diag(np.diag(normal))
        step: Array = np.asarray(np.linalg.solve(damped, gradient), dtype=np.float64)
        trial = state.step(step)
        trial_terms = terms(trial)
        if _cost(*trial_terms, weights) > cost * (1 + 1e-9) + 1e-9:
            damping = max(damping, 1e-4) * DAMPING
            continue
        state, (measurement, prior), damping = trial, trial_terms, damping / DAMPING
        if float(step @ normal @ step) < CONVERGED**2:
            break
    return state, measurement, prior


def _spread(values: Array, blocks: Blocks) -> Array:
    """Each block's value (B,) at all of its measurements (M,)."""
    return np.repeat(values, [block.stop - block.start for block in blocks])


def _cost(measurement: Terms, prior: Terms, weights: Array) -> float:
    return float(weights @ measurement.residuals**2 + prior.residuals @ prior.residuals)


def _normal_matrix(measurement: Terms, prior: Terms, weights: Array) -> Array:
    return (measurement.jacobian.T * weights) @ measurement.jacobian + prior.jacobian.T @ prior.jacobian


def _robust_weights(residuals: Array, blocks: Blocks) -> Array:
    """Huber weights with a cut-off, in units of each block's median deviation where that exceeds the assumed noise."""
    size = np.abs(residuals)
    for block in blocks:
        members = size[block]
        if len(members):
            middle = len(members) // 2
            members /= max(1.0, MEDIAN_TO_SIGMA * float(np.partition(members, middle)[middle]))
    return np.where(size > CUTOFF, 0.0, np.minimum(1.0, HUBER / np.maximum(size, HUBER)))


def _measure_inflation(measurement: Terms, blocks: Blocks, observations: Observations) -> Array:
    """Noise inflation of each block, (L + 1,)."""
    weights = _robust_weights(measurement.residuals, blocks)
    normalised = np.sqrt(weights) * measurement.residuals
    nearness = observations.world_rays[:, 2]
    along = np.concatenate([nearness, nearness[observations.has_depth]])
    parts = []
    for block in blocks:
        members = block.start + np.flatnonzero(weights[block])
        parts.append(normalised[members[np.argsort(along[members])]])
    pixels = noise_inflation(parts[:-1], CORRELATION, CORRELATION_SIGMA)
    return np.concatenate([pixels, noise_inflation(parts[-1:], 0.0, CORRELATION_SIGMA)])


def _derive_solution(
    inflation: dict[str, float], fit: Fit, plane: DeckPlane, blocks: Blocks, scale: Array, has_height: bool
) -> Solution:
    state, measurement, prior = fit
    factors = _spread(scale, blocks)
    weights = _robust_weights(measurement.residuals, blocks) / factors**2
    inverse = np.linalg.inv(_normal_matrix(measurement, prior, weights))
    by_points = inverse @ measurement.jacobian.T * (weights * factors)
    by_prior = inverse @ prior.jacobian.T
    geometry = by_prior[:, : -NUISANCES - 1 if has_height else -NUISANCES]
    height, score = np.zeros(len(inverse)), 0.0
    if has_height:
        height, row = by_prior[:, -NUISANCES - 1], prior.jacobian[-NUISANCES - 1]
        score = float(prior.residuals[-NUISANCES - 1] / np.sqrt(max(1 - row @ height, 1e-12)))
    points = np.hstack([by_points, geometry])
    nuisances = by_prior[:, -NUISANCES:]
    return Solution(tuple(inflation)[:-1], state, plane, points, height, nuisances, score, inflation)


def noise_inflation(lines: list[Array], prior_correlation: float, prior_sigma: float) -> Array:
    """Factors on 1-sigma (L,) for residuals that are larger or more correlated than assumed.

    N points with correlation r between neighbours carry the information of N (1 - r) / (1 + r) independent ones. All
    lines come from one detector and share r. The factor is the posterior mean of the variance over a grid of
    correlations and dispersions. No factor is less than 1.

    Args:
        lines: normalised residuals (N,) of each line, in order along it, less two fitted numbers.
        prior_correlation: of neighbouring residuals, at most 0.9 either way.
        prior_sigma: 1-sigma of it; 0: known.

    Source: restricted likelihood of first-order autoregressive errors (Harville 1974), with priors.
    """
    dispersions = np.array([_dispersion(residuals) for residuals in lines])
    scores = SCORES[np.abs(prior_correlation + prior_sigma * SCORES) <= MAX_CORRELATION] if prior_sigma else np.zeros(1)
    correlations = prior_correlation + prior_sigma * scores
    normalised = [line / dispersion for line, dispersion in zip(lines, dispersions, strict=True)]
    squares, log_volume, degrees = _restricted_likelihood(normalised, correlations)
    if degrees < 1:
        return dispersions
    log_dispersion = LOG_DISPERSIONS[:, None]
    fit = log_volume + 2 * degrees * log_dispersion + squares * np.exp(-2 * log_dispersion)
    log_odds = -(fit + scores**2) / 2
    log_odds[:-1] += np.log((1 - AS_STATED) / (len(LOG_DISPERSIONS) - 1))
    log_odds[-1] += np.log(AS_STATED)
    odds = np.exp(log_odds - log_odds.max())
    variances = np.exp(2 * log_dispersion) * (1 + correlations) / (1 - correlations)
    return dispersions * np.sqrt(max(1.0, float((odds * variances).sum() / odds.sum())))


def _restricted_likelihood(lines: list[Array], correlations: Array) -> tuple[Array, Array, int]:
    """Restricted likelihood of all residuals without the fitted lines, for each correlation (C,).

    Returns:
        (C,) sums of whitened squares; (C,) log determinants; degrees of freedom.
    """
    lines = [residuals for residuals in lines if len(residuals) >= MIN_POINTS]
    if not lines:
        return np.zeros(len(correlations)), np.zeros(len(correlations)), 0
    shared = 1 - correlations**2
    parts = np.array([_lag_products(residuals) for residuals in lines])  # (L, 4, 3, 3)
    first, later, lagged, earlier = parts.transpose(1, 2, 3, 0)[..., None]
    # Whitened, numbers are x_1 and (x_i - r x_i-1) / sqrt(1 - r^2): their products are quadratic in r.
    products = first + (later - correlations * lagged + correlations**2 * earlier) / shared  # (3, 3, L, C)
    (a, b, x), (_, c, y), (_, _, z) = products
    determinant = a * c - b**2
    squares = z - (c * x**2 - 2 * b * x * y + a * y**2) / determinant
    counts = np.array([len(residuals) for residuals in lines])
    volume = np.log(determinant).sum(axis=0) + (counts - 1).sum() * np.log(shared)
    return squares.sum(axis=0), volume, int((counts - 2).sum())


def _lag_products(residuals: Array) -> Array:
    """Scalar products (3, 3) of a constant, a slope and residuals (N,).

    Returns:
        (4, 3, 3) of the first numbers; of all others; of neighbours, both ways; of all but the last ones.
    """
    count = len(residuals)
    rows = np.array([np.ones(count), np.linspace(-1.0, 1.0, count), residuals])
    first, last = (np.outer(ends, ends) for ends in (rows[:, 0], rows[:, -1]))
    whole, lagged = rows @ rows.T, rows[:, 1:] @ rows[:, :-1].T
    return np.array([first, whole - first, lagged + lagged.T, whole - last])


def _dispersion(residuals: Array) -> float:
    degrees = max(len(residuals) - 2, 1)
    chi2 = float(residuals @ residuals) / degrees
    return float(np.sqrt(chi2)) if chi2 > 1 + SIGNIFICANT_SIGMA * np.sqrt(2 / degrees) else 1.0
