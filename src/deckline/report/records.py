"""One record per frame: a line of guidance.jsonl, a row of guidance.csv.

Degrees where people read, units in the names, null for what does not exist: never NaN or Infinity.
"""

import csv
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from deckline.config import Approach
from deckline.dehaze import DehazeResult
from deckline.files import check_regular, open_regular, printable
from deckline.flight import FrameResult
from deckline.recording import BadFrame
from deckline.recording.source import parse_json
from deckline.truth import errors_against, lengths_in_widths, range_to_ramp_m, true_guidance, true_width_m
from deckline.types import SIDES, Diagnostics, Guidance, Protection, RunwayLine, Track, Value

DIGITS = 9  # significant digits written,
DECIMALS = 6  # but never fewer decimals than these: microseconds of a Unix time, micrometres of a far origin
GUIDANCE = {  # what is written of the guidance, and what people call it
    "lateral_deviation_m": "Lateral deviation",
    "heading_error_deg": "Heading error",
    "height_above_deck_m": "Height above deck",
    "distance_to_ramp_m": "Distance to ramp",
    "lateral_deviation_widths": "Lateral deviation, runway widths",
    "height_above_deck_widths": "Height above deck, runway widths",
    "distance_to_ramp_widths": "Distance to ramp, runway widths",
    "vertical_deviation_m": "Deviation from glideslope",
    "lateral_deviation_deg": "Lateral deviation, angle",
    "vertical_deviation_deg": "Deviation from glideslope, angle",
    "distance_to_touchdown_m": "Distance to touchdown",
    "lateral_rate_m_s": "Rate of the lateral deviation",
    "height_rate_m_s": "Rate of the height",
    "deck_acceleration_m_s2": "Acceleration of the deck",
    "closing_m_s": "Closing speed",
}
KNOWN_TRUE = tuple(name for name in GUIDANCE if not name.endswith(("_m_s", "_m_s2")))  # one frame's truth has no rates
UNITS = ("_m_s2", "_m_s", "_deg", "_m", "_widths")
FORMULA = ("=", "+", "-", "@")  # how texts begin that spreadsheets compute; an apostrophe makes them texts
LINES = (*SIDES, "centre")
LINE_ERRORS = {  # of each line, and what people call it
    "direction_error_deg": "direction",
    "lateral_error_at_ramp_m": "sideways at the ramp",
    "height_error_m": "height",
}
STAGES = ("dehaze", "detect", "localize", "guide", "track", "picture")
NO_COLUMNS: Mapping[str, Iterable[str | int]] = {}
SKIPPED = "skipped"  # what a frame that cannot be used counts as

Record = dict[str, Any]
FlightView = Callable[[FrameResult | None, Record], None]  # watches a flight; None: a record without a result


def frame_record(result: FrameResult, approach: Approach) -> Record:
    """What is written about one frame, plain JSON values only; `approach` states what the guidance should be."""
    frame, estimate, detection = result.frame, result.estimate, result.detection
    has_metres = not frame.in_widths  # else lines and ramp are in widths, and not written
    lines: Record = {}
    for side in SIDES:
        line = estimate.pixel_lines.get(side)
        lines[side] = _pick(getattr(detection, side), "points_px", "confidence", "sigma_px")
        lines[side]["pixel_line"] = line and _pick(line, "coefficients", "ends_px", "sigma_px", "inliers")
        lines[side]["world"] = _world(estimate.lines.get(side)) if has_metres else None
    lines["centre"] = {"world": _world(estimate.lines.get("centre")) if has_metres else None}
    ramp = None if estimate.ramp_m is None else {"point_m": estimate.ramp_m, "sigma_m": estimate.ramp_sigma_m}
    record = {
        "file": frame.file,
        "time_s": frame.time_s,
        "status": str(result.guidance.status),
        "seen": str(estimate.seen),
        "pose_source": result.guidance.pose_source and str(result.guidance.pose_source),
        "scale_sources": [str(source) for source in result.guidance.scale_sources],
        "mode": str(estimate.mode),
        "edge": detection.edge and str(detection.edge),
        "frames_joined": detection.frames,
        "reason": result.guidance.reason,
        "reasons": [str(diagnostic.reason) for diagnostic in result.guidance.diagnostics],
        "lines": lines,
        "ramp": ramp if has_metres else None,
        "guidance": guidance_record(result.guidance),
        "protection": result.guidance.protection and protection_record(result.guidance.protection),
        "flags": _diagnostics(result.guidance.flags),
        "track": result.track and _track(result.track, has_metres),
        **dehazing_record(result.dehazed),
        "seconds": dict(result.seconds),
        **_truth(result, approach),
    }
    return {key: _plain(value) for key, value in record.items()}


def dehazing_record(dehazed: DehazeResult | None) -> Record:
    """What dehazing found in a frame: why it is left as it is, and the visibility; null for what is not known."""
    values = {name: getattr(dehazed, name, None) for name in ("visibility_m", "visibility_heights")}
    measured: Record = {name: value and _plain(vars(value)) for name, value in values.items()}
    return {"not_dehazed": (dehazed and dehazed.note) or None, **measured}


def skipped_record(bad: BadFrame) -> Record:
    """What is written about a frame that could not be used."""
    return {"file": printable(bad.file), "skipped": printable(bad.reason)}


def guidance_record(guidance: Guidance) -> Record:
    """Values with their 1-sigma as they are written, angles in degrees; None for what is not known."""
    values: Record = _plain({name: _value(guidance, name) for name in GUIDANCE})
    return values


def protection_record(protection: Protection) -> Record:
    """Protection levels as they are written: the heading's in degrees."""
    levels = dict(vars(protection))
    heading_rad = levels.pop("heading_rad")
    levels["heading_deg"] = None if heading_rad is None else float(np.rad2deg(heading_rad))
    return levels


def to_line(record: Record) -> str:
    """One line of JSON, ended by a newline.

    Raises:
        ValueError: a number that is not finite.
    """
    return json.dumps(record, allow_nan=False, ensure_ascii=False, separators=(",", ":")) + "\n"


def read_records(path: Path) -> Iterator[Record]:
    """Records of a JSONL file, one at a time; half a line at its end, which an interrupted writer leaves, is none.

    Raises:
        ValueError: a line that is no JSON object; names file and line.
    """
    with open_regular(path) as file:
        for number, line in enumerate(file, 1):
            if line.endswith(b"\n"):
                record = parse_json(line.decode(errors="replace"), f"{path} line {number}")
                if not isinstance(record, dict):
                    raise ValueError(f"{path} line {number}: no record of a frame: {line[:40]!r}")
                yield record


def kind_of(record: Record) -> str:
    """What a record counts as: its status, or "skipped"."""
    return SKIPPED if "skipped" in record else str(record["status"])


def keep_whole_lines(path: Path, most: int | None = None) -> int:
    """Cut a JSONL file after its last whole line, or after `most` lines; returns the number of lines retained."""
    count = end = 0
    check_regular(path)
    with path.open("r+b") as file:
        for line in islice(file, most):
            if line.endswith(b"\n"):
                count, end = count + 1, end + len(line)
        file.truncate(end)
    return count


def write_csv(path: Path, records: Iterable[Record], more: Mapping[str, Iterable[str | int]] = NO_COLUMNS) -> None:
    """The records as a table, one row each; empty cells for what does not exist.

    Args:
        more: further columns: name -> where the value lies in a record.
    """
    columns = {**COLUMNS, **more}
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for record in records:
            writer.writerow(_cell(lookup(record, keys)) for keys in columns.values())


def lookup(record: Record, keys: Iterable[str | int]) -> Any:
    """A nested value; None where the way to it ends early."""
    value: Any = record
    for key in keys:
        try:
            value = value[key]
        except (LookupError, TypeError):
            return None
    return value


def _columns() -> dict[str, tuple[str | int, ...]]:
    """Column names with units -> where each value lies in a record."""
    columns: dict[str, tuple[str | int, ...]] = {
        name: (name,)
        for name in (
            "file",
            "time_s",
            "status",
            "seen",
            "pose_source",
            "scale_sources",
            "mode",
            "edge",
            "frames_joined",
            "reason",
        )
    }
    columns |= {name: (name,) for name in ("flags", "skipped")}
    for name in GUIDANCE:
        unit = next(unit for unit in UNITS if name.endswith(unit))
        columns[name] = ("guidance", name, "value")
        columns[f"{name.removesuffix(unit)}_sigma{unit}"] = ("guidance", name, "sigma")
    columns |= {"visibility_m": ("visibility_m", "value"), "visibility_sigma_m": ("visibility_m", "sigma")}
    for name, unit in (("lateral", "m"), ("vertical", "m"), ("heading", "deg"), ("distance", "m")):
        columns[f"{name}_protection_{unit}"] = ("protection", f"{name}_{unit}")
    columns |= {f"track_{name}": ("track", name) for name in ("state", "flags", "excluded")}
    for line in LINES:
        columns |= {f"{line}_{axis}_m": ("lines", line, "world", "point_m", i) for i, axis in enumerate("xyz")}
        columns[f"{line}_azimuth_deg"] = ("lines", line, "world", "azimuth_deg")
    for side in SIDES:
        ends = ((end, i, axis) for end in (0, 1) for i, axis in enumerate("uv"))
        columns |= {f"{side}_{axis}{end}_px": ("lines", side, "pixel_line", "ends_px", end, i) for end, i, axis in ends}
    columns |= {f"ramp_{axis}_m": ("ramp", "point_m", i) for i, axis in enumerate("xyz")}
    columns |= {f"true_{name}": ("truth", name) for name in ("range_to_ramp_m", *KNOWN_TRUE)}
    columns |= {f"{line}_{name}": ("errors", name, line) for name in LINE_ERRORS for line in LINES}
    return columns | {f"{stage}_s": ("seconds", stage) for stage in STAGES}


COLUMNS = _columns()


def _cell(value: Any) -> Any:
    if isinstance(value, list):  # flags: their names
        return ";".join(str(item["name"] if isinstance(item, dict) else item) for item in value)
    if isinstance(value, str) and value.startswith(FORMULA):
        return f"'{value}"
    return "" if value is None else value


def _pick(values: object, *names: str) -> Record:
    return {name: getattr(values, name) for name in names}


def _world(line: RunwayLine | None) -> Record | None:
    if line is None:
        return None
    names = ("point_m", "slope", "intercept_m", "height_m", "covariance", "relative_covariance")
    return {"azimuth_deg": np.rad2deg(line.azimuth_rad), **_pick(line, *names)}


def _value(guidance: Guidance, name: str) -> Record | None:
    if name.endswith("_widths"):
        length: Value | None = getattr(guidance.in_widths, name.removesuffix("_widths"), None)
        return None if length is None else dict(vars(length))
    in_degrees = name.endswith("_deg")
    value: Value | None = getattr(guidance, name.removesuffix("_deg") + "_rad" if in_degrees else name)
    if value is None:
        return None
    return {key: np.rad2deg(number) if in_degrees else number for key, number in vars(value).items()}


def _diagnostics(diagnostics: Diagnostics) -> list[Record]:
    return [{"name": str(diagnostic.reason), "reason": diagnostic.message} for diagnostic in diagnostics]


def _track(track: Track, has_metres: bool) -> Record:
    return {
        "state": str(track.state),
        "age_s": track.age_s,
        "flags": _diagnostics(track.flags),
        "excluded": _diagnostics(track.excluded),
        "lines": {line: _world(track.lines.get(line)) if has_metres else None for line in LINES},
    }


def _truth(result: FrameResult, approach: Approach) -> Record:
    """Truth and errors of a frame; None where it carries no truth."""
    frame, truth = result.frame, result.frame.truth
    if truth is None:
        return {"truth": None, "errors": None}
    exact = true_guidance(frame, approach)
    widths = lengths_in_widths(exact, true_width_m(truth))
    values = {} if exact is None else guidance_record(replace(exact, in_widths=widths))
    known = {
        "has_runway": truth.left is not None,
        "visibility_m": truth.visibility_m,
        "clear_air": truth.visibility_m is not None and math.isinf(truth.visibility_m),
        "range_to_ramp_m": range_to_ramp_m(frame),
        **{name: lookup(values, (name, "value")) for name in KNOWN_TRUE},
    }
    return {"truth": known, "errors": errors_against(truth, result.estimate, result.guidance, exact)}


def _plain(value: Any) -> Any:
    """Plain JSON values; numbers cut to `DIGITS`, and null for those that are not finite."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, float | np.floating):
        if not math.isfinite(value):
            return None
        return (
            round(float(value), DECIMALS) if abs(value) >= 10 ** (DIGITS - DECIMALS) else float(f"{value:.{DIGITS}g}")
        )
    return value
