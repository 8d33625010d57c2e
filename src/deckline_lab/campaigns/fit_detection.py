"""Fit `detection_model` to the looks of rendered flights."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import owens_t
from scipy.stats import norm

from deckline.geometry import Camera
from deckline.types import SIDES, LinePoints
from deckline_lab.campaigns.looks import approach_moments, points_of
from deckline_sim.landing.detection_model import (
    DEPTHS,
    RANGE_M,
    DetectionModel,
    Extent,
    FalseLines,
    LineErrors,
    Presence,
)
from deckline_sim.landing.modelled_detector import OUTWARD, latent_mean, visible_ends
from deckline_sim.landing.surroundings import Surroundings
from deckline_sim.ship.layout import truth_segments

Array = NDArray[np.float64]
FALSE_M = 2.0  # distance of a line's points from the true line from which it is another one
LEAST_POINTS = 4  # of a line whose slope counts
SHARES = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7)  # of a variance that a flight keeps, tried
TIMES_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.0)  # time constants tried, s
ROWS_PX = (0.1, 0.3, 0.5, 0.8, 1.2, 1.8, 2.5, 4.0)  # rows tried, px
SLOW_SHARES = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  # of a variance that changes slowly, tried
SLOW_S = (0.3, 0.6, 1.2, 2.5, 5.0, 10.0, 20.0, 40.0)  # its time constants tried, s
TINY = 1e-9  # in place of a zero that is divided by
LEAST_SCORE = 0.05  # 1-sigma of an offset or a slope, in reported 1-sigmas
MOST_SCORE = 2.5  # in reported 1-sigmas, beyond which an error counts as so large
MOST_STEPS = 2.0  # of the nearest point from the true end
LAGS = (1, 2, 4, 8, 16, 32)  # looks
UNSURE = 2.5  # latent means within which a pair of looks tells of its correlation
FALSE_DEFAULT = (0.5, 3.0)  # mean time, s, and 1-sigma, m, of false lines where the flights have none; our choice


@dataclass(frozen=True, eq=False)
class LineLook:
    """One found line against its truth."""

    flight: int
    side: int
    time_s: float
    range_m: float
    depth: float
    points: float
    """As many as its rows would have untrimmed."""
    near_steps: float
    """From the true near end to the nearest point, in rows between neighbouring points."""
    far: float
    """Share of the rows without points at the far end."""
    log_sigma: float
    """Of the median, px."""
    log_sigma_rows: float
    """Change from the middle to the near end."""
    offset: float
    """In reported 1-sigmas."""
    slope: float
    """In reported 1-sigmas."""
    white: float
    """Root mean square of single points, in reported 1-sigmas."""
    correlation: float
    """Of neighbouring points."""
    step_px: float
    """Between the rows of neighbouring points, px."""
    off_m: float
    """Median distance from the true line, m."""


@dataclass(frozen=True, eq=False)
class FlightLooks:
    """One flight in the numbers that are fitted."""

    time_s: Array
    """(N,) of the looks, s."""
    depth: Array
    """(N,) distance to the ramp in visibilities."""
    range_m: Array
    """(N,) distance to the ramp, m."""
    width_px: Array
    """(N,) apparent width of the runway at the ramp, px."""
    found: NDArray[np.int64]
    """(N,) lines found."""
    lines: list[LineLook]
    """The found lines."""
    is_dark: bool
    """At dusk or night."""


def read_flight(number: int, scene: Surroundings, looks: Sequence[dict[str, Any]]) -> FlightLooks:
    """One flight against its truth."""
    lines: list[LineLook] = []
    widths, visibility_m = [], scene.config.visibility_m
    for moment, look in zip(approach_moments(scene), looks, strict=True):
        segments = truth_segments(scene.deck.moved_layout(moment.time_s))
        camera_from_world = (moment.world_from_body * scene.body_from_camera).inv()
        width_m = float(np.linalg.norm(segments[1].p0_m - segments[0].p0_m))
        widths.append(scene.camera.fx * width_m / max(look["range_m"], 1.0))
        for side, (name, segment) in enumerate(zip(SIDES, segments, strict=True)):
            points = points_of(look[name])
            ends = visible_ends(scene.camera, camera_from_world.apply(np.stack([segment.p0_m, segment.p1_m])))
            if len(points) >= LEAST_POINTS and ends is not None:
                place = (number, side, moment.time_s, look["range_m"], look["range_m"] / visibility_m)
                lines.append(compare_points(place, points, ends, scene.camera))
    ranges = np.array([look["range_m"] for look in looks])
    return FlightLooks(
        np.array([look["time_s"] for look in looks]),
        ranges / visibility_m,
        ranges,
        np.array(widths),
        np.array([sum(bool(look[side]) for side in SIDES) for look in looks]),
        lines,
        scene.config.time_of_day != "day",
    )


def compare_points(
    place: tuple[int, int, float, float, float], points: LinePoints, ends: Array, camera: Camera
) -> LineLook:
    """Points of a line against its true picture; `place`: the first fields of a `LineLook`."""
    order = np.argsort(-points.points_px[:, 1])  # near end first
    (u, v), sigma = points.points_px[order].T, points.sigma_px[order]
    share = (v - ends[0, 1]) / (ends[1, 1] - ends[0, 1])
    true_u, _, inverse_m = (start + share * (end - start) for start, end in zip(*ends, strict=True))
    error, middle = u - true_u, float(np.median(sigma))
    along = 1.0 - 2.0 * (share - share[0]) / max(share[-1] - share[0], 1e-9)
    basis = np.column_stack([np.ones(len(u)), along])
    offset, slope = np.linalg.lstsq(basis / sigma[:, None], error / sigma, rcond=None)[0]
    rest = (error - basis @ [offset, slope]) / sigma
    power = float(rest @ rest)
    near, far = float(share[0]), max(1.0 - float(share[-1]), 0.0)
    step_px = float(abs(v[0] - v[-1])) / (len(v) - 1)
    return LineLook(
        *place,
        points=len(u) / max(1.0 - near - far, 0.1),
        near_steps=near * float(abs(ends[1, 1] - ends[0, 1])) / max(step_px, 1e-9),
        far=far,
        log_sigma=float(np.log(middle)),
        log_sigma_rows=float(np.linalg.lstsq(basis, np.log(sigma), rcond=None)[0][1]),
        offset=float(offset) / middle,
        slope=float(slope) / middle,
        white=float(np.sqrt(power / len(rest))),
        correlation=float(rest[1:] @ rest[:-1]) / max(power, 1e-12),
        step_px=step_px,
        off_m=float(np.median(error / (camera.fx * np.maximum(inverse_m, 1e-6)))),
    )


def fit_detection(flights: Sequence[FlightLooks], rate_hz: float) -> DetectionModel:
    """The model of these flights; `rate_hz`: of their pictures."""
    lines = [line for flight in flights for line in flight.lines]
    true = [line for line in lines if abs(line.off_m) <= FALSE_M]
    if not true:
        raise ValueError(f"expected looks with lines, got none in {len(flights)} flights")
    return DetectionModel(
        fit_presence(flights), fit_errors(true), fit_extent(true), fit_false_lines(lines, rate_hz), rate_hz
    )


def fit_presence(flights: Sequence[FlightLooks]) -> Presence:
    """Ordinal probit by maximum likelihood, then its correlation by the likelihood of pairs of looks."""
    shapes = [(flight.depth, flight.width_px, flight.is_dark) for flight in flights]
    found = np.concatenate([flight.found for flight in flights])

    def presence(values: Array, share: float = 0.0, seconds: float = 1.0) -> Presence:
        intercept, per_visibility, per_size, dusk, log_band = map(float, values)
        return Presence(intercept, per_visibility, per_size, dusk, float(np.exp(log_band)), share, seconds)

    def means(values: Array) -> list[Array]:
        return [np.asarray(latent_mean(presence(values), *shape)) for shape in shapes]

    def loss(values: Array) -> float:
        mean, band = np.concatenate(means(values)), float(np.exp(values[4]))
        both, some = norm.cdf(mean), norm.cdf(mean + band)
        likely = np.choose(found, [1.0 - some, some - both, both])
        return float(-np.log(np.maximum(likely, 1e-6)).sum() + 0.01 * np.sum(np.square(values[1:])))

    best = minimize(loss, np.array([8.0, -6.0, 0.0, 0.0, -1.0]), method="Nelder-Mead", options={"maxiter": 4000}).x
    both = [flight.found == 2 for flight in flights]
    latent, seconds = means(best), [flight.time_s for flight in flights]
    share, time_s = max(product(SHARES, TIMES_S), key=lambda pair: pair_likelihood(both, latent, seconds, *pair))
    return presence(best, share, time_s)


def pair_likelihood(
    both: Sequence[NDArray[np.bool_]], latent: Sequence[Array], seconds: Sequence[Array], share: float, time_s: float
) -> float:
    """Log likelihood of pairs of looks under a share kept by a flight and a time constant of the rest."""
    total = 0.0
    for seen, mean, at in zip(both, latent, seconds, strict=True):
        for lag in LAGS:
            first, second = mean[:-lag], mean[lag:]
            unsure = np.maximum(np.abs(first), np.abs(second)) <= UNSURE
            rho = share + (1.0 - share) * np.exp(-(at[lag:] - at[:-lag]) / time_s)
            signs = np.where(np.stack([seen[:-lag], seen[lag:]]), 1.0, -1.0)
            chance = both_below(signs[0] * first, signs[1] * second, signs[0] * signs[1] * rho)
            total += float(np.log(np.maximum(chance[unsure], 1e-6)).sum())
    return total


def both_below(h: Array, k: Array, rho: Array) -> Array:
    """Chance that two standard normal variables of correlation rho lie below h and k.

    Source: Owen, "Tables for computing bivariate normal probabilities", 1956, equation 3.9.
    """
    h, k, rho = np.where(h == 0.0, TINY, h), np.where(k == 0.0, TINY, k), np.clip(rho, -0.9999, 0.9999)
    root = np.sqrt(1.0 - rho**2)
    rest = owens_t(h, (k / h - rho) / root) + owens_t(k, (h / k - rho) / root)
    return np.asarray((norm.cdf(h) + norm.cdf(k)) / 2 - rest - np.where(h * k < 0.0, 0.5, 0.0))


def fit_errors(lines: Sequence[LineLook]) -> LineErrors:
    """Reported 1-sigma, and errors in its units."""
    basis = np.array([[*hat(line.range_m, RANGE_M), *hat(line.depth, DEPTHS)[1:]] for line in lines])
    ridge = 0.1 * np.eye(basis.shape[1])
    values = np.array([line.log_sigma for line in lines])
    start = values.mean()
    solved = np.linalg.solve(basis.T @ basis + ridge, basis.T @ (values - start))
    in_range = [float(start + value) for value in solved[: len(RANGE_M)]]
    spread = float(np.std(values - start - basis @ solved))
    outward = mean_table(lines, RANGE_M, by_range, lambda line: OUTWARD[line.side] * line.slope)
    rows = min(ROWS_PX, key=lambda rows: sum((x.correlation - np.exp(-x.step_px / rows)) ** 2 for x in lines))
    offset = rms_table(lines, "offset", lambda line: noise_of_mean(line, rows))
    centred = [replace(line, slope=line.slope - expected_slope(line, outward)) for line in lines]
    slope = rms_table(centred, "slope", lambda line: 3.0 * noise_of_mean(line, rows))
    white = rms_table(lines, "white", lambda line: 0.0)
    share, seconds = fit_memory(lines, offset, slope, outward)
    return LineErrors(
        tuple(in_range),
        (0.0, *(float(value) for value in solved[len(RANGE_M) :])),
        spread,
        mean_table(lines, RANGE_M, by_range, lambda line: line.log_sigma_rows),
        offset,
        offset_between(lines, offset),
        slope,
        outward,
        white,
        rows,
        share,
        seconds,
    )


def by_range(line: LineLook) -> float:
    """The distance of a look, m."""
    return line.range_m


def expected_slope(line: LineLook, outward: Sequence[float]) -> float:
    """The mean slope of a line at its distance, in reported 1-sigmas."""
    return OUTWARD[line.side] * value_at(line, outward)


def offset_between(lines: Sequence[LineLook], offset: Sequence[float]) -> tuple[float, ...]:
    """Correlation of the offsets of both lines over `RANGE_M`, none below 0."""
    pairs = both_lines(lines)
    products = {id(left): clip(left.offset) * clip(right.offset) / value_at(left, offset) ** 2 for left, right in pairs}
    table = mean_table([left for left, _ in pairs], RANGE_M, by_range, lambda line: products[id(line)])
    return tuple(np.clip(table, 0.0, 0.95).tolist())


def both_lines(lines: Sequence[LineLook]) -> list[tuple[LineLook, LineLook]]:
    """Left and right of the looks that have both."""
    found: dict[tuple[int, float], dict[int, LineLook]] = {}
    for line in lines:
        found.setdefault((line.flight, line.time_s), {})[line.side] = line
    return [(pair[0], pair[1]) for pair in found.values() if len(pair) == len(SIDES)]


def clip(score: float) -> float:
    """A score with rare large values cut, which would rule a variance."""
    return min(max(score, -MOST_SCORE), MOST_SCORE)


def fit_memory(
    lines: Sequence[LineLook], offset: Sequence[float], slope: Sequence[float], outward: Sequence[float]
) -> tuple[float, float]:
    """Share of the variance that changes slowly and its time constant, s, by the mean products at lags."""
    products: list[tuple[float, float]] = []
    for key in {(line.flight, line.side) for line in lines}:
        own = [line for line in lines if (line.flight, line.side) == key]
        offsets = [clip(line.offset) / value_at(line, offset) for line in own]
        slopes = [clip(line.slope - expected_slope(line, outward)) / value_at(line, slope) for line in own]
        for scores in (offsets, slopes):
            for lag in LAGS:
                pairs = range(len(own) - lag)
                products += [(own[i + lag].time_s - own[i].time_s, scores[i] * scores[i + lag]) for i in pairs]
    apart, found = np.array(products).T

    def loss(share: float, seconds: float) -> float:
        return float(np.sum((found - share * np.exp(-apart / seconds)) ** 2))

    return min(product(SLOW_SHARES, SLOW_S), key=lambda pair: loss(*pair))


def fit_extent(lines: Sequence[LineLook]) -> Extent:
    """Which rows have points, by distance, and how the nearest point's place is correlated."""

    def table(part: Callable[[LineLook], float]) -> tuple[float, ...]:
        return mean_table(lines, DEPTHS, lambda line: line.depth, part)

    near = mean_table(lines, RANGE_M, by_range, steps)
    squares = mean_table(lines, RANGE_M, by_range, lambda line: (steps(line) - value_at(line, near)) ** 2)
    spread = tuple(float(np.sqrt(square)) for square in squares)

    def score(line: LineLook) -> float:
        return (steps(line) - value_at(line, near)) / value_at(line, spread)

    pairs = np.array([[score(left), score(right)] for left, right in both_lines(lines)])
    between = float(np.clip(np.corrcoef(pairs.T)[0, 1], 0.0, 1.0))
    ordered = sorted(lines, key=lambda line: (line.flight, line.side, line.time_s))
    same = [pair for pair in pairwise(ordered) if pair[0].flight == pair[1].flight and pair[0].side == pair[1].side]
    new = float(np.mean([(score(then) - score(first)) ** 2 / 2 for first, then in same]))
    slow = min(max(1.0 - new, 0.0), 1.0)
    return Extent(table(lambda line: line.points), near, spread, between, slow, table(lambda line: line.far))


def steps(line: LineLook) -> float:
    """Rows of the nearest point from the true end, with rare large values cut."""
    return min(max(line.near_steps, -MOST_STEPS), MOST_STEPS)


def value_at(line: LineLook, table: Sequence[float]) -> float:
    """A table over `RANGE_M` at a look's distance."""
    return float(np.interp(line.range_m, RANGE_M, table))


def fit_false_lines(lines: Sequence[LineLook], rate_hz: float) -> FalseLines:
    """Spells of looks in which a line is another one."""
    starts, wrong = 0, [line.off_m for line in lines if abs(line.off_m) > FALSE_M]
    for key in {(line.flight, line.side) for line in lines}:
        flags = [abs(line.off_m) > FALSE_M for line in lines if (line.flight, line.side) == key]
        starts += sum(now and not before for before, now in zip([False, *flags], flags, strict=False))
    if not starts:
        return FalseLines(0.0, *FALSE_DEFAULT)
    return FalseLines(
        starts * rate_hz / len(lines), len(wrong) / starts / rate_hz, float(np.sqrt(np.mean(np.square(wrong))))
    )


def hat(value: float, knots: Sequence[float]) -> Array:
    """Weights (K,) of knots in a linear interpolation at a value."""
    return np.array([np.interp(value, knots, row) for row in np.eye(len(knots))])


def mean_table(
    lines: Sequence[LineLook],
    knots: Sequence[float],
    at: Callable[[LineLook], float],
    of: Callable[[LineLook], float],
) -> tuple[float, ...]:
    """Means at knots, each look weighted as an interpolation weights it; the mean of all where there is none."""
    weights = np.array([hat(at(line), knots) for line in lines])
    values = np.array([of(line) for line in lines])
    known = weights.sum(axis=0)
    means = np.where(known > 1.0, weights.T @ values / np.maximum(known, 1e-9), values.mean())
    return tuple(means.tolist())


def rms_table(lines: Sequence[LineLook], name: str, noise: Callable[[LineLook], float]) -> tuple[float, ...]:
    """Root mean squares of a field over `RANGE_M`, without the variance that the noise of single points gives it."""
    squares = mean_table(lines, RANGE_M, by_range, lambda line: clip(float(getattr(line, name))) ** 2)
    of_noise = mean_table(lines, RANGE_M, by_range, noise)
    return tuple(
        float(np.sqrt(max(square - other, LEAST_SCORE**2))) for square, other in zip(squares, of_noise, strict=True)
    )


def noise_of_mean(line: LineLook, rows_px: float) -> float:
    """Variance of a line's mean error by the correlated noise of its points; a fitted slope's is three times as large.

    Source: of a first-order autoregression, Priestley, "Spectral Analysis and Time Series", 1981, section 5.3.
    """
    correlation = float(np.exp(-line.step_px / rows_px))
    return line.white**2 * (1.0 + correlation) / (1.0 - correlation) / line.points
