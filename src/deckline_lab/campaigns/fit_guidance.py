"""Fit `guidance_model` to the looks of flights that were seen by points."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from deckline.types import Status
from deckline_lab.campaigns.fit_detection import hat
from deckline_lab.campaigns.looks import QUANTITIES
from deckline_sim.landing.guidance_model import (
    DEPTHS,
    GRADES,
    LEVELS,
    RANGE_M,
    ROUGH_SEA,
    SCORES,
    STATUSES,
    GuidanceModel,
)
from deckline_sim.landing.surroundings import Surroundings

Array = NDArray[np.float64]
LEAST_LOOKS = 40  # of a table's cell; with fewer it has those of both groups
LAGS_S = (0.2, 0.5, 1.0, 2.0)  # at which scores are compared with themselves
TIMES_S = np.geomspace(0.05, 20.0, 40)  # time constants tried, s
PRIOR_LOOKS = 2.0  # looks of the prior that is added to those from each status


@dataclass(frozen=True, eq=False)
class Looks:
    """Looks of many flights, one row each, in the order of flights and times."""

    flight: NDArray[np.int64]
    """(N,)."""
    time_s: Array
    """(N,) s."""
    range_m: Array
    """(N,) m."""
    depth: Array
    """(N,) distance in visibilities."""
    condition: NDArray[np.int64]
    """(N, 2) navigation grade, sea."""
    status: NDArray[np.int64]
    """(N,) index in `STATUSES`."""
    errors: Array
    """(N, 8) shares of the protection level, m/s and m/s2; NaN: not given."""
    sigmas: Array
    """(N, 8)."""
    levels: Array
    """(N, 4)."""


def gather(flights: Sequence[tuple[Surroundings, Sequence[Mapping[str, Any]]]]) -> Looks:
    """The looks of flights as arrays."""
    rows: list[tuple[Any, ...]] = []
    for number, (scene, looks) in enumerate(flights):
        config = scene.config
        condition = GRADES.index(config.navigation), int(config.sea_state >= ROUGH_SEA)
        for look in looks:
            values = [look["errors"][name] or (None, None, None) for name in QUANTITIES]
            error, sigma, level = (np.array(part, dtype=np.float64) for part in zip(*values, strict=True))
            status = STATUSES.index(Status(look["status"]))
            depth = look["range_m"] / config.visibility_m
            rows.append((number, look["time_s"], look["range_m"], depth, condition, status, error, sigma, level))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    flight, time_s, range_m, depth, conditions, statuses, errors, sigmas, levels = columns
    levels = levels[:, : len(LEVELS)]
    errors[:, : len(LEVELS)] /= levels
    return Looks(flight, time_s, range_m, depth, conditions, statuses, errors, sigmas, levels)


def fit_guidance(looks: Looks, rate_hz: float) -> GuidanceModel:
    """The model of these looks; `rate_hz`: of their pictures.

    Raises:
        ValueError: no look with guidance of a navigation grade and a sea.
    """
    shape = (len(GRADES), 2, 2, len(RANGE_M))
    probabilities = norm.cdf(SCORES)
    errors, sigmas = np.zeros((*shape, len(QUANTITIES), len(SCORES))), np.zeros((*shape, len(QUANTITIES)))
    levels = np.zeros((*shape, len(LEVELS)))
    for cell, rows in cells(looks):
        errors[cell] = np.nanquantile(looks.errors[rows], probabilities, axis=0).T
        sigmas[cell] = np.nanmedian(looks.sigmas[rows], axis=0)
        levels[cell] = np.nanmedian(looks.levels[rows], axis=0)
    scores = normal_scores(looks, errors)
    return GuidanceModel(
        rate_hz,
        fit_times(looks, scores),
        fit_mixing(scores),
        errors,
        sigmas,
        levels,
        fit_level_spread(looks, levels),
        fit_transitions(looks),
    )


def cells(looks: Looks) -> Iterator[tuple[tuple[int, int, int, int], NDArray[np.bool_]]]:
    """Every cell of the tables with its looks; a sparse cell has those of both groups, then of more distances."""
    given = np.isfinite(looks.errors[:, :4]).all(axis=1) & np.isfinite(looks.levels).all(axis=1)
    nearest = np.abs(looks.range_m[:, None] - np.array(RANGE_M)).argmin(axis=1)
    is_other = looks.status != STATUSES.index(Status.OK)
    for grade, sea in product(range(len(GRADES)), range(2)):
        here = given & (looks.condition[:, 0] == grade) & (looks.condition[:, 1] == sea)
        if not here.any():
            raise ValueError(f"no look with guidance of grade {GRADES[grade]} and sea {sea}")
        for group, k in product(range(2), range(len(RANGE_M))):
            rows = here & (nearest == k) & (is_other == bool(group))
            reach = 0
            while rows.sum() < LEAST_LOOKS and reach <= len(RANGE_M):
                rows = here & (np.abs(nearest - k) <= reach)
                reach += 1
            yield (grade, sea, group, k), rows


def places(looks: Looks) -> tuple[Array, NDArray[np.int64]]:
    """Weights (N, ranges) of the tables' distances at every look, and its group (N,)."""
    weights = np.array([hat(float(range_m), RANGE_M) for range_m in looks.range_m])
    return weights, (looks.status != STATUSES.index(Status.OK)).astype(np.int64)


def normal_scores(looks: Looks, errors: Array) -> Array:
    """(N, 8) normal score of every error in its condition; NaN where none was given."""
    weights, group = places(looks)
    table = errors[looks.condition[:, 0], looks.condition[:, 1], group]  # (N, ranges, 8, scores)
    quantiles = np.einsum("nr,nrqs->nqs", weights, table)
    scores = np.full(looks.errors.shape, np.nan)
    for i, j in np.argwhere(np.isfinite(looks.errors)):
        scores[i, j] = np.interp(looks.errors[i, j], quantiles[i, j], SCORES)
    return scores


def fit_mixing(scores: Array) -> Array:
    """Lower triangle (8, 8) that gives independent scores the correlations of these."""
    known = scores[np.isfinite(scores).all(axis=1)]
    values, vectors = np.linalg.eigh(np.corrcoef(known.T))
    lifted = vectors @ np.diag(np.maximum(values, 1e-3)) @ vectors.T
    scale = 1.0 / np.sqrt(np.diag(lifted))
    return np.asarray(np.linalg.cholesky(lifted * np.outer(scale, scale)))


def fit_times(looks: Looks, scores: Array) -> Array:
    """Time constant (8,) of every score, s, by its correlation with itself."""
    step_s = float(np.median(np.diff(looks.time_s)[np.diff(looks.flight) == 0]))
    seconds = []
    for column in scores.T:
        found = []
        for lag_s in LAGS_S:
            lag = max(round(lag_s / step_s), 1)
            same = looks.flight[lag:] == looks.flight[:-lag]
            pair = np.stack([column[lag:], column[:-lag]])[:, same]
            pair = pair[:, np.isfinite(pair).all(axis=0)]
            found.append((lag * step_s, float(np.corrcoef(pair)[0, 1])))
        lags, correlations = np.array(found).T
        losses = [float(np.sum((np.exp(-lags / time_s) - correlations) ** 2)) for time_s in TIMES_S]
        seconds.append(float(TIMES_S[int(np.argmin(losses))]))
    return np.array(seconds)


def fit_level_spread(looks: Looks, levels: Array) -> float:
    """1-sigma over the flights of the mean logarithm of a level over its table's."""
    weights, group = places(looks)
    table = levels[looks.condition[:, 0], looks.condition[:, 1], group]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(looks.levels[:, :2] / np.einsum("nr,nrq->nq", weights, table)[:, :2]).mean(axis=1)
    means = [np.nanmean(ratio[looks.flight == flight]) for flight in np.unique(looks.flight[np.isfinite(ratio)])]
    return float(np.std(means))


def fit_transitions(looks: Looks) -> Array:
    """(grades, depths, statuses, statuses) cumulative probabilities of the next status.

    A flight begins as not seen. Prior: the same of all grades, and of these that any status is followed by what is
    seen at the distance.
    """
    size, band = len(STATUSES), np.clip(np.searchsorted(DEPTHS, looks.depth, "right") - 1, 0, None)
    counts = np.zeros((len(GRADES), len(DEPTHS), size, size))
    is_first = np.diff(looks.flight, prepend=-1) != 0
    before = np.where(is_first, STATUSES.index(Status.NOT_SEEN), np.roll(looks.status, 1))
    np.add.at(counts, (looks.condition[:, 0], band, before, looks.status), 1.0)
    seen = counts.sum(axis=(0, 2))
    seen += 1e-6 * seen.sum(axis=0)  # distances without looks have those of all
    of_all = counts.sum(axis=0) + PRIOR_LOOKS * (seen / seen.sum(axis=1, keepdims=True))[:, None]
    chances = counts + PRIOR_LOOKS * of_all / of_all.sum(axis=2, keepdims=True)
    cumulative: Array = np.cumsum(chances / chances.sum(axis=3, keepdims=True), axis=3)
    cumulative[..., -1] = 1.0
    return cumulative
