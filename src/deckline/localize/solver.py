"""The joint fit: lines, deck height and the errors of camera and attitude, estimated together in the image.

Robust Gauss-Newton on residuals in units of their noise, in pixels for points and in log depth for the depth camera,
with priors of the deck, the pose and the calibration. The last step gives the sensitivity of the estimate to every
source of noise, and with it the covariance.
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
    deck_terms,
    height_term,
    measurement_terms,
    nuisance_terms,
)
from deckline.localize.noise import CORRELATION, CORRELATION_SIGMA, noise_inflation
from deckline.localize.observations import Observations

Array = NDArray[np.float64]
STEPS = 12  # Gauss-Newton; three or four are enough unless the reported height is far off
CONVERGED = 1e-2  # 1-sigma; a smaller step ends the iteration
HUBER = 2.5  # residuals beyond so many 1-sigma count by their size, not its square: 99 % efficient without outliers
CUTOFF = 5.0  # residuals beyond so many are outliers and do not count
MIN_COMMON_DIRECTION = 1e-6  # length of the lines' summed directions that still has a direction
MEDIAN_TO_SIGMA = 1.4826  # of a normal distribution's sizes
DEPTH = "depth"  # beside the lines' names
DAMPING = 10.0  # of a step that made things worse


@dataclass(frozen=True, eq=False)
class _Fit:
    """A state with what follows from it."""

    state: State
    measured: Terms
    known: Terms


@dataclass(frozen=True, eq=False)
class Solution:
    """A state and how it follows the measurements: columns of `gain` are 1-sigma of one source each."""

    names: tuple[str, ...]
    state: State
    deck: DeckPlane
    points: Array  # (P, M) by the points' noise and by the prior of the lines' geometry
    height: Array  # (P,) by the error of the reported deck height less that of the aircraft; 0 without
    nuisances: Array  # (P, 6)
    height_score: float  # innovation of the reported deck height against all else, 1-sigma
    inflation: dict[str, float]  # noise inflation of each line's points, and DEPTH of all depths


def solve(
    view: Observations,
    start: State,
    noise: FrameNoise,
    deck: Deck,
    deck_z_m: float | None,
    inflation: dict[str, float] | None = None,
) -> Solution:
    """The most probable state.

    Args:
        view: the lines' points.
        start: of the iteration.
        noise: 1-sigma of pose, calibration and depth.
        deck: prior of the lines' geometry.
        deck_z_m: the deck height that is reported; None: not to be used.
        inflation: of an earlier solution; the prior of the lines' geometry is then used as well. None: it is measured
            by a fit that does not use that prior.
    """
    plane = _deck_plane(view, start, noise)
    blocks = _blocks(view)

    def terms(state: State) -> tuple[Terms, Terms]:
        measured = _stack(*measurement_terms(view, state, plane, noise))
        geometry = _no_terms(state) if inflation is None else deck_terms(view.names, state, deck)
        return measured, _stack(geometry, height_term(state, deck_z_m, noise), nuisance_terms(state))

    keys = (*view.names, DEPTH)
    if inflation is None:
        scale = np.ones(len(keys))
        fit = _minimise(terms, start, blocks, scale)
        scale = _measure_inflation(fit.measured, blocks, view)
        fit = _minimise(terms, fit.state, blocks, scale) if (scale > 1.0).any() else fit
    else:
        scale = np.array([inflation[key] for key in keys])
        fit = _minimise(terms, start, blocks, scale)
    found = dict(zip(keys, scale.tolist(), strict=True))
    return _solution(found, fit, plane, blocks, scale, deck_z_m is not None)


def _deck_plane(view: Observations, start: State, noise: FrameNoise) -> DeckPlane:
    along = np.array([np.cos(start.azimuths_rad).sum(), np.sin(start.azimuths_rad).sum()])
    length = float(np.linalg.norm(along))
    if length < MIN_COMMON_DIRECTION:  # lines in opposite directions
        along, length = np.array([np.cos(start.azimuths_rad[0]), np.sin(start.azimuths_rad[0])]), 1.0
    forward, right = along / length, np.array([-along[1], along[0]]) / length
    return DeckPlane(start.points_m.mean(axis=0), np.stack([forward, right]), np.full(2, noise.slope_rad))


def _blocks(view: Observations) -> NDArray[np.int64]:
    """Block number (N + D,) of each measurement: one per line for its pixels and one for all depths."""
    depths = int(np.isfinite(view.log_depth).sum())
    return np.concatenate([view.line, np.full(depths, len(view.names), dtype=np.int64)])


def _minimise(
    terms: Callable[[State], tuple[Terms, Terms]], start: State, blocks: NDArray[np.int64], scale: Array
) -> _Fit:
    state, damping = start, 0.0
    measured, known = terms(state)
    for _ in range(STEPS):
        weights = _weights(measured.residuals, blocks) / scale[blocks] ** 2
        cost = _cost(measured, known, weights)
        normal = _normal(measured, known, weights)
        right = measured.jacobian.T @ (weights * measured.residuals) + known.jacobian.T @ known.residuals
        damped = normal + damping * np.diag(np.diag(normal))
        step: Array = np.asarray(np.linalg.solve(damped, right), dtype=np.float64)
        trial = state.step(step)
        after = terms(trial)
        if _cost(*after, weights) > cost * (1 + 1e-9) + 1e-9:
            damping = max(damping, 1e-4) * DAMPING
            continue
        state, (measured, known), damping = trial, after, damping / DAMPING
        if float(step @ normal @ step) < CONVERGED**2:
            break
    return _Fit(state, measured, known)


def _cost(measured: Terms, known: Terms, weights: Array) -> float:
    return float(weights @ measured.residuals**2 + known.residuals @ known.residuals)


def _normal(measured: Terms, known: Terms, weights: Array) -> Array:
    return (measured.jacobian.T * weights) @ measured.jacobian + known.jacobian.T @ known.jacobian


def _weights(residuals: Array, blocks: NDArray[np.int64]) -> Array:
    """Huber weights with a cut-off, in units of each block's median deviation where that exceeds the assumed noise."""
    size = np.abs(residuals)
    deviation = np.ones(int(blocks.max()) + 1)
    for block in range(len(deviation)):
        mine = np.sort(size[blocks == block])
        if len(mine):
            deviation[block] = max(1.0, MEDIAN_TO_SIGMA * float(mine[len(mine) // 2]))
    size = size / deviation[blocks]
    return np.where(size > CUTOFF, 0.0, np.minimum(1.0, HUBER / np.maximum(size, HUBER)))


def _measure_inflation(measured: Terms, blocks: NDArray[np.int64], view: Observations) -> Array:
    """Noise inflation of each block, (L + 1,)."""
    weights = _weights(measured.residuals, blocks)
    nearness = view.world_rays[:, 2]
    along = np.concatenate([nearness, nearness[np.isfinite(view.log_depth)]])
    parts = []
    for block in range(len(view.names) + 1):
        mine = np.flatnonzero((blocks == block) & (weights > 0))
        mine = mine[np.argsort(along[mine])]
        parts.append(np.sqrt(weights[mine]) * measured.residuals[mine])
    pixels = noise_inflation(parts[:-1], CORRELATION, CORRELATION_SIGMA)
    return np.concatenate([pixels, noise_inflation(parts[-1:], 0.0, CORRELATION_SIGMA)])


def _solution(
    inflation: dict[str, float], fit: _Fit, plane: DeckPlane, blocks: NDArray[np.int64], scale: Array, reported: bool
) -> Solution:
    measured, known = fit.measured, fit.known
    weights = _weights(measured.residuals, blocks) / scale[blocks] ** 2
    inverse = np.linalg.inv(_normal(measured, known, weights))
    by_points = inverse @ measured.jacobian.T * (weights * scale[blocks])
    by_known = inverse @ known.jacobian.T
    geometry = by_known[:, : -NUISANCES - 1 if reported else -NUISANCES]
    height, score = np.zeros(len(inverse)), 0.0
    if reported:
        height, row = by_known[:, -NUISANCES - 1], known.jacobian[-NUISANCES - 1]
        score = float(known.residuals[-NUISANCES - 1] / np.sqrt(max(1 - row @ height, 1e-12)))
    points = np.hstack([by_points, geometry])
    nuisances = by_known[:, -NUISANCES:]
    return Solution(tuple(inflation)[:-1], fit.state, plane, points, height, nuisances, score, inflation)


def _stack(*terms: Terms) -> Terms:
    return Terms(np.concatenate([t.residuals for t in terms]), np.vstack([t.jacobian for t in terms]))


def _no_terms(state: State) -> Terms:
    return Terms(np.zeros(0), np.zeros((0, 2 * len(state.azimuths_rad) + 1 + NUISANCES)))
