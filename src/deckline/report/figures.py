"""Figures of a run for its report: what was found, how far from truth, how fast."""

from collections import Counter
from collections.abc import Hashable, Iterable

import numpy as np
from numpy.typing import NDArray

from deckline.report.bands import RANGE_M, by_band, share
from deckline.report.records import GUIDANCE, KNOWN_TRUE, LINE_ERRORS, LINES, STAGES, Record, lookup
from deckline.types import LineVisibility

NONE = "–"


class TextCounter:
    """How often each key comes, with the text first given for it."""

    def __init__(self) -> None:
        self._texts: dict[Hashable, str] = {}
        self._times: Counter[Hashable] = Counter()

    def add(self, key: Hashable, text: str) -> None:
        """Count a key once more."""
        self._texts.setdefault(key, text)
        self._times[key] += 1

    def rows(self) -> list[tuple[str, int]]:
        """Texts and counts, most frequent first."""
        return [(self._texts[key], count) for key, count in self._times.most_common()]


def error_rows(records: list[Record]) -> list[tuple[str, ...]]:
    """Measured minus true, of the guidance and of each line; empty without truth.

    Returns: a row each: name, frames that have both, median and 95 % of the absolute error, mean of the signed one,
        shares of frames within 1 and 2 sigma.
    """
    rows = []
    for key in KNOWN_TRUE:
        errors, sigmas = _gather(records, ("errors", "guidance", key), ("guidance", key, "sigma"))
        within = [np.mean(np.abs(errors) <= k * sigmas) for k in (1, 2)] if len(errors) else []
        rows.append((GUIDANCE[key], key, errors, np.mean(errors) if len(errors) else None, within))
    for key, what in LINE_ERRORS.items():
        for line in LINES:  # sizes without a sign, and no sigma is given
            (errors,) = _gather(records, ("errors", key, line))
            rows.append((f"{line.capitalize()} line, {what}", key, errors, None, [None, None]))
    return [
        (name, f"{len(errors)}", *_quantiles(errors, key), number(mean, _unit(key), sign=True), *map(percent, within))
        for name, key, errors, mean, within in rows
        if len(errors)
    ]


def band_rows(records: list[Record]) -> list[tuple[str, ...]]:
    """Found-rate and errors by true distance to the ramp; empty without truth. Bands without frames are left out.

    Returns: a row each: band, frames, share with both lines, median and 95 % of the lateral error, median errors of
        heading and height; lengths in runway widths where a band has these.
    """
    rows: list[tuple[str, ...]] = []
    known = [record for record in records if lookup(record, ("truth", "distance_to_ramp_m")) is not None]
    for band, members in by_band(known, lambda record: record["truth"]["distance_to_ramp_m"], RANGE_M).items():
        (widths,) = _gather(members, ("errors", "guidance", "lateral_deviation_widths"))
        unit = "widths" if len(widths) else "m"
        names = (f"lateral_deviation_{unit}", "heading_error_deg", f"height_above_deck_{unit}")
        lateral, heading, height = (
            _quantiles(_gather(members, ("errors", "guidance", name))[0], name) for name in names
        )
        found = share(members, lambda record: record["seen"] == LineVisibility.BOTH)
        rows.append((band, f"{len(members)}", percent(found), *lateral, heading[0], height[0]))
    return rows


def found_rate(records: list[Record]) -> float | None:
    """Share of frames with both lines found among those that truly show a runway; None where that is not known."""
    decks = [r for r in records if lookup(r, ("truth", "has_runway"))]
    return sum(r["seen"] == LineVisibility.BOTH for r in decks) / len(decks) if decks else None


def false_lines(records: list[Record]) -> tuple[int, int]:
    """Frames with a line though there is truly no runway, and frames without a runway."""
    empty = [r for r in records if lookup(r, ("truth", "has_runway")) is False]
    return sum(r["seen"] != LineVisibility.NONE for r in empty), len(empty)


def stage_seconds(records: list[Record]) -> dict[str, float]:
    """Median wall time of each stage, s."""
    medians = {stage: _median(_gather(records, ("seconds", stage))[0]) for stage in STAGES}
    return {stage: median for stage, median in medians.items() if median is not None}


def median_visibility(records: list[Record]) -> tuple[str, str] | None:
    """The median visibility and what to know of it; None where no dehazed picture shows one."""
    values, sigmas = _gather(records, ("visibility_m", "value"), ("visibility_m", "sigma"))
    if len(values):
        detail = f"median of {len(values)} frames, 1 sigma {number(float(np.median(sigmas)), 'm')}"
        return number(float(np.median(values)), "m"), detail
    if any(record.get("visibility_heights") for record in records):
        return NONE, "in metres once --camera-height-m states the camera's height above the water"
    return None


def median_sigma(records: list[Record], name: str) -> float | None:
    """Median 1-sigma of a guidance value, in its unit."""
    return _median(_gather(records, ("guidance", name, "sigma"))[0])


def count_reasons(records: Iterable[Record]) -> list[tuple[str, int]]:
    """Why something is missing, in the words first given, and in how many frames; most frequent first."""
    reasons = TextCounter()
    for record in records:
        if record.get("reasons"):
            reasons.add(tuple(record["reasons"]), record["reason"])
    return reasons.rows()


def count_flags(records: Iterable[Record]) -> list[tuple[str, int]]:
    """What was flagged, with the reason first given, and in how many frames; most frequent first."""
    flags = TextCounter()
    for flag in (flag for record in records for flag in record.get("flags") or ()):
        flags.add(flag["name"], f"{flag['name']}: at first {flag['reason']}")
    return flags.rows()


def beyond_protection(records: list[Record]) -> tuple[int, int] | None:
    """Frames without a flag whose error is beyond its protection level, of those where both are known; None: none."""
    bounded = [record for record in records if not record.get("flags")]
    paths = (("errors", "guidance", "lateral_deviation_m"), ("errors", "guidance", "height_above_deck_m"))
    across, above, *levels = _gather(bounded, *paths, ("protection", "lateral_m"), ("protection", "vertical_m"))
    beyond = (np.abs(across) > levels[0]) | (np.abs(above) > levels[1])
    return (int(beyond.sum()), len(beyond)) if len(beyond) else None


def number(value: float | None, unit: str, sign: bool = False) -> str:
    """A figure to three digits with a true minus sign; a dash where there is none."""
    if value is None:
        return NONE
    places = 0 if abs(value) >= 100 else 1 if abs(value) >= 10 else 2
    text = f"{value:{'+' if sign else ''}.{places}f}".replace("-", "−")
    text = text.lstrip("+−") if not float(f"{value:.{places}f}") else text
    return f"{text}{'' if unit == '°' else ' '}{unit}"


def percent(share: float | None) -> str:
    """A share 0..1 as text; a dash where there is none."""
    return NONE if share is None else f"{100 * share:.{1 if 0 < share < 1 else 0}f} %"


def _gather(records: Iterable[Record], *paths: tuple[str, ...]) -> NDArray[np.float64]:
    """Values under each path, a row each, of the records that have all of them."""
    rows = ([lookup(record, path) for path in paths] for record in records)
    return np.array([row for row in rows if None not in row], dtype=np.float64).reshape(-1, len(paths)).T


def _median(values: NDArray[np.float64]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _quantiles(errors: NDArray[np.float64], key: str) -> tuple[str, str]:
    size = np.abs(errors)
    p95 = float(np.percentile(size, 95)) if len(size) else None
    return number(_median(size), _unit(key)), number(p95, _unit(key))


def _unit(key: str) -> str:
    return "°" if key.endswith("_deg") else "widths" if key.endswith("_widths") else "m"
