"""What a detector finds of the runway's lines and how wrong it is, drawn look by look: fitted to rendered flights.

Presence is an ordinal probit in distance, size and light with a latent variable that is correlated in time: nothing,
one line, both lines. A line's error in the image is an offset, a slope along the rows and the noise of single points,
each in units of the 1-sigma that the detector reports.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from deckline.config_file import config_from_table

MODEL_FILE = Path(__file__).with_name("detection_model.json")
RANGE_M = (20.0, 100.0, 250.0, 500.0, 900.0, 1300.0)  # knots of tables over the distance to the ramp
DEPTHS = (0.5, 0.8, 1.0, 1.2)  # knots of tables over that distance in visibilities
SIZE_PX = 20.0  # apparent width of the runway at the ramp where the size has no effect


@dataclass(frozen=True)
class Presence:
    """Which lines are found: both where the latent variable exceeds 0, one where it exceeds -`one_line`."""

    intercept: float
    """Of the latent mean."""
    per_visibility: float
    """Change of the latent mean for one visibility more of distance."""
    per_size: float
    """Change for e times the apparent width."""
    dusk: float
    """Change at dusk and at night."""
    one_line: float
    """Width of the latent band where one line is found."""
    flight_share: float
    """Share of the latent variance that a flight keeps."""
    correlation_s: float
    """Time constant of the rest, s."""


@dataclass(frozen=True)
class LineErrors:
    """Errors of a found line in the image; tables are over `RANGE_M` unless they say otherwise."""

    log_sigma: tuple[float, ...]
    """Logarithm of the reported 1-sigma of u, px, in clear air."""
    log_sigma_depth: tuple[float, ...]
    """What haze adds to it, over `DEPTHS`."""
    log_sigma_spread: float
    """1-sigma of the logarithm about these."""
    log_sigma_rows: tuple[float, ...]
    """Its change from a line's middle to its near end."""
    offset: tuple[float, ...]
    """1-sigma of the offset, in reported 1-sigmas."""
    offset_between: tuple[float, ...]
    """Correlation of the offsets of both lines."""
    slope: tuple[float, ...]
    """1-sigma of the error at the near end beside the offset's, in reported 1-sigmas."""
    slope_outward: tuple[float, ...]
    """Mean of that error, positive away from the runway, in reported 1-sigmas."""
    white: tuple[float, ...]
    """1-sigma of single points, in reported 1-sigmas."""
    rows_px: float
    """Rows over which the errors of single points are correlated, px."""
    slow_share: float
    """Share of the variances of offset, slope and reported 1-sigma that changes slowly; the rest is new."""
    correlation_s: float
    """Time constant of the slow part, s."""


@dataclass(frozen=True)
class Extent:
    """Which rows of a line have points; tables are over `DEPTHS` unless they say otherwise."""

    points: tuple[float, ...]
    """Points of a line."""
    near_steps: tuple[float, ...]
    """Mean distance of the nearest point from the line's near end, in rows between points, over `RANGE_M`."""
    near_steps_spread: tuple[float, ...]
    """Its 1-sigma, likewise."""
    near_between: float
    """Its correlation between both lines."""
    near_slow_share: float
    """Share of its variance that changes slowly, with the time constant of the errors."""
    far: tuple[float, ...]
    """Mean share of the line's rows that is missing at its far end."""


@dataclass(frozen=True)
class FalseLines:
    """Lines that are something else on the deck or the sea."""

    per_s: float
    """How often one begins while lines are found, 1/s."""
    seconds: float
    """Mean time that it lasts, s."""
    offset_m: float
    """1-sigma of its distance from the true line, m."""


@dataclass(frozen=True)
class DetectionModel:
    """All of it."""

    presence: Presence
    """Which lines are found."""
    errors: LineErrors
    """How wrong a found line is."""
    extent: Extent
    """Where it has points."""
    false_lines: FalseLines
    """What else is found."""
    rate_hz: float
    """Pictures a second of the flights that it was fitted to."""

    def __post_init__(self) -> None:
        for part, name, count in (
            *(
                (self.errors, name, len(RANGE_M))
                for name in ("log_sigma", "log_sigma_rows", "offset", "slope", "white")
            ),
            (self.errors, "log_sigma_depth", len(DEPTHS)),
            *((self.extent, name, len(RANGE_M)) for name in ("near_steps", "near_steps_spread")),
            *((self.extent, name, len(DEPTHS)) for name in ("points", "far")),
        ):
            if len(getattr(part, name)) != count:
                raise ValueError(f"{name} must have {count} values, got {len(getattr(part, name))}")


@cache
def read_detection_model() -> DetectionModel:
    """The shipped model."""
    data: dict[str, Any] = json.loads(MODEL_FILE.read_text())
    return config_from_table(DetectionModel, data["model"], source=str(MODEL_FILE))
