"""The rows of the paper's Table 5: what differs between them, and their training."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deckline.recording import open_recording
from deckline_lab.train.checkpoint import read_progress
from deckline_lab.train.clear_views import shrink
from deckline_lab.train.dehaze import ONNX_FILE, DehazeTrainConfig, train_dehaze
from deckline_lab.train.dehaze_network import Attention, Transformer
from deckline_lab.train.dehaze_samples import HazeAugmentation
from deckline_lab.train.loop import BUDGET, MACHINE, is_finished

FLIP = 0.5  # probability, horizontal and vertical each; Li et al. 2024, section 4.1.1


@dataclass(frozen=True)
class AblationRow:
    """One row of the table; each has what the one above has and one part more."""

    key: str  # its folders' name
    name: str  # for people
    attention: Attention
    transformer: Transformer
    sub_images: bool  # with flips; else whole pictures as they are
    redrawn: bool  # haze drawn anew in a share of the crops; else as recorded in all
    paper_psnr_db: float | None  # on the paper's own pictures; Li et al. 2024, Table 5


ROWS = (
    AblationRow("baseline", "depthwise, plain transformers", "depthwise", "plain", False, False, 28.94),
    AblationRow("mix-attention", "+ MixAttention", "mix", "plain", False, False, 29.46),
    AblationRow("mobilevit", "+ MobileViTv3", "mix", "mobilevit", False, False, 30.10),
    AblationRow("sub-images", "+ sub-images and flips", "mix", "mobilevit", True, False, 30.18),
    AblationRow("redrawn", "+ haze drawn anew (ours)", "mix", "mobilevit", True, True, None),
)


@dataclass(frozen=True)
class Training:
    """A row with one seed: its recipe and its folder."""

    row: AblationRow
    recipe: DehazeTrainConfig
    folder: Path


def base_recipe(
    minutes: float | None,
    steps: int | None,
    size: str,
    unshuffle: int,
    recorded_share: float,
    sub_image_px: int,
    **same: Any,
) -> DehazeTrainConfig:
    """What the rows have in common, with the paper's loss; the arguments are `AblationConfig`'s, `same` those that
    recipes have too.
    """
    if minutes is None and steps is None:
        raise ValueError("give each row a budget: --minutes, --steps, or both (whichever ends first)")
    return DehazeTrainConfig(
        network=f"{'full' if unshuffle == 1 else 'coarse'}-{size}",
        minutes=minutes,
        steps=DehazeTrainConfig.steps if steps is None else steps,
        crop_height=sub_image_px,
        crop_width=sub_image_px,
        visible_share=0.0,
        haze=HazeAugmentation(recorded_share=recorded_share, noise_share=0.0, crop_scale=(1.0, 1.0)),
        **same,
    )


def row_recipe(row: AblationRow, base: DehazeTrainConfig, size: tuple[int, int]) -> DehazeTrainConfig:
    """The recipe of one row; `size` is the height and width of the whole pictures, px."""
    flip = FLIP if row.sub_images else 0.0
    haze = replace(
        base.haze,
        recorded_share=base.haze.recorded_share if row.redrawn else 1.0,
        flip_horizontal=flip,
        flip_vertical=flip,
    )
    height, width = (base.crop_height, base.crop_width) if row.sub_images else size
    return replace(
        base,
        attention=row.attention,
        transformer=row.transformer,
        haze=haze,
        crop_height=height,
        crop_width=width,
        sub_images=row.sub_images,
    )


def list_trainings(base: DehazeTrainConfig, size: tuple[int, int], seeds: Sequence[int], out: Path) -> list[Training]:
    """Every row with every seed, in the order of training: a seed's rows together."""
    return [
        Training(row, replace(row_recipe(row, base, size), seed=seed), out / f"{row.key}-{seed}")
        for seed in seeds
        for row in ROWS
    ]


def describe_rows(base: DehazeTrainConfig, recording: Path) -> dict[str, Any]:
    """What the rows are made with, but for machine, budget and seed: JSON values."""
    left_out = (*MACHINE, *BUDGET, "seed")
    recipe = {name: value for name, value in asdict(base).items() if name not in left_out}
    return {**recipe, "recording": str(recording.resolve())}


def train_rows(trainings: Sequence[Training], recording: Path) -> dict[str, dict[str, float]]:
    """Train what is not finished, in order, on pairs with depth; the same call goes on.

    Returns:
        steps and minutes (means over the seeds) of each row, by key.
    """
    spent: dict[str, list[dict[str, float]]] = {}
    for k, training in enumerate(trainings, 1):
        row, recipe, folder = training.row, training.recipe, training.folder
        print(f"training {k} of {len(trainings)}: {row.name}, seed {recipe.seed}", flush=True)
        if is_finished(recipe, folder, ONNX_FILE):
            print("finished before", flush=True)
        else:
            train_dehaze(recipe, [recording], folder)
        progress = read_progress(folder) or {}
        spent.setdefault(row.key, []).append({"steps": progress["step"], "minutes": progress["seconds"] / 60})
    return {
        key: {name: float(np.mean([each[name] for each in figures])) for name in figures[0]}
        for key, figures in spent.items()
    }


def check_pairs(recording: Path, held_out: float) -> tuple[int, int]:
    """Height and width, px, of the recording's pictures as training sees them.

    Raises:
        ValueError: no pairs, recorded in haze and in clear air, to train on and to hold out.
    """
    source = open_recording(recording)
    if round(held_out * len(source)) < 1:
        raise ValueError(f"{recording}: {len(source)} pairs are too few to hold {100 * held_out:g} % of them out")
    for frame in source:
        truth = frame.truth
        visibility_m = math.inf if truth is None or truth.visibility_m is None else truth.visibility_m
        if truth is None or truth.clear_rgb is None or math.isinf(visibility_m):
            raise ValueError(f"{recording}: {frame.file} is no pair of a hazy and a clear picture")
        height, width = shrink(truth.clear_rgb, DehazeTrainConfig.working_long_side_px)[0].shape[:2]
        return height, width
    raise ValueError(f"{recording}: no frame can be read")
