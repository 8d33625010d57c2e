"""How guidance errs and which status it has: tables fitted to flights that were seen by points.

Errors of a look are quantiles of the errors in its condition (navigation grade, sea, status, range) at normal scores
that are correlated in time and among each other. Errors that have a protection level are shares of it: where guidance
is uncertain, both are large. The status is a Markov chain whose transitions depend on the range in
visibilities.
"""

import json
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.types import Status

Array = NDArray[np.float64]
MODEL_FILE = Path(__file__).with_name("guidance_model.json")
GRADES = ("exact", "good", "tactical")
ROUGH_SEA = 2.5  # sea state from which a sea is rough: the middle of what was flown
QUANTITIES = (
    *("lateral_m", "height_m", "heading_rad", "distance_m"),
    *("lateral_rate_m_s", "height_rate_m_s", "closing_m_s", "deck_acceleration_m_s2"),
)
LEVELS = QUANTITIES[:4]  # that have a protection level
STATUSES = (Status.NOT_SEEN, Status.UNVERIFIED, Status.OK, Status.ONE_LINE, Status.COASTING, Status.STALE)
RANGE_M = (0.0, 50.0, 150.0, 300.0, 500.0, 800.0, 1200.0)  # centres of the tables' bands
DEPTHS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4)  # lower ends of bands of range over visibility
SCORES = (-2.576, -1.645, -0.674, 0.0, 0.674, 1.645, 2.576)  # normal scores of the 0.5, 5, 25, ... 99.5 % quantiles


@dataclass(frozen=True, eq=False)
class GuidanceModel:
    """The tables; sea is calm or rough, group is `ok` or another status."""

    rate_hz: float
    """Looks a second of the flights that it was fitted to: the chain's step."""
    correlation_s: Array
    """(8,) time constant of each error's score, s."""
    mixing: Array
    """(8, 8) lower triangle: correlated scores from independent ones."""
    errors: Array
    """(grades, seas, groups, ranges, 8, scores) quantiles of the errors, shares of the level, m/s and m/s2."""
    sigmas: Array
    """(grades, seas, groups, ranges, 8) median of the stated 1-sigma, m, rad, m/s, m/s2."""
    levels: Array
    """(grades, seas, groups, ranges, 4) median of the protection levels, m, rad."""
    level_spread: float
    """1-sigma of the logarithm of a level about its median, one draw a flight."""
    transitions: Array
    """(grades, depths, statuses, statuses) cumulative over the last axis."""

    def __post_init__(self) -> None:
        seen, count = (len(GRADES), 2, 2, len(RANGE_M)), len(QUANTITIES)
        shapes = {
            "correlation_s": (count,),
            "mixing": (count, count),
            "errors": (*seen, count, len(SCORES)),
            "sigmas": (*seen, count),
            "levels": (*seen, len(LEVELS)),
            "transitions": (len(GRADES), len(DEPTHS), len(STATUSES), len(STATUSES)),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"GuidanceModel.{name} must have shape {shape}, got {getattr(self, name).shape}")


@cache
def read_guidance_model() -> GuidanceModel:
    """The shipped model."""
    data: dict[str, Any] = json.loads(MODEL_FILE.read_text())
    values: dict[str, Any] = {}
    for field in fields(GuidanceModel):
        given = data[field.name]
        values[field.name] = np.array(given) if isinstance(given, list) else given
    return GuidanceModel(**values)
