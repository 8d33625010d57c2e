"""report.html of a run: one file that needs no network and no server."""

import base64
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from deckline.report import figures
from deckline.report.parts import bar, card, info_table, listed, number, percent, table
from deckline.report.records import GUIDANCE, Record, lookup
from deckline.types import SIDES

TEMPLATES = Path(__file__).parent / "templates"
STATUSES = ("ok", "one line", "not seen", "skipped")
MODES = ("fine", "coarse", "none")
DIGITS = 6  # significant digits of the numbers behind the plots


@dataclass(frozen=True)
class Picture:
    """Two small images of one frame."""

    record: int  # index of the frame's record
    hazy_jpeg: bytes  # as the camera saw it
    result_jpeg: bytes  # dehazed, with the lines found


def report_html(
    info: Mapping[str, str], records: list[Record], pictures: list[Picture], counts: Mapping[str, int]
) -> str:
    """The report as one HTML text: styles, script, data and images inside.

    Args:
        info: label to value, in the order shown: source, command, version, weights, configuration, date. "source"
            is the heading, "date" and "version" stand below it; "frames" is told with their number, and values whose
            label begins with "note" are repeated above everything else.
        records: records of guidance.jsonl, perhaps thinned out evenly: plots and figures are made of these.
        pictures: for the slider, in the order shown.
        counts: frames of the whole run by status: "ok", "one line", "not seen" and "skipped".

    Raises:
        ValueError: a picture of a record that does not exist or was skipped, or an unknown status in `counts`.
    """
    _check(records, pictures, counts)
    seen = figures.seen_frames(records)
    source = info.get("source", "recording")
    return Template(_template("report.html")).substitute(
        title=escape(f"{Path(source).name} - deckline"),
        heading=escape(Path(source).name or source),
        subtitle=escape(" · ".join([info[key] for key in ("date", "version") if key in info])),
        style=_template("report.css"),
        script=_template("report.js"),
        summary=_summary(info, seen, counts),
        plots_note=_plots_note(seen, counts),
        accuracy=_accuracy(seen),
        troubles=_troubles(records, counts),
        info=info_table(info),
        data=_script_json({"rows": [_row(r) for r in records], "pictures": [_picture(p) for p in pictures]}),
    )


def _check(records: list[Record], pictures: list[Picture], counts: Mapping[str, int]) -> None:
    unknown = sorted(set(counts) - set(STATUSES))
    if unknown:
        raise ValueError(f"counts must be of {', '.join(STATUSES)}, got {', '.join(unknown)}")
    for picture in pictures:
        if not 0 <= picture.record < len(records):
            raise ValueError(f"a picture belongs to record {picture.record}, but there are {len(records)} records")
        if "skipped" in records[picture.record]:
            raise ValueError(f"a picture belongs to record {picture.record}, whose frame was skipped")


def _template(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def _script_json(value: Any) -> str:
    """JSON that cannot end the script element it stands in."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _row(record: Record) -> Record:
    """What plots and numbers need of a record."""
    if "skipped" in record:
        return {"file": record["file"], "skipped": True}
    row = {key: record.get(key) for key in ("file", "time_s", "status", "mode", "reason", "guidance")}
    for group, keys in (("truth", ("truth",)), ("errors", ("errors", "guidance"))):
        values = lookup(record, keys)
        row[group] = values and {name: values.get(name) for name in GUIDANCE}
    row["protection"], row["track"] = record.get("protection"), lookup(record, ("track", "state"))
    row["flags"] = [flag["reason"] for flag in lookup(record, ("track", "flags")) or []]
    for side in SIDES:
        row[side] = _line(lookup(record, ("lines", side)) or {})
    row["seconds"] = sum(record["seconds"].values()) if record.get("seconds") else None
    rounded: Record = _rounded(row)
    return rounded


def _line(line: Record) -> Record:
    confidence = line.get("confidence") or []
    inliers = lookup(line, ("pixel_line", "inliers"))
    return {
        "points": len(confidence),
        "kept": None if inliers is None else sum(inliers),
        "confidence": float(np.mean(confidence)) if confidence else None,
    }


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _picture(picture: Picture) -> Record:
    encoded = (base64.b64encode(jpeg).decode("ascii") for jpeg in (picture.hazy_jpeg, picture.result_jpeg))
    return {"record": picture.record, **dict(zip(("hazy", "result"), encoded, strict=True))}


def _summary(info: Mapping[str, str], seen: list[Record], counts: Mapping[str, int]) -> str:
    shown = [(name, counts.get(name, 0)) for name in STATUSES]
    modes = [(name, sum(record["mode"] == name for record in seen)) for name in MODES]
    bars = bar("Lines found", shown) + bar("Where distances came from", modes)
    notes = "".join(f"<p>{escape(value)}</p>" for label, value in info.items() if label.startswith("note"))
    notice = f'<div class="panel notice">{notes}</div>' if notes else ""
    return f'{notice}<div class="cards">{"".join(_cards(info, seen, counts))}</div><div class="bars">{bars}</div>'


def _cards(info: Mapping[str, str], seen: list[Record], counts: Mapping[str, int]) -> Iterable[str]:
    total, skipped = sum(counts.values()), counts.get("skipped", 0)
    used = total - skipped
    detail = [info["frames"]] if "frames" in info else []
    yield card("Frames", f"{total:,}", "; ".join([*detail, f"{skipped:,} skipped" if skipped else "none skipped"]))
    rate = figures.found_rate(seen)
    if rate is not None:
        yield card("Both lines found", percent(rate), "of the frames that truly show a runway")
    elif used:
        yield card("Both lines found", percent(counts.get("ok", 0) / used), "of the frames used")
    errors = {row.name: row for row in figures.error_rows(seen)}
    for name, label in (("Lateral deviation", "Lateral error"), ("Centre line, direction", "Direction error")):
        if name in errors:
            row = errors[name]
            yield card(f"{label}, median", number(row.median, row.unit), f"95 %: {number(row.p95, row.unit)}")
    sigma = figures.median_sigma(seen, "lateral_deviation_m")
    if not errors and sigma is not None:
        yield card("Lateral deviation, 1 sigma", number(sigma, "m"), "median; no truth to compare with")
    yield from _track_cards(seen)
    wrong, empty = figures.false_lines(seen)
    if empty:
        yield card("False lines", f"{wrong}", f"in {empty} frames without a runway")
    times = figures.stage_seconds(seen)
    if times:
        parts = ", ".join(f"{stage} {1000 * t:.{0 if t > 0.001 else 1}f}" for stage, t in times.items())
        yield card("Time per frame", f"{1000 * sum(times.values()):.0f} ms", parts)


def _track_cards(seen: list[Record]) -> Iterable[str]:
    """How much of the run was guided by a track, and what its integrity said."""
    tracks = [record["track"] for record in seen if record.get("track")]
    if not tracks:
        return
    states = Counter(track["state"] for track in tracks)
    detail = ", ".join(f"{states[name]} {name}" for name in ("coasting", "lost") if states[name]) or "without a break"
    yield card("Tracked", percent((states["tracking"] + states["coasting"]) / len(tracks)), detail)
    flagged = sum(bool(track["flags"]) for track in tracks)
    missed = figures.beyond_protection(seen)
    told = "" if missed is None else f"{missed[0]} of {missed[1]} beyond their protection level without a flag"
    yield card("Flagged frames", f"{flagged}", told)


def _plots_note(seen: list[Record], counts: Mapping[str, int]) -> str:
    notes = []
    used = sum(counts.values()) - counts.get("skipped", 0)
    if len(seen) < used:
        notes.append(f"Plots, pictures and figures are made of {len(seen)} of {used} frames, evenly chosen.")
    if not any(lookup(record, ("guidance", name)) for record in seen for name in GUIDANCE):
        common = figures.reasons(seen)
        why = f" Most often: {common[0][0]}." if common else ""
        notes.append(f"No frame could be placed relative to the deck, so there are no deviations to plot.{why}")
    return f'<p class="quiet">{escape(" ".join(notes))}</p>' if notes else ""


def _accuracy(seen: list[Record]) -> str:
    rows = figures.error_rows(seen)
    if not rows:
        return ""
    body = [
        (
            row.name,
            str(row.frames),
            number(row.median, row.unit),
            number(row.p95, row.unit),
            "–" if row.bias is None else number(row.bias, row.unit, sign=True),
            *("–" if share is None else percent(share) for share in (row.within_1_sigma, row.within_2_sigma)),
        )
        for row in rows
    ]
    head = ("Error against truth", "frames", "median", "95 %", "mean, signed", "within 1 σ", "within 2 σ")
    note = (
        "Median and 95 % are of the absolute error. Where 1 sigma is honest and errors are normal, "
        "68 % lie within 1 σ and 95 % within 2 σ."
    )
    return (
        '<section aria-labelledby="accuracy-title"><h2 id="accuracy-title">Against truth</h2>'
        f'<div class="panel"><div class="scroll">{table(head, body)}</div><p class="quiet">{note}</p></div></section>'
        f"{_bands(seen)}"
    )


def _bands(seen: list[Record]) -> str:
    bands = figures.band_rows(seen)
    if not bands:
        return ""
    body = [
        (
            f"{b.low_m:.0f} m and more" if math.isinf(b.high_m) else f"{b.low_m:.0f} to {b.high_m:.0f} m",
            str(b.frames),
            percent(b.found_rate),
            number(b.lateral_median_m, "m"),
            number(b.lateral_p95_m, "m"),
            number(b.heading_median_deg, "°"),
            number(b.height_median_m, "m"),
        )
        for b in bands
    ]
    head = (
        "True distance to ramp",
        "frames",
        "both lines",
        "lateral, median",
        "95 %",
        "heading, median",
        "height, median",
    )
    return (
        '<section aria-labelledby="bands-title"><h2 id="bands-title">Error by distance</h2>'
        f'<div class="panel scroll">{table(head, body)}</div></section>'
    )


def _troubles(records: list[Record], counts: Mapping[str, int]) -> str:
    skipped = [(str(r["file"]), str(r["skipped"])) for r in records if "skipped" in r]
    missing = [(reason, str(times)) for reason, times in figures.reasons(figures.seen_frames(records))]
    flags = figures.flags(figures.seen_frames(records))
    parts = []
    if flags:
        parts.append("<h2>Flags</h2>" + listed(("What contradicted the guidance", "Frames"), flags, len(flags)))
    if counts.get("skipped"):
        parts.append("<h2>Skipped frames</h2>" + listed(("File", "Why"), skipped, counts["skipped"]))
    if missing:
        parts.append("<h2>Why numbers are missing</h2>" + listed(("Reason", "Frames"), missing, len(missing)))
    return "".join(f"<section>{part}</section>" for part in parts)
