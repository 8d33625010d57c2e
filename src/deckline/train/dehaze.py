"""Train a dehazing network: `train_dehaze`."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import torch
from rich.console import Console
from torch import Tensor, nn

from deckline.train.dehaze_data import ClearViews, training_batch
from deckline.train.dehaze_finish import export_dehaze, validate
from deckline.train.dehaze_haze import HazeAugmentation
from deckline.train.dehaze_network import (
    SIZES,
    Attention,
    DehazeNetwork,
    DehazeNetworkConfig,
    Transformer,
    network_metadata,
)
from deckline.train.network_cost import count_parameters
from deckline.train.rivals import build
from deckline.train.start import start_with
from deckline.train.training import Loss, Recipe, mixed, open_run, set_up, train
from deckline.train.views import made_ahead

# What checkpoints do not say that are older than the choice: the one network that there was.
OLDER_RECIPE = {
    "network": "deckline",
    "attention": "mix",
    "transformer": "mobilevit",
    "prior": False,
    "best_psnr_db": 50.0,
}
Network = Literal["deckline", "aod-net", "gca-net", "grid-dehaze-net", "g-unet-t", "dehaze-former-t"]
Batch = tuple[Tensor, Tensor, Tensor, Tensor]  # hazy, clear, transmission, prior


@dataclass(frozen=True)
class DehazeTrainConfig(Recipe):
    """Recipe. The paper's: 600 k steps, batch 16, crops of 512x512, AdamW, lr 5e-4 cosine to 1e-7, PSNRLoss."""

    COUNTS = (*Recipe.COUNTS, "crop_height", "crop_width", "unshuffle")

    network: Network = "deckline"  # ours, or one to compare it with; those work at full resolution
    size: Literal["t", "s", "b"] = "t"  # of ours
    unshuffle: int = 4  # of ours: image px per px of the network's grid; 1 is the paper's full resolution
    attention: Attention = "mix"  # of ours; depthwise is for the ablation
    transformer: Transformer = "mobilevit"  # of ours; plain is for the ablation
    prior: bool = False  # ours, coarse: starts from the geometry dehazer's picture where there is one
    crop_height: int = 288  # px
    crop_width: int = 512  # px
    visible_share: float = 0.5  # of the loss is PSNRLoss weighted by transmission; the paper's is 0
    best_psnr_db: float = 50.0  # better than that earns nothing, or the clear images would outweigh the hazy ones
    working_long_side_px: int = 640  # a coarse network sees larger images averaged down to about this
    haze: HazeAugmentation = field(default_factory=HazeAugmentation)
    steps: int = 600_000
    batch: int = 4
    lr: float = 5e-4
    lr_end: float = 1e-7
    weight_decay: float = 4e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.network not in get_args(Network):
            raise ValueError(f"network must be one of {', '.join(get_args(Network))}, got {self.network!r}")
        if self.size not in SIZES:
            raise ValueError(f"size must be one of {', '.join(SIZES)}, got {self.size!r}")

    @property
    def shape(self) -> DehazeNetworkConfig:
        """Of our network."""
        return replace(
            SIZES[self.size],
            unshuffle=self.unshuffle,
            prior=self.prior,
            attention=self.attention,
            transformer=self.transformer,
        )


def psnr_loss(
    restored: Tensor, clear: Tensor, weight: Tensor | None = None, best_psnr_db: float = DehazeTrainConfig.best_psnr_db
) -> Tensor:
    """PSNRLoss: mean over images of -PSNR in dB. Source: SPEC section 2.

    Args:
        restored, clear: (B, 3, H, W) in 0..1.
        weight: (B, 1, H, W) of each pixel's squared error; None counts all alike.
        best_psnr_db: what a perfect picture counts as.
    """
    squared = ((restored - clear) ** 2).mean(1, keepdim=True)
    weight = torch.ones_like(squared) if weight is None else weight
    total = weight.sum((1, 2, 3)).clamp(min=1)  # an image that shows less than one pixel's worth teaches nothing
    mse = (weight * squared).sum((1, 2, 3)) / total
    return 10 * torch.log10(mse + 10 ** (-best_psnr_db / 10)).mean()


def dehaze_loss(
    restored: Tensor,
    clear: Tensor,
    t: Tensor,
    visible_share: float,
    best_psnr_db: float = DehazeTrainConfig.best_psnr_db,
) -> Tensor:
    """PSNRLoss over the whole image, and over what still shows through the haze (weighted by transmission t).

    The sky and far water are hidden completely and their error cannot be learned away; without the second part it
    would drown the deck's.
    """
    whole, visible = (psnr_loss(restored, clear, weight, best_psnr_db) for weight in (None, t))
    return (1 - visible_share) * whole + visible_share * visible


def train_dehaze(
    config: DehazeTrainConfig, recordings: list[Path], out: Path, start_from: Path | None = None
) -> dict[str, float]:
    """Train until the budget is used, then validate and export `out`/dehaze.onnx.

    Args:
        config: recipe; a checkpoint in `out` must have been made with the same one, budget and device apart.
        recordings: clear recordings with full depth.
        out: folder of checkpoint.safetensors, dehaze.onnx and figures.json.
        start_from: folder of an earlier training, or its .onnx file: its averaged weights are this one's first.

    Returns:
        Measured figures by name; {} when interrupted (the checkpoint is saved).

    Raises:
        ValueError: recordings without what training needs, or another recipe's checkpoint.
        FloatingPointError: the loss stopped being a number.
    """
    console = Console()
    device = set_up(config)
    model = _new_network(config).to(device).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimizer = torch.optim.AdamW(model.parameters(), config.lr, (0.9, 0.999), weight_decay=config.weight_decay)
    if start_from is not None:
        start_with(model, start_from)
    run = open_run(model, optimizer, out, config.kept(), _of_today)
    views = ClearViews(recordings, config.working_long_side_px, config.held_out)
    console.print(f"{count_parameters(model)} parameters, {len(views)} views, {device}, from step {run.step}")

    def loss(batch: Batch, fraction: float) -> Loss:
        hazy, clear, t, prior = (x.to(device, memory_format=torch.channels_last) for x in batch)
        with mixed(config, device):
            restored = model(prior, torch.cat([hazy, prior], 1)) if config.prior else model(hazy)
            return dehaze_loss(restored.float(), clear, t, config.visible_share, config.best_psnr_db), {}

    finished = train(config, run, _batches(config, views, run.step), loss, console)
    for file, reason in views.skipped.items():
        console.print(f"skipped {file}: {reason}")
    if not finished:
        console.print(f"interrupted; give the same command again to go on from step {run.step}")
        return {}
    model.load_state_dict(run.ema)
    path = export_dehaze(
        model, out / "dehaze.onnx", _network_metadata(config), config.working_long_side_px, run.recipe, run.step
    )
    held_out = ClearViews(recordings, config.working_long_side_px, config.held_out, train=False)
    figures = validate(model, held_out, config.seed, config.prior)
    for name, value in figures.items():
        console.print(f"{name} = {value:.4g}")
    (out / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
    console.print(str(path))
    return figures


def _batches(config: DehazeTrainConfig, views: ClearViews, start: int) -> Iterator[Batch]:
    """Batches of the steps from `start` on, made ahead by threads."""
    crop = (config.crop_height, config.crop_width)

    def make(step: int) -> Batch:
        return training_batch(views, config.batch, crop, config.haze, [config.seed, step], config.prior)

    return made_ahead(make, start, config.steps)


def _new_network(config: DehazeTrainConfig) -> nn.Module:
    return DehazeNetwork(config.shape) if config.network == "deckline" else build(config.network)


def _network_metadata(config: DehazeTrainConfig) -> dict[str, Any]:
    """What the network was built from; the others' shapes are fixed by their names."""
    shape = network_metadata(config.shape) if config.network == "deckline" else {"unshuffle": 1}
    return {"name": config.network} | shape


def _of_today(stored: dict[str, Any]) -> dict[str, Any]:
    """A stored recipe with what older ones do not say."""
    haze = {"physical_share": 0.0, "recorded_share": 0.0, "prior_share": 0.5} | stored["haze"]
    return OLDER_RECIPE | stored | {"haze": haze}
