"""Both lines, the deck's height and what is uncertain of camera and attitude, fitted together in the image.

Robust Gauss-Newton on residuals in units of their noise, in pixels for points and in log depth for the depth camera,
with prior terms for what is known of the deck and how wrong pose and calibration may be. The same step that gives the
estimate gives its covariance: what every source of noise moves it by.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.localize.config import LocalizeConfig, NoiseConfig
from deckline.localize.model import (
    NUISANCES,
    Deck,
    State,
    Terms,
    deck_terms,
    height_term,
    measured_terms,
    nuisance_terms,
)
from deckline.localize.sight import Sight
from deckline.localize.spread import inflation

Array = NDArray[np.float64]
STEPS = 12  # Gauss-Newton; three or four are enough unless the reported height is far off
SETTLED = 1e-2  # 1-sigma; the step after such a one is nothing
HUBER = 2.5  # residuals beyond so many 1-sigma count by their size, not its square: 99 % efficient without outliers
CUTOFF = 5.0  # residuals beyond so many are outliers and do not count
LEAST_COMMON = 1e-6  # length of the lines' summed directions that still has a direction
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
    deck: Deck
    points: Array  # (P, M) by the points' noise and by what is known of the lines' lie
    height: Array  # (P,) by the error of the reported deck height against the own; 0 without
    nuisances: Array  # (P, 6)
    height_score: float  # reported deck height against what everything else says, 1-sigma
    spreads: dict[str, float]  # how much more than assumed each line's points err, and DEPTH all depths


def solve(
    view: Sight,
    start: State,
    config: LocalizeConfig,
    deck_z_m: float | None,
    spreads: dict[str, float] | None = None,
) -> Solution:
    """The most probable state.

    Args:
        view: what is seen of the lines.
        start: where to begin.
        config: noise and what is known of the deck.
        deck_z_m: the deck height that is reported; None: not to be used.
        spreads: those of an earlier solution: then what is known of how the lines lie to each other is used as well.
            None: they are measured, by a fit that does not use it.
    """
    deck = _deck(view, start, config)
    blocks = _blocks(view)

    def terms(state: State) -> tuple[Terms, Terms]:
        measured = _stacked(*measured_terms(view, state, deck, config.noise))
        known = _nothing(state) if spreads is None else deck_terms(view.names, state, config)
        return measured, _stacked(known, height_term(state, deck_z_m, config.noise), nuisance_terms(state))

    keys = (*view.names, DEPTH)
    scale = np.ones(len(keys))
    if spreads is None:
        fit = _minimum(terms, start, blocks, scale)
        scale = _scales(fit.measured, blocks, view, config.noise)
        fit = _minimum(terms, fit.state, blocks, scale) if (scale > 1.0).any() else fit
    else:
        scale = np.array([spreads[key] for key in keys])
        fit = _minimum(terms, start, blocks, scale)
    found = dict(zip(keys, scale.tolist(), strict=True))
    return _solution(found, fit, deck, blocks, scale, deck_z_m is not None)


def _deck(view: Sight, start: State, config: LocalizeConfig) -> Deck:
    along = np.array([np.cos(start.azimuths_rad).sum(), np.sin(start.azimuths_rad).sum()])
    length = float(np.linalg.norm(along))
    if length < LEAST_COMMON:  # lines in opposite directions
        along, length = np.array([np.cos(start.azimuths_rad[0]), np.sin(start.azimuths_rad[0])]), 1.0
    forward, right = along / length, np.array([-along[1], along[0]]) / length
    return Deck(start.points_m.mean(axis=0), np.stack([forward, right]), np.full(2, config.deck.tilt_rad))


def _blocks(view: Sight) -> NDArray[np.int64]:
    """Which measurements err alike: (N + D,) numbers, one per line for its pixels and one for all depths."""
    depths = int(np.isfinite(view.log_depth).sum())
    return np.concatenate([view.line, np.full(depths, len(view.names), dtype=np.int64)])


def _minimum(
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
        trial = state.moved(step)
        after = terms(trial)
        if _cost(*after, weights) > cost * (1 + 1e-9) + 1e-9:
            damping = max(damping, 1e-4) * DAMPING
            continue
        state, (measured, known), damping = trial, after, damping / DAMPING
        if float(step @ normal @ step) < SETTLED**2:
            break
    return _Fit(state, measured, known)


def _cost(measured: Terms, known: Terms, weights: Array) -> float:
    return float(weights @ measured.residuals**2 + known.residuals @ known.residuals)


def _normal(measured: Terms, known: Terms, weights: Array) -> Array:
    return (measured.jacobian.T * weights) @ measured.jacobian + known.jacobian.T @ known.jacobian


def _weights(residuals: Array, blocks: NDArray[np.int64]) -> Array:
    """Huber's, with a cut-off, in units of each block's own spread where that is larger than assumed."""
    size = np.abs(residuals)
    spread = np.ones(int(blocks.max()) + 1)
    for block in range(len(spread)):
        mine = np.sort(size[blocks == block])
        if len(mine):
            spread[block] = max(1.0, MEDIAN_TO_SIGMA * float(mine[len(mine) // 2]))
    size = size / spread[blocks]
    return np.where(size > CUTOFF, 0.0, np.minimum(1.0, HUBER / np.maximum(size, HUBER)))


def _scales(measured: Terms, blocks: NDArray[np.int64], view: Sight, noise: NoiseConfig) -> Array:
    """How much more than assumed the measurements of each block err, as 1-sigma, (L + 1,)."""
    weights = _weights(measured.residuals, blocks)
    nearness = view.world_rays[:, 2]
    along = np.concatenate([nearness, nearness[np.isfinite(view.log_depth)]])
    parts = []
    for block in range(len(view.names) + 1):
        mine = np.flatnonzero((blocks == block) & (weights > 0))
        mine = mine[np.argsort(along[mine])]
        parts.append(np.sqrt(weights[mine]) * measured.residuals[mine])
    sigma = noise.point_correlation_sigma
    pixels, depths = inflation(parts[:-1], noise.point_correlation, sigma), inflation(parts[-1:], 0.0, sigma)
    return np.concatenate([pixels, depths])


def _solution(
    spreads: dict[str, float], fit: _Fit, deck: Deck, blocks: NDArray[np.int64], scale: Array, reported: bool
) -> Solution:
    measured, known = fit.measured, fit.known
    weights = _weights(measured.residuals, blocks) / scale[blocks] ** 2
    inverse = np.linalg.inv(_normal(measured, known, weights))
    by_points = inverse @ measured.jacobian.T * (weights * scale[blocks])
    by_known = inverse @ known.jacobian.T
    lie = by_known[:, : -NUISANCES - 1 if reported else -NUISANCES]
    height, score = np.zeros(len(inverse)), 0.0
    if reported:
        height, row = by_known[:, -NUISANCES - 1], known.jacobian[-NUISANCES - 1]
        score = float(known.residuals[-NUISANCES - 1] / np.sqrt(max(1 - row @ height, 1e-12)))
    moved = np.hstack([by_points, lie])
    return Solution(tuple(spreads)[:-1], fit.state, deck, moved, height, by_known[:, -NUISANCES:], score, spreads)


def _stacked(*terms: Terms) -> Terms:
    return Terms(np.concatenate([t.residuals for t in terms]), np.vstack([t.jacobian for t in terms]))


def _nothing(state: State) -> Terms:
    return Terms(np.zeros(0), np.zeros((0, 2 * len(state.azimuths_rad) + 1 + NUISANCES)))
