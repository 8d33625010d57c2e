"""Train a dehazing network: `train_dehaze`. A plain loop that resumes from its own checkpoint."""

import json
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor, nn

from deckline.train.checkpoint import load_checkpoint, read_progress, save_checkpoint, stop_on_interrupt
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
from deckline.train.schedule import averaged, fraction_done, learning_rate
from deckline.train.start import start_with

PREFETCH = 3  # batches made ahead
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
class DehazeTrainConfig:
    """Recipe. The paper's: 600 k steps, batch 16, crops of 512x512, AdamW, lr 5e-4 cosine to 1e-7, PSNRLoss."""

    network: Network = "deckline"  # ours, or one to compare it with; those work at full resolution
    size: Literal["t", "s", "b"] = "t"  # of ours
    unshuffle: int = 4  # of ours: image px per px of the network's grid; 1 is the paper's full resolution
    attention: Attention = "mix"  # of ours; depthwise is for the ablation
    transformer: Transformer = "mobilevit"  # of ours; plain is for the ablation
    prior: bool = False  # ours, coarse: starts from the geometry dehazer's picture where there is one
    steps: int = 600_000
    minutes: float | None = None  # stop after so much training time; the schedule follows whichever ends first
    cpu_minutes: bool = False  # they are of this process's computing, on all cores: the same budget on a busy machine
    batch: int = 4
    crop_height: int = 288  # px
    crop_width: int = 512  # px
    lr: float = 5e-4
    lr_end: float = 1e-7
    warm_up: float = 0.02  # of the run
    weight_decay: float = 4e-3
    visible_share: float = 0.5  # of the loss is PSNRLoss weighted by transmission; the paper's is 0
    best_psnr_db: float = 50.0  # better than that earns nothing, or the clear images would outweigh the hazy ones
    clip_norm: float = 1.0  # of the gradient
    ema_decay: float = 0.999  # of the averaged weights, which are the ones exported
    held_out: float = 0.05  # of every recording, for validation
    working_long_side_px: int = 640  # a coarse network sees larger images averaged down to about this
    checkpoint_every: int = 500  # steps
    bf16: bool | None = None  # half of the arithmetic in bfloat16; None: on CUDA only (a CPU needs AVX512-BF16 or AMX)
    threads: int = 0  # of torch on a CPU; 0 leaves torch's own choice
    device: Literal["auto", "cpu", "cuda"] = "auto"
    seed: int = 0
    haze: HazeAugmentation = field(default_factory=HazeAugmentation)

    def __post_init__(self) -> None:
        for name in ("steps", "batch", "crop_height", "crop_width", "checkpoint_every", "unshuffle"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.minutes is not None and self.minutes <= 0:
            raise ValueError(f"minutes must be positive, got {self.minutes}")
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
    if config.threads:
        torch.set_num_threads(config.threads)
    device = torch.device(_device(config.device))
    torch.manual_seed(config.seed)
    model = _new_network(config).to(device).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimizer = torch.optim.AdamW(model.parameters(), config.lr, (0.9, 0.999), weight_decay=config.weight_decay)
    if start_from is not None:
        start_with(model, start_from)
    ema, step, seconds = _resume(config, model, optimizer, out)
    views = ClearViews(recordings, config.working_long_side_px, config.held_out)
    console.print(f"{count_parameters(model)} parameters, {len(views)} views, {device}, from step {step}")
    step, finished = _run(config, model, optimizer, ema, views, out, step, seconds, console)
    for file, reason in views.skipped.items():
        console.print(f"skipped {file}: {reason}")
    if not finished:
        console.print(f"interrupted; give the same command again to go on from step {step}")
        return {}
    model.load_state_dict(ema)
    path = export_dehaze(
        model, out / "dehaze.onnx", _network_metadata(config), config.working_long_side_px, _recipe(config), step
    )
    held_out = ClearViews(recordings, config.working_long_side_px, config.held_out, train=False)
    figures = validate(model, held_out, config.seed, config.prior)
    for name, value in figures.items():
        console.print(f"{name} = {value:.4g}")
    (out / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")
    console.print(str(path))
    return figures


def _run(
    config: DehazeTrainConfig,
    model: nn.Module,
    optimizer: torch.optim.Optimizer,
    ema: dict[str, Tensor],
    views: ClearViews,
    out: Path,
    step: int,
    seconds: float,
    console: Console,
) -> tuple[int, bool]:
    """Steps until the budget is used or Ctrl-C; returns (steps done, whether the budget was used)."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    recent = 0.0
    with stop_on_interrupt() as stopped, Progress(*columns, console=console) as progress:
        bar = progress.add_task("training", total=1.0)
        clock = time.process_time if config.cpu_minutes else time.monotonic
        last = clock()
        for batch in _batches(config, views, step):
            fraction = fraction_done(step, config.steps, seconds, config.minutes)
            if fraction >= 1 or stopped.is_set():
                break
            rate = learning_rate(fraction, config.lr, config.lr_end, config.warm_up)
            loss = _step(model, optimizer, batch, rate, config)
            if not np.isfinite(loss):
                raise FloatingPointError(f"loss is {loss} at step {step}; lower lr ({config.lr}) and start again")
            averaged(ema, model, config.ema_decay, step)
            step += 1
            seconds += clock() - last
            last = clock()
            recent = -loss if recent == 0 else 0.98 * recent - 0.02 * loss
            progress.update(bar, completed=fraction, description=f"step {step}, loss {-recent:.2f} dB")
            if step % config.checkpoint_every == 0:
                _save(config, model, optimizer, ema, step, seconds, out)
                console.print(f"step {step}, {seconds / 60:.1f} min, lr {rate:.2e}, loss {-recent:.2f} dB")
    _save(config, model, optimizer, ema, step, seconds, out)
    return step, fraction_done(step, config.steps, seconds, config.minutes) >= 1


def _step(
    model: nn.Module, optimizer: torch.optim.Optimizer, batch: Batch, rate: float, config: DehazeTrainConfig
) -> float:
    device = next(model.parameters()).device
    hazy, clear, t, prior = (x.to(device, memory_format=torch.channels_last) for x in batch)
    for group in optimizer.param_groups:
        group["lr"] = rate
    bf16 = device.type == "cuda" if config.bf16 is None else config.bf16
    with torch.autocast(device.type, torch.bfloat16) if bf16 else nullcontext():
        restored = model(prior, torch.cat([hazy, prior], 1)) if config.prior else model(hazy)
        loss = dehaze_loss(restored.float(), clear, t, config.visible_share, config.best_psnr_db)
    optimizer.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(model.parameters(), config.clip_norm)
    optimizer.step()
    return loss.item()


def _batches(config: DehazeTrainConfig, views: ClearViews, start: int) -> Iterator[Batch]:
    """Batches of the steps from `start` on, made ahead by threads."""
    crop = (config.crop_height, config.crop_width)

    def batch(step: int) -> Batch:
        return training_batch(views, config.batch, crop, config.haze, [config.seed, step], config.prior)

    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(batch, start + k) for k in range(PREFETCH)]
        try:
            for step in range(start, config.steps + 1):
                waiting.append(pool.submit(batch, step + PREFETCH))
                yield waiting.pop(0).result()
        finally:
            pool.shutdown(cancel_futures=True)


def _new_network(config: DehazeTrainConfig) -> nn.Module:
    return DehazeNetwork(config.shape) if config.network == "deckline" else build(config.network)


def _network_metadata(config: DehazeTrainConfig) -> dict[str, Any]:
    """What the network was built from; the others' shapes are fixed by their names."""
    shape = network_metadata(config.shape) if config.network == "deckline" else {"unshuffle": 1}
    return {"name": config.network} | shape


def _resume(
    config: DehazeTrainConfig, model: nn.Module, optimizer: torch.optim.Optimizer, out: Path
) -> tuple[dict[str, Tensor], int, float]:
    progress = read_progress(out)
    if progress is None:
        return {name: value.detach().clone() for name, value in model.state_dict().items()}, 0, 0.0
    stored = OLDER_RECIPE | progress["recipe"]
    stored["haze"] = {"physical_share": 0.0, "recorded_share": 0.0, "prior_share": 0.5} | stored["haze"]
    if stored != _recipe(config):
        changed = [name for name, value in _recipe(config).items() if stored.get(name) != value]
        raise ValueError(
            f"{out} holds a checkpoint of another recipe ({', '.join(changed)} differ): use another folder"
        )
    loaded = load_checkpoint(out, model, optimizer)
    if loaded is None or loaded[0] is None:
        raise ValueError(f"{out}: the checkpoint holds no averaged weights")
    device = next(model.parameters()).device
    return {name: value.to(device) for name, value in loaded[0].items()}, progress["step"], progress["seconds"]


def _save(
    config: DehazeTrainConfig,
    model: nn.Module,
    optimizer: torch.optim.Optimizer,
    ema: dict[str, Tensor],
    step: int,
    seconds: float,
    out: Path,
) -> None:
    save_checkpoint(out, model, optimizer, ema, {"recipe": _recipe(config), "step": step, "seconds": seconds})


def _recipe(config: DehazeTrainConfig) -> dict[str, Any]:
    """What must stay the same when a run goes on: all but budget and machine; tuples as JSON gives them back."""
    keys = asdict(config)
    for name in ("steps", "minutes", "threads", "device", "bf16", "checkpoint_every", "cpu_minutes"):
        del keys[name]
    keys["haze"] = {name: list(v) if isinstance(v, tuple) else v for name, v in keys["haze"].items()}
    return keys


def _device(wanted: str) -> str:
    if wanted == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if wanted == "cuda" and not torch.cuda.is_available():
        raise ValueError("device cuda was asked for, but torch sees no CUDA device")
    return wanted
