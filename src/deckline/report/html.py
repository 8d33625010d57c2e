"""report.html of a run: one file that needs no network and no server."""

import base64
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from deckline.report import figures
from deckline.report.figures import number, percent
from deckline.report.records import GUIDANCE, Record, lookup
from deckline.report.status import STATUS_COLOURS, STATUS_WORDS
from deckline.types import SIDES, LineVisibility

TEMPLATES = Path(__file__).parent / "templates"
MODES = {"fine": "depth camera", "coarse": "deck plane", "width": "lines' spacing", "none": "no distance"}
LISTED = 40  # rows of a list at most

ReportPictures = dict[int, tuple[bytes, bytes]]  # index of a record -> JPEG files: hazy, and dehazed with the lines


def report_html(
    info: Mapping[str, str],
    records: list[Record],
    pictures: ReportPictures,
    counts: Mapping[str, int],
    dehazing: Sequence[Record] = (),
) -> str:
    """The report as one HTML text: styles, script, data and images inside.

    Args:
        info: label to value, in the order shown: source, command, version, weights, configuration, date. "source"
            is the heading, "date" and "version" are below it; "frames" is repeated beside their number, values whose
            label begins with "note" above everything else.
        records: records of guidance.jsonl, perhaps thinned out evenly: plots and figures are made of these.
        pictures: for the slider: index of a frame's record -> two JPEG files, as the camera saw it, and dehazed with
            the lines found.
        counts: frames of the whole run by status, and "skipped".
        dehazing: records of dehazing.jsonl, perhaps thinned out.
    """
    seen = [record for record in records if "skipped" not in record]
    source = info.get("source", "recording")
    coded = {index: [base64.b64encode(jpeg).decode() for jpeg in pair] for index, pair in pictures.items()}
    shown = [{"record": index, "hazy": hazy, "marked": marked} for index, (hazy, marked) in coded.items()]
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.filters["percent"] = percent
    return environment.get_template("report.html").render(
        heading=Path(source).name or source,
        info=info,
        style=Markup((TEMPLATES / "report.css").read_text(encoding="utf-8") + _status_style()),
        script=Markup((TEMPLATES / "report.js").read_text(encoding="utf-8")),
        cards=list(_cards(info, seen, counts, dehazing)),
        bars=_bars(seen, counts),
        plots_note=_plots_note(seen, counts),
        errors=figures.error_rows(seen),
        bands=figures.band_rows(seen),
        flags=figures.count_flags(seen),
        skipped=[(record["file"], record["skipped"]) for record in records if "skipped" in record],
        skipped_frames=counts.get("skipped", 0),
        reasons=figures.count_reasons(seen),
        listed=LISTED,
        data={
            "rows": [_row(record) for record in records],
            "pictures": shown,
            "titles": GUIDANCE,
            "statuses": STATUS_WORDS,
        },
    )


def _status_style() -> str:
    """CSS of the status colours."""
    rules = ((word.replace(" ", "-"), *colours.css) for word, colours in STATUS_COLOURS.items())
    return "\n".join(f".{name} {{ --key: {fill}; --on-key: {ink}; }}" for name, fill, ink in rules)


def _row(record: Record) -> Record:
    if "skipped" in record:
        return {"file": record["file"], "skipped": True}
    names = ("file", "time_s", "status", "seen", "mode", "reason", "guidance", "protection")
    row = {key: record.get(key) for key in names}
    for group, keys in (("truth", ("truth",)), ("errors", ("errors", "guidance"))):
        values = lookup(record, keys)
        row[group] = values and {name: values.get(name) for name in GUIDANCE}
    row["track"] = lookup(record, ("track", "state"))
    row["flags"] = [flag["reason"] for flag in record.get("flags") or ()]
    for side in SIDES:
        confidence = lookup(record, ("lines", side, "confidence")) or []
        inliers = lookup(record, ("lines", side, "pixel_line", "inliers"))
        row[side] = {
            "points": len(confidence),
            "used": None if inliers is None else sum(inliers),
            "confidence": float(np.mean(confidence)) if confidence else None,
        }
    return row | {"seconds": sum(record["seconds"].values()) if record.get("seconds") else None}


def _bars(seen: list[Record], counts: Mapping[str, int]) -> list[tuple[str, list[tuple[str, str, int]]]]:
    """Title of each bar and its parts: name, meaning, frames."""
    worth = [(name, "", counts.get(name, 0)) for name in STATUS_WORDS]
    modes = [(name, words, sum(record["mode"] == name for record in seen)) for name, words in MODES.items()]
    return [("What guidance is worth", worth), ("Where distances came from", modes)]


def _cards(
    info: Mapping[str, str], seen: list[Record], counts: Mapping[str, int], dehazing: Sequence[Record]
) -> Iterator[tuple[str, str, str]]:
    """What a figure is, the figure, and what else to know."""
    total, skipped = sum(counts.values()), counts.get("skipped", 0)
    detail = [info["frames"]] if "frames" in info else []
    yield "Frames", f"{total:,}", "; ".join([*detail, f"{skipped:,} skipped" if skipped else "none skipped"])
    rate = figures.found_rate(seen)
    if rate is not None:
        yield "Both lines found", percent(rate), "of the frames that truly show a runway"
    elif total > skipped:
        both = sum(record["seen"] == LineVisibility.BOTH for record in seen)
        yield "Both lines found", percent(both / len(seen)), "of the frames used"
    errors = {name: (median, p95) for name, _, median, p95, *_ in figures.error_rows(seen)}
    labels = (
        (GUIDANCE["lateral_deviation_m"], "Lateral error"),
        (GUIDANCE["lateral_deviation_widths"], "Lateral error"),
        ("Centre line, direction", "Direction error"),
    )
    for name, label in labels:
        if name in errors:
            yield f"{label}, median", errors[name][0], f"95 %: {errors[name][1]}"
    for name, unit in (("lateral_deviation_m", "m"), ("lateral_deviation_widths", "widths")):
        sigma = figures.median_sigma(seen, name)
        if not errors and sigma is not None:
            yield "Lateral deviation, 1 sigma", number(sigma, unit), "median; no truth to compare with"
    visibility = figures.median_visibility([*dehazing] or seen)
    if visibility is not None:
        yield "Visibility", *visibility
    yield from _track_cards(seen)
    wrong, empty = figures.false_lines(seen)
    if empty:
        yield "False lines", f"{wrong}", f"in {empty} frames without a runway"
    times = figures.stage_seconds(seen)
    if times:
        parts = ", ".join(f"{stage} {1000 * t:.{0 if t > 0.001 else 1}f}" for stage, t in times.items())
        yield "Time per frame", f"{1000 * sum(times.values()):.0f} ms", parts


def _track_cards(seen: list[Record]) -> Iterator[tuple[str, str, str]]:
    """How much of the run was guided by a track, and what was flagged."""
    tracks = [record["track"] for record in seen if record.get("track")]
    if tracks:
        states = Counter(track["state"] for track in tracks)
        lost = ", ".join(f"{states[name]} {name}" for name in ("coasting", "lost") if states[name]) or "without a break"
        yield "Tracked", percent((states["tracking"] + states["coasting"]) / len(tracks)), lost
    flagged = sum(bool(record.get("flags")) for record in seen)
    if tracks or flagged:
        missed = figures.beyond_protection(seen)
        words = "" if missed is None else f"{missed[0]} of {missed[1]} beyond their protection level without a flag"
        yield "Flagged frames", f"{flagged}", words


def _plots_note(seen: list[Record], counts: Mapping[str, int]) -> str:
    notes = []
    used = sum(counts.values()) - counts.get("skipped", 0)
    if len(seen) < used:
        notes.append(f"Plots, pictures and figures are made of {len(seen)} of {used} frames, evenly chosen.")
    if not any(lookup(record, ("guidance", name)) for record in seen for name in GUIDANCE):
        reasons = figures.count_reasons(seen)
        why = f" Most often: {reasons[0][0]}." if reasons else ""
        notes.append(f"No frame could be placed relative to the deck, so there are no deviations to plot.{why}")
    return " ".join(notes)
