"""How sure a difference is that was measured on the same images."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import bootstrap

CONFIDENCE = 0.95
RESAMPLES = 5000  # the ends of the interval then move by about 2 % of its width from seed to seed
STATISTICS: dict[str, Callable[..., Any]] = {"mean": np.mean, "median": np.median}


@dataclass(frozen=True)
class Difference:
    """A method minus its reference, in the unit of what was measured."""

    value: float
    low: float  # ends of the 95 % interval; NaN with fewer than two images
    high: float
    images: int  # measured with both

    @property
    def above(self) -> bool:
        """Surely more than the reference."""
        return self.low > 0

    @property
    def below(self) -> bool:
        """Surely less than the reference."""
        return self.high < 0


def paired_difference(
    differences: ArrayLike, rng: np.random.Generator, statistic: Literal["mean", "median"] = "mean"
) -> Difference:
    """Mean or median of per-image differences with its 95 % percentile bootstrap interval over the images.

    The images count as independent. Those of one flight resemble each other: their interval is too narrow.

    Args:
        differences: (N,), one for each image.
        rng: draws the images of each resample.

    Raises:
        ValueError: no image.
    Source: Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13.
    """
    values = np.asarray(differences, dtype=np.float64)
    if values.ndim != 1 or len(values) == 0:
        raise ValueError(f"expected the differences (N,) of at least one image, got shape {values.shape}")
    of = STATISTICS[statistic]
    value = float(of(values))
    if len(values) == 1:
        return Difference(value, np.nan, np.nan, 1)
    found = bootstrap(
        (values,), of, n_resamples=RESAMPLES, confidence_level=CONFIDENCE, method="percentile", batch=500, rng=rng
    )
    return Difference(value, float(found.confidence_interval.low), float(found.confidence_interval.high), len(values))
