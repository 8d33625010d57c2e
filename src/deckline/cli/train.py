"""`deckline train`: everything behind it needs the train extra."""

from pathlib import Path
from typing import Annotated

import tyro

from deckline.extras import needs_extra
from deckline.runtime import shipped_weights

with needs_extra("train"):
    from deckline.train.dehaze import DehazeTrainConfig, train_dehaze
    from deckline.train.detect import DetectTrainConfig, train_detect

SHIPPED = "shipped"


def dehaze(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    start_from: Path | None = None,
    config: Annotated[DehazeTrainConfig, tyro.conf.arg(name="")] = DehazeTrainConfig(),  # noqa: B008 - frozen
) -> int:
    """Train a dehazing network on clear recordings with depth; goes on from its own checkpoint in `out`.

    Args:
        recordings: folders written by `deckline sim --visibility clear --depth.range-m inf`.
        out: folder of the checkpoint and the exported ONNX file.
        start_from: folder of an earlier training, or its .onnx file, a shipped one too: to go on from its weights with
            other data or another recipe.
        config: the recipe.
    """
    train_dehaze(config, list(recordings), out, start_from)
    return 0


def detect(
    recordings: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    start_from: Path | None = None,
    config: Annotated[DetectTrainConfig, tyro.conf.arg(name="")] = DetectTrainConfig(),  # noqa: B008 - frozen
) -> int:
    """Train the line detector on clear recordings with depth and true lines; goes on from its own checkpoint in `out`.

    Args:
        recordings: folders written by `deckline sim --visibility clear --depth.range-m inf`, and folders of images with
            labels.json, to which no haze is added; one given twice is drawn twice as often.
        out: folder of the checkpoint and the exported ONNX file.
        start_from: folder of an earlier training, its .onnx file, or the word shipped: to go on from those weights with
            other data or another recipe; for pictures of your own lower --lr, 2e-4 say.
        config: the recipe.
    """
    if start_from is not None and str(start_from) == SHIPPED:
        start_from = shipped_weights("hybrid" if config.network == "hybrid" else "detect")
    train_detect(config, list(recordings), out, start_from)
    return 0
