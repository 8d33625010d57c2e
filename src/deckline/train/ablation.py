"""The paper's ablation, Table 5: the rows that each add one part, trained one after the other under one budget."""

import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from deckline.atomic import write_atomic
from deckline.evaluation.ablation_measure import TrainedRow
from deckline.recording import open_recording
from deckline.train.checkpoint import read_progress
from deckline.train.dehaze import DehazeTrainConfig, train_dehaze
from deckline.train.dehaze_network import Attention, DehazeNetwork, Transformer
from deckline.train.network_cost import network_cost
from deckline.train.schedule import fraction_done
from deckline.train.training import MACHINE

RECIPE_FILE = "recipe.json"
WEIGHTS_FILE = "dehaze.onnx"


@dataclass(frozen=True)
class AblationRow:
    """One row of the table; each has what the one above has and one part more."""

    key: str  # its folder's name
    name: str  # for people
    attention: Attention
    transformer: Transformer
    augmented: bool
    paper_psnr_db: float  # on the paper's own pictures. Source: SPEC section 2


ROWS = (
    AblationRow("baseline", "depthwise, plain transformers", "depthwise", "plain", False, 28.94),
    AblationRow("mix-attention", "+ MixAttention", "mix", "plain", False, 29.46),
    AblationRow("mobilevit", "+ MobileViTv3", "mix", "mobilevit", False, 30.10),
    AblationRow("augmentation", "+ augmentation", "mix", "mobilevit", True, 30.18),
)


def row_recipe(row: AblationRow, base: DehazeTrainConfig) -> DehazeTrainConfig:
    """The recipe of one row.

    Without augmentation every pair is what was recorded: its own haze, neither mirrored nor resized. Crops lie anywhere
    in all rows, as whole pictures are too large to train on.
    """
    recorded = replace(
        base.haze,
        recorded_share=1.0,
        noise_share=0.0,
        crop_scale=(1.0, 1.0),
        flip_horizontal=0.0,
        flip_vertical=0.0,
    )
    return replace(
        base,
        network="deckline",
        attention=row.attention,
        transformer=row.transformer,
        prior=False,
        haze=base.haze if row.augmented else recorded,
    )


def train_rows(base: DehazeTrainConfig, recording: Path, out: Path) -> list[TrainedRow] | None:
    """Train every row that is not finished in `out`/<key>, in order.

    Args:
        base: recipe and budget of each row.
        recording: pairs with depth.
        out: folder; its recipe.json keeps rows of different budgets or recipes apart.

    Returns:
        The rows; None when interrupted, and the same call goes on.

    Raises:
        ValueError: no pairs, pairs that cannot be trained on, or a folder of another recipe.
    """
    check_pairs(recording, base.held_out)
    _claim(out, base, recording)
    for row in ROWS:
        recipe, folder = row_recipe(row, base), out / row.key
        if is_finished(recipe, folder):
            print(f"{row.key}: finished before")
            continue
        print(f"{row.key}: {row.name}")
        if not train_dehaze(recipe, [recording], folder):
            return None
    return [_trained(row, row_recipe(row, base), out / row.key) for row in ROWS]


def is_finished(recipe: DehazeTrainConfig, folder: Path) -> bool:
    """Whether the folder holds the weights of a training that used its budget."""
    progress = read_progress(folder)
    if progress is None or not (folder / WEIGHTS_FILE).is_file():
        return False
    return fraction_done(progress["step"], recipe.steps, progress["seconds"], recipe.minutes) >= 1


def check_pairs(recording: Path, held_out: float) -> None:
    """Raise ValueError unless there are pairs, recorded in haze and in clear air, to train on and to hold out."""
    source = open_recording(recording)
    if round(held_out * len(source)) < 1:
        raise ValueError(f"{recording}: {len(source)} pairs are too few to keep {100 * held_out:g} % out of training")
    for frame in source:
        truth = frame.truth
        visibility_m = math.inf if truth is None or truth.visibility_m is None else truth.visibility_m
        if truth is None or truth.clear_rgb is None or math.isinf(visibility_m):
            raise ValueError(f"{recording}: {frame.file} is no pair of a hazy and a clear picture")
        return
    raise ValueError(f"{recording}: no frame can be read")


def _trained(row: AblationRow, recipe: DehazeTrainConfig, folder: Path) -> TrainedRow:
    progress = read_progress(folder)
    if progress is None:
        raise ValueError(f"{folder} holds no checkpoint")
    cost = network_cost(DehazeNetwork(recipe.shape))
    return TrainedRow(
        key=row.key,
        name=row.name,
        paper_psnr_db=row.paper_psnr_db,
        weights=folder / WEIGHTS_FILE,
        steps=progress["step"],
        minutes=progress["seconds"] / 60,
        parameters=cost.parameters,
        macs_256=cost.macs,
    )


def _claim(out: Path, base: DehazeTrainConfig, recording: Path) -> None:
    """Write down what the rows in `out` are made with, or see that they were made with the same."""
    told = json.loads(json.dumps({**_kept(base), "recording": str(recording.resolve())}))
    path = out / RECIPE_FILE
    if not path.is_file():
        out.mkdir(parents=True, exist_ok=True)
        write_atomic(path, (json.dumps(told, indent=1) + "\n").encode())
        return
    try:
        stored = dict(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path} is damaged ({error}): use another folder") from error
    changed = sorted(name for name in {*told, *stored} if stored.get(name) != told.get(name))
    if changed:
        raise ValueError(f"{out} holds an ablation with another {', '.join(changed)}: use another folder")


def _kept(base: DehazeTrainConfig) -> dict[str, Any]:
    return {name: value for name, value in asdict(base).items() if name not in MACHINE}
