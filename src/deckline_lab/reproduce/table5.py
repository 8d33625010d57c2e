"""The paper's Table 5: what each part of the dehazing network is worth."""

from pathlib import Path

from deckline_lab.reproduce.runs import make_data, run

DIFFERS = """\
What differs: the paper trains each row for 600,000 steps of 16 on pictures of its own; here as few as stated, 2 crops a
step, one seed."""


def make_table5(runs: Path, path: Path, minutes: float, threads: int) -> None:
    """The ablation's rows."""
    data, out = make_data(runs), runs / "table5"
    budget = ("--minutes", minutes, "--cpu-minutes", "--threads", threads, "--recorded-share", 0.5, "--every", 3)
    run("eval", "ablation", data, "--out", out, *budget)
    (out / "ablation.json").replace(path)
