"""The rows of the paper's Table 5: what differs between them, and their training."""

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from deckline.recording import open_recording
from deckline_lab.train.checkpoint import read_progress
from deckline_lab.train.dehaze import DehazeTrainConfig, build_ours, train_dehaze
from deckline_lab.train.dehaze_network import Attention, Transformer
from deckline_lab.train.dehaze_samples import HazeAugmentation
from deckline_lab.train.export import network_cost
from deckline_lab.train.loop import MACHINE

WEIGHTS_FILE = "dehaze.onnx"


@dataclass(frozen=True)
class AblationRow:
    """One row of the table; each has what the one above has and one part more."""

    key: str  # its folder's name
    name: str  # for people
    attention: Attention
    transformer: Transformer
    augmented: bool
    paper_psnr_db: float  # on the paper's own pictures; Li et al. 2024, Table 5


ROWS = (
    AblationRow("baseline", "depthwise, plain transformers", "depthwise", "plain", False, 28.94),
    AblationRow("mix-attention", "+ MixAttention", "mix", "plain", False, 29.46),
    AblationRow("mobilevit", "+ MobileViTv3", "mix", "mobilevit", False, 30.10),
    AblationRow("augmentation", "+ augmentation", "mix", "mobilevit", True, 30.18),
)


def base_recipe(
    minutes: float | None,
    steps: int | None,
    size: str,
    unshuffle: int,
    recorded_share: float,
    flip_vertical: float,
    **same: Any,
) -> DehazeTrainConfig:
    """What the rows have in common; the arguments are `AblationConfig`'s, `same` those that recipes have too."""
    if minutes is None and steps is None:
        raise ValueError("give each row a budget: --minutes, --steps, or both (whichever ends first)")
    return DehazeTrainConfig(
        network=f"{'full' if unshuffle == 1 else 'coarse'}-{size}",
        minutes=minutes,
        steps=DehazeTrainConfig.steps if steps is None else steps,
        haze=HazeAugmentation(recorded_share=recorded_share, flip_vertical=flip_vertical),
        **same,
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
    haze = base.haze if row.augmented else recorded
    return replace(base, attention=row.attention, transformer=row.transformer, haze=haze)


def describe_rows(base: DehazeTrainConfig, recording: Path) -> dict[str, Any]:
    """What the rows are made with, but for the machine: JSON values."""
    recipe = {name: value for name, value in asdict(base).items() if name not in MACHINE}
    return {**recipe, "recording": str(recording.resolve())}


def train_rows(base: DehazeTrainConfig, recording: Path, out: Path) -> dict[str, dict[str, float]]:
    """Train every row that is not finished in `out`/<key>, in order, on pairs with depth; the same call goes on.

    Returns:
        parameters, macs_256, steps and minutes of each row, by key.
    """
    costs: dict[str, dict[str, float]] = {}
    for row in ROWS:
        recipe, folder = row_recipe(row, base), out / row.key
        if is_finished(recipe, folder):
            print(f"{row.key}: finished before")
        else:
            print(f"{row.key}: {row.name}")
            train_dehaze(recipe, [recording], folder)
        progress, cost = read_progress(folder) or {}, network_cost(build_ours(recipe))
        spent = {"steps": progress["step"], "minutes": progress["seconds"] / 60}
        costs[row.key] = {"parameters": cost.parameters, "macs_256": cost.macs, **spent}
    return costs


def is_finished(recipe: DehazeTrainConfig, folder: Path) -> bool:
    """Whether the folder holds the weights of a training that used its budget."""
    progress = read_progress(folder)
    if progress is None or not (folder / WEIGHTS_FILE).is_file():
        return False
    return recipe.fraction_done(progress["step"], progress["seconds"]) >= 1


def check_pairs(recording: Path, held_out: float) -> None:
    """Raise ValueError unless there are pairs, recorded in haze and in clear air, to train on and to hold out."""
    source = open_recording(recording)
    if round(held_out * len(source)) < 1:
        raise ValueError(f"{recording}: {len(source)} pairs are too few to hold {100 * held_out:g} % of them out")
    for frame in source:
        truth = frame.truth
        visibility_m = math.inf if truth is None or truth.visibility_m is None else truth.visibility_m
        if truth is None or truth.clear_rgb is None or math.isinf(visibility_m):
            raise ValueError(f"{recording}: {frame.file} is no pair of a hazy and a clear picture")
        return
    raise ValueError(f"{recording}: no frame can be read")
