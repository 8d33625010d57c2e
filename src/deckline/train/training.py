"""What the trainings share: a plain loop under a budget that resumes from its own checkpoint."""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np
import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor, nn

from deckline.train.checkpoint import load_checkpoint, read_progress, save_checkpoint, stop_on_interrupt
from deckline.train.schedule import averaged, fraction_done, learning_rate

SMOOTHING = 0.98  # of the printed losses
RATE = "rate"  # of a group of parameters, relative to the recipe's
MACHINE = ("threads", "device", "bf16", "checkpoint_every")  # of a recipe, that may change when a run goes on
BUDGET = ("steps", "minutes", "cpu_minutes")

Batch = TypeVar("Batch")
Loss = tuple[Tensor, Mapping[str, float]]  # and its parts by name


@dataclass(frozen=True)
class Recipe:
    """What every training's configuration says.

    Raises:
        ValueError: a budget that is none, or a count below 1.
    """

    COUNTS: ClassVar[tuple[str, ...]] = ("steps", "batch", "checkpoint_every")

    steps: int = 1_000_000
    minutes: float | None = None  # stop after so much training time; the schedule follows whichever ends first
    cpu_minutes: bool = False  # they are of this process's computing, on all cores: the same budget on a busy machine
    batch: int = 8
    lr: float = 1e-3
    lr_end: float = 1e-6
    warm_up: float = 0.02  # of the run
    weight_decay: float = 1e-3
    clip_norm: float = 1.0  # of the gradient
    ema_decay: float = 0.999  # of the averaged weights, which are the ones exported
    held_out: float = 0.05  # of every recording, for validation
    checkpoint_every: int = 500  # steps
    threads: int = 0  # of torch on a CPU; 0 leaves torch's own choice
    device: Literal["auto", "cpu", "cuda"] = "auto"
    bf16: bool | None = None  # half of the arithmetic in bfloat16; None: on CUDA only (a CPU needs AVX512-BF16 or AMX)
    seed: int = 0

    def __post_init__(self) -> None:
        for name in self.COUNTS:
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.minutes is not None and self.minutes <= 0:
            raise ValueError(f"minutes must be positive, got {self.minutes}")

    def kept(self) -> dict[str, Any]:
        """What must stay the same when a run goes on: all but budget and machine; as JSON gives it back."""
        keys = {name: value for name, value in asdict(self).items() if name not in (*BUDGET, *MACHINE)}
        recipe: dict[str, Any] = json.loads(json.dumps(keys))
        return recipe


@dataclass(eq=False)
class Run:
    """A training under way: what a checkpoint holds.

    Args:
        recipe: what must stay the same when it goes on; plain JSON values.
        ema: averaged weights, by the model's names.
        seconds: of training so far.
    """

    model: nn.Module
    optimizer: torch.optim.Optimizer
    out: Path
    recipe: dict[str, Any]
    ema: dict[str, Tensor]
    step: int = 0
    seconds: float = 0.0
    recent: dict[str, float] = field(default_factory=dict)  # smoothed losses

    def save(self) -> None:
        progress = {"recipe": self.recipe, "step": self.step, "seconds": self.seconds}
        save_checkpoint(self.out, self.model, self.optimizer, self.ema, progress)


def set_up(config: Recipe) -> torch.device:
    """Threads, seed and device.

    Raises:
        ValueError: a CUDA device was asked for and there is none.
    """
    if config.threads:
        torch.set_num_threads(config.threads)
    torch.manual_seed(config.seed)
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ValueError("device cuda was asked for, but torch sees no CUDA device")
    return torch.device("cuda" if config.device != "cpu" and torch.cuda.is_available() else "cpu")


def open_run(
    model: nn.Module,
    optimizer: torch.optim.Optimizer,
    out: Path,
    recipe: dict[str, Any],
    of_today: Callable[[dict[str, Any]], dict[str, Any]],
) -> Run:
    """A new run, or the one whose checkpoint lies in `out`.

    Args:
        of_today: a stored recipe with what older ones do not say.

    Raises:
        ValueError: a checkpoint of another recipe, or none that can be used.
    """
    progress = read_progress(out)
    if progress is None:
        ema = {name: value.detach().clone() for name, value in model.state_dict().items()}
        return Run(model, optimizer, out, recipe, ema)
    stored = of_today(progress["recipe"])
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
    return Run(model, optimizer, out, recipe, ema, progress["step"], progress["seconds"])


def train(
    config: Recipe, run: Run, batches: Iterator[Batch], loss: Callable[[Batch, float], Loss], console: Console
) -> bool:
    """Steps until the budget is used or Ctrl-C; whether the budget was used. The run is saved either way.

    Args:
        batches: of the steps from `run.step` on.
        loss: of a batch, at a share of the budget.

    Raises:
        FloatingPointError: the loss stopped being a number.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with stop_on_interrupt() as stopped, Progress(*columns, console=console) as progress:
        bar = progress.add_task("training", total=1.0)
        clock = time.process_time if config.cpu_minutes else time.monotonic
        last = clock()
        for batch in batches:
            fraction = _fraction(config, run)
            if fraction >= 1 or stopped.is_set():
                break
            losses = _step(config, run, loss(batch, fraction), fraction)
            run.step += 1
            run.seconds += clock() - last
            last = clock()
            run.recent = {name: v + SMOOTHING * (run.recent.get(name, v) - v) for name, v in losses.items()}
            progress.update(bar, completed=fraction, description=f"step {run.step}, loss {run.recent['total']:.3f}")
            if run.step % config.checkpoint_every == 0:
                run.save()
                parts = ", ".join(f"{name} {value:.3f}" for name, value in run.recent.items())
                console.print(f"step {run.step}, {run.seconds / 60:.1f} min: {parts}")
    run.save()
    return _fraction(config, run) >= 1


def _fraction(config: Recipe, run: Run) -> float:
    return fraction_done(run.step, config.steps, run.seconds, config.minutes)


def _step(config: Recipe, run: Run, loss: Loss, fraction: float) -> dict[str, float]:
    value, parts = loss
    total = float(value.detach())
    if not np.isfinite(total):
        raise FloatingPointError(f"loss is {total} at step {run.step}; lower lr ({config.lr}) and start again")
    rate = learning_rate(fraction, config.lr, config.lr_end, config.warm_up)
    for group in run.optimizer.param_groups:
        group["lr"] = rate * group.get(RATE, 1.0)
    run.optimizer.zero_grad()
    value.backward()
    torch.nn.utils.clip_grad_norm_(run.model.parameters(), config.clip_norm)
    run.optimizer.step()
    averaged(run.ema, run.model, config.ema_decay, run.step)
    return {"total": total, **parts}


def mixed(config: Recipe, device: torch.device) -> AbstractContextManager[Any]:
    """Half of the arithmetic in bfloat16 where the recipe says so, or on CUDA where it says nothing."""
    bf16 = device.type == "cuda" if config.bf16 is None else config.bf16
    return torch.autocast(device.type, torch.bfloat16) if bf16 else nullcontext()
