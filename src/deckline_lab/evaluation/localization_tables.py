"""The tables of `deckline eval localization`: Table 6, a pilot's errors, consistency, efficiency, protection."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from deckline.localize import localize
from deckline.report.bands import by_band, share
from deckline.types import SIDES
from deckline_lab.evaluation.localization_methods import DEHAZED, HAZY, PAPERS, Method
from deckline_lab.evaluation.localization_requirements import UNIT, Scores, accuracy_table, sizes
from deckline_lab.evaluation.localization_score import LocalizationScore
from deckline_lab.evaluation.pilot_errors import STATES
from deckline_lab.evaluation.tables import MISSING, Figures, Table, number
from deckline_lab.evaluation.visible_distance import ApproachFrame, visible_distance, visible_tables
from deckline_lab.statistics import APPROACH_RANGE_M, VISIBILITY_M, consistency, paired_difference, percentile

LINE_CELLS = {  # heading: figure, format
    "slope": ("slope", ".5f"),
    "intercept, m": ("intercept_m", ".3f"),
    "height, m": ("height_m", ".3f"),
    "slope off": ("slope_error", ".5f"),
    "intercept off, m": ("intercept_error_m", ".3f"),
    "height off, m": ("height_error_m", ".3f"),
    "direction off, deg": ("direction_error_deg", ".4f"),
}
LINE_FIGURES = (*(name for name, _ in LINE_CELLS.values()), "lateral_error_m")
IMPROVED = {"direction": "direction_error_deg", "intercept": "intercept_error_m"}
GAINED = {"direction_error_deg": ".4f", "intercept_error_m": ".3f"}  # formats of what dehazing changes
PILOT_CELLS = {"lateral": ("lateral_m", "m"), "height": ("height_m", "m"), "heading": ("heading_deg", "deg")}
USABLE = {"direction_error_deg": 0.3, "lateral_error_m": 1.0}  # our marks of the near and of the far range
SEED = 0  # of the intervals' resampling
PAIRED = "on the same frames as"  # how a title begins
USABLE_TITLE = "both lines within {:g} deg and {:g} m at the ramp, in the world".format(*USABLE.values())
LINES_NOTE = """\
A line is y = slope x + intercept at world z = height (down); the first three columns are means of the estimates, "off"
are means of the sizes of the errors; all are means over approaches of each approach's mean over its frames. found:
frames with this line after deckline's checks of the lines; the others are in no mean. Exact pose: the navigation unit's
error taken away, in that row alone."""
IMPROVEMENT_NOTE = """\
1 - error / error of the first row, of the mean sizes of direction or intercept errors, left and right added for "both".
Each mean is over the frames that its row finds, so that rows compare different frames. Unit alone: lines seen exactly,
placed by the navigation unit's own wrong position and heading, in every frame: the floor of all rows, up to the frames
that a row finds."""
GAINS_NOTE = "Degrees and metres, left and right averaged, of frames in which both rows have both lines."
PAIRED_NOTE = "Each detector and the first one in the hazy picture, of frames in which both have both lines."
USABLE_NOTE = "Of all frames, those without a line counted as of no use; it is no figure of the paper's."
PILOT_NOTE = """\
Errors of the centre line as seen from the aircraft, at the touchdown point; what the navigation unit is wrong by about
its own position and heading is taken out, as a landing follows the picture."""
CONSISTENCY_NOTE = """\
Mean of the squared error over its covariance of offset, azimuth and height, with its 95 % interval over approaches; 3
is expected, and 95 % inside."""
EFFICIENCY_NOTE = """\
The Cramer-Rao bound's variance for the detected points and their stated noise, over the mean squared error."""


def localization_tables(scores: Scores, methods: Sequence[Method]) -> list[Table]:
    """Every table, of the methods in their order."""
    tracked = [method.name for method in methods if method.tracked]
    paired = [table for table in (dehazing_gains(scores), detector_gains(scores)) if table.rows]
    tables = [table_6(scores), improvements(scores), *paired]
    tables += visible_tables((((name,), visible_figures(members)) for name, members in scores.items()), ("method",))
    tables += [usable_table(scores), _pilot_table("pilot, all frames", scores, [PILOT_NOTE])]
    for name in tracked:
        for what, bands in {"range to the ramp": by_range, "visibility": by_visibility}.items():
            tables.append(_pilot_table(f"pilot, {name}, by {what}", bands(scores[name])))
    tables += [accuracy_table(scores), consistency_table(scores)]
    joint = [method.name for method in methods if method.localizer is localize and not method.tracked]
    tables += [efficiency_table(name, scores[name]) for name in joint[:1]]
    return tables + ([protection_table(scores, tracked)] if tracked else [])


def by_range(scores: Sequence[LocalizationScore]) -> dict[str, list[LocalizationScore]]:
    return by_band(scores, lambda score: score.range_m, APPROACH_RANGE_M)


def by_visibility(scores: Sequence[LocalizationScore]) -> dict[str, list[LocalizationScore]]:
    return by_band(scores, lambda score: score.visibility_m, VISIBILITY_M)


def by_approach(scores: Iterable[LocalizationScore], name: str) -> list[list[float]]:
    """The figure of each approach's frames, of approaches that have any."""
    runs: dict[int, list[float]] = {}
    for score in scores:
        if name in score.figures:
            runs.setdefault(score.approach, []).append(score.figures[name])
    return list(runs.values())


def run_mean(scores: Iterable[LocalizationScore], name: str) -> float:
    """Mean over approaches of each one's mean over the frames that have the figure; NaN where none has."""
    runs = by_approach(scores, name)
    return float(np.mean([np.mean(values) for values in runs])) if runs else float("nan")


def line_means(scores: Sequence[LocalizationScore], side: str, prefix: str = "") -> Figures:
    """LINE_FIGURES of one line of Table 6, with prefix `unit.` of the navigation unit alone, `true_` of the true line.

    What no frame has is left out.
    """
    means = {name: run_mean(scores, f"{prefix}{name}.{side}") for name in LINE_FIGURES}
    return {name: value for name, value in means.items() if np.isfinite(value)}


def found_share(scores: Sequence[LocalizationScore], side: str) -> float:
    return share(scores, lambda score: f"slope.{side}" in score.figures)


def table_6(scores: Scores) -> Table:
    """The paper's columns, left and right."""
    rows = []
    for side in SIDES:
        true = line_means(next(iter(scores.values())), side, "true_")
        rows.append(("true", side, MISSING, *(number(true.get(name), form) for name, form in LINE_CELLS.values())))
    for method, members in scores.items():
        for side in SIDES:
            means = line_means(members, side)
            cells = (number(means.get(name), form) for name, form in LINE_CELLS.values())
            rows.append((method, side, f"{100 * found_share(members, side):.1f}", *cells))
    return Table("Table 6", ("method", "line", "found %", *LINE_CELLS), rows, [LINES_NOTE])


def improvement(means: Sequence[Figures], reference: Sequence[Figures], name: str) -> float:
    """1 - error / reference's error of a figure, the errors of the given lines added up; NaN where one is missing.

    Frames in which a method gave no line are not in its mean, which favours the method that gives up more often.
    """
    ours, theirs = (sum(line.get(name, np.nan) for line in each) for each in (means, reference))
    return float(1.0 - ours / theirs) if theirs else float("nan")


def improvements(scores: Scores) -> Table:
    """Improvement of every row over the first, and of lines seen exactly: no row can do better in the world."""
    lines = {name: {side: line_means(members, side) for side in SIDES} for name, members in scores.items()}
    reference, every = next(iter(scores)), next(iter(scores.values()))
    lines[UNIT] = {side: line_means(every, side, "unit.") for side in SIDES}
    columns = [(what, group) for what in IMPROVED for group in (("left",), ("right",), SIDES)]
    rows = []
    for name, sides in lines.items():
        values = (
            improvement([sides[s] for s in group], [lines[reference][s] for s in group], IMPROVED[what])
            for what, group in columns
        )
        rows.append((name, *(number(100 * value, ".1f") for value in values)))
    headings = (f"{what} {'both' if group == SIDES else group[0]}" for what, group in columns)
    return Table(f"improvement over {reference}, %", ("method", *headings), rows, [IMPROVEMENT_NOTE])


def dehazing_gains(scores: Scores) -> Table:
    """What dehazing changes: rows that differ in nothing else, on the frames in which both have both lines."""
    rows = []
    for name, hazy in scores.items():
        dehazed = scores.get(name.replace(f", {HAZY}", f", {DEHAZED}"), ())
        if f", {HAZY}" in name and dehazed:
            found = (share(members, _has_both) for members in (hazy, dehazed))
            cells = (_gain_cells(hazy, dehazed, figure, form) for figure, form in GAINED.items())
            rows.append((name.replace(f", {HAZY}", ""), *(f"{100 * each:.1f}" for each in found), *sum(cells, ())))
    headings = (f"{what} {each}" for what in IMPROVED for each in ("hazy", "dehazed", "change [95 %]", "better, %"))
    columns = ("method", "both found %, hazy", "dehazed", *headings)
    return Table("what dehazing changes", columns, rows, [GAINS_NOTE])


def detector_gains(scores: Scores) -> Table:
    """What another detector changes in the hazy picture, on the frames in which it and the first have both lines."""
    reference, first = next(iter(scores.items()))
    chain = f", {HAZY}, {PAPERS}"
    rows = []
    for name, members in scores.items():
        if name != reference and name.endswith(chain) and reference.endswith(chain):
            cells = (_gain_cells(first, members, figure, form) for figure, form in GAINED.items())
            shared = np.mean([_has_both(a) and _has_both(b) for a, b in zip(first, members, strict=True)])
            rows.append((name, f"{100 * shared:.1f}", *sum(cells, ())))
    headings = (
        f"{what} {each}" for what in IMPROVED for each in ("of the first", "here", "change [95 %]", "better, %")
    )
    return Table(f"{PAIRED} {reference}", ("method", "frames %", *headings), rows, [PAIRED_NOTE])


def _has_both(score: LocalizationScore) -> bool:
    return all(f"slope.{side}" in score.figures for side in SIDES)


def _gain_cells(
    one: Sequence[LocalizationScore], other: Sequence[LocalizationScore], figure: str, form: str
) -> tuple[str, ...]:
    """Mean error of both rows, their difference with its interval over approaches, and the share that is gone."""
    runs: dict[int, list[tuple[float, float]]] = {}
    for pair in zip(one, other, strict=True):
        if all(map(_has_both, pair)):
            before, after = (sum(score.figures[f"{figure}.{side}"] for side in SIDES) / len(SIDES) for score in pair)
            runs.setdefault(pair[0].approach, []).append((before, after))
    if not runs:
        return (MISSING,) * 4
    means = np.array([np.mean(pairs, axis=0) for pairs in runs.values()])
    before, after = means.mean(axis=0)
    change = paired_difference(means[:, 1] - means[:, 0], np.random.default_rng(SEED))
    better = number(100 * (1 - after / before) if before else None, ".1f")
    return f"{before:{form}}", f"{after:{form}}", change.text(f"+{form}"), better


def visible_figures(scores: Iterable[LocalizationScore]) -> Figures:
    """Where a method's detector first holds both lines in the picture; empty for rows stored without that."""
    return visible_distance(
        ApproachFrame(
            str(score.approach),
            score.figures["time_s"],
            score.range_m,
            score.visibility_m,
            bool(score.figures["is_right"]),
        )
        for score in scores
        if "is_right" in score.figures
    )


def usable_share(scores: Sequence[LocalizationScore]) -> float:
    """Share of the frames with both lines, each within USABLE of the true one.

    Every frame counts: one without a line, or with a wrong one, is of no use.
    """
    limits = {f"{name}.{side}": most for name, most in USABLE.items() for side in SIDES}
    return share(scores, lambda score: all(score.figures.get(name, np.inf) <= most for name, most in limits.items()))


def unusable_improvement(scores: Sequence[LocalizationScore], reference: Sequence[LocalizationScore]) -> float:
    """1 - share of frames that are not usable / the reference's share; NaN where all of the reference's are usable."""
    theirs = 1 - usable_share(reference)
    return 1 - (1 - usable_share(scores)) / theirs if theirs else float("nan")


def usable_table(scores: Scores) -> Table:
    """Share of frames that are of use, those without a line counted as what they are."""
    reference = next(iter(scores))
    rows = []
    for name, members in scores.items():
        fewer = unusable_improvement(members, scores[reference])
        rows.append((name, str(len(members)), number(100 * usable_share(members), ".1f"), number(100 * fewer, ".1f")))
    columns = ("method", "frames", "usable %", f"fewer not usable than {reference}, %")
    return Table(USABLE_TITLE, columns, rows, [USABLE_NOTE])


def _pilot_table(title: str, groups: Mapping[str, Sequence[LocalizationScore]], notes: Sequence[str] = ()) -> Table:
    rows = []
    for name, members in groups.items():
        given = share(members, lambda score: "centre.lateral_m" in score.figures)
        fine = share(members, lambda score: score.mode == "fine")
        errors = [sizes(members, f"centre.{figure}") for figure, _ in PILOT_CELLS.values()]
        cells = (number(percentile(values, percent), ".3f") for values in errors for percent in (50.0, 95.0))
        rows.append((name, str(len(members)), f"{100 * given:.1f}", f"{100 * fine:.0f}", *cells))
    headings = (f"{what} {q}, {unit}" for what, (_, unit) in PILOT_CELLS.items() for q in ("50 %", "95 %"))
    return Table(title, ("", "frames", "given %", "fine %", *headings), rows, notes)


def consistency_table(scores: Scores) -> Table:
    """Squared errors over their covariance, those of the centre line also by where the distances came from."""
    rng = np.random.default_rng(SEED)
    centre, figure = "centre, from the aircraft", "centre.normalised"
    rows = []
    for method, members in scores.items():
        lines = {side: (f"normalised.{side}", members) for side in SIDES} | {centre: (figure, members)}
        for mode in ("fine", "coarse"):
            lines[f"{centre}, {mode}"] = figure, [score for score in members if score.mode == mode]
        for line, (name, inside) in lines.items():
            found = consistency(by_approach(inside, name), len(STATES), rng)
            if found.frames:
                interval = "" if np.isnan(found.low) else f" [{found.low:.2f}, {found.high:.2f}]"
                cells = (str(found.frames), f"{found.mean:.2f}{interval}", f"{100 * found.inside:.1f}")
                rows.append((method, line, *cells))
    columns = ("method", "line", "frames", "mean, 3 is expected", "in 95 %, %")
    return Table("consistency", columns, rows, [CONSISTENCY_NOTE])


def efficiency(scores: Iterable[LocalizationScore], error: str, bound: str) -> tuple[float, int]:
    """Cramer-Rao variance over mean squared error, and from how many frames; NaN without any."""
    pairs = np.array([(s.figures[error], s.figures[bound]) for s in scores if {error, bound} <= s.figures.keys()])
    if not len(pairs):
        return float("nan"), 0
    squared = float(np.mean(pairs[:, 0] ** 2))
    return float(np.mean(pairs[:, 1] ** 2)) / squared if squared else float("inf"), len(pairs)


def efficiency_table(method: str, scores: Sequence[LocalizationScore]) -> Table:
    """Bound over mean squared error of the centre line, by range."""
    rows = []
    for band, members in by_range(scores).items():
        found = [efficiency(members, f"centre.{name}", f"bound.{name}") for name, _ in PILOT_CELLS.values()]
        rows.append((band, str(max(frames for _, frames in found)), *(number(value, ".2f") for value, _ in found)))
    return Table(f"efficiency, {method}", ("range to the ramp", "frames", *PILOT_CELLS), rows, [EFFICIENCY_NOTE])


def protection_table(scores: Scores, tracked: Sequence[str]) -> Table:
    """Protection levels of the tracker, and the frames whose errors exceed them without a flag."""
    rows = []
    for name in tracked:
        members = scores[name]
        promised = [s for s in members if {"protection.lateral_m", "centre.lateral_m"} <= s.figures.keys()]
        flagged = sum(s.figures.get("flagged", 0.0) > 0 for s in members)
        counts = (len(members), len(promised), flagged, sum(misleads(s.figures) for s in promised))
        levels = (percentile(sizes(promised, f"protection.{what}_m"), 50.0) for what in ("lateral", "height"))
        rows.append((name, *map(str, counts), *(number(level, ".2f") for level in levels)))
    columns = ("method", "frames", "protected", "flagged", "misleading", "lateral level, m", "height level, m")
    return Table("protection", columns, rows)


def misleads(figures: Figures) -> bool:
    """Whether an error is beyond its protection level, without a flag."""
    pairs = {"centre.deviation_m": "protection.lateral_m", "centre.height_m": "protection.height_m"}
    known = {error: level for error, level in pairs.items() if {error, level} <= figures.keys()}
    return not figures.get("flagged") and any(abs(figures[error]) > figures[level] for error, level in known.items())


def flat_figures(scores: Scores) -> Figures:
    """The numbers of the tables under dotted names: method, then figure."""
    rng = np.random.default_rng(SEED)
    lines = {name: [line_means(members, side) for side in SIDES] for name, members in scores.items()}
    reference, first = next(iter(lines.values())), next(iter(scores.values()))
    figures: Figures = {}
    for name, members in scores.items():
        for side, means in zip(SIDES, lines[name], strict=True):
            figures |= {f"{name}.{figure}.{side}": value for figure, value in means.items()}
            figures[f"{name}.found.{side}"] = found_share(members, side)
        for what, figure in IMPROVED.items():
            figures[f"{name}.improvement.{what}"] = improvement(lines[name], reference, figure)
        figures |= {f"{name}.{figure}": value for figure, value in visible_figures(members).items()}
        figures[f"{name}.usable"] = usable_share(members)
        figures[f"{name}.improvement.not_usable"] = unusable_improvement(members, first)
        for band, inside in ({"": members} | by_range(members) | by_visibility(members)).items():
            prefix = f"{name}.pilot.{band}" if band else f"{name}.pilot"
            for figure, _ in PILOT_CELLS.values():
                values = sizes(inside, f"centre.{figure}")
                figures[f"{prefix}.{figure}.median"] = percentile(values, 50.0)
                figures[f"{prefix}.{figure}.p95"] = percentile(values, 95.0)
        found = consistency(by_approach(members, "centre.normalised"), len(STATES), rng)
        figures |= {f"{name}.honesty.mean": found.mean, f"{name}.honesty.inside": found.inside}
    return figures
