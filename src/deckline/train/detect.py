"""Train the line detector: `train_detect`."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from torch import Tensor

from deckline.train.detect_augment import DetectAugmentation
from deckline.train.detect_losses import DetectTargets, LossWeights
from deckline.train.detect_samples import make_batch
from deckline.train.detect_validation import export_detect, validate
from deckline.train.detect_views import open_line_views
from deckline.train.export import count_parameters
from deckline.train.line_networks import Hybrid, LineNetwork, PyramidConfig, Ufld
from deckline.train.loop import (
    RATE,
    Loss,
    Recipe,
    autocast,
    build_network,
    open_run,
    print_figures,
    select_device,
    train,
)
from deckline.train.start import settle_norms, start_detector
from deckline.train.views import make_ahead

START_VIEWS = 24  # whose statistics the batch norms of another training's weights are given


@dataclass(frozen=True)
class DetectTrainConfig(Recipe):
    """Recipe; its defaults are made for an hour of two CPU cores."""

    network: str = "hybrid"  # a shipped one, or one to compare it with
    shape: PyramidConfig = field(default_factory=PyramidConfig)  # of the shipped ones; the others' are fixed
    backbone_lr: float = 0.3  # relative to the heads'
    augment: DetectAugmentation = field(default_factory=DetectAugmentation)
    losses: LossWeights = field(default_factory=LossWeights)
    minutes: float | None = 60.0  # stop after so much training time; the schedule follows whichever ends first
    lr: float = 1.5e-3  # of the heads
    warm_up: float = 0.03  # of the run
    clip_norm: float = 5.0  # of the gradient
    ema_decay: float = 0.995  # of the averaged weights, which are the ones exported

    def identity(self) -> dict[str, Any]:
        """As of every recipe, but the batch may change."""
        return {name: value for name, value in super().identity().items() if name != "batch"}


NETWORKS: dict[str, Callable[[DetectTrainConfig], LineNetwork]] = {
    "hybrid": lambda config: Hybrid(config.shape),
    "ufld": lambda config: Ufld(config.shape),
}


def train_detect(
    config: DetectTrainConfig,
    recordings: list[Path],
    out: Path,
    start_from: Path | None = None,
    networks: Mapping[str, Callable[[DetectTrainConfig], LineNetwork]] = NETWORKS,
) -> dict[str, float]:
    """Train until the budget is used, then validate and export `out`/detect.onnx.

    Args:
        config: recipe; a checkpoint in `out` must have been made with the same one, budget, batch and machine apart.
        recordings: clear recordings with full depth and true lines, or pictures with labels.json.
        out: folder of checkpoint.safetensors and detect.onnx.
        start_from: folder of an earlier training, or its .onnx file: its averaged weights are this one's first.
        networks: what can be trained, by name.

    Returns:
        Measured figures by name.

    Raises:
        ValueError: recordings without what training needs, or another recipe's checkpoint.
        FloatingPointError: the loss stopped being a number.
        KeyboardInterrupt: after Ctrl-C; the checkpoint is written.
    """
    console = Console()
    device = select_device(config)
    model: LineNetwork = build_network(networks, config)
    views = open_line_views(recordings, config.held_out)
    grid = model.kind.target_grid
    if start_from is not None:
        start_detector(model, start_from)
        settle_norms(model, make_batch(views, START_VIEWS, grid, config.augment, [config.seed])[0])
    model.to(device)
    model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack this form
    run = open_run(config, model, _optimizer(config, model), out)
    console.print(f"{count_parameters(model)} parameters, {len(views)} views, {device}, from step {run.step}")

    def make(step: int) -> tuple[Tensor, DetectTargets]:
        return make_batch(views, config.batch, grid, config.augment, [config.seed, step])

    def loss(batch: tuple[Tensor, DetectTargets], fraction: float) -> Loss:
        image = batch[0].to(device, memory_format=torch.channels_last)
        targets = DetectTargets(*(tensor.to(device) for tensor in batch[1])).first(model.kind.lines)
        model.train()
        with autocast(config, device):
            output = model(image)
        return model.loss(output, targets, config.losses, fraction)

    train(config, run, make_ahead(make, run.step, config.steps), loss, console)
    model.load_state_dict(run.ema)
    path = export_detect(model, out / "detect.onnx", run.recipe, run.step)
    held_out = open_line_views(recordings, config.held_out, train=False)
    figures = validate(model, held_out, config.augment, config.seed)
    figures |= {"steps": run.step, "minutes": run.seconds / 60}
    print_figures(console, figures, views.skipped | held_out.skipped)
    console.print(str(path))
    return figures


def _optimizer(config: DetectTrainConfig, model: LineNetwork) -> torch.optim.Optimizer:
    learned = [(name, value) for name, value in model.named_parameters() if value.requires_grad]
    backbone = [value for name, value in learned if name.startswith("backbone.")]
    rest = [value for name, value in learned if not name.startswith("backbone.")]
    groups: list[dict[str, Any]] = [{"params": backbone, RATE: config.backbone_lr}, {"params": rest}]
    return torch.optim.AdamW(groups, config.lr, weight_decay=config.weight_decay)
