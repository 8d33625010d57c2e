"""Tables of detection figures, on the screen and as Markdown."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from deckline.atomic import write_atomic
from deckline.evaluation.commands import heading, write_json
from deckline.evaluation.detection_measure import DetectionScore
from deckline.evaluation.detection_summary import Figures, Reliability, groups, reliability, summarise_detection

COLUMNS = {  # heading: figure, factor, digits after the point
    "found %": ("found_rate", 100.0, 1),
    "in 3 px %": ("placed_rate", 100.0, 1),
    "px": ("error_px.median", 1.0, 2),
    "95 % px": ("error_px.p95", 1.0, 2),
    "acc %": ("tusimple.accuracy", 100.0, 1),
    "FP %": ("tusimple.false_positive", 100.0, 1),
    "FN %": ("tusimple.false_negative", 100.0, 1),
    "F1 %": ("culane.f1", 100.0, 1),
    "ECE %": ("expected_calibration_error", 100.0, 1),
    "false %": ("false_rate", 100.0, 1),
}
NOTES = """\
decks: frames with both lines in view, 10 % of each, whose light comes through the air to 2 % or more (bands: of the
ramp's); empty: without anything of a runway in the image; the others are not rated. contrast: what sets the lines
apart from the deck in the picture; below one grey level it takes a clean camera to see them. found: points on both
lines; in 3 px: and half of each line's points or more within 3 px of 1280. px: error of all points of decks, normal to
the line, median and 95th percentile. acc, FP, FN: TuSimple's, on 56 rows that the lines have, 20 px of 1280. F1:
CULane's, lines drawn 30 px of 1640 wide, IoU over 0.5. ECE: expected calibration error of the points' confidence.
false: empty frames with any point."""
NONE = "-"


@dataclass(frozen=True)
class TableText:
    """A table as text."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def rich(self) -> Table:
        table = Table(title=self.title, title_justify="left")
        table.add_column(self.columns[0], no_wrap=True)
        for column in self.columns[1:]:
            table.add_column(column, justify="right")
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> str:
        rule = tuple("---" if k == 0 else "---:" for k in range(len(self.columns)))
        lines = (f"| {' | '.join(row)} |" for row in (self.columns, rule, *self.rows))
        return f"**{self.title}**\n\n" + "\n".join(lines) + "\n"


def report(
    title: str,
    tables: Sequence[TableText],
    notes: Sequence[str],
    figures: Mapping[str, float],
    json_file: Path | None,
    markdown_file: Path | None,
) -> None:
    """Print tables under a title, notes below them; write them and the figures where files are asked for."""
    console = heading(title)
    for table in tables:
        console.print(table.rich())
    for text in notes:
        console.print(text, highlight=False, markup=False)
    if markdown_file is not None:
        parts = [title, "", *(table.markdown() for table in tables), *notes, ""]
        write_atomic(markdown_file, "\n".join(parts).encode())
        print(markdown_file)
    if json_file is not None:
        write_json(json_file, dict(figures))
        print(json_file)


def detection_tables(scores: Sequence[DetectionScore]) -> list[TableText]:
    """All frames, then by range, visibility, light, contrast and ship, then how far confidence can be trusted."""
    by_group = groups(scores)
    return [
        _figures_table("all frames", {"all": list(scores)}),
        *(_figures_table(f"by {what}", members) for what, members in by_group.items() if members),
        _reliability_table(reliability(scores)),
    ]


def _figures_table(title: str, named: dict[str, list[DetectionScore]]) -> TableText:
    rows = []
    for name, members in named.items():
        figures = summarise_detection(members)
        counts = (f"{figures['frames']:.0f}", f"{figures['decks']:.0f}", f"{figures['empty']:.0f}")
        rows.append((name, *counts, *(cell(figures, column) for column in COLUMNS)))
    columns = ("", "frames", "decks", "empty", *COLUMNS)
    told = [k for k in range(len(columns)) if any(row[k] != NONE for row in rows)]
    return TableText(title, tuple(columns[k] for k in told), tuple(tuple(row[k] for k in told) for row in rows))


def cell(figures: Figures, column: str) -> str:
    """One figure under its column's heading."""
    name, factor, digits = COLUMNS[column]
    value = figures.get(name, math.nan)
    return f"{factor * value:.{digits}f}" if math.isfinite(value) else NONE


def _reliability_table(found: Reliability) -> TableText:
    rows = tuple(
        (f"{b.low:.1f} to {b.high:.1f}", str(b.points), f"{100 * b.confidence:.1f}", f"{100 * b.right:.1f}")
        for b in found.bins
        if b.points
    )
    error = 100 * found.expected_calibration_error
    title = f"points by confidence; expected calibration error {error:.1f} %" if rows else "no points"
    return TableText(title, ("confidence", "points", "mean, %", "within 3 px, %"), rows)


def flat_figures(scores: Sequence[DetectionScore]) -> Figures:
    """Every number of the tables under dotted names."""
    figures = dict(summarise_detection(scores))
    for what, named in groups(scores).items():
        for name, members in named.items():
            figures |= {f"{what}.{name}.{key}": value for key, value in summarise_detection(members).items()}
    for b in reliability(scores).bins:
        values = {"points": float(b.points), "confidence": b.confidence, "right": b.right}
        figures |= {f"reliability.{b.low:.1f}-{b.high:.1f}.{key}": value for key, value in values.items()}
    return figures
