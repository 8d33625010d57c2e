"""Tables of localization scores: the paper's Table 6, the improvement, a pilot's percentiles, honesty, efficiency."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from deckline.evaluation.localization_measure import STATES, Score
from deckline.types import SIDES

LINE_COLUMNS = (
    "slope",
    "intercept_m",
    "height_m",
    "slope_error",
    "intercept_error_m",
    "height_error_m",
    "direction_error_deg",
    "lateral_error_m",
)
PILOT_COLUMNS = ("lateral_m", "height_m", "heading_deg")
RANGE_BANDS_M = ((0.0, 150.0), (150.0, 300.0), (300.0, 500.0), (500.0, 1000.0), (1000.0, np.inf))
VISIBILITY_BANDS_M = ((0.0, 500.0), (500.0, 1000.0), (1000.0, 2000.0), (2000.0, np.inf))
QUANTILES = (50.0, 95.0)  # percent
USABLE_DEG, USABLE_M = 0.3, 1.0  # of direction and lateral at the ramp: our marks, of the near and of the far range
CONFIDENCE = 0.95
RESAMPLES = 5000

Band = tuple[float, float]


@dataclass(frozen=True)
class LineRow:
    """One method and one line of Table 6: means over approaches of each approach's mean over its frames."""

    means: dict[str, float]  # LINE_COLUMNS; what no frame has is left out
    found: float  # share of the frames with this line, 0..1


@dataclass(frozen=True)
class Quantiles:
    """Sizes of an error over frames."""

    p50: float  # NaN without frames
    p95: float
    frames: int


@dataclass(frozen=True)
class Honesty:
    """How errors compare with the covariance that came with them."""

    mean: float  # of e' C^-1 e; 3 is expected
    low: float  # 95 % interval of the mean, approaches drawn with replacement; NaN with one approach
    high: float
    inside: float  # share of frames within the 95 % ellipsoid; 0.95 is expected
    frames: int


@dataclass(frozen=True)
class Mark:
    """An accuracy asked for, of errors pooled over lines."""

    name: str
    figures: tuple[str, ...]
    percent: float  # of the sizes of the errors
    limit: float
    band_m: Band  # of range
    unit: str
    source: str


LINES = {name: tuple(f"{name}.{side}" for side in SIDES) for name in LINE_COLUMNS}
NEAR_M, FAR_M = (0.0, 150.0), (150.0, 800.0)
OWN, CARRIER, SATELLITE, CAT_IIIB = "own mark", "carrier, 1 ft", "shipboard satellite landing", "CAT IIIb, 95 %"
MARKS = (  # public figures: SPEC section 8
    Mark("direction, median", LINES["direction_error_deg"], 50.0, 0.1, NEAR_M, "deg", OWN),
    Mark("direction, 95 %", LINES["direction_error_deg"], 95.0, 0.3, NEAR_M, "deg", OWN),
    Mark("lateral at the ramp, 95 %", LINES["lateral_error_m"], 95.0, 0.3, NEAR_M, "m", OWN),
    Mark("height, 95 %", LINES["height_error_m"], 95.0, 0.3, NEAR_M, "m", OWN),
    Mark("direction, median", LINES["direction_error_deg"], 50.0, 0.3, FAR_M, "deg", OWN),
    Mark("lateral at the ramp, 95 %", LINES["lateral_error_m"], 95.0, 1.0, FAR_M, "m", OWN),
    Mark("pilot's height, 95 %", ("centre.height_m",), 95.0, 0.3048, NEAR_M, "m", CARRIER),
    Mark("pilot's height, 95 %", ("centre.height_m",), 95.0, 0.4, NEAR_M, "m", SATELLITE),
    Mark("pilot's height, largest", ("centre.height_m",), 100.0, 1.1, NEAR_M, "m", f"{SATELLITE}, alert limit"),
    Mark("pilot's height, 95 %", ("centre.height_m",), 95.0, 2.0, NEAR_M, "m", CAT_IIIB),
    Mark("pilot's lateral, 95 %", ("centre.lateral_m",), 95.0, 6.2, NEAR_M, "m", CAT_IIIB),
    Mark("pilot's lateral, largest", ("centre.lateral_m",), 100.0, 15.5, NEAR_M, "m", f"{CAT_IIIB}, alert limit"),
)


def line_row(scores: Sequence[Score], side: str) -> LineRow:
    """Table 6 of one method's scores.

    Raises:
        ValueError: no scores.
    """
    if not scores:
        raise ValueError("no frame could be evaluated")
    means = {name: run_mean(scores, f"{name}.{side}") for name in LINE_COLUMNS}
    found = sum(f"slope.{side}" in score.figures for score in scores) / len(scores)
    return LineRow({name: value for name, value in means.items() if np.isfinite(value)}, found)


def unit_row(scores: Iterable[Score], side: str) -> LineRow:
    """The same of the navigation unit alone, lines seen exactly in every frame."""
    members = list(scores)
    means = {name: run_mean(members, f"unit.{name}.{side}") for name in LINE_COLUMNS}
    return LineRow({name: value for name, value in means.items() if np.isfinite(value)}, 1.0)


def run_mean(scores: Iterable[Score], name: str) -> float:
    """Mean over approaches of each one's mean over the frames that have the figure; NaN where none has."""
    runs: dict[int, list[float]] = {}
    for score in scores:
        if name in score.figures:
            runs.setdefault(score.approach, []).append(score.figures[name])
    return float(np.mean([np.mean(values) for values in runs.values()])) if runs else float("nan")


def improvement(rows: Sequence[LineRow], reference: Sequence[LineRow], name: str) -> float:
    """1 - error / reference's error of a figure, the errors of the given lines added up; NaN where one is missing.

    Frames in which a method gave no line are not in its mean, which favours the method that gives up more often.
    """
    ours, theirs = (sum(row.means.get(name, np.nan) for row in each) for each in (rows, reference))
    return float(1.0 - ours / theirs) if theirs else float("nan")


def usable_share(scores: Sequence[Score]) -> float:
    """Share of the frames with both lines, each within USABLE_DEG and USABLE_M of the true one.

    Every frame counts: one without a line, or with a wrong one, is of no use.

    Raises:
        ValueError: no scores.
    """
    if not scores:
        raise ValueError("no frame could be evaluated")
    return sum(_usable(score) for score in scores) / len(scores)


def _usable(score: Score) -> bool:
    limits = {"direction_error_deg": USABLE_DEG, "lateral_error_m": USABLE_M}
    return all(score.figures.get(f"{name}.{side}", np.inf) <= most for name, most in limits.items() for side in SIDES)


def unusable_improvement(scores: Sequence[Score], reference: Sequence[Score]) -> float:
    """1 - share of frames that are not usable / the reference's share; NaN where all of the reference's are usable."""
    theirs = 1 - usable_share(reference)
    return 1 - (1 - usable_share(scores)) / theirs if theirs else float("nan")


def unit_measured(scores: Iterable[Score], mark: Mark) -> float:
    """What the navigation unit alone would have, lines seen exactly; NaN where it has no such error."""
    return measured(scores, replace(mark, figures=tuple(f"unit.{name}" for name in mark.figures)))


def quantiles(scores: Iterable[Score], names: Iterable[str]) -> Quantiles:
    """50 % and 95 % of the sizes of figures, pooled."""
    values = sizes(scores, names)
    p50, p95 = np.percentile(values, QUANTILES) if len(values) else (np.nan, np.nan)
    return Quantiles(float(p50), float(p95), len(values))


def sizes(scores: Iterable[Score], names: Iterable[str]) -> np.ndarray:
    """Absolute values (N,) of figures, pooled."""
    wanted = tuple(names)
    return np.abs([score.figures[name] for score in scores for name in wanted if name in score.figures])


def measured(scores: Iterable[Score], mark: Mark) -> float:
    """What a mark is compared with; NaN without frames in its band."""
    values = sizes(in_band(scores, mark.band_m), mark.figures)
    return float(np.percentile(values, mark.percent)) if len(values) else float("nan")


def in_band(scores: Iterable[Score], band_m: Band) -> list[Score]:
    """Scores whose range lies in a band."""
    return [score for score in scores if band_m[0] <= score.range_m < band_m[1]]


def by_range(scores: Sequence[Score]) -> dict[str, list[Score]]:
    """Scores by range to the ramp; empty bands are left out."""
    return _banded(scores, "range_m", RANGE_BANDS_M)


def by_visibility(scores: Sequence[Score]) -> dict[str, list[Score]]:
    """Scores by visibility; empty bands are left out."""
    return _banded(scores, "visibility_m", VISIBILITY_BANDS_M)


def _banded(scores: Sequence[Score], key: str, bands: Sequence[Band]) -> dict[str, list[Score]]:
    named = {}
    for low, high in bands:
        members = [s for s in scores if low <= getattr(s, key) < high or getattr(s, key) == high == np.inf]
        if members:
            named[f"{low:g} m and more" if np.isinf(high) else f"{low:g} to {high:g} m"] = members
    return named


def honesty(scores: Sequence[Score], name: str, rng: np.random.Generator) -> Honesty:
    """Normalised squared errors `name`: their mean with an interval, and how many lie where 95 % should.

    Frames of one approach share the navigation unit's drift, so approaches are resampled, not frames.
    """
    runs: dict[int, list[float]] = {}
    for score in scores:
        if name in score.figures:
            runs.setdefault(score.approach, []).append(score.figures[name])
    values = np.concatenate([np.asarray(run) for run in runs.values()]) if runs else np.zeros(0)
    if not len(values):
        return Honesty(*(float("nan"),) * 4, 0)
    low = high = float("nan")
    if len(runs) > 1:
        totals, counts = (np.array([of(run) for run in runs.values()]) for of in (np.sum, len))
        drawn = rng.integers(0, len(runs), (RESAMPLES, len(runs)))
        means = totals[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
        low, high = (float(end) for end in np.quantile(means, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]))
    inside = float(np.mean(values <= chi2.ppf(CONFIDENCE, len(STATES))))
    return Honesty(float(values.mean()), low, high, inside, len(values))


def efficiency(scores: Iterable[Score], error: str, bound: str) -> tuple[float, int]:
    """Cramer-Rao variance over mean squared error, and from how many frames; NaN without any."""
    pairs = np.array([(s.figures[error], s.figures[bound]) for s in scores if {error, bound} <= s.figures.keys()])
    if not len(pairs):
        return float("nan"), 0
    squared = float(np.mean(pairs[:, 0] ** 2))
    return float(np.mean(pairs[:, 1] ** 2)) / squared if squared else float("inf"), len(pairs)
