"""Train the line detector: `train_detect`. A plain loop that resumes from its own checkpoint."""

import json
import time
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor

from deckline.train.checkpoint import load_checkpoint, read_progress, save_checkpoint, stop_on_interrupt
from deckline.train.detect_augment import DetectAugmentation
from deckline.train.detect_data import LineViews, batches, make_batch
from deckline.train.detect_finish import export_detect, validate
from deckline.train.detect_losses import DetectTargets, LossWeights
from deckline.train.detect_start import settle_norms, start_detector
from deckline.train.detectors import DETECTORS_TO_TRAIN
from deckline.train.line_network import LineNetwork
from deckline.train.network_cost import count_parameters
from deckline.train.schedule import averaged, fraction_done, learning_rate
from deckline.train.ufld import Ufld, UfldConfig

START_VIEWS = 24  # whose statistics the batch norms of another training's weights are given
SMOOTHING = 0.98  # of the printed losses
Network = Literal["deckline", "hybrid", "ufld-r18", "enet-sad", "resa-r18"]


@dataclass(frozen=True)
class DetectTrainConfig:
    """Recipe; its defaults are made for an hour of two CPU cores."""

    network: Network = "deckline"  # the shipped one, its successor, or one to compare it with
    shape: UfldConfig = field(default_factory=UfldConfig)  # of `deckline`; the others' are fixed
    steps: int = 1_000_000
    minutes: float | None = 60.0  # stop after so much training time; the schedule follows whichever ends first
    cpu_minutes: bool = False  # they are of this process's computing, on all cores: the same budget on a busy machine
    batch: int = 8
    lr: float = 1.5e-3  # of the heads
    backbone_lr: float = 0.3  # relative to the heads'
    lr_end: float = 1e-6
    warm_up: float = 0.03  # of the run
    weight_decay: float = 1e-3
    clip_norm: float = 5.0  # of the gradient
    ema_decay: float = 0.995  # of the averaged weights, which are the ones exported
    held_out: float = 0.05  # of every recording, for validation
    checkpoint_every: int = 200  # steps
    threads: int = 0  # of torch on a CPU; 0 leaves torch's own choice
    device: Literal["auto", "cpu", "cuda"] = "auto"
    bf16: bool | None = None  # half of the arithmetic in bfloat16; None: on CUDA only (a CPU needs AVX512-BF16 or AMX)
    seed: int = 0
    augment: DetectAugmentation = field(default_factory=DetectAugmentation)
    losses: LossWeights = field(default_factory=LossWeights)

    def __post_init__(self) -> None:
        for name in ("steps", "batch", "checkpoint_every"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.minutes is not None and self.minutes <= 0:
            raise ValueError(f"minutes must be positive, got {self.minutes}")
        if self.network not in get_args(Network):
            raise ValueError(f"network must be one of {', '.join(get_args(Network))}, got {self.network!r}")


@dataclass(eq=False)
class _Run:
    """What a checkpoint holds."""

    model: LineNetwork
    optimizer: torch.optim.Optimizer
    ema: dict[str, Tensor]
    step: int = 0
    seconds: float = 0.0


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
    if config.threads:
        torch.set_num_threads(config.threads)
    torch.manual_seed(config.seed)
    device = torch.device(_device(config.device))
    model = _new_network(config)
    views = LineViews(recordings, config.held_out)
    if start_from is not None:
        start_detector(model, start_from)
        settle_norms(model, make_batch(views, START_VIEWS, model.kind.target_grid, config.augment, [config.seed])[0])
    model.to(device)
    model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack this form
    run = _resume(config, model, _optimizer(config, model), out)
    console.print(f"{count_parameters(model)} parameters, {len(views)} views, {device}, from step {run.step}")
    if not _train(config, run, views, out, console):
        console.print(f"interrupted; give the same command again to go on from step {run.step}")
        return {}
    model.load_state_dict(run.ema)
    path = export_detect(model, out / "detect.onnx", _recipe(config), run.step)
    figures = validate(model, LineViews(recordings, config.held_out, train=False), config.augment, config.seed)
    figures |= {"steps": run.step, "minutes": run.seconds / 60}
    for name, value in figures.items():
        console.print(f"{name} = {value:.4g}")
    console.print(str(path))
    return figures


def _train(config: DetectTrainConfig, run: _Run, views: LineViews, out: Path, console: Console) -> bool:
    """Steps until the budget is used or Ctrl-C; whether the budget was used."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    recent: dict[str, float] = {}
    with stop_on_interrupt() as stopped, Progress(*columns, console=console) as progress:
        bar = progress.add_task("training", total=1.0)
        clock = time.process_time if config.cpu_minutes else time.monotonic
        last = clock()
        grid = run.model.kind.target_grid
        for image, targets in batches(views, config.batch, grid, config.augment, config.seed, run.step, config.steps):
            fraction = fraction_done(run.step, config.steps, run.seconds, config.minutes)
            if fraction >= 1 or stopped.is_set():
                break
            losses = _step(config, run, image, targets, fraction)
            run.step += 1
            run.seconds += clock() - last
            last = clock()
            recent = {name: value + SMOOTHING * (recent.get(name, value) - value) for name, value in losses.items()}
            progress.update(bar, completed=fraction, description=f"step {run.step}, loss {recent['total']:.3f}")
            if run.step % config.checkpoint_every == 0:
                _save(config, run, out)
                parts = ", ".join(f"{name} {value:.3f}" for name, value in recent.items())
                console.print(f"step {run.step}, {run.seconds / 60:.1f} min: {parts}")
    _save(config, run, out)
    return fraction_done(run.step, config.steps, run.seconds, config.minutes) >= 1


def _step(
    config: DetectTrainConfig, run: _Run, image: Tensor, targets: DetectTargets, fraction: float
) -> dict[str, float]:
    device = next(run.model.parameters()).device
    image = image.to(device, memory_format=torch.channels_last)
    targets = DetectTargets(*(tensor.to(device) for tensor in targets)).first(run.model.kind.lines)
    rate = learning_rate(fraction, config.lr, config.lr_end, config.warm_up)
    for group, scale in zip(run.optimizer.param_groups, (config.backbone_lr, 1.0), strict=True):
        group["lr"] = rate * scale
    run.model.train()
    bf16 = device.type == "cuda" if config.bf16 is None else config.bf16
    with torch.autocast(device.type, torch.bfloat16) if bf16 else nullcontext():
        output = run.model(image)
    loss, parts = run.model.loss(output, targets, config.losses, fraction)
    total = float(loss.detach())
    if not np.isfinite(total):
        raise FloatingPointError(f"loss is {total} at step {run.step}; lower lr ({config.lr}) and start again")
    run.optimizer.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(run.model.parameters(), config.clip_norm)
    run.optimizer.step()
    averaged(run.ema, run.model, config.ema_decay, run.step)
    return {"total": total, **parts}


def _new_network(config: DetectTrainConfig) -> LineNetwork:
    return Ufld(config.shape) if config.network == "deckline" else DETECTORS_TO_TRAIN[config.network]()


def _optimizer(config: DetectTrainConfig, model: LineNetwork) -> torch.optim.Optimizer:
    learned = [(name, value) for name, value in model.named_parameters() if value.requires_grad]
    backbone = [value for name, value in learned if name.startswith("backbone.")]
    rest = [value for name, value in learned if not name.startswith("backbone.")]
    groups = [{"params": backbone}, {"params": rest}]
    return torch.optim.AdamW(groups, config.lr, weight_decay=config.weight_decay)


def _resume(config: DetectTrainConfig, model: LineNetwork, optimizer: torch.optim.Optimizer, out: Path) -> _Run:
    progress = read_progress(out)
    if progress is None:
        return _Run(model, optimizer, {name: value.detach().clone() for name, value in model.state_dict().items()})
    recipe, stored = _recipe(config), progress["recipe"]
    if isinstance(stored["network"], dict):  # of checkpoints from when there was one network
        stored = stored | {"network": "deckline", "shape": stored["network"]}
    if stored != recipe:
        changed = [name for name, value in recipe.items() if stored.get(name) != value]
        raise ValueError(
            f"{out} holds a checkpoint of another recipe ({', '.join(changed)} differ): use another folder"
        )
    loaded = load_checkpoint(out, model, optimizer)
    if loaded is None or loaded[0] is None:
        raise ValueError(f"{out}: the checkpoint holds no averaged weights")
    device = next(model.parameters()).device
    ema = {name: value.to(device) for name, value in loaded[0].items()}
    return _Run(model, optimizer, ema, progress["step"], progress["seconds"])


def _save(config: DetectTrainConfig, run: _Run, out: Path) -> None:
    progress = {"recipe": _recipe(config), "step": run.step, "seconds": run.seconds}
    save_checkpoint(out, run.model, run.optimizer, run.ema, progress)


def _recipe(config: DetectTrainConfig) -> dict[str, Any]:
    """What must stay the same when a run goes on: all but budget, batch and machine; as JSON gives it back."""
    keys = asdict(config)
    for name in ("steps", "minutes", "batch", "threads", "device", "bf16", "checkpoint_every", "cpu_minutes"):
        del keys[name]
    recipe: dict[str, Any] = json.loads(json.dumps(keys))
    return recipe


def _device(wanted: str) -> str:
    if wanted == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if wanted == "cuda" and not torch.cuda.is_available():
        raise ValueError("device cuda was asked for, but torch sees no CUDA device")
    return wanted
