"""Train the line detector: `train_detect`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import torch
from rich.console import Console
from torch import Tensor

from deckline.train.detect_augment import DetectAugmentation
from deckline.train.detect_data import LineViews, batches, make_batch
from deckline.train.detect_finish import export_detect, validate
from deckline.train.detect_losses import DetectTargets, LossWeights
from deckline.train.detect_start import settle_norms, start_detector
from deckline.train.detectors import DETECTORS_TO_TRAIN
from deckline.train.line_network import LineNetwork
from deckline.train.network_cost import count_parameters
from deckline.train.training import RATE, Loss, Recipe, mixed, open_run, set_up, train
from deckline.train.ufld import Ufld, UfldConfig

START_VIEWS = 24  # whose statistics the batch norms of another training's weights are given
Network = Literal["deckline", "hybrid", "ufld-r18", "enet-sad", "resa-r18"]


@dataclass(frozen=True)
class DetectTrainConfig(Recipe):
    """Recipe; its defaults are made for an hour of two CPU cores."""

    network: Network = "deckline"  # the shipped one, its successor, or one to compare it with
    shape: UfldConfig = field(default_factory=UfldConfig)  # of `deckline`; the others' are fixed
    backbone_lr: float = 0.3  # relative to the heads'
    augment: DetectAugmentation = field(default_factory=DetectAugmentation)
    losses: LossWeights = field(default_factory=LossWeights)
    minutes: float | None = 60.0  # stop after so much training time; the schedule follows whichever ends first
    lr: float = 1.5e-3  # of the heads
    warm_up: float = 0.03  # of the run
    clip_norm: float = 5.0  # of the gradient
    ema_decay: float = 0.995  # of the averaged weights, which are the ones exported
    checkpoint_every: int = 200  # steps

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.network not in get_args(Network):
            raise ValueError(f"network must be one of {', '.join(get_args(Network))}, got {self.network!r}")

    def kept(self) -> dict[str, Any]:
        """As of every recipe, but the batch may change."""
        return {name: value for name, value in super().kept().items() if name != "batch"}


def train_detect(
    config: DetectTrainConfig, recordings: list[Path], out: Path, start_from: Path | None = None
) -> dict[str, float]:
    """Train until the budget is used, then validate and export `out`/detect.onnx.

    Args:
        config: recipe; a checkpoint in `out` must have been made with the same one, budget and device apart.
        recordings: clear recordings with full depth and true lines, or images with labels.json.
        out: folder of checkpoint.safetensors and detect.onnx.
        start_from: folder of an earlier training, or its .onnx file: its averaged weights are this one's first.

    Returns:
        Measured figures by name; {} when interrupted (the checkpoint is saved).

    Raises:
        ValueError: recordings without what training needs, or another recipe's checkpoint.
        FloatingPointError: the loss stopped being a number.
    """
    console = Console()
    device = set_up(config)
    model = _new_network(config)
    views = LineViews(recordings, config.held_out)
    if start_from is not None:
        start_detector(model, start_from)
        settle_norms(model, make_batch(views, START_VIEWS, model.kind.target_grid, config.augment, [config.seed])[0])
    model.to(device)
    model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack this form
    run = open_run(model, _optimizer(config, model), out, config.kept(), _of_today)
    console.print(f"{count_parameters(model)} parameters, {len(views)} views, {device}, from step {run.step}")

    def loss(batch: tuple[Tensor, DetectTargets], fraction: float) -> Loss:
        image = batch[0].to(device, memory_format=torch.channels_last)
        targets = DetectTargets(*(tensor.to(device) for tensor in batch[1])).first(model.kind.lines)
        model.train()
        with mixed(config, device):
            output = model(image)
        return model.loss(output, targets, config.losses, fraction)

    made = batches(
        views, config.batch, model.kind.target_grid, config.augment, config.seed, run.step, config.steps
    )  # fmt: skip
    if not train(config, run, made, loss, console):
        console.print(f"interrupted; give the same command again to go on from step {run.step}")
        return {}
    model.load_state_dict(run.ema)
    path = export_detect(model, out / "detect.onnx", run.recipe, run.step)
    held_out = LineViews(recordings, config.held_out, train=False)
    figures = validate(model, held_out, config.augment, config.seed)
    figures |= {"steps": run.step, "minutes": run.seconds / 60}
    for file, reason in (views.skipped | held_out.skipped).items():
        console.print(f"skipped {file}: {reason}")
    for name, value in figures.items():
        console.print(f"{name} = {value:.4g}")
    console.print(str(path))
    return figures


def _new_network(config: DetectTrainConfig) -> LineNetwork:
    return Ufld(config.shape) if config.network == "deckline" else DETECTORS_TO_TRAIN[config.network]()


def _optimizer(config: DetectTrainConfig, model: LineNetwork) -> torch.optim.Optimizer:
    learned = [(name, value) for name, value in model.named_parameters() if value.requires_grad]
    backbone = [value for name, value in learned if name.startswith("backbone.")]
    rest = [value for name, value in learned if not name.startswith("backbone.")]
    groups: list[dict[str, Any]] = [{"params": backbone, RATE: config.backbone_lr}, {"params": rest}]
    return torch.optim.AdamW(groups, config.lr, weight_decay=config.weight_decay)


def _of_today(stored: dict[str, Any]) -> dict[str, Any]:
    """A stored recipe in today's words: once there was one network, and its shape was called `network`."""
    if isinstance(stored["network"], dict):
        return stored | {"network": "deckline", "shape": stored["network"]}
    return stored
