"""The paper's Table 5: what each part of the dehazing network is worth."""

from pathlib import Path

from deckline_lab.reproduce.runs import make_data, run

STEPS_A_MINUTE = 100  # of --minutes: a rerun has the same steps on any machine; about those of one core
SEEDS = (0, 1, 2)
SUB_IMAGE_PX = 256
EVERY = 3  # test pairs
DIFFERS = """\
What differs: the paper trains each row for 600,000 steps of 16 on pictures of its own; here as few as stated, 2
pictures or sub-images a step, averaged down by two, on the coarse grid. A whole picture has 3.5 times the pixels of a
sub-image."""


def make_table5(runs: Path, path: Path, minutes: float, threads: int) -> None:
    """The ablation's rows, each STEPS_A_MINUTE x `minutes` steps."""
    data, out = make_data(runs), runs / "table5"
    budget = ("--steps", max(1, round(STEPS_A_MINUTE * minutes)), "--seeds", *SEEDS, "--threads", threads)
    run("eval", "ablation", data, "--out", out, *budget, "--sub-image-px", SUB_IMAGE_PX, "--every", EVERY)
    (out / "ablation.json").replace(path)
