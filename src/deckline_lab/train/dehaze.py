"""Train a dehazing network: the recipe, the loss, the training, figures on held-out views, and the ONNX file."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from torch import Tensor, nn

from deckline.dehaze.tensors import image_to_tensor, tensor_to_image
from deckline.haze import add_haze, beta_from_visibility
from deckline_lab.evaluation.metrics import SSIM_WINDOW_PX, psnr_db, ssim
from deckline_lab.train.airlight import random_airlight
from deckline_lab.train.clear_views import ClearView
from deckline_lab.train.dehaze_network import SHAPES, Attention, DehazeNetwork, DehazeNetworkConfig, Transformer
from deckline_lab.train.dehaze_samples import HazeAugmentation, geometry_prior, make_batch
from deckline_lab.train.export import count_parameters, export_onnx, network_cost
from deckline_lab.train.loop import (
    HELD_OUT_BATCHES,
    Loss,
    Recipe,
    TrainingRun,
    autocast,
    build_network,
    open_run,
    print_figures,
    select_device,
    train,
)
from deckline_lab.train.pair_views import PairView, open_clear_views
from deckline_lab.train.photographs import open_photographs
from deckline_lab.train.start import start_with
from deckline_lab.train.view_sets import Views, make_ahead

ONNX_FILE = "dehaze.onnx"
Batch = tuple[Tensor, Tensor, Tensor, Tensor]  # hazy, clear, transmission, prior
BEST_LOSS_PSNR_DB = 50.0  # better than that earns nothing, or the clear images would outweigh the hazy ones
VALIDATION_VISIBILITY_M = (500.0, 3000.0)  # uniform; the range that the project's mark is set for
VALIDATION_VIEWS = 120  # at most, spread over the held-out ones
HORIZON_SHARE = 1.0  # of the airlights: haze by day has the colour of the sky at the horizon
BEST_PSNR_DB = 60.0  # replaces the infinite PSNR of an unchanged view in means


@dataclass(frozen=True)
class DehazeTrainConfig(Recipe):
    """Recipe. The paper's is recipes/published.toml."""

    COUNTS = (*Recipe.COUNTS, "crop_height", "crop_width")

    network: str = "coarse-t"  # ours (SHAPES), or one to compare it with; those work at full resolution
    attention: Attention = "mix"  # of ours; depthwise is for the ablation
    transformer: Transformer = "mobilevit"  # of ours; plain is for the ablation
    prior: bool = False  # ours, coarse: starts from the geometry dehazer's picture where there is one
    crop_height: int = 288  # px
    crop_width: int = 512  # px
    sub_images: bool = False  # crops, square ones, are the paper's eight overlapping squares of a picture
    visible_share: float = 0.5  # of the loss is PSNRLoss weighted by transmission; the paper's is 0
    best_psnr_db: float = BEST_LOSS_PSNR_DB  # of the loss
    working_long_side_px: int = 640  # a coarse network sees larger images averaged down to about this
    haze: HazeAugmentation = field(default_factory=HazeAugmentation)
    steps: int = 600_000
    batch: int = 4
    lr: float = 5e-4
    lr_end: float = 1e-7
    weight_decay: float = 4e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sub_images and self.crop_height != self.crop_width:
            sides = f"crop_height {self.crop_height} and crop_width {self.crop_width}"
            raise ValueError(f"sub_images are squares: expected equal sides, got {sides}")

    @property
    def shape(self) -> DehazeNetworkConfig | None:
        """Of our network; None of another one."""
        if self.network not in SHAPES:
            return None
        shape = SHAPES[self.network]
        return replace(shape, prior=self.prior, attention=self.attention, transformer=self.transformer)


def build_ours(config: DehazeTrainConfig) -> DehazeNetwork:
    """Our network in the recipe's shape."""
    if config.shape is None:
        raise ValueError(f"network must be one of {', '.join(SHAPES)}, got {config.network!r}")
    return DehazeNetwork(config.shape)


NETWORKS: dict[str, Callable[[DehazeTrainConfig], nn.Module]] = dict.fromkeys(SHAPES, build_ours)


def psnr_loss(
    restored: Tensor, clear: Tensor, weight: Tensor | float = 1.0, best_psnr_db: float = BEST_LOSS_PSNR_DB
) -> Tensor:
    """PSNRLoss: mean over images of -PSNR in dB. Source: Li et al. 2024, section 4.1.1.

    Args:
        restored, clear: (B, 3, H, W) in 0..1.
        weight: (B, 1, H, W) of each pixel's squared error.
        best_psnr_db: what a perfect picture counts as.
    """
    squared = ((restored - clear) ** 2).mean(1, keepdim=True)
    weight = weight * torch.ones_like(squared)
    total = weight.sum((1, 2, 3)).clamp(min=1)  # an image that shows less than one pixel's worth teaches nothing
    mse = (weight * squared).sum((1, 2, 3)) / total
    return 10 * torch.log10(mse + 10 ** (-best_psnr_db / 10)).mean()


def dehaze_loss(
    restored: Tensor, clear: Tensor, t: Tensor, visible_share: float, best_psnr_db: float = BEST_LOSS_PSNR_DB
) -> Tensor:
    """PSNRLoss over the whole image, and over what still shows through the haze (weighted by transmission t).

    The sky and far water are hidden completely and their error cannot be learned away; without the second part it
    would drown the deck's.
    """
    whole, visible = (psnr_loss(restored, clear, weight, best_psnr_db) for weight in (1.0, t))
    return (1 - visible_share) * whole + visible_share * visible


def train_dehaze(
    config: DehazeTrainConfig,
    recordings: list[Path],
    out: Path,
    start_from: Path | None = None,
    networks: Mapping[str, Callable[[DehazeTrainConfig], nn.Module]] = NETWORKS,
    photographs: Path | None = None,
) -> dict[str, float]:
    """Train until the budget is used, then validate and export; returns the measured figures, none without held-out
    views.

    Args:
        config: recipe; a checkpoint in `out` must have been made with the same one, budget and machine apart.
        recordings: clear recordings with full depth, and labelled folders with pairs of a hazy and a clear picture.
        out: folder of checkpoint.safetensors, losses.csv, losses.png, dehaze.onnx and figures.json.
        start_from: folder of an earlier training, or its .onnx file: its averaged weights are this one's first.
        networks: what can be trained, by name.
        photographs: folder of clear photographs, for pictures without a pose; their depth is made up.
    """
    console = Console()
    device = select_device(config)
    model = build_network(networks, config).to(device).to(memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(model.parameters(), config.lr, (0.9, 0.999), weight_decay=config.weight_decay)
    if start_from is not None:
        start_with(model, start_from)
    run = open_run(config, model, optimizer, out)
    open_part = partial(open_clear_views, recordings, config.working_long_side_px, config.held_out)
    views, held_out = open_part(True), open_part(False) if config.held_out else None
    console.print(f"{count_parameters(model)} parameters, {len(views)} views, {device}, from step {run.step}")
    crop, size = (config.crop_height, config.crop_width), config.working_long_side_px
    real = None if photographs is None else open_photographs(photographs, size, config.held_out)

    def make(step: int, views: Views[ClearView | PairView] = views, real: Views[ClearView] | None = real) -> Batch:
        seed = [config.seed, step]
        return make_batch(views, config.batch, crop, config.haze, seed, config.prior, real, config.sub_images)

    def restore(batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        hazy, clear, t, prior = (x.to(device, memory_format=torch.channels_last) for x in batch)
        with autocast(config, device):
            restored = model(prior, torch.cat([hazy, prior], 1)) if config.prior else model(hazy)
        return restored.float(), clear, t

    def loss(batch: Batch, fraction: float) -> Loss:
        return dehaze_loss(*restore(batch), config.visible_share, config.best_psnr_db), {}

    def figures_of(batch: Batch) -> dict[str, float]:
        model.eval()
        figures = batch_figures(*restore(batch)[:2])
        model.train()
        return figures

    measured = [make(k, held_out, None) for k in range(HELD_OUT_BATCHES)] if held_out else []
    train(config, run, make_ahead(make, run.step, config.steps), loss, console, measured, figures_of)
    figures = _finish(config, run, held_out)
    print_figures(console, figures, views.skipped | (held_out.skipped if held_out else {}))
    console.print(str(out / ONNX_FILE))
    return figures


def _finish(
    config: DehazeTrainConfig, run: TrainingRun, held_out: Views[ClearView | PairView] | None
) -> dict[str, float]:
    """Export the averaged weights, and measure them on held-out views."""
    run.model.load_state_dict(run.ema)
    shape = {"unshuffle": 1} | getattr(run.model, "grid", {}) if config.shape is None else asdict(config.shape)
    network, path = {"name": config.network, **shape}, run.out / ONNX_FILE
    export_dehaze(run.model, path, network, config.working_long_side_px, run.recipe, run.step)
    figures = validate(run.model, held_out, config.seed, config.prior) if held_out else {}
    (run.out / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
    return figures


def batch_figures(restored: Tensor, clear: Tensor) -> dict[str, float]:
    """Means of PSNR (dB) and SSIM over a batch (B, 3, H, W) in 0..1; SSIM where the crops hold its window."""
    images = [[tensor_to_image(x[None].cpu().numpy()) for x in pair] for pair in zip(restored, clear, strict=True)]
    figures = {"psnr_db": float(np.mean([min(psnr_db(a, b), BEST_PSNR_DB) for a, b in images]))}
    if min(clear.shape[2:]) >= SSIM_WINDOW_PX:
        figures["ssim"] = float(np.mean([ssim(a, b) for a, b in images]))
    return figures


@torch.no_grad()
def validate(model: nn.Module, views: Views[ClearView | PairView], seed: int, prior: bool = False) -> dict[str, float]:
    """PSNR (dB) and SSIM on whole held-out views, hazy as they come and dehazed; PSNR without the sky; PSNR on
    haze-free views. A network that takes a prior is measured without one; its PSNR also with one. Pairs retain
    their haze, and their sky is not known.

    Haze depends on `seed` and the view alone, so that runs can be compared.
    """
    was_training = model.training
    model.eval()
    rows = []
    for index in views.spread(VALIDATION_VIEWS):
        view = views.get_usable(index)
        if view is not None:
            rows.append(_figures(model, view, np.random.default_rng([seed, index]), prior))
    model.train(was_training)
    if not rows:
        raise ValueError(f"no held-out frame can be used: {views.skipped}")
    means = {name: float(np.mean([min(row[name], BEST_PSNR_DB) for row in rows])) for name in rows[0]}
    return {**means, "views": float(len(rows))}


def _figures(model: nn.Module, view: ClearView | PairView, rng: np.random.Generator, prior: bool) -> dict[str, float]:
    clear = view.clear_rgb
    if isinstance(view, PairView):
        hazy, surface = view.hazy_rgb, np.ones(clear.shape[:2], np.bool_)
    else:
        airlight = random_airlight(view.horizon_rgb, HORIZON_SHARE, rng)
        hazy = add_haze(clear, view.range_m, beta_from_visibility(rng.uniform(*VALIDATION_VISIBILITY_M)), airlight)
        surface = np.isfinite(view.range_m)  # sea and ship

    def surface_psnr_db(image: NDArray[np.uint8]) -> float:
        return psnr_db(image[surface][None], clear[surface][None])

    dehazed = _dehaze(model, hazy, hazy if prior else None)
    figures = {
        "psnr_db_hazy.mean": psnr_db(hazy, clear),
        "psnr_db.mean": psnr_db(dehazed, clear),
        "psnr_db_clear_air.mean": psnr_db(_dehaze(model, clear, clear if prior else None), clear),
        "psnr_db_surface_hazy.mean": surface_psnr_db(hazy),
        "psnr_db_surface.mean": surface_psnr_db(dehazed),
        "ssim_hazy.mean": ssim(hazy, clear),
        "ssim.mean": ssim(dehazed, clear),
    }
    if prior:
        with_prior = _dehaze(model, hazy, geometry_prior(view, hazy, rng))
        figures["psnr_db_with_prior.mean"] = psnr_db(with_prior, clear)
        figures["psnr_db_surface_with_prior.mean"] = surface_psnr_db(with_prior)
    return figures


def export_dehaze(
    model: nn.Module, path: Path, network: dict[str, Any], working_long_side_px: int, recipe: dict[str, Any], step: int
) -> Path:
    """Write the network as ONNX with dynamic height and width; recipe and network config go into the metadata.

    A coarse network's file takes a working image whose sides are multiples of `unshuffle`, and an image larger by a
    whole factor; OnnxDehazer pads images to that. A full-resolution network's file takes any size.

    Args:
        model: takes an image (1, 3, H, W), and a working image where `network` has an `unshuffle` above 1, of six
            channels where it has a `prior`.
        path: of the file.
        network: what the model was built from; its `unshuffle` is 1 for every network at full resolution. It may hold
            the shortest side of a working image, `min_side_px`.
        working_long_side_px: the size of images that it was trained on.
        recipe, step: of the training.
    """
    coarse, prior = network["unshuffle"] > 1, network.get("prior", False)
    device = next(model.parameters()).device
    dynamic = {"image": {2: "height", 3: "width"}, "clear": {2: "height", 3: "width"}}
    args = [torch.rand(1, 3, 256, 384, device=device)]
    if coarse:
        dynamic["working"] = {2: "working_height", 3: "working_width"}
        args.append(torch.rand(1, 6 if prior else 3, 128, 192, device=device))
    cost = network_cost(model, channels=(3, 6) if prior else (3,))
    metadata = {"kind": "dehaze", "network": network, "parameters": cost.parameters, "macs_256": cost.macs}
    metadata |= {"working_long_side_px": working_long_side_px, "recipe": recipe, "step": step}
    names = ["image", "working"] if coarse else ["image"]
    return export_onnx(model, tuple(args), path, names, ["clear"], dynamic, metadata)


def _dehaze(model: nn.Module, image_rgb: NDArray[np.uint8], prior_rgb: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    device = next(model.parameters()).device
    hazy, *prior = (
        torch.from_numpy(image_to_tensor(image)).to(device) for image in (image_rgb, prior_rgb) if image is not None
    )
    restored = model(*prior, torch.cat([hazy, *prior], 1)) if prior else model(hazy)
    return tensor_to_image(restored.float().cpu().numpy())
