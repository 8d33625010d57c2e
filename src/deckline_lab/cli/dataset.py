"""`deckline dataset`: everything behind it needs the sim extra."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

import tyro

from deckline_lab.datasets.paper import MANIFEST, DatasetConfig, check_dataset, write_dataset
from deckline_sim.record import parse_visibility, visibility_text
from deckline_sim.workers import RayOption, choose_workers

DATASET_HELP = """\
examples:
  deckline dataset data --views landing --one-scene --jobs 0
  deckline dataset data --check

Render the paper's dataset: 600 clear and hazy pairs with depth, 421 for training and 179 for testing, in tiles.
A stopped command goes on where it was when it is given again. For any number of fully random training frames see
deckline sim --preset train --trajectory random."""


@dataclass(frozen=True)
class DatasetFlags:
    """The flags of `deckline dataset`."""

    out: tyro.conf.Positional[Path]  # folder of the dataset
    check: bool = False  # render nothing; compare every file with the manifest
    jobs: int = 1  # processes that render; 0: one for every core
    ray: RayOption = None  # render as Ray tasks, on the cluster at ADDRESS, without it on one that is started here
    frames: int = DatasetConfig.frames  # clear and hazy pairs, training and test together
    test: int = DatasetConfig.test  # how many of them are for testing
    seed: int = DatasetConfig.seed  # the same seed makes the same files
    visibility: str = visibility_text(DatasetConfig.visibility_m)  # metres at 2 % contrast: one value or LOW..HIGH
    width: int = DatasetConfig.width  # of the images, px
    height: int = DatasetConfig.height  # of the images, px
    fov_deg: float = DatasetConfig.fov_deg  # horizontal field of view
    depth_range_m: float = DatasetConfig.depth_range_m  # reach of the depth camera
    # mixed: half random views, half flights; landing: the paper's flight from its holding track, again and again
    views: Literal["mixed", "landing"] = DatasetConfig.views
    one_scene: bool = DatasetConfig.one_scene  # the same light, sky and sea in every frame
    tiles: bool = DatasetConfig.tiles  # also cut every image into 8 overlapping squares
    tile_px: int = DatasetConfig.tile_px  # their side


def dataset(args: Sequence[str]) -> int:
    """Parse and run `deckline dataset ARGS`."""
    flags = tyro.cli(DatasetFlags, prog="deckline dataset", description=DATASET_HELP, args=args)
    if flags.check:
        print(f"{flags.out}: all {check_dataset(flags.out, flags.jobs)} files match {MANIFEST}")
        return 0
    workers = choose_workers(flags.ray, flags.jobs)
    values = {item.name: getattr(flags, item.name) for item in fields(DatasetConfig) if item.name != "visibility_m"}
    write_dataset(DatasetConfig(**values, visibility_m=parse_visibility(flags.visibility)), flags.out, workers)
    return 0


COMMANDS = {"dataset": dataset}
PARSED_BY_COMMAND = True
