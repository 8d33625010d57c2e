"""`deckline train dehaze`."""

from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from deckline_lab.cli.recipe_flags import FLAGS, find_weights, make_flags, make_recipe
from deckline_lab.rivals.dehazers import DEHAZERS
from deckline_lab.train.dehaze import NETWORKS, DehazeTrainConfig, train_dehaze

DEHAZE_FLAGS: dict[str, tuple[Any, str]] = {
    "network": (
        Literal[*NETWORKS, *DEHAZERS],
        "ours on a grid of 4 px (coarse) or at full resolution, or one to compare.",
    ),
    "prior": (bool, "start from the geometry dehazer's picture, as the shipped network does; coarse networks only."),
    "crop_height": (int, "px."),
    "crop_width": (int, "px."),
    "visible_share": (float, "of the loss, on what haze leaves visible."),
}
DehazeFlags = make_flags(DehazeTrainConfig, DEHAZE_FLAGS | FLAGS)
NO_FLAGS = DehazeFlags()


def dehaze(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    recipe: Path | None = None,
    start_from: str | None = None,
    photographs: Path | None = None,
    flags: Annotated[DehazeFlags, tyro.conf.arg(name="")] = NO_FLAGS,  # type: ignore[valid-type]
) -> int:
    """Train a dehazing network on clear recordings with depth, or on pairs of hazy and clear pictures of your own.

    The same command goes on from its own checkpoint in --out, where recipe.toml holds every value that was used.

    Args:
        recordings: folders written by `deckline sim --visibility clear --depth.range-m inf`, and folders of pictures
            whose labels.json names the clear one of each hazy one as pair_of; one given twice is drawn twice as often.
        out: folder of recipe.toml, the checkpoint, losses.csv, losses.png and dehaze.onnx.
        recipe: TOML file of all settings of a training (see recipe.toml in an --out), or a shipped recipe's name:
            published (the paper's), coarse-t, paper-scene; flags override it.
        start_from: first weights: folder of an earlier training, .onnx file, shipped, or a shipped model's name.
        photographs: folder of clear photographs; they get haze over a made-up depth, for pictures without a pose.
        flags: over the recipe.
    """
    config = make_recipe(DehazeTrainConfig, recipe, flags)
    start = find_weights(start_from, config.network)
    train_dehaze(config, list(recordings), out, start, NETWORKS | DEHAZERS, photographs)
    return 0
