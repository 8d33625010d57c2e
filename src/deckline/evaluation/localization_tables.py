"""The tables of `deckline eval localization`."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from deckline.evaluation.localization_measure import Figures, Score
from deckline.evaluation.localization_methods import Method
from deckline.evaluation.localization_summary import (
    MARKS,
    PILOT_COLUMNS,
    USABLE_DEG,
    USABLE_M,
    Honesty,
    LineRow,
    Mark,
    by_range,
    by_visibility,
    efficiency,
    honesty,
    improvement,
    line_row,
    measured,
    quantiles,
    run_mean,
    unit_measured,
    unit_row,
    unusable_improvement,
    usable_share,
)
from deckline.evaluation.tables import MISSING as NONE
from deckline.evaluation.tables import Table
from deckline.localize import localize
from deckline.types import SIDES

Scores = Mapping[str, Sequence[Score]]  # method -> its frames
LINE_CELLS = {  # heading: figure, digits after the point
    "slope": ("slope", 5),
    "intercept, m": ("intercept_m", 3),
    "height, m": ("height_m", 3),
    "slope off": ("slope_error", 5),
    "intercept off, m": ("intercept_error_m", 3),
    "height off, m": ("height_error_m", 3),
    "direction off, deg": ("direction_error_deg", 4),
}
IMPROVED = {"direction": "direction_error_deg", "intercept": "intercept_error_m"}
PILOT_CELLS = {"lateral": ("lateral_m", "m"), "height": ("height_m", "m"), "heading": ("heading_deg", "deg")}
UNIT = "unit alone"
SEED = 0  # of the intervals' resampling
NOTES = """\
Table 6: a line is y = slope x + intercept at world z = height (down); the first three columns are means of the
estimates, "off" are means of the sizes of the errors; all are means over approaches of each approach's mean over its
frames. found: frames with this line; the others are in no mean. Improvement: 1 - error / error of the first row, of the
mean sizes of direction or intercept errors, left and right added for "both". Usable: of all frames, those without a
line counted as of no use; it is no figure of the paper's. Unit alone: lines seen exactly, placed by the navigation
unit's own wrong position and heading, in every frame. Pilot: errors of the centre line as seen
from the aircraft, 70 m past the ramp; what the navigation unit is wrong by about its own position and heading is taken
out, as a landing follows the picture. A star: as asked for. Honesty: mean of the squared error over its covariance of
offset, azimuth and height, with its 95 % interval over approaches; 3 is expected, and 95 % inside. Efficiency: the
Cramer-Rao bound's variance for the detected points and their stated noise, over the mean squared error."""


def localization_tables(scores: Scores, methods: Sequence[Method]) -> list[Table]:
    """Every table, of the methods in their order."""
    rows = {m.name: {side: line_row(scores[m.name], side) for side in SIDES} for m in methods}
    tracked = [m.name for m in methods if m.tracked]
    tables = [
        table_6(scores, rows),
        improvements(scores, rows),
        usable_table(scores),
        _pilot_table("pilot, all frames", scores),
    ]
    for name in tracked:
        bands = (("range to the ramp", by_range), ("visibility", by_visibility))
        tables += [_pilot_table(f"pilot, {name}, by {what}", of(scores[name])) for what, of in bands]
    tables += [marks_table(scores), honesty_table(scores)]
    joint = next((m.name for m in methods if m.localizer is localize and not m.tracked), None)
    if joint is not None:
        tables.append(efficiency_table(joint, scores[joint]))
    return tables + ([protection_table(scores, tracked)] if tracked else [])


def table_6(scores: Scores, rows: Mapping[str, Mapping[str, LineRow]]) -> Table:
    """The paper's columns, left and right."""
    first = next(iter(scores.values()))
    cells = []
    for side in SIDES:
        true = {name: run_mean(first, f"true_{name}.{side}") for name, _ in LINE_CELLS.values()}
        cells.append(("true", side, NONE, *(_number(true[name], digits) for name, digits in LINE_CELLS.values())))
    for name, sides in rows.items():
        for side, row in sides.items():
            means = (_number(row.means.get(figure), digits) for figure, digits in LINE_CELLS.values())
            cells.append((name, side, f"{100 * row.found:.1f}", *means))
    return Table("Table 6", ("method", "line", "found %", *LINE_CELLS), tuple(cells))


def improvements(scores: Scores, rows: Mapping[str, Mapping[str, LineRow]]) -> Table:
    """Improvement of every row over the first, and of lines seen exactly: no row can do better in the world."""
    reference, every = next(iter(rows)), next(iter(scores.values()))
    rows = {**rows, UNIT: {side: unit_row(every, side) for side in SIDES}}
    columns = [(what, group) for what in IMPROVED for group in (("left",), ("right",), SIDES)]
    cells = []
    for name, sides in rows.items():
        values = (
            improvement([sides[s] for s in group], [rows[reference][s] for s in group], IMPROVED[what])
            for what, group in columns
        )
        cells.append((name, *(_number(100 * value, 1) for value in values)))
    headings = (f"{what} {'both' if group == SIDES else group[0]}" for what, group in columns)
    return Table(f"improvement over {reference}, %", ("method", *headings), tuple(cells))


def usable_table(scores: Scores) -> Table:
    """Share of frames that are of use, those without a line counted as what they are."""
    reference = next(iter(scores))
    cells = []
    for name, members in scores.items():
        less = unusable_improvement(members, scores[reference])
        cells.append((name, str(len(members)), _number(100 * usable_share(members), 1), _number(100 * less, 1)))
    title = f"both lines within {USABLE_DEG:g} deg and {USABLE_M:g} m at the ramp, in the world"
    return Table(title, ("method", "frames", "usable %", f"fewer not usable than {reference}, %"), tuple(cells))


def _pilot_table(title: str, groups: Mapping[str, Sequence[Score]]) -> Table:
    cells = []
    for name, members in groups.items():
        given = sum("centre.lateral_m" in score.figures for score in members) / len(members)
        fine = sum(score.mode == "fine" for score in members) / len(members)
        row = [name, str(len(members)), f"{100 * given:.1f}", f"{100 * fine:.0f}"]
        for figure, _ in PILOT_CELLS.values():
            found = quantiles(members, (f"centre.{figure}",))
            row += [_number(found.p50, 3), _number(found.p95, 3)]
        cells.append(tuple(row))
    headings = (f"{what} {q}, {unit}" for what, (_, unit) in PILOT_CELLS.items() for q in ("50 %", "95 %"))
    return Table(title, ("", "frames", "given %", "fine %", *headings), tuple(cells))


def marks_table(scores: Scores) -> Table:
    """What is asked for, what the navigation unit alone would give and what each method does; a star where reached."""
    cells, every = [], next(iter(scores.values()))
    for mark in MARKS:
        low, high = mark.band_m
        asked = (mark.name, f"{low:g}-{high:g} m", f"{mark.limit:.3g} {mark.unit}", mark.source)
        found = (unit_measured(every, mark), *(measured(members, mark) for members in scores.values()))
        cells.append((*asked, *(_against(mark, value) for value in found)))
    return Table("accuracy asked for", ("error", "range", "limit", "from", UNIT, *scores), tuple(cells))


def _against(mark: Mark, value: float) -> str:
    return NONE if math.isnan(value) else f"{value:.3f}{' *' if value <= mark.limit else ''}"


def honesty_table(scores: Scores) -> Table:
    """Squared errors over their covariance, those of the centre line also by where the distances came from."""
    rng = np.random.default_rng(SEED)
    centre = "centre, from the aircraft"
    names = {side: f"normalised.{side}" for side in SIDES} | {centre: "centre.normalised"}
    cells = []
    for method, members in scores.items():
        groups = {line: (figure, members) for line, figure in names.items()}
        for mode in ("fine", "coarse"):
            groups[f"{centre}, {mode}"] = names[centre], [score for score in members if score.mode == mode]
        for line, (figure, inside) in groups.items():
            found = honesty(inside, figure, rng)
            if found.frames:
                cells.append((method, line, str(found.frames), *_honest_cells(found)))
    return Table("honesty", ("method", "line", "frames", "mean, 3 is honest", "in 95 %, %"), tuple(cells))


def _honest_cells(found: Honesty) -> tuple[str, str]:
    interval = "" if math.isnan(found.low) else f" [{found.low:.2f}, {found.high:.2f}]"
    return f"{found.mean:.2f}{interval}", f"{100 * found.inside:.1f}"


def efficiency_table(method: str, scores: Sequence[Score]) -> Table:
    """Bound over mean squared error of the centre line, by range."""
    cells = []
    for band, members in by_range(scores).items():
        found = [efficiency(members, f"centre.{name}", f"bound.{name}") for name in PILOT_COLUMNS]
        cells.append((band, str(max(frames for _, frames in found)), *(_number(value, 2) for value, _ in found)))
    return Table(f"efficiency, {method}", ("range to the ramp", "frames", *PILOT_CELLS), tuple(cells))


def protection_table(scores: Scores, tracked: Sequence[str]) -> Table:
    """What the tracker promised, and whether it kept it."""
    cells = []
    for name in tracked:
        members = scores[name]
        promised = [s for s in members if "protection.lateral_m" in s.figures and "centre.lateral_m" in s.figures]
        beyond = [s for s in promised if misleading(s.figures)]
        medians = (_median(promised, f"protection.{what}_m") for what in ("lateral", "height"))
        flagged = sum(s.figures.get("flagged", 0.0) > 0 for s in members)
        counts = (str(len(members)), str(len(promised)), str(flagged), str(len(beyond)))
        cells.append((name, *counts, *(_number(value, 2) for value in medians)))
    columns = ("method", "frames", "protected", "flagged", "misleading", "lateral level, m", "height level, m")
    return Table("protection", columns, tuple(cells))


def misleading(figures: Figures) -> bool:
    """An error beyond its protection level, and no flag."""
    pairs = {"centre.deviation_m": "protection.lateral_m", "centre.height_m": "protection.height_m"}
    known = {error: level for error, level in pairs.items() if {error, level} <= figures.keys()}
    return not figures.get("flagged") and any(abs(figures[error]) > figures[level] for error, level in known.items())


def flat_figures(scores: Scores) -> Figures:
    """The numbers of the tables under dotted names: method, then figure."""
    rng = np.random.default_rng(SEED)
    figures: Figures = {}
    rows = {name: [line_row(members, side) for side in SIDES] for name, members in scores.items()}
    reference, first = next(iter(rows.values())), next(iter(scores.values()))
    for name, members in scores.items():
        for side, row in zip(SIDES, rows[name], strict=True):
            figures |= {f"{name}.{figure}.{side}": value for figure, value in row.means.items()}
            figures[f"{name}.found.{side}"] = row.found
        for what, figure in IMPROVED.items():
            figures[f"{name}.improvement.{what}"] = improvement(rows[name], reference, figure)
        figures[f"{name}.usable"] = usable_share(members)
        figures[f"{name}.improvement.not_usable"] = unusable_improvement(members, first)
        figures |= _pilot_figures(f"{name}.pilot", members)
        for band, inside in (by_range(members) | by_visibility(members)).items():
            figures |= _pilot_figures(f"{name}.pilot.{band}", inside)
        found = honesty(members, "centre.normalised", rng)
        figures |= {f"{name}.honesty.mean": found.mean, f"{name}.honesty.inside": found.inside}
    return figures


def _pilot_figures(prefix: str, scores: Sequence[Score]) -> Figures:
    found = {name: quantiles(scores, (f"centre.{name}",)) for name in PILOT_COLUMNS}
    medians = {f"{prefix}.{name}.median": each.p50 for name, each in found.items()}
    return medians | {f"{prefix}.{name}.p95": each.p95 for name, each in found.items()}


def _median(scores: Sequence[Score], name: str) -> float | None:
    values = [score.figures[name] for score in scores if name in score.figures]
    return float(np.median(values)) if values else None


def _number(value: float | None, digits: int) -> str:
    return NONE if value is None or not math.isfinite(value) else f"{value:.{digits}f}"
