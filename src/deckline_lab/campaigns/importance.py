"""Importance sampling: rare conditions are drawn more often than they occur, and weigh less by that."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from deckline.checks import check_numbers


@dataclass(frozen=True)
class Importance:
    """A setting that occurs as a normal distribution cut off at both ends, and is drawn evenly between these ends."""

    name: str
    """Of the setting, such as turbulence."""
    mean: float
    """Of the normal distribution before it is cut off, in the setting's unit."""
    sigma: float
    """Its standard deviation, in the setting's unit."""
    low: float
    """Least value that occurs and is drawn."""
    high: float
    """Greatest value that occurs and is drawn."""

    def __post_init__(self) -> None:
        check_numbers(self, "importance", "mean", "low", "high")
        check_numbers(self, "importance", "sigma", above=0.0)
        if not self.low < self.high:
            raise ValueError(f"importance.low must be less than high, got {self.low} and {self.high}")
        if not 0 < self.greatest_weight < np.inf:
            raise ValueError(f"importance: mean {self.mean} lies too far from low {self.low} and high {self.high}")

    @cached_property
    def greatest_weight(self) -> float:
        """Of any value."""
        return self.weight(float(np.clip(self.mean, self.low, self.high)))

    def draw(self, rng: np.random.Generator) -> float:
        """A value, drawn evenly."""
        return float(rng.uniform(self.low, self.high))

    def weight(self, value: float) -> float:
        """How much more often a value occurs than it is drawn: the ratio of both densities."""
        if not self.low <= value <= self.high:
            return 0.0
        score, low, high = ((x - self.mean) / self.sigma for x in (value, self.low, self.high))
        inside = ndtr(high) - ndtr(low) if low < 0 else ndtr(-low) - ndtr(-high)
        density = np.exp(-(score**2) / 2) / (np.sqrt(2 * np.pi) * self.sigma)
        return float(density / inside * (self.high - self.low)) if inside > 0 else 0.0
