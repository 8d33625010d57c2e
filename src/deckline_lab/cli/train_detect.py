"""`deckline train detect`."""

from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from deckline_lab.cli.recipe_flags import FLAGS, find_weights, make_flags, make_recipe
from deckline_lab.rivals.detectors import DETECTORS
from deckline_lab.train.detect import NETWORKS, DetectTrainConfig, train_detect

DETECT_FLAGS: dict[str, tuple[Any, str]] = {
    "network": (Literal[*NETWORKS, *DETECTORS], "a shipped one, or one to compare.")
}
DetectFlags = make_flags(DetectTrainConfig, DETECT_FLAGS | FLAGS)
NO_FLAGS = DetectFlags()


def detect(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    recipe: Path | None = None,
    start_from: str | None = None,
    photographs: Path | None = None,
    flags: Annotated[DetectFlags, tyro.conf.arg(name="")] = NO_FLAGS,  # type: ignore[valid-type]
) -> int:
    """Train a line detector on clear recordings with depth and true lines, or on pictures of your own with labels.json.

    The same command goes on from its own checkpoint in --out, where recipe.toml holds every value that was used. For
    pictures of your own start from shipped weights with a lower --lr, such as 2e-4.

    Args:
        recordings: folders written by `deckline sim --visibility clear --depth.range-m inf`, and folders of pictures
            with labels.json, to which no haze is added; one given twice is drawn twice as often.
        out: folder of recipe.toml, the checkpoint, losses.csv, losses.png and detect.onnx.
        recipe: TOML file of all settings of a training (see recipe.toml in an --out), or a shipped recipe's name:
            hybrid, ufld; flags override it.
        start_from: first weights: folder of an earlier training, .onnx file, shipped, or a shipped model's name.
        photographs: folder of pictures without a runway, which take the place of some views' sky.
        flags: over the recipe.
    """
    config = make_recipe(DetectTrainConfig, recipe, flags)
    start = find_weights(start_from, config.network)
    train_detect(config, list(recordings), out, start, NETWORKS | DETECTORS, photographs)
    return 0
