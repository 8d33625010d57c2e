"""The paper's Table 6: the runway lines in haze, of ours and its rivals."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from deckline_lab.evaluation.tables import MISSING, Table
from deckline_lab.reproduce.runs import run

DETECTORS = ("sad-lite0", "ufld-lite0", "resa-lite0", "hybrid")  # the first one is the reference, the last one ours
VIEWS = (
    *("--preset", "train", "--trajectory", "random", "--visibility", "clear", "--depth.range-m", "inf"),
    *("--no-keep-clear", "--set", "sensor.noise=0", "sensor.electrons=0", "sensor.jpeg_quality=0"),
    *("--width", 640, "--height", 360, "--frames", 2000, "--seed", 5, "--jobs", 0),
)

# Of Li et al. 2024, Table 6.
PAPER_6 = {  # slope, intercept, m, and direction, degrees, off: left, right
    "the paper, without dehazing": (("0.15", "9.25", "8.5456"), ("0.07", "5.33", "3.9949")),
    "the paper, dehazed": (("0.02489", "1.85", "1.3347"), ("0.00122", "0.051", "0.0559")),
}
DIFFERS = """\
What differs: the paper flies in AirSim, and its lines without dehazing are UFLD's. Here the first row is the rival that
finds lines soonest in a short training, SAD; a rival that finds none has no figures. The paper's improvement is
computed from its errors as ours is."""


def with_paper_6(tables: Sequence[Table]) -> list[Table]:
    """The table of lines with the paper's rows, and the improvements with the paper's own.

    The evaluation calls whatever --ufld names ufld; here it is the first of DETECTORS.
    """
    lines, improved = (
        replace(table, title=_rename(table.title), rows=[tuple(map(_rename, row)) for row in table.rows])
        for table in tables[:2]
    )
    offs = [lines.columns.index(name) for name in ("slope off", "intercept off, m", "direction off, deg")]
    rows = [*lines.rows]
    for name, sides in PAPER_6.items():
        for side, errors in zip(("left", "right"), sides, strict=True):
            row = [name, side, *[MISSING] * (len(lines.columns) - 2)]
            for k, error in zip(offs, errors, strict=True):
                row[k] = error
            rows.append(row)
    cells = []
    for k in (2, 1):  # direction, then intercept
        before, after = ([float(side[k]) for side in sides] for sides in PAPER_6.values())
        cells += [1 - b / a for a, b in zip([*before, sum(before)], [*after, sum(after)], strict=True)]
    paper = ("the paper", *(f"{100 * cell:.1f}" for cell in cells))
    return [replace(lines, rows=rows), replace(improved, rows=[*improved.rows, paper])]


def _rename(text: str) -> str:
    return text.replace("ufld, ", f"{DETECTORS[0]}, ")


def make_table6(runs: Path, path: Path, minutes: float, threads: int) -> None:
    """Ours and its rivals, trained on the same clear views with the same budget, on approaches through haze."""
    run("sim", *VIEWS, "--out", runs / "views")
    out = runs / "table6"
    for name in DETECTORS:
        budget = ("--minutes", minutes, "--threads", threads)
        run("train", "detect", runs / "views", "--network", name, "--out", out / name, *budget)
    first, *others, ours = (out / name / "detect.onnx" for name in DETECTORS)
    rows = ("--ufld", first, "--rival", *others, "--detector", ours)
    unit = ("--grade", "good", "--sea-state", 0)  # the errors of the vision, not of the navigation unit
    run("eval", "localization", *rows, *unit, "--approaches", 4, "--json", path, quiet=True)
