"""Shares of landings with 95 % intervals, with and without weights."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, chi2

from deckline_lab.statistics import CONFIDENCE, share_interval


@dataclass(frozen=True)
class Share:
    """How often an event happens."""

    hits: int
    """Landings that had it, whatever they weigh."""
    value: float
    """Estimate of its probability."""
    low: float
    """Ends of the 95 % interval."""
    high: float
    at_most: float
    """One-sided 95 % bound: the rule of three, 3 / n, where no landing had it."""

    def text(self) -> str:
        """Percent for a table, such as `99.2 [98.1, 99.8]`."""
        value, low, high = (f"{100 * number:.3g}" for number in (self.value, self.low, self.high))
        return f"{value} [{low}, {high}]"


def estimate_share(
    happened: NDArray[np.bool_],
    weights: NDArray[np.float64] | None = None,
    greatest_weight: float = 1.0,
    common: bool = False,
) -> Share:
    """Estimate the probability of an event from independent landings.

    Args:
        happened: (N,), of each landing.
        weights: (N,), ratios of the density that occurs to that drawn, of mean 1; None: drawn as they occur.
        greatest_weight: that a landing can have.
        common: with weights, estimate that the event does not happen, and bound that as a rare event. Not chosen by the
            result, which would bias it.

    Raises:
        ValueError: no landing.
    Source: Clopper and Pearson, "The use of confidence or fiducial limits", 1934; for weights see `_gamma_bounds`.
    """
    hits, trials = int(happened.sum()), len(happened)
    if weights is None:
        low, high = share_interval(hits, trials)
        at_most = 1.0 if hits == trials else float(beta.ppf(CONFIDENCE, hits + 1, trials - hits))
        return Share(hits, hits / trials, low, high, at_most)
    if not trials:
        raise ValueError("expected at least 1 landing, got 0")
    tails = (1 - CONFIDENCE) / 2, 1 - CONFIDENCE  # of the interval, of the one-sided bound
    if common:
        rest = weights * ~happened / trials
        (low, high), (least, _) = (_gamma_bounds(rest, greatest_weight / trials, tail) for tail in tails)
        return Share(hits, max(0.0, 1 - float(rest.sum())), max(0.0, 1 - high), 1 - low, 1 - least)
    parts = weights * happened / trials
    (low, high), (_, most) = (_gamma_bounds(parts, greatest_weight / trials, tail) for tail in tails)
    return Share(hits, float(parts.sum()), low, min(1.0, high), min(1.0, most))


def _gamma_bounds(parts: NDArray[np.float64], greatest: float, tail: float) -> tuple[float, float]:
    """Bounds of the expected sum of weighted rare events, each missed with a probability of at most about `tail`.

    Args:
        parts: weights of the landings that had the event, 0 of the others, over the number of landings.
        greatest: value that a part can have.
        tail: probability beyond each bound.

    Source: Fay and Feuer, "Confidence intervals for directly standardized rates: a method based on the gamma
        distribution", 1997, equations 7 and 8. With equal weights they are the exact bounds of a Poisson count.
    """
    total, variance = float(parts.sum()), float((parts**2).sum())
    low = variance / (2 * total) * chi2.ppf(tail, 2 * total**2 / variance) if total > 0 else 0.0
    total, variance = total + greatest, variance + greatest**2
    return float(low), float(variance / (2 * total) * chi2.isf(tail, 2 * total**2 / variance))
