"""The tables and the JSON of `deckline eval dehazing`."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from deckline.dehaze import NOT_DEHAZED
from deckline_lab.evaluation.dehazers import Cost
from deckline_lab.evaluation.dehazing_score import ALL, DehazingSummary, Summaries, worse_lines
from deckline_lab.evaluation.no_reference import no_reference_table
from deckline_lab.evaluation.tables import MISSING, Figures, Table, number
from deckline_lab.evaluation.visible_distance import visible_tables
from deckline_lab.statistics import Difference

INTERVALS = (
    "[low, high]: 95 % paired bootstrap interval over images, taken as independent; frames of one flight are not, "
    "theirs is too narrow."
)
MEANING = (
    "PSNR and SSIM are means over images, an untouched image counting 60 dB; below the horizon: sea and ship alone, "
    "as haze hides the sky's true colours."
)
SEEN = (
    "Lines seen to: the farthest range at which a true line has 5 % contrast, 0 where it has less; a mean over images."
)
FILM = "Rain or drops on the lens, or an exposure that takes time: the clear picture is without them as without haze."
LINES = (
    f"Differences to {NOT_DEHAZED}. Asked: images with both lines in view. Found: both lines, in agreement. Points: "
    "normal distance of all detected points to the true lines; its difference: median over the images with points both "
    "ways."
)
FALSE = (
    "False edges: pixels on steps of 5 % or more of which the clear picture has less than half within 2 px; mean over "
    "images."
)
LEVELS = {
    "psnr_db": "PSNR, dB",
    "psnr_db_surface": "below horizon, dB",
    "visible_range_m": "lines seen to, m",
    "false_edges_per_mille": "false edges, per mille",
}
MIB, MS = 2.0**20, 1e3


@dataclass(frozen=True)
class DehazingResults:
    """All that was measured."""

    title: str
    reference: str
    summaries: Summaries
    film: Summaries  # one of FILMS -> dehazer; {} without rain and motion blur
    sizes: Mapping[str, tuple[int, int] | None]  # dehazer -> parameters, MACs at 256x256
    costs: Mapping[str, Cost]
    cost_size_px: tuple[int, int]
    failed: Mapping[str, str]  # dehazer -> why its cost could not be measured
    skipped: tuple[tuple[str, str], ...]  # image, reason
    visible: Mapping[str, Figures]  # dehazer -> where the lines are first held; empty without a detector

    @property
    def levels(self) -> dict[str, str]:
        """Figures with a unit that some image has -> how their column is called."""
        known = {name for summary in self.summaries[ALL].values() for name in summary.means}
        return {name: heading for name, heading in LEVELS.items() if name in known}


def dehazing_tables(results: DehazingResults) -> list[Table]:
    """Restoration with its cost, by visibility and by rain and motion blur, the lines where they were asked for, and
    the figures without a clear picture.
    """
    tables = [_restoration(results)]
    bands = {band: members for band, members in results.summaries.items() if band != ALL}
    if bands and results.levels:
        tables.append(_grouped(results, "visibility", bands))
    if results.film:
        tables.append(_grouped(results, "rain and motion blur", results.film, (FILM,)))
    if any(summary.asked for summary in results.summaries[ALL].values()):
        tables.append(_lines(results))
    tables += visible_tables((((name,), figures) for name, figures in results.visible.items()), ("dehazer",))
    no_reference = {name: summary.no_reference for name, summary in results.summaries[ALL].items()}
    return [*tables, no_reference_table(no_reference)]


def _restoration(results: DehazingResults) -> Table:
    columns = ["dehazer", "images", *_level_columns(results), "left as is", "parameters", "MACs 256x256"]
    notes = [MEANING, INTERVALS] if results.levels else []
    notes += [SEEN] if "visible_range_m" in results.levels else []
    notes += [FALSE] if "false_edges_per_mille" in results.levels else []
    if results.costs:
        width, height = results.cost_size_px
        columns += [f"ms at {width}x{height}", "peak MiB"]
        ratio = f"; in brackets the ratio to {results.reference}" if results.reference != NOT_DEHAZED else ""
        notes.append(
            f"Milliseconds and memory beyond the loaded model: medians, each run in a process of its own{ratio}."
        )
    rows = []
    for name, summary in results.summaries[ALL].items():
        size = results.sizes.get(name)
        sizes = [MISSING, MISSING] if size is None else [f"{size[0] / 1e6:.3f} M", f"{size[1] / 1e9:.2f} G"]
        cost = _cost_cells(name, results) if results.costs else ()
        rows.append((name, *_level_cells(summary, results), *sizes, *cost))
    notes += [f"{name}: no cost: {reason}" for name, reason in results.failed.items()]
    return Table("Restoration", columns, rows, notes)


def _grouped(results: DehazingResults, by: str, groups: Summaries, notes: tuple[str, ...] = ()) -> Table:
    rows = [
        (group, name, *_level_cells(summary, results))
        for group, members in groups.items()
        for name, summary in members.items()
    ]
    columns = (by, "dehazer", "images", *_level_columns(results), "left as is")
    return Table(f"Restoration by {by}", columns, rows, notes)


def _lines(results: DehazingResults) -> Table:
    columns = ("visibility", "dehazer", "asked", "PSNR, dB", "found, %", "difference, points", "points, median px")
    rows = []
    for band, members in results.summaries.items():
        rows += [(band, name, *_line_cells(summary)) for name, summary in members.items() if summary.asked]
    worse = [f"{name} ({band})" for band, members in results.summaries.items() for name in worse_lines(members)]
    notes = [LINES, *([f"Higher PSNR, worse lines: {', '.join(worse)}."] if worse else [])]
    return Table("Lines by visibility", (*columns, "95 % px", "difference of medians, px"), rows, notes)


def _level_columns(results: DehazingResults) -> list[str]:
    pairs = ((heading, f"to {results.reference}, {heading.rpartition(' ')[2]}") for heading in results.levels.values())
    return [*(word for pair in pairs for word in pair), *(["SSIM"] if results.levels else [])]


def _level_cells(summary: DehazingSummary, results: DehazingResults) -> list[str]:
    cells = [str(summary.images)]
    for name in results.levels:
        cells += [number(summary.means.get(name), ".2f"), _difference(summary.differences.get(name), "+.2f")]
    cells += [number(summary.means.get("ssim"), ".4f")] if results.levels else []
    return [*cells, str(summary.left_alone)]


def _line_cells(summary: DehazingSummary) -> list[str]:
    lines, differences = summary.lines, summary.line_differences
    return [
        str(summary.asked),
        number(summary.means.get("psnr_db"), ".2f"),
        number(100 * lines["found_rate"], ".1f"),
        _difference(differences.get("found_rate"), "+.1f", 100),
        number(lines.get("point_error_px.median"), ".2f"),
        number(lines.get("point_error_px.p95"), ".1f"),
        _difference(differences.get("point_error_px"), "+.2f"),
    ]


def _cost_cells(name: str, results: DehazingResults) -> tuple[str, str]:
    """Time and memory, with the ratio to the reference unless that is doing nothing."""
    cost, reference = results.costs.get(name), results.costs.get(results.reference)
    if cost is None:
        return MISSING, MISSING
    seconds, peak = f"{MS * cost.seconds:.1f}", number(cost.peak_bytes and cost.peak_bytes / MIB, ".0f")
    if reference is None or results.reference == NOT_DEHAZED:
        return seconds, peak
    if cost.peak_bytes is not None and reference.peak_bytes:
        peak += f" ({cost.peak_bytes / reference.peak_bytes:.2f})"
    return f"{seconds} ({cost.seconds / reference.seconds:.2f})", peak


def _difference(difference: Difference | None, form: str, scale: float = 1.0) -> str:
    return MISSING if difference is None or math.isnan(difference.value) else difference.text(form, scale)


def json_of(results: DehazingResults) -> dict[str, Any]:
    """The numbers of the tables."""
    visibility, film = (
        {group: {name: asdict(one) for name, one in members.items()} for group, members in groups.items()}
        for groups in (results.summaries, results.film)
    )
    return {
        "title": results.title,
        "reference": results.reference,
        "visibility": visibility,
        "film": film,
        "visible_distance": results.visible,
        "higher_psnr_worse_lines": {band: worse_lines(members) for band, members in results.summaries.items()},
        "size": {
            name: None if size is None else {"parameters": size[0], "macs_256": size[1]}
            for name, size in results.sizes.items()
        },
        "cost": {name: asdict(cost) for name, cost in results.costs.items()},
        "cost_size_px": results.cost_size_px,
        "no_cost": results.failed,
        "skipped": results.skipped,
    }
