"""Statistics that every evaluation shares: quantiles, paired differences, intervals of shares."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binomtest, bootstrap, chi2

CONFIDENCE = 0.95
RESAMPLES = 5000  # the ends of an interval then move by about 2 % of its width from seed to seed
STATISTICS: dict[str, Callable[..., Any]] = {"mean": np.mean, "median": np.median}

# Edges of the bands that results are grouped by.
APPROACH_RANGE_M = (0.0, 150.0, 300.0, 500.0, 1000.0, np.inf)  # of approaches: 150 m is where our accuracy marks change
VISIBILITY_M = (0.0, 500.0, 1000.0, 2000.0, np.inf)
DETECTION_VISIBILITY_M = (0.0, 200.0, 500.0, 1000.0, 2000.0, np.inf)
DEHAZING_VISIBILITY_M = (0.0, 150.0, 300.0, 500.0, 1000.0, 3000.0, np.inf)
LIGHT_PERCENT = (0.0, 10.0, 30.0, 60.0, np.inf)  # of the ramp's light that comes through the air
CONTRAST = (0.0, 1.0, 2.0, 5.0, 15.0, np.inf)  # grey levels


def median_and_p95(values: ArrayLike, name: str) -> dict[str, float]:
    """`name.median` and `name.p95` of values (N,); empty without values."""
    numbers = np.asarray(values, dtype=np.float64)
    if not len(numbers):
        return {}
    return {f"{name}.median": float(np.median(numbers)), f"{name}.p95": float(np.percentile(numbers, 95))}


def percentile(values: NDArray[np.float64], percent: float) -> float:
    """A percentile of values (N,); NaN without any."""
    return float(np.percentile(values, percent)) if len(values) else float("nan")


def share_interval(hits: int, trials: int) -> tuple[float, float]:
    """95 % interval of a share, never too narrow for independent trials.

    Raises:
        ValueError: no trial, or more hits than trials.
    Source: Clopper and Pearson, "The use of confidence or fiducial limits", 1934.
    """
    if not 0 <= hits <= trials or trials < 1:
        raise ValueError(f"expected 0 <= hits <= trials and at least 1 trial, got {hits} of {trials}")
    interval = binomtest(hits, trials).proportion_ci(CONFIDENCE, method="exact")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True)
class Difference:
    """A method minus its reference, in the unit of what was measured."""

    value: float
    low: float  # ends of the 95 % interval; NaN with fewer than two images
    high: float
    images: int  # measured with both

    def text(self, form: str, scale: float = 1.0) -> str:
        """Value and interval for a table, such as `+1.2 [+0.3, +2.1]`."""
        value, low, high = (format(scale * number, form) for number in (self.value, self.low, self.high))
        return value if np.isnan(self.low) else f"{value} [{low}, {high}]"


def paired_difference(
    differences: ArrayLike, rng: np.random.Generator, statistic: Literal["mean", "median"] = "mean"
) -> Difference:
    """Mean or median of per-image differences with its 95 % percentile bootstrap interval over the images.

    The images count as independent. Those of one flight resemble each other: their interval is too narrow.

    Args:
        differences: (N,), one for each image.
        rng: draws the images of each resample.
        statistic: of the differences.

    Raises:
        ValueError: no image.
    Source: Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13.
    """
    values = np.asarray(differences, dtype=np.float64)
    if values.ndim != 1 or len(values) == 0:
        raise ValueError(f"expected the differences (N,) of at least one image, got shape {values.shape}")
    compute = STATISTICS[statistic]
    value = float(compute(values))
    if len(values) == 1:
        return Difference(value, np.nan, np.nan, 1)
    interval = bootstrap(
        (values,), compute, n_resamples=RESAMPLES, confidence_level=CONFIDENCE, method="percentile", batch=500, rng=rng
    ).confidence_interval
    return Difference(value, float(interval.low), float(interval.high), len(values))


def difference_of_trainings(ours: ArrayLike, theirs: ArrayLike, rng: np.random.Generator) -> Difference:
    """Mean difference of two methods that were each trained several times, with its 95 % bootstrap interval.

    Every resample draws the images with replacement, the same for both methods, and of each method's T trainings T - 1
    with replacement, as T of so few would give too small a variance. A single training adds no spread.

    Args:
        ours: (T, N), of each training and image.
        theirs: (U, N), of the same images.
        rng: draws the resamples.

    Raises:
        ValueError: no image, or not the same ones.
    Source: Rao and Wu, "Resampling inference with complex survey data", 1988, section 2.
    """
    pair = [np.atleast_2d(np.asarray(values, dtype=np.float64)) for values in (ours, theirs)]
    images = pair[0].shape[1]
    if not images or pair[1].shape[1] != images:
        raise ValueError(f"expected figures of the same images, got shapes {pair[0].shape} and {pair[1].shape}")
    value = float(pair[0].mean() - pair[1].mean())
    if images == 1:
        return Difference(value, np.nan, np.nan, 1)
    weights = rng.multinomial(images, np.full(images, 1 / images), RESAMPLES) / images
    means = []
    for values in pair:
        drawn = max(1, len(values) - 1)
        of_training = rng.multinomial(drawn, np.full(len(values), 1 / len(values)), RESAMPLES) / drawn
        means.append((of_training * (weights @ values.T)).sum(axis=1))
    low, high = np.quantile(means[0] - means[1], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Difference(value, float(low), float(high), images)


def resample_runs(totals: NDArray[Any], counts: NDArray[Any], rng: np.random.Generator) -> tuple[float, float]:
    """95 % percentile bootstrap interval of a mean over all frames, drawn run by run: sums (N,) and frames (N,)."""
    drawn = rng.integers(0, len(counts), (RESAMPLES, len(counts)))
    means = totals[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def share_interval_of_runs(hits: Sequence[int], trials: Sequence[int], rng: np.random.Generator) -> tuple[float, float]:
    """95 % interval of a share whose trials come in independent runs; trials of one run resemble each other.

    A bootstrap over the runs, never narrower than the interval of independent trials. Where no trial or every trial is
    a hit, runs do not differ and a bootstrap has no width: the interval is then that of the runs themselves.

    Args:
        hits: (N,), of each run.
        trials: (N,); runs without a trial are left out.
        rng: draws the runs of each resample.

    Raises:
        ValueError: no trial, or more hits than trials.
    """
    runs = [(some, of) for some, of in zip(hits, trials, strict=True) if of]
    hit, all_trials = np.array(runs, dtype=np.int64).reshape(-1, 2).T
    least, most = share_interval(int(hit.sum()), int(all_trials.sum()))
    if hit.sum() in (0, all_trials.sum()):
        return share_interval(len(runs) if hit.any() else 0, len(runs))
    low, high = resample_runs(hit, all_trials, rng)
    return min(low, least), max(high, most)


@dataclass(frozen=True)
class Consistency:
    """How errors compare with the covariance that came with them."""

    mean: float  # of e' C^-1 e; the degrees of freedom are expected
    low: float  # 95 % interval of the mean, runs drawn with replacement; NaN with one run
    high: float
    inside: float  # share of frames within the 95 % ellipsoid; 0.95 is expected
    frames: int


def consistency(runs: Sequence[Sequence[float]], degrees: int, rng: np.random.Generator) -> Consistency:
    """Normalised estimation error squared: its mean with an interval, and how many lie where 95 % should.

    Frames of one run share the navigation unit's drift, so runs are resampled, not frames.

    Args:
        runs: e' C^-1 e of each run's frames.
        degrees: of freedom of e.
        rng: draws the runs of each resample.

    Source: Bar-Shalom et al., "Estimation with Applications to Tracking and Navigation", 2001, section 5.4.
    """
    if not runs:
        return Consistency(*(float("nan"),) * 4, 0)
    values = np.concatenate(runs)
    low = high = float("nan")
    if len(runs) > 1:
        low, high = resample_runs(np.array([np.sum(run) for run in runs]), np.array([len(run) for run in runs]), rng)
    inside = float(np.mean(values <= chi2.ppf(CONFIDENCE, degrees)))
    return Consistency(float(values.mean()), low, high, inside, len(values))
