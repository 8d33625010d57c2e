"""One record per frame: a line of guidance.jsonl, a row of guidance.csv.

Degrees where people read, units in the names, null for what does not exist: never NaN or Infinity.
"""

import csv
import json
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from deckline.evaluation.chain import range_to_ramp_m
from deckline.pipeline import FrameResult
from deckline.recording import BadFrame
from deckline.truth import errors_against, true_guidance
from deckline.types import SIDES, Frame, Guidance, LinePoints, PixelLine, RunwayLine, Track, Truth, Value

DIGITS = 9  # significant digits written
GUIDANCE = (
    "lateral_deviation_m",
    "heading_error_deg",
    "height_above_deck_m",
    "distance_to_ramp_m",
    "vertical_deviation_m",
    "lateral_deviation_deg",
    "vertical_deviation_deg",
    "distance_to_touchdown_m",
    "lateral_rate_m_s",
    "height_rate_m_s",
    "closing_m_s",
)
KNOWN_TRUE = tuple(name for name in GUIDANCE if not name.endswith("_m_s"))  # one frame's truth has no rates
UNITS = ("_m_s", "_deg", "_m")
LINE_ERRORS = ("direction_error_deg", "lateral_error_at_ramp_m", "height_error_m")
STAGES = ("dehaze", "detect", "localize", "guide", "track")

Record = dict[str, Any]


def frame_record(result: FrameResult) -> Record:
    """What is written about one frame; plain JSON values only."""
    frame, estimate = result.frame, result.estimate
    points = {"left": result.detection.left, "right": result.detection.right}
    lines: Record = {
        side: _points(points[side])
        | {"pixel_line": _pixel_line(estimate.pixel_lines.get(side)), "world": _world(estimate.lines.get(side))}
        for side in SIDES
    }
    lines["centre"] = {"world": _world(estimate.lines.get("centre"))}
    ramp = None if estimate.ramp_m is None else {"point_m": estimate.ramp_m, "sigma_m": estimate.ramp_sigma_m}
    truth = true_guidance(frame)
    return _plain(
        {
            "file": frame.file,
            "time_s": frame.time_s,
            "status": str(estimate.status),
            "mode": str(estimate.mode),
            "reason": result.guidance.reason,
            "lines": lines,
            "ramp": ramp,
            "guidance": guidance_record(result.guidance),
            "protection": None if result.guidance.protection is None else vars(result.guidance.protection),
            "track": None if result.track is None else _track(result.track),
            "truth": None if frame.truth is None else _truth(frame, frame.truth, truth),
            "errors": None if frame.truth is None else errors_against(frame.truth, estimate, result.guidance, truth),
            "seconds": result.seconds,
        }
    )


def skipped_record(bad: BadFrame) -> Record:
    """What is written about a frame that could not be used."""
    return {"file": bad.file, "skipped": bad.reason}


def to_line(record: Record) -> str:
    """One line of JSON, ended by a newline.

    Raises:
        ValueError: a number that is not finite.
    """
    return json.dumps(record, allow_nan=False, ensure_ascii=False, separators=(",", ":")) + "\n"


def read_records(path: Path) -> Iterator[Record]:
    """Records of a JSONL file, one at a time, up to the first line that is not whole."""
    for _, record in _whole_lines(path):
        yield record


def keep_whole_lines(path: Path) -> int:
    """Cut a JSONL file after its last whole line, as an interrupted writer may have left half of one.

    Returns: the number of lines kept.
    """
    end = count = 0
    for line_end, _ in _whole_lines(path):
        end, count = line_end, count + 1
    with path.open("r+b") as file:
        file.truncate(end)
    return count


def _whole_lines(path: Path) -> Iterator[tuple[int, Record]]:
    """Records and the byte where each one's line ends."""
    end = 0
    with path.open("rb") as file:
        for line in file:
            end += len(line)
            if not line.endswith(b"\n"):
                return
            try:
                record = json.loads(line)
            except ValueError:
                return
            if not isinstance(record, dict) or "file" not in record:
                return
            yield end, record


def write_csv(path: Path, records: Iterable[Record]) -> None:
    """The records as a table, one row each; empty cells for what does not exist."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(column for column, _ in COLUMNS)
        for record in records:
            writer.writerow(_cell(lookup(record, keys)) for _, keys in COLUMNS)


def lookup(record: Record, keys: Iterable[str | int]) -> Any:
    """A nested value; None where the way to it ends early."""
    value: Any = record
    for key in keys:
        if value is None or (isinstance(value, dict) and key not in value):
            return None
        value = value[key]
    return value


def _columns() -> list[tuple[str, tuple[str | int, ...]]]:
    """Column names with units, and where each value lies in a record."""
    columns: list[tuple[str, tuple[str | int, ...]]] = [
        (name, (name,)) for name in ("file", "time_s", "status", "mode", "reason", "skipped")
    ]
    for name in GUIDANCE:
        unit = next(unit for unit in UNITS if name.endswith(unit))
        sigma = f"{name.removesuffix(unit)}_sigma{unit}"
        columns += [(name, ("guidance", name, "value")), (sigma, ("guidance", name, "sigma"))]
    columns += [(f"{axis}_protection_m", ("protection", f"{axis}_m")) for axis in ("lateral", "vertical")]
    columns += [
        ("track_state", ("track", "state")),
        *((f"track_{name}", ("track", name)) for name in ("flags", "excluded")),
    ]
    for side in (*SIDES, "centre"):
        place: tuple[str, ...] = ("lines", side, "world")
        columns += [(f"{side}_{axis}_m", (*place, "point_m", i)) for i, axis in enumerate("xyz")]
        columns.append((f"{side}_azimuth_deg", (*place, "azimuth_deg")))
    columns += [(f"ramp_{axis}_m", ("ramp", "point_m", i)) for i, axis in enumerate("xyz")]
    columns += [(f"true_{name}", ("truth", name)) for name in ("range_to_ramp_m", *KNOWN_TRUE)]
    columns += [(f"{side}_{name}", ("errors", name, side)) for name in LINE_ERRORS for side in (*SIDES, "centre")]
    return columns + [(f"{stage}_s", ("seconds", stage)) for stage in STAGES]


COLUMNS = _columns()


def _cell(value: Any) -> Any:
    if isinstance(value, list):  # flags: their names
        return " ".join(str(item["name"]) for item in value)
    return "" if value is None else value


def _points(points: LinePoints) -> Record:
    return {"points_px": points.points_px, "confidence": points.confidence, "sigma_px": points.sigma_px}


def _pixel_line(line: PixelLine | None) -> Record | None:
    if line is None:
        return None
    return {
        "coefficients": line.coefficients,
        "ends_px": line.ends_px,
        "sigma_px": line.sigma_px,
        "inliers": line.inliers,
    }


def _world(line: RunwayLine | None) -> Record | None:
    if line is None:
        return None
    return {
        "point_m": line.point_m,
        "azimuth_deg": np.rad2deg(line.azimuth_rad),
        "slope": line.slope,
        "intercept_m": line.intercept_m,
        "height_m": line.height_m,
        "covariance": line.covariance,
        "relative_covariance": line.relative_covariance,
    }


def guidance_record(guidance: Guidance) -> Record:
    """Values with their 1-sigma, under the names of `GUIDANCE`, angles in degrees; None for what is not known."""
    return {name: _value(guidance, name) for name in GUIDANCE}


def _value(guidance: Guidance, name: str) -> Record | None:
    in_degrees = name.endswith("_deg")
    value: Value | None = getattr(guidance, name.removesuffix("_deg") + "_rad" if in_degrees else name)
    if value is None:
        return None
    number, sigma = np.rad2deg([value.value, value.sigma]) if in_degrees else (value.value, value.sigma)
    return {"value": number, "sigma": sigma}


def _track(track: Track) -> Record:
    return {
        "state": str(track.state),
        "age_s": track.age_s,
        "flags": [vars(flag) for flag in track.flags],
        "excluded": [vars(flag) for flag in track.excluded],
        "lines": {side: _world(track.lines.get(side)) for side in (*SIDES, "centre")},
    }


def _truth(frame: Frame, truth: Truth, guidance: Guidance | None) -> Record:
    visibility = truth.visibility_m
    values = {} if guidance is None else guidance_record(guidance)
    return {
        "has_runway": truth.left is not None,
        "visibility_m": visibility,
        "clear_air": visibility is not None and math.isinf(visibility),
        "range_to_ramp_m": range_to_ramp_m(frame),
        **{name: None if values.get(name) is None else values[name]["value"] for name in KNOWN_TRUE},
    }


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
    if isinstance(value, float | np.floating):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value
