"""Accuracies that public sources ask for, beside what was measured."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.types import SIDES
from deckline_lab.evaluation.localization_score import LocalizationScore
from deckline_lab.evaluation.tables import Table, number
from deckline_lab.statistics import percentile

UNIT = "unit alone"
Scores = Mapping[str, Sequence[LocalizationScore]]  # method -> its frames


@dataclass(frozen=True)
class Requirement:
    """An accuracy asked for, of errors pooled over lines."""

    name: str
    figures: tuple[str, ...]
    percent: float  # of the sizes of the errors
    limit: float
    band_m: tuple[float, float]  # of range
    unit: str
    source: str


DIRECTION, LATERAL, HEIGHT = (
    tuple(f"{name}.{side}" for side in SIDES) for name in ("direction_error_deg", "lateral_error_m", "height_error_m")
)
NEAR_M, FAR_M = (0.0, 150.0), (150.0, 800.0)
OWN, CARRIER, SATELLITE, CAT_IIIB = "own mark", "carrier, 1 ft", "shipboard satellite landing", "CAT IIIb, 95 %"
REQUIREMENTS = (  # public figures
    Requirement("direction, median", DIRECTION, 50.0, 0.1, NEAR_M, "deg", OWN),
    Requirement("direction, 95 %", DIRECTION, 95.0, 0.3, NEAR_M, "deg", OWN),
    Requirement("lateral at the ramp, 95 %", LATERAL, 95.0, 0.3, NEAR_M, "m", OWN),
    Requirement("height, 95 %", HEIGHT, 95.0, 0.3, NEAR_M, "m", OWN),
    Requirement("direction, median", DIRECTION, 50.0, 0.3, FAR_M, "deg", OWN),
    Requirement("lateral at the ramp, 95 %", LATERAL, 95.0, 1.0, FAR_M, "m", OWN),
    Requirement("pilot's height, 95 %", ("centre.height_m",), 95.0, 0.3048, NEAR_M, "m", CARRIER),
    Requirement("pilot's height, 95 %", ("centre.height_m",), 95.0, 0.4, NEAR_M, "m", SATELLITE),
    Requirement("pilot's height, largest", ("centre.height_m",), 100.0, 1.1, NEAR_M, "m", f"{SATELLITE}, alert limit"),
    Requirement("pilot's height, 95 %", ("centre.height_m",), 95.0, 2.0, NEAR_M, "m", CAT_IIIB),
    Requirement("pilot's lateral, 95 %", ("centre.lateral_m",), 95.0, 6.2, NEAR_M, "m", CAT_IIIB),
    Requirement(
        "pilot's lateral, largest", ("centre.lateral_m",), 100.0, 15.5, NEAR_M, "m", f"{CAT_IIIB}, alert limit"
    ),
)


def sizes(scores: Iterable[LocalizationScore], *names: str) -> NDArray[np.float64]:
    """Absolute values (N,) of figures, pooled."""
    return np.abs([score.figures[name] for score in scores for name in names if name in score.figures])


def measure_required(scores: Iterable[LocalizationScore], required: Requirement) -> float:
    """The measured error that a requirement limits; NaN without frames in its band."""
    low, high = required.band_m
    return percentile(
        sizes((score for score in scores if low <= score.range_m < high), *required.figures), required.percent
    )


def accuracy_table(scores: Scores) -> Table:
    """What is asked for, what the navigation unit alone would give and what each method does; a star where reached."""
    rows, every = [], next(iter(scores.values()))
    for required in REQUIREMENTS:
        low, high = required.band_m
        of_unit = replace(required, figures=tuple(f"unit.{name}" for name in required.figures))
        values = (
            measure_required(every, of_unit),
            *(measure_required(members, required) for members in scores.values()),
        )
        cells = (number(value, ".3f") + (" *" if value <= required.limit else "") for value in values)
        rows.append(
            (required.name, f"{low:g}-{high:g} m", f"{required.limit:.3g} {required.unit}", required.source, *cells)
        )
    columns = ("error", "range", "limit", "from", UNIT, *scores)
    return Table("accuracy asked for", columns, rows, ["A star: as asked for."])
