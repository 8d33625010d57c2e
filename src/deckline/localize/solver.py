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
    State,
    Terms,
    linearize_deck_prior,
    linearize_height_prior,
    linearize_measurements,
    linearize_nuisance_prior,
)
from deckline.localize.noise import CORRELATION, CORRELATION_SIGMA, noise_inflation
from deckline.localize.observations import Observations

Array = NDArray[np.float64]
STEPS = 12  # of Gauss-Newton at most; three or four are usual
CONVERGED = 1e-2  # 1-sigma; a smaller step ends the iteration
HUBER = 2.5  # 1-sigma; cost of larger residuals grows linearly: 99 % efficient without outliers
CUTOFF = 5.0  # 1-sigma; larger residuals are outliers of weight 0
MIN_COMMON_DIRECTION = 1e-6  # length of the sum of the lines' unit vectors; 0 for opposite directions
MEDIAN_TO_SIGMA = 1.4826  # of a normal distribution's sizes
DEPTH = "depth"  # key of all depths in `Solution.inflation`
DAMPING = 10.0  # factor on the damping after a step that raises the cost


@dataclass(frozen=True, eq=False)
class _Fit:
    """A state and the residuals there."""

    state: State
    measurement: Terms
    prior: Terms


@dataclass(frozen=True, eq=False)
class Solution:
    """The estimated state and its sensitivities: each column is the change by one source of 1-sigma."""

    names: tuple[str, ...]
    state: State
    plane: DeckPlane
    points: Array  # (P, M) to the points' noise and the prior of the lines' geometry
    height: Array  # (P,) to the error of the reported deck height less the aircraft's own; 0 without a report
    nuisances: Array  # (P, 6) to the nuisances
    height_score: float  # normalised innovation of the reported deck height
    inflation: dict[str, float]  # noise inflation of each line's points, and DEPTH of all depths


def solve(
    observations: Observations,
    start: State,
    noise: FrameNoise,
    deck: Deck,
    deck_z_m: float | None,
    inflation: dict[str, float] | None = None,
) -> Solution:
    """The most probable state.

    Args:
        observations: the lines' points.
        start: of the iteration.
        noise: 1-sigma of pose, calibration and depth.
        deck: prior of the lines' geometry.
        deck_z_m: the reported deck height; None: it is not used.
        inflation: of an earlier solution; the prior of the lines' geometry is then used too. None: a fit without
            that prior measures it.
    """
    plane = _orient_plane(start, noise)
    blocks = _number_blocks(observations)

    def terms(state: State) -> tuple[Terms, Terms]:
        measurement = _concatenate(*linearize_measurements(observations, state, plane, noise))
        geometry = _no_terms(state) if inflation is None else linearize_deck_prior(observations.names, state, deck)
        height = linearize_height_prior(state, deck_z_m, noise)
        return measurement, _concatenate(geometry, height, linearize_nuisance_prior(state))

    keys = (*observations.names, DEPTH)
    if inflation is None:
        scale = np.ones(len(keys))
        fit = _minimize(terms, start, blocks, scale)
        scale = _measure_inflation(fit.measurement, blocks, observations)
        fit = _minimize(terms, fit.state, blocks, scale) if (scale > 1.0).any() else fit
    else:
        scale = np.array([inflation[key] for key in keys])
        fit = _minimize(terms, start, blocks, scale)
    factors = dict(zip(keys, scale.tolist(), strict=True))
    return _derive_solution(factors, fit, plane, blocks, scale, deck_z_m is not None)


def _orient_plane(start: State, noise: FrameNoise) -> DeckPlane:
    """The plane of the deck through the lines, its axes along and across their mean direction."""
    along = np.array([np.cos(start.azimuths_rad).sum(), np.sin(start.azimuths_rad).sum()])
    length = float(np.linalg.norm(along))
    if length < MIN_COMMON_DIRECTION:  # lines in opposite directions
        along, length = np.array([np.cos(start.azimuths_rad[0]), np.sin(start.azimuths_rad[0])]), 1.0
    forward, right = along / length, np.array([-along[1], along[0]]) / length
    return DeckPlane(start.points_m.mean(axis=0), np.stack([forward, right]), np.full(2, noise.slope_rad))


def _number_blocks(observations: Observations) -> NDArray[np.int64]:
    """Block number (N + D,) of each measurement: one per line for its pixels and one for all depths."""
    depths = int(np.isfinite(observations.log_depth).sum())
    return np.concatenate([observations.line, np.full(depths, len(observations.names), dtype=np.int64)])


def _minimize(
    terms: Callable[[State], tuple[Terms, Terms]], start: State, blocks: NDArray[np.int64], scale: Array
) -> _Fit:
    state, damping = start, 0.0
    measurement, prior = terms(state)
    for _ in range(STEPS):
        weights = _robust_weights(measurement.residuals, blocks) / scale[blocks] ** 2
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
    return _Fit(state, measurement, prior)


def _cost(measurement: Terms, prior: Terms, weights: Array) -> float:
    return float(weights @ measurement.residuals**2 + prior.residuals @ prior.residuals)


def _normal_matrix(measurement: Terms, prior: Terms, weights: Array) -> Array:
    return (measurement.jacobian.T * weights) @ measurement.jacobian + prior.jacobian.T @ prior.jacobian


def _robust_weights(residuals: Array, blocks: NDArray[np.int64]) -> Array:
    """Huber weights with a cut-off, in units of each block's median deviation where that exceeds the assumed noise."""
    size = np.abs(residuals)
    deviation = np.ones(int(blocks.max()) + 1)
    for block in range(len(deviation)):
        members = np.sort(size[blocks == block])
        if len(members):
            deviation[block] = max(1.0, MEDIAN_TO_SIGMA * float(members[len(members) // 2]))
    size = size / deviation[blocks]
    return np.where(size > CUTOFF, 0.0, np.minimum(1.0, HUBER / np.maximum(size, HUBER)))


def _measure_inflation(measurement: Terms, blocks: NDArray[np.int64], observations: Observations) -> Array:
    """Noise inflation of each block, (L + 1,)."""
    weights = _robust_weights(measurement.residuals, blocks)
    nearness = observations.world_rays[:, 2]
    along = np.concatenate([nearness, nearness[np.isfinite(observations.log_depth)]])
    parts = []
    for block in range(len(observations.names) + 1):
        members = np.flatnonzero((blocks == block) & (weights > 0))
        members = members[np.argsort(along[members])]
        parts.append(np.sqrt(weights[members]) * measurement.residuals[members])
    pixels = noise_inflation(parts[:-1], CORRELATION, CORRELATION_SIGMA)
    return np.concatenate([pixels, noise_inflation(parts[-1:], 0.0, CORRELATION_SIGMA)])


def _derive_solution(
    inflation: dict[str, float], fit: _Fit, plane: DeckPlane, blocks: NDArray[np.int64], scale: Array, has_height: bool
) -> Solution:
    measurement, prior = fit.measurement, fit.prior
    weights = _robust_weights(measurement.residuals, blocks) / scale[blocks] ** 2
    inverse = np.linalg.inv(_normal_matrix(measurement, prior, weights))
    by_points = inverse @ measurement.jacobian.T * (weights * scale[blocks])
    by_prior = inverse @ prior.jacobian.T
    geometry = by_prior[:, : -NUISANCES - 1 if has_height else -NUISANCES]
    height, score = np.zeros(len(inverse)), 0.0
    if has_height:
        height, row = by_prior[:, -NUISANCES - 1], prior.jacobian[-NUISANCES - 1]
        score = float(prior.residuals[-NUISANCES - 1] / np.sqrt(max(1 - row @ height, 1e-12)))
    points = np.hstack([by_points, geometry])
    nuisances = by_prior[:, -NUISANCES:]
    return Solution(tuple(inflation)[:-1], fit.state, plane, points, height, nuisances, score, inflation)


def _concatenate(*terms: Terms) -> Terms:
    return Terms(np.concatenate([t.residuals for t in terms]), np.vstack([t.jacobian for t in terms]))


def _no_terms(state: State) -> Terms:
    return Terms(np.zeros(0), np.zeros((0, 2 * len(state.azimuths_rad) + 1 + NUISANCES)))
