"""The tables of `deckline eval dehazing`: on the screen, as Markdown, and their numbers as JSON."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from deckline.dehaze import NOT_DEHAZED
from deckline.evaluation.dehazing_cost import Cost
from deckline.evaluation.dehazing_measure import ALL, Summary, worse_lines
from deckline.evaluation.statistics import Difference

INTERVALS = (
    "[low, high]: 95 % paired bootstrap interval over images, taken as independent; frames of one flight are not, "
    "theirs is too narrow."
)
MEANING = (
    "PSNR and SSIM are means over images, an untouched image counting 60 dB; below the horizon: sea and ship alone, "
    "as haze hides the sky's true colours."
)
FILM = "Rain or drops on the lens, or an exposure that takes time: the clear picture is without them as without haze."
LINES = (
    f"Differences to {NOT_DEHAZED}. Asked: images with both lines in view. Found: both lines, in agreement. Points: "
    "normal distance of all detected points to the true lines; its difference: median over the images with points both "
    "ways."
)
MIB, MS = 2.0**20, 1e3

Summaries = Mapping[str, Mapping[str, Summary]]  # band -> dehazer


@dataclass(frozen=True)
class Results:
    """All that was measured."""

    title: str
    about: Mapping[str, str]  # machine, versions, date
    reference: str
    summaries: Summaries
    film: Summaries  # one of FILMS -> dehazer; {} without rain and motion blur
    sizes: Mapping[str, tuple[int, int] | None]  # dehazer -> parameters, MACs at 256x256
    costs: Mapping[str, Cost]
    cost_size_px: tuple[int, int]
    failed: Mapping[str, str]  # dehazer -> why its cost could not be measured
    skipped: tuple[tuple[str, str], ...]  # image, reason


@dataclass(frozen=True)
class Sheet:
    """One table of words."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    captions: tuple[str, ...]


def sheets_of(results: Results) -> list[Sheet]:
    """Restoration with its cost, by visibility and by rain and motion blur, and the lines where they were asked for."""
    sheets = [_restoration(results)]
    bands = {band: members for band, members in results.summaries.items() if band != ALL}
    if bands:
        sheets.append(_grouped(results, "visibility", bands))
    if results.film:
        sheets.append(_grouped(results, "rain and motion blur", results.film, (FILM,)))
    if any(summary.asked for summary in results.summaries[ALL].values()):
        sheets.append(_lines(results))
    return sheets


def _restoration(results: Results) -> Sheet:
    columns = [
        "dehazer",
        "images",
        *_restoration_columns(results),
        "left as is",
        "parameters",
        "MACs 256x256",
    ]
    if results.costs:
        width, height = results.cost_size_px
        columns += [f"ms at {width}x{height}", "peak MiB"]
    rows = []
    for name, summary in results.summaries[ALL].items():
        row = [name, str(summary.images), *_restoration_cells(summary, results), str(summary.left_alone)]
        row += _size_cells(results.sizes.get(name))
        rows.append((*row, *_cost_cells(name, results)) if results.costs else tuple(row))
    captions = [MEANING, INTERVALS]
    if results.costs:
        captions.append(
            "Milliseconds and memory beyond the loaded model: medians, each run in a process of its own"
            + (f"; in brackets the ratio to {results.reference}." if _has_ratio(results) else ".")
        )
    captions += [f"{name}: no cost: {reason}" for name, reason in results.failed.items()]
    return Sheet("Restoration", tuple(columns), tuple(rows), tuple(captions))


def _grouped(results: Results, by: str, groups: Summaries, captions: tuple[str, ...] = ()) -> Sheet:
    rows = [
        (group, name, str(summary.images), *_restoration_cells(summary, results), str(summary.left_alone))
        for group, members in groups.items()
        for name, summary in members.items()
    ]
    columns = (by, "dehazer", "images", *_restoration_columns(results), "left as is")
    return Sheet(f"Restoration by {by}", columns, tuple(rows), captions)


def _lines(results: Results) -> Sheet:
    columns = ("visibility", "dehazer", "asked", "PSNR, dB", "found, %", "difference, points", "points, median px")
    rows = []
    for band, members in results.summaries.items():
        for name, summary in members.items():
            if summary.asked:
                rows.append((band, name, str(summary.asked), *_line_cells(summary)))
    worse = [
        f"{name} ({band})" for band, members in results.summaries.items() for name in worse_lines(members, NOT_DEHAZED)
    ]
    verdict = f"Higher PSNR, worse lines: {', '.join(worse)}." if worse else ""
    captions = tuple(filter(None, (LINES, verdict)))
    return Sheet("Lines by visibility", (*columns, "95 % px", "difference of medians, px"), tuple(rows), captions)


def _levels(results: Results) -> dict[str, str]:
    """Figures in dB that some image has -> how their column is called."""
    names = {"psnr_db": "PSNR, dB", "psnr_db_surface": "below horizon, dB"}
    there = {name for summary in results.summaries[ALL].values() for name in summary.means}
    return {name: title for name, title in names.items() if name in there}


def _restoration_columns(results: Results) -> list[str]:
    return [*(word for title in _levels(results).values() for word in (title, f"to {results.reference}, dB")), "SSIM"]


def _restoration_cells(summary: Summary, results: Results) -> list[str]:
    cells = []
    for name in _levels(results):
        cells += [_number(summary.means.get(name), ".2f"), _difference(summary.differences.get(name), "+.2f")]
    return [*cells, _number(summary.means.get("ssim"), ".4f")]


def _line_cells(summary: Summary) -> list[str]:
    found, lines, differences = summary.lines["found_rate"], summary.lines, summary.line_differences
    return [
        _number(summary.means["psnr_db"], ".2f"),
        _number(100 * found, ".1f"),
        _difference(differences.get("found_rate"), "+.1f", 100),
        _number(lines.get("point_error_px.median"), ".2f"),
        _number(lines.get("point_error_px.p95"), ".1f"),
        _difference(differences.get("point_error_px"), "+.2f"),
    ]


def _size_cells(size: tuple[int, int] | None) -> list[str]:
    return ["-", "-"] if size is None else [f"{size[0] / 1e6:.3f} M", f"{size[1] / 1e9:.2f} G"]


def _cost_cells(name: str, results: Results) -> tuple[str, str]:
    cost, reference = results.costs.get(name), results.costs.get(results.reference)
    if cost is None:
        return "-", "-"
    with_ratio = reference is not None and _has_ratio(results)
    ms = f"{MS * cost.seconds:.1f}"
    peak = _number(None if cost.peak_bytes is None else cost.peak_bytes / MIB, ".0f")
    if reference is None or not with_ratio:
        return ms, peak
    if cost.peak_bytes is not None and reference.peak_bytes:
        peak += f" ({cost.peak_bytes / reference.peak_bytes:.2f})"
    return f"{ms} ({cost.seconds / reference.seconds:.2f})", peak


def _has_ratio(results: Results) -> bool:
    """Nothing is compared with the cost of doing nothing."""
    return results.reference != NOT_DEHAZED


def _number(value: float | None, form: str) -> str:
    return "-" if value is None or math.isnan(value) else format(value, form)


def _difference(difference: Difference | None, form: str, scale: float = 1.0) -> str:
    if difference is None:
        return "-"
    value, low, high = (scale * number for number in (difference.value, difference.low, difference.high))
    return format(value, form) if math.isnan(low) else f"{value:{form}} [{low:{form}}, {high:{form}}]"


def heading_of(results: Results) -> list[str]:
    """What was measured, on what, when; and how many frames could not be."""
    lines = [results.title, ", ".join(results.about.values())]
    if results.skipped:
        image, reason = results.skipped[0]
        lines.append(f"skipped {len(results.skipped)}; the first: {image}: {reason}")
    return lines


def print_results(console: Console, results: Results) -> None:
    """Heading and tables for people."""
    for line in heading_of(results):
        console.print(line, highlight=False, markup=False)
    for sheet in sheets_of(results):
        table = Table(*map(escape, sheet.columns), title=sheet.title, title_justify="left", title_style="bold")
        previous = None
        for row in sheet.rows:
            if previous is not None and row[0] != previous and sheet.columns[0] != "dehazer":
                table.add_section()
            table.add_row(*map(escape, row))
            previous = row[0]
        console.print(table)
        for caption in sheet.captions:
            console.print(caption, highlight=False, markup=False)


def markdown_of(results: Results) -> str:
    """The same, to be pasted into a document."""
    parts = ["\n".join(heading_of(results))]
    for sheet in sheets_of(results):
        rows = (sheet.columns, ("---",) * len(sheet.columns), *sheet.rows)
        parts += [f"**{sheet.title}**", "\n".join(f"| {' | '.join(row)} |" for row in rows), *sheet.captions]
    return "\n\n".join(parts) + "\n"


def json_of(results: Results) -> dict[str, Any]:
    """The same numbers as plain JSON values; null for what does not exist."""
    worse = {band: worse_lines(members, NOT_DEHAZED) for band, members in results.summaries.items()}
    return _plain(
        {
            "title": results.title,
            "about": dict(results.about),
            "reference": results.reference,
            "visibility": _numbers(results.summaries),
            "film": _numbers(results.film),
            "higher_psnr_worse_lines": worse,
            "size": {
                name: None if size is None else {"parameters": size[0], "macs_256": size[1]}
                for name, size in results.sizes.items()
            },
            "cost": {name: asdict(cost) for name, cost in results.costs.items()},
            "cost_size_px": list(results.cost_size_px),
            "no_cost": dict(results.failed),
            "skipped": [list(item) for item in results.skipped],
        }
    )


def _numbers(groups: Summaries) -> dict[str, Any]:
    return {group: {name: asdict(one) for name, one in members.items()} for group, members in groups.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
