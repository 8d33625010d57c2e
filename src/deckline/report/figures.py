"""Figures of a run for its report: what was found, how far from truth, how fast."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deckline.evaluation.statistics import RANGE_M
from deckline.report.records import LINES, STAGES, Record, lookup

GUIDANCE_NAMES = {
    "lateral_deviation_m": "Lateral deviation",
    "heading_error_deg": "Heading error",
    "height_above_deck_m": "Height above deck",
    "distance_to_ramp_m": "Distance to ramp",
    "vertical_deviation_m": "Deviation from glideslope",
    "lateral_deviation_deg": "Lateral deviation, angle",
    "vertical_deviation_deg": "Deviation from glideslope, angle",
    "distance_to_touchdown_m": "Distance to touchdown",
}
LINE_ERRORS = (
    ("direction_error_deg", "direction"),
    ("lateral_error_at_ramp_m", "sideways at the ramp"),
    ("height_error_m", "height"),
)


@dataclass(frozen=True)
class ErrorRow:
    """Measured minus true over the frames that have both, in the quantity's unit."""

    name: str
    unit: str
    frames: int
    median: float  # of the absolute error
    p95: float  # of the absolute error
    bias: float | None  # mean of the signed error; None for a size without sign
    within_1_sigma: float | None  # share of frames, 0..1; None where no sigma is given
    within_2_sigma: float | None


@dataclass(frozen=True)
class BandRow:
    """Frames whose true distance to the ramp lies in a band. None: no such value in the band."""

    low_m: float
    high_m: float
    frames: int
    found_rate: float  # both lines, 0..1
    lateral_median_m: float | None
    lateral_p95_m: float | None
    heading_median_deg: float | None
    height_median_m: float | None


def seen_frames(records: Iterable[Record]) -> list[Record]:
    """Records of frames that went through the chain: all but the skipped ones."""
    return [record for record in records if "skipped" not in record]


def error_rows(records: list[Record]) -> list[ErrorRow]:
    """Errors of the guidance and of each line; empty without truth."""
    rows = []
    for key, name in GUIDANCE_NAMES.items():
        errors, sigmas = _gather(records, ("errors", "guidance", key), ("guidance", key, "sigma"))
        rows.append(_error_row(name, key, errors, sigmas))
    for key, what in LINE_ERRORS:
        for line in LINES:
            (errors,) = _gather(records, ("errors", key, line))
            rows.append(_error_row(f"{line.capitalize()} line, {what}", key, errors))
    return [row for row in rows if row.frames]


def _error_row(name: str, key: str, errors: NDArray[np.float64], sigmas: NDArray[np.float64] | None = None) -> ErrorRow:
    unit = "°" if key.endswith("_deg") else "m"
    if not len(errors):
        return ErrorRow(name, unit, 0, np.nan, np.nan, None, None, None)
    size = np.abs(errors)
    row = (name, unit, len(size), float(np.median(size)), float(np.percentile(size, 95)))
    if sigmas is None:
        return ErrorRow(*row, None, None, None)
    return ErrorRow(*row, float(np.mean(errors)), *(float(np.mean(size <= k * sigmas)) for k in (1, 2)))


def band_rows(records: list[Record]) -> list[BandRow]:
    """Found-rate and errors by true distance to the ramp; empty without truth. Bands without frames are left out."""
    rows = []
    ranges = [(lookup(record, ("truth", "distance_to_ramp_m")), record) for record in records]
    for low, high in pairwise(RANGE_M):
        members = [record for range_m, record in ranges if range_m is not None and low <= range_m < high]
        if members:
            names = ("lateral_deviation_m", "heading_error_deg", "height_above_deck_m")
            lateral, heading, height = (np.abs(_gather(members, ("errors", "guidance", name))[0]) for name in names)
            quantiles = (_percentile(lateral, 50), _percentile(lateral, 95))
            medians = (_percentile(heading, 50), _percentile(height, 50))
            found = sum(r["status"] == "ok" for r in members) / len(members)
            rows.append(BandRow(low, high, len(members), found, *quantiles, *medians))
    return rows


def found_rate(records: list[Record]) -> float | None:
    """Share of frames with both lines found among those that truly show a runway; None where that is not known."""
    decks = [r for r in records if lookup(r, ("truth", "has_runway"))]
    return sum(r["status"] == "ok" for r in decks) / len(decks) if decks else None


def false_lines(records: list[Record]) -> tuple[int, int]:
    """Frames with a line though there is truly no runway, and frames without a runway."""
    empty = [r for r in records if lookup(r, ("truth", "has_runway")) is False]
    return sum(r["status"] != "not seen" for r in empty), len(empty)


def stage_seconds(records: list[Record]) -> dict[str, float]:
    """Median wall time of each stage, s."""
    medians = {stage: _percentile(_gather(records, ("seconds", stage))[0], 50) for stage in STAGES}
    return {stage: median for stage, median in medians.items() if median is not None}


def median_sigma(records: list[Record], name: str) -> float | None:
    """Median 1-sigma of a guidance value, in its unit."""
    return _percentile(_gather(records, ("guidance", name, "sigma"))[0], 50)


def count_reasons(records: Iterable[Record]) -> list[tuple[str, int]]:
    """Why something is missing and in how many frames, most frequent first."""
    return Counter(str(record["reason"]) for record in records if record.get("reason")).most_common()


def count_flags(records: Iterable[Record]) -> list[tuple[str, int]]:
    """What was flagged, with the reason first given, and in how many frames; most frequent first."""
    first: dict[str, str] = {}
    times: Counter[str] = Counter()
    for record in records:
        for flag in lookup(record, ("track", "flags")) or []:
            first.setdefault(flag["name"], flag["reason"])
            times[flag["name"]] += 1
    return [(f"{name}: at first {first[name]}", count) for name, count in times.most_common()]


def beyond_protection(records: list[Record]) -> tuple[int, int] | None:
    """Frames without a flag whose error is beyond its protection level, of those where both are known; None: none."""
    bounded = [record for record in records if lookup(record, ("track", "flags")) == []]
    paths = (("errors", "guidance", "lateral_deviation_m"), ("errors", "guidance", "height_above_deck_m"))
    across, above, *levels = _gather(bounded, *paths, ("protection", "lateral_m"), ("protection", "vertical_m"))
    beyond = (np.abs(across) > levels[0]) | (np.abs(above) > levels[1])
    return (int(beyond.sum()), len(beyond)) if len(beyond) else None


def _gather(records: Iterable[Record], *paths: tuple[str, ...]) -> NDArray[np.float64]:
    """Values under each path, a row each, of the records that have all of them."""
    rows = ([lookup(record, path) for path in paths] for record in records)
    return np.array([row for row in rows if None not in row], dtype=np.float64).reshape(-1, len(paths)).T


def _percentile(values: NDArray[np.float64], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if len(values) else None
