"""Figures of a run for its report: what was found, how far from truth, how fast."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from deckline.evaluation.chain import RANGE_BANDS_M
from deckline.report.records import STAGES, Record, lookup
from deckline.types import SIDES


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
    ("direction_error_deg", "direction", "°"),
    ("lateral_error_at_ramp_m", "sideways at the ramp", "m"),
    ("height_error_m", "height", "m"),
)


def seen_frames(records: Iterable[Record]) -> list[Record]:
    """Records of frames that went through the chain: all but the skipped ones."""
    return [record for record in records if "skipped" not in record]


def error_rows(records: list[Record]) -> list[ErrorRow]:
    """Errors of the guidance and of each line; empty without truth."""
    rows = [_guidance_row(records, name) for name in GUIDANCE_NAMES]
    for key, what, unit in LINE_ERRORS:
        for side in (*SIDES, "centre"):
            rows.append(_row(f"{side.capitalize()} line, {what}", unit, _values(records, "errors", key, side), None))
    return [row for row in rows if row is not None]


def _guidance_row(records: list[Record], name: str) -> ErrorRow | None:
    both = [
        (error, sigma)
        for record in records
        if (error := lookup(record, ("errors", "guidance", name))) is not None
        and (sigma := lookup(record, ("guidance", name, "sigma"))) is not None
    ]
    errors, sigmas = np.array(both).reshape(-1, 2).T
    return _row(GUIDANCE_NAMES[name], "°" if name.endswith("_deg") else "m", errors, sigmas)


def _row(name: str, unit: str, errors: np.ndarray, sigmas: np.ndarray | None) -> ErrorRow | None:
    if not len(errors):
        return None
    size = np.abs(errors)
    median, p95 = (float(value) for value in np.percentile(size, [50, 95]))
    if sigmas is None:
        return ErrorRow(name, unit, len(size), median, p95, None, None, None)
    within = (float(np.mean(size <= k * sigmas)) for k in (1, 2))
    return ErrorRow(name, unit, len(size), median, p95, float(np.mean(errors)), *within)


def band_rows(records: list[Record]) -> list[BandRow]:
    """Found-rate and errors by true distance to the ramp; empty without truth. Bands without frames are left out."""
    rows = []
    for low, high in RANGE_BANDS_M:
        members = [r for r in records if low <= _true_range_m(r) < high]
        if members:
            lateral = np.abs(_values(members, "errors", "guidance", "lateral_deviation_m"))
            heading = np.abs(_values(members, "errors", "guidance", "heading_error_deg"))
            height = np.abs(_values(members, "errors", "guidance", "height_above_deck_m"))
            found = sum(r["status"] == "ok" for r in members) / len(members)
            quantiles = (_percentile(lateral, 50), _percentile(lateral, 95))
            medians = (_percentile(heading, 50), _percentile(height, 50))
            rows.append(BandRow(low, high, len(members), found, *quantiles, *medians))
    return rows


def _true_range_m(record: Record) -> float:
    value = lookup(record, ("truth", "distance_to_ramp_m"))
    return float("nan") if value is None else float(value)


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
    times = {stage: _values(records, "seconds", stage) for stage in STAGES}
    return {stage: float(np.median(values)) for stage, values in times.items() if len(values)}


def median_sigma(records: list[Record], name: str) -> float | None:
    """Median 1-sigma of a guidance value, in its unit."""
    return _percentile(_values(records, "guidance", name, "sigma"), 50)


def reasons(records: list[Record], key: str = "reason") -> list[tuple[str, int]]:
    """Texts under `key` and how many records carry each, most frequent first."""
    return Counter(str(r[key]) for r in records if r.get(key)).most_common()


def flags(records: list[Record]) -> list[tuple[str, str]]:
    """What was flagged, with the reason first given, and in how many frames; most frequent first."""
    first: dict[str, str] = {}
    times: Counter[str] = Counter()
    for record in records:
        for flag in lookup(record, ("track", "flags")) or []:
            first.setdefault(flag["name"], flag["reason"])
            times[flag["name"]] += 1
    return [(f"{name}: at first {first[name]}", str(count)) for name, count in times.most_common()]


def beyond_protection(records: list[Record]) -> tuple[int, int] | None:
    """Frames without a flag whose error is beyond its protection level, of those where both are known; None: none."""
    beyond = known = 0
    for record in records:
        if not record.get("protection") or not record.get("errors") or record["track"]["flags"]:
            continue
        pairs = (("lateral_m", "lateral_deviation_m"), ("vertical_m", "height_above_deck_m"))
        errors = [(record["protection"][level], lookup(record, ("errors", "guidance", name))) for level, name in pairs]
        if any(error is None for _, error in errors):
            continue
        known += 1
        beyond += any(abs(error) > level for level, error in errors)
    return (beyond, known) if known else None


def _values(records: list[Record], *keys: str) -> np.ndarray:
    values = (lookup(record, keys) for record in records)
    return np.array([value for value in values if value is not None], dtype=np.float64)


def _percentile(values: np.ndarray, percent: float) -> float | None:
    return float(np.percentile(values, percent)) if len(values) else None
