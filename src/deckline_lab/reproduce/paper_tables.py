"""`deckline reproduce`: the paper's Tables 4, 5 and 6 beside the paper's figures, saved ones or made anew.

RUNS/data, RUNS/views       what is trained on
RUNS/table4/<network>/      checkpoint and ONNX file of each training
RUNS/table4.json            the figures, as an evaluation's --json writes them
"""

import json
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import tyro

from deckline.extras import needs_extra
from deckline_lab.evaluation.tables import MISSING, Table, print_tables, read_saved
from deckline_lab.labels.lines import LABELS_FILE

SAVED = Path(__file__).parent / "saved"
DEHAZERS = (
    "coarse-t",
    "aod-net-coarse",
    "gca-net-coarse",
    "grid-dehaze-net-coarse",
    "g-unet-t-coarse",
    "dehaze-former-t-coarse",
)
DETECTORS = ("sad-lite0", "ufld-lite0", "resa-lite0", "hybrid")  # the first one is the reference, the last one ours
RECIPE = """batch = 2
crop_height = 256
crop_width = 256
lr = 1e-3
visible_share = 0.0
held_out = 0.01
cpu_minutes = true

[haze]
noise_share = 0.0
"""
VIEWS = (
    *("--preset", "train", "--trajectory", "random", "--visibility", "clear", "--depth.range-m", "inf"),
    *("--no-keep-clear", "--set", "sensor.noise=0", "sensor.electrons=0", "sensor.jpeg_quality=0"),
    *("--width", 640, "--height", 360, "--frames", 2000, "--seed", 5, "--jobs", 0),
)

# Of Li et al. 2024: Table 4 and section 4.1, Table 6. The table of its text is lost but for these.
PAPER_4 = {"coarse-t": ("30.18", "0.972"), "dehaze-former-t-coarse": ("29.11", MISSING)}  # PSNR, dB, SSIM
PAPER_6 = {  # slope, intercept, m, and direction, degrees, off: left, right
    "the paper, without dehazing": (("0.15", "9.25", "8.5456"), ("0.07", "5.33", "3.9949")),
    "the paper, dehazed": (("0.02489", "1.85", "1.3347"), ("0.00122", "0.051", "0.0559")),
}
SHOWN_4 = (
    "dehazer",
    "images",
    "PSNR, dB",
    "to coarse-t, dB",
    "below horizon, dB",
    "SSIM",
    "parameters",
    "MACs 256x256",
)
DIFFERS = {
    "table4": """\
What differs: the paper trains on pictures of its own, 600,000 steps of 16 on an RTX 4090, each network in its own form.
Here all see the same simulated pairs for the same budget behind the same 4x4 grid, without poses. The paper's text does
not name its five rivals; DehazeFormer's figure is ours less the lead that it states.""",
    "table5": """\
What differs: the paper trains each row for 600,000 steps of 16 on pictures of its own; here as few as stated, 2 crops a
step, one seed.""",
    "table6": """\
What differs: the paper flies in AirSim, and its lines without dehazing are UFLD's. Here the first row is the rival that
finds lines soonest in a short training, SAD; a rival that finds none has no figures. The paper's improvement is
computed from its errors as ours is.""",
}


def reproduce(
    table: tyro.conf.Positional[Literal["table4", "table5", "table6"]],
    runs: Path | None = None,
    minutes: float | None = None,
    threads: int = 2,
) -> int:
    """Print the paper's Table 4 (dehazing), 5 (ablation) or 6 (lines) as deckline has it, beside the paper's figures.

    Figures saved with deckline need a second. With --minutes data, trainings and measurements are made anew; the same
    command goes on after a stop, and more minutes go on from the checkpoints. Every command is printed before it runs.

    Args:
        table: of Li et al. 2024.
        runs: folder of a run of your own; without --minutes its figures are printed as they are.
        minutes: of training for each network; makes --runs, with the extras sim and train.
        threads: of the processor, for training.
    """
    path = (runs or SAVED) / f"{table}.json"
    if minutes is not None:
        if runs is None or minutes <= 0:
            raise ValueError(f"--minutes {minutes:g} trains anew: expected a positive number and a folder --runs")
        {"table4": make_table4, "table5": make_table5, "table6": make_table6}[table](runs, path, minutes, threads)
    if not path.is_file():
        raise ValueError(f"{path} is not there: add --minutes to make it, or leave --runs out for saved figures")
    saved = read_saved(path)
    add = {"table4": with_paper_4, "table5": lambda tables: tables, "table6": with_paper_6}[table]
    print_tables(saved.title, saved.made_with, add(saved.tables), (f"Command: {saved.command}", DIFFERS[table]))
    return 0


def with_paper_4(tables: Sequence[Table]) -> list[Table]:
    """The restoration table with the paper's PSNR and SSIM."""
    whole = tables[0]
    columns = [whole.columns.index(name) for name in SHOWN_4]
    rows = [(*(row[k] for k in columns), *PAPER_4.get(row[0], (MISSING, MISSING))) for row in whole.rows]
    rows.sort(key=lambda row: float(row[2]))
    return [Table("Table 4", (*SHOWN_4, "paper, dB", "paper, SSIM"), rows, whole.notes[:2])]


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


def make_table4(runs: Path, path: Path, minutes: float, threads: int) -> None:
    """Ours and its five rivals behind one coarse grid, trained on the same pairs with the same budget."""
    run("dataset", runs / "data", "--one-scene", "--no-tiles", "--jobs", 0)
    pairs, out = shrink_pairs(runs / "data" / "train", runs / "pairs"), runs / "table4"
    out.mkdir(parents=True, exist_ok=True)
    recipe = out / "recipe.toml"
    recipe.write_text(RECIPE)
    budget = ("--recipe", recipe, "--minutes", minutes, "--threads", threads)
    for name in DEHAZERS:
        run("train", "dehaze", pairs, "--network", name, "--out", out / name, *budget)
    files = [out / name / "dehaze.onnx" for name in DEHAZERS]
    measure = ("--reference", files[0], "--detector", "none", "--every", 3, "--json", path)
    run("eval", "dehazing", runs / "data" / "test", "--dehazer", *files, *measure, quiet=True)


def make_table5(runs: Path, path: Path, minutes: float, threads: int) -> None:
    """The ablation's rows."""
    run("dataset", runs / "data", "--one-scene", "--no-tiles", "--jobs", 0)
    out = runs / "table5"
    budget = ("--minutes", minutes, "--cpu-minutes", "--threads", threads, "--recorded-share", 0.5, "--every", 3)
    run("eval", "ablation", runs / "data", "--out", out, *budget)
    (out / "ablation.json").replace(path)


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


def shrink_pairs(recording: Path, folder: Path) -> Path:
    """`folder` with the recording's pairs at the size that they are trained at: loading them anew takes little time."""
    with needs_extra("train"):
        from deckline.report.draw import write_picture
        from deckline_lab.train.dehaze import DehazeTrainConfig
        from deckline_lab.train.pair_views import open_clear_views
    if not (folder / LABELS_FILE).exists():
        folder.mkdir(exist_ok=True)
        views, entries = open_clear_views([recording], DehazeTrainConfig.working_long_side_px, held_out=0.0), []
        for index in range(len(views)):
            view, names = views[index], {"file": f"{index:03d}-hazy.png", "pair_of": f"{index:03d}-clear.png"}
            if view.hazy_rgb is None:
                raise ValueError(f"{recording}: picture {index} has no hazy one; write it with `deckline dataset`")
            for name, picture in zip(names.values(), (view.hazy_rgb, view.clear_rgb), strict=True):
                write_picture(folder / name, picture)
            entries.append(names)
        (folder / LABELS_FILE).write_text(json.dumps({"frames": entries}))
    return folder


def run(*words: object, quiet: bool = False) -> None:
    """Print and run a deckline command; `quiet` drops its tables.

    Raises:
        SystemExit: its exit code, where it fails; it has printed the reason.
    """
    command = ["deckline", *map(str, words)]
    print(shlex.join(command), flush=True)
    output = subprocess.DEVNULL if quiet else None
    if code := subprocess.run([sys.executable, "-m", *command], check=False, stdout=output).returncode:
        raise SystemExit(code)
