"""`deckline dataset`: everything behind it needs the sim extra."""

from pathlib import Path
from typing import Annotated

import tyro

from deckline_lab.datasets.paper import MANIFEST, DatasetConfig, check_dataset, write_dataset
from deckline_sim.workers import RayOption, choose_workers

AS_THE_PAPER = DatasetConfig()


def dataset(
    out: tyro.conf.Positional[Path],
    check: bool = False,
    jobs: int = 1,
    ray: RayOption = None,
    config: Annotated[DatasetConfig, tyro.conf.arg(name="")] = AS_THE_PAPER,
) -> int:
    """Render the paper's dataset: 600 clear and hazy pairs with depth, 421 for training and 179 for testing, in tiles.

    A stopped command goes on where it was when it is given again. For any number of fully random training frames see
    deckline sim --preset train --trajectory random.

    Args:
        out: folder of the dataset.
        check: render nothing; compare every file with the manifest.
        jobs: processes that render; 0: one for every core.
        ray: render as Ray tasks, on the cluster at ADDRESS, without it on one that is started here.
        config: what is rendered.
    """
    if check:
        print(f"{out}: all {check_dataset(out, jobs)} files match {MANIFEST}")
        return 0
    write_dataset(config, out, choose_workers(ray, jobs))
    return 0


COMMANDS = {"dataset": dataset}
EXAMPLES = {
    "deckline dataset": (
        "deckline dataset data --views landing --one-scene --jobs 0",
        "deckline dataset data --check",
    ),
}
