"""`deckline reproduce`: the paper's Tables 4, 5 and 6 beside the paper's figures, saved ones or made anew.

RUNS/data, RUNS/pairs       the paper's dataset, and its pairs averaged down by two
RUNS/table4/<network>/      checkpoint and ONNX file of each training
RUNS/table6/<network>/      the same of Table 6
RUNS/table4.json            the figures, as an evaluation's --json writes them; table5.json, table6.json too
RUNS/figures                the paper's figures
"""

from pathlib import Path
from typing import Literal

import tyro

from deckline_lab.evaluation.tables import print_tables, read_saved
from deckline_lab.reproduce import table4, table5, table6
from deckline_lab.reproduce.runs import SAVED


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
        minutes: of training for each network, in Table 5 a hundred steps each; makes --runs, with the extras sim and
            train.
        threads: of the processor, for training.
    """
    path = (runs or SAVED) / f"{table}.json"
    if minutes is not None:
        if runs is None or minutes <= 0:
            raise ValueError(f"--minutes {minutes:g} trains anew: expected a positive number and a folder --runs")
        make = {"table4": table4.make_table4, "table5": table5.make_table5, "table6": table6.make_table6}[table]
        make(runs, path, minutes, threads)
    if not path.is_file():
        raise ValueError(f"{path} is not there: add --minutes to make it, or leave --runs out for saved figures")
    saved = read_saved(path)
    differs = {"table4": table4.DIFFERS, "table5": table5.DIFFERS, "table6": table6.DIFFERS}[table]
    print_tables(saved.title, saved.made_with, saved.tables, (*saved.notes, f"Command: {saved.command}", differs))
    return 0


COMMANDS = {"reproduce": reproduce}
EXAMPLES = {
    "deckline reproduce": (
        "deckline reproduce table6",
        "deckline reproduce table4 --runs runs --minutes 7",
    ),
}
