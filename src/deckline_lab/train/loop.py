"""The training loop under a budget, its learning-rate schedule, averaged weights and checkpoints."""

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor, nn

from deckline.atomic import write_atomic
from deckline.checks import check_numbers
from deckline.config_file import to_toml_text
from deckline_lab.train.checkpoint import load_checkpoint, read_progress, save_checkpoint, stop_on_interrupt
from deckline_lab.train.curves import HELD_OUT, Curves

RECIPE_FILE = "recipe.toml"
SMOOTHING = 0.98  # of the printed losses
RATE = "rate"  # of a group of parameters, relative to the recipe's
# Settings of a recipe that a resumed run may change.
MACHINE = ("threads", "device", "bf16", "checkpoint_minutes", "tensorboard")
BUDGET = ("steps", "minutes", "cpu_minutes")
CURVE_ROWS, CURVE_HELD_OUT = 100, 10  # of a training: points of the losses, and measurements on held-out batches
HELD_OUT_BATCHES = 4

Batch = TypeVar("Batch")
Loss = tuple[Tensor, Mapping[str, float]]  # and its parts by name


@dataclass(frozen=True)
class Recipe:
    """The settings that every training has."""

    COUNTS: ClassVar[tuple[str, ...]] = ("steps", "batch")

    network: str = ""  # name of a builder
    steps: int = 1_000_000
    minutes: float | None = None  # stop after so much training time; the schedule follows whichever ends first
    cpu_minutes: bool = False  # they are of this process's computing, on all cores: the same budget on a busy machine
    batch: int = 8
    lr: float = 1e-3
    lr_end: float = 1e-6
    warm_up: float = 0.02  # of the run; 0: none
    weight_decay: float = 1e-3
    clip_norm: float = 1.0  # of the gradient; 0: no limit
    ema_decay: float = 0.999  # of the averaged weights, which are the ones exported; 0: the last ones
    held_out: float = 0.05  # of every recording, for validation
    checkpoint_minutes: float = 3.0  # between checkpoints; a killed run loses no more than that
    threads: int = 0  # of torch on a CPU; 0 leaves torch's own choice
    device: Literal["auto", "cpu", "cuda"] = "auto"
    bf16: bool | None = None  # half of the arithmetic in bfloat16; None: on CUDA only (a CPU needs AVX512-BF16 or AMX)
    seed: int = 0
    tensorboard: bool = False  # write its events beside losses.csv

    def __post_init__(self) -> None:
        check_numbers(self, "", *self.COUNTS, least=1)
        check_numbers(self, "", "lr", above=0)
        check_numbers(self, "", "clip_norm", least=0)
        check_numbers(self, "", "warm_up", "ema_decay", "held_out", least=0, below=1)
        for name in ("minutes", "checkpoint_minutes"):
            value = getattr(self, name)
            if value is not None and value <= 0:
                raise ValueError(f"{name} must be positive, got {value}")

    def identity(self) -> dict[str, Any]:
        """Settings that a resumed run must have unchanged: all but budget and machine; JSON values."""
        return json.loads(json.dumps({k: v for k, v in asdict(self).items() if k not in (*BUDGET, *MACHINE)}))

    def fraction_done(self, step: int, seconds: float) -> float:
        """Share of the budget that is used, whichever of steps and training time is further; 1 is the end."""
        by_time = 0.0 if self.minutes is None else seconds / (60 * self.minutes)
        return min(1.0, max(step / self.steps, by_time))


@dataclass(eq=False)
class TrainingRun:
    """The state of a training: what a checkpoint holds."""

    model: nn.Module
    optimizer: torch.optim.Optimizer
    out: Path
    recipe: dict[str, Any]  # settings that a resumed run must have unchanged; JSON values
    ema: dict[str, Tensor]  # averaged weights, by the model's names
    step: int = 0
    seconds: float = 0.0  # of training so far
    recent: dict[str, float] = field(default_factory=dict)  # smoothed losses

    def save(self) -> None:
        progress = {"recipe": self.recipe, "step": self.step, "seconds": self.seconds}
        save_checkpoint(self.out, self.model, self.optimizer, self.ema, progress)


def build_network(networks: Mapping[str, Callable[[Any], nn.Module]], config: Recipe) -> Any:
    """The recipe's network, with first weights from its seed."""
    if config.network not in networks:
        raise ValueError(f"network must be one of {', '.join(networks)}, got {config.network!r}")
    torch.manual_seed(config.seed)
    return networks[config.network](config)


def select_device(config: Recipe) -> torch.device:
    """The recipe's device; torch gets its threads."""
    if config.threads:
        torch.set_num_threads(config.threads)
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ValueError("device cuda was asked for, but torch sees no CUDA device")
    return torch.device("cuda" if config.device != "cpu" and torch.cuda.is_available() else "cpu")


def is_finished(config: Recipe, folder: Path, weights: str) -> bool:
    """Whether the folder holds the file `weights` of a training with this recipe that used its budget."""
    progress = read_progress(folder)
    if progress is None or not (folder / weights).is_file() or progress["recipe"] != config.identity():
        return False
    return config.fraction_done(progress["step"], progress["seconds"]) >= 1


def open_run(config: Recipe, model: nn.Module, optimizer: torch.optim.Optimizer, out: Path) -> TrainingRun:
    """A new run, or the one whose checkpoint lies in `out`, of the same recipe; the recipe is written there."""
    recipe, progress = config.identity(), read_progress(out)
    ema = {name: value.detach().clone() for name, value in model.state_dict().items()}
    run = TrainingRun(model, optimizer, out, recipe, ema)
    if progress is not None:
        stored = progress["recipe"]
        changed = ", ".join(sorted(name for name in {*recipe, *stored} if stored.get(name) != recipe.get(name)))
        if changed:
            raise ValueError(f"{out} holds a checkpoint of another recipe ({changed} differ): use another folder")
        device = next(model.parameters()).device
        run.ema = {name: value.to(device) for name, value in load_checkpoint(out, model, optimizer).items()}
        run.step, run.seconds = progress["step"], progress["seconds"]
    out.mkdir(parents=True, exist_ok=True)
    write_atomic(out / RECIPE_FILE, to_toml_text(config).encode())
    return run


def train(
    config: Recipe,
    run: TrainingRun,
    batches: Iterator[Batch],
    loss: Callable[[Batch, float], Loss],
    console: Console,
    held_out: Sequence[Batch] = (),
    figures: Callable[[Batch], Mapping[str, float]] = lambda _: {},
    now: Callable[[], float] = time.monotonic,
) -> None:
    """Steps until the budget is used. The run is saved every `checkpoint_minutes` and at the end, its curves as well.

    Args:
        batches: of the steps from `run.step` on.
        loss: of a batch, at a share of the budget.
        held_out: batches of views that training does not see, whose loss is measured along the way.
        figures: of a held-out batch besides its loss, by name.
        now: a clock, s; it decides when to save.

    Raises:
        FloatingPointError: the loss stopped being a number.
        ImportError: TensorBoard is asked for and not there.
        KeyboardInterrupt: after Ctrl-C; the step is finished and the run saved.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    curves = Curves(run.out, run.step, config.tensorboard)
    with stop_on_interrupt() as stopped, Progress(*columns, console=console) as progress:
        bar = progress.add_task("training", total=1.0)
        clock = time.process_time if config.cpu_minutes else time.monotonic
        last, saved = clock(), now()
        for batch in batches:
            fraction = config.fraction_done(run.step, run.seconds)
            if fraction >= 1 or stopped.is_set():
                break
            losses = _step(config, run, loss(batch, fraction), fraction)
            run.step += 1
            run.seconds += clock() - last
            run.recent = {name: v + SMOOTHING * (run.recent.get(name, v) - v) for name, v in losses.items()}
            _add_to_curves(curves, config, run, fraction, partial(held_out_figures, run, held_out, loss, figures))
            last = clock()
            progress.update(bar, completed=fraction, description=f"step {run.step}, loss {run.recent['total']:.3f}")
            if now() - saved >= 60 * config.checkpoint_minutes:
                run.save()
                saved = now()
                parts = ", ".join(f"{name} {value:.3f}" for name, value in run.recent.items())
                console.print(f"step {run.step}, {run.seconds / 60:.1f} min: {parts}")
    run.save()
    if curves.rows:
        try:
            console.print(str(curves.draw()))
        except ImportError as error:
            console.print(f"no picture of the losses: {error}")
    if config.fraction_done(run.step, run.seconds) < 1:
        raise KeyboardInterrupt(f"{run.out} holds step {run.step}, the same command goes on from there")


def _add_to_curves(
    curves: Curves,
    config: Recipe,
    run: TrainingRun,
    before: float,
    measure: Callable[[float], Mapping[str, float]],
) -> None:
    """A row, at every hundredth of the budget that this step ended; at every tenth with the held-out figures."""
    fraction = config.fraction_done(run.step, run.seconds)

    def passes(count: int) -> bool:
        return int(count * fraction) > int(count * before)

    if passes(CURVE_ROWS):
        rate = learning_rate(before, config.lr, config.lr_end, config.warm_up)
        row = {"step": run.step, "minutes": run.seconds / 60, "lr": rate, **run.recent}
        if passes(CURVE_HELD_OUT):
            row |= measure(fraction)
        curves.add(row)


@torch.no_grad()
def held_out_figures(
    run: TrainingRun,
    batches: Sequence[Batch],
    loss: Callable[[Batch, float], Loss],
    figures: Callable[[Batch], Mapping[str, float]],
    fraction: float,
) -> dict[str, float]:
    """Mean loss and figures of the averaged weights, {} without batches; the run is left as it was."""
    weights = {name: value.clone() for name, value in run.model.state_dict().items()}
    with torch.random.fork_rng():
        run.model.load_state_dict(run.ema)
        measured = [figures(batch) for batch in batches]  # first: a loss moves the running means of norms
        rows = [{"": float(loss(x, fraction)[0]), **row} for x, row in zip(batches, measured, strict=True)]
        run.model.load_state_dict(weights)
    names = dict.fromkeys(name for row in rows for name in row)
    return {f"{HELD_OUT}_{name}".rstrip("_"): sum(row[name] for row in rows) / len(rows) for name in names}


def print_figures(console: Console, figures: Mapping[str, float], skipped: Mapping[str, str]) -> None:
    """What a training reached, and the frames that it could not use."""
    for file, reason in skipped.items():
        console.print(f"skipped {file}: {reason}")
    for name, value in figures.items():
        console.print(f"{name} = {value:.4g}")


def _step(config: Recipe, run: TrainingRun, loss: Loss, fraction: float) -> dict[str, float]:
    value, parts = loss
    total = float(value.detach())
    if not math.isfinite(total):
        raise FloatingPointError(f"loss is {total} at step {run.step}; lower lr ({config.lr}) and start again")
    rate = learning_rate(fraction, config.lr, config.lr_end, config.warm_up)
    for group in run.optimizer.param_groups:
        group["lr"] = rate * group.get(RATE, 1.0)
    run.optimizer.zero_grad()
    value.backward()
    if config.clip_norm:
        torch.nn.utils.clip_grad_norm_(run.model.parameters(), config.clip_norm)
    run.optimizer.step()
    update_average(run.ema, run.model, config.ema_decay, run.step)
    return {"total": total, **parts}


def learning_rate(fraction: float, peak: float, end: float, warm_up: float) -> float:
    """Linear warm-up over the first `warm_up` of the run, then half a cosine from `peak` to `end`.

    A function of the fraction alone, so that budgets in minutes and resumed runs follow the same curve.
    """
    if fraction < warm_up:
        return peak * max(fraction / warm_up, 0.01)
    along = (fraction - warm_up) / (1 - warm_up)
    return end + (peak - end) * (1 + math.cos(math.pi * min(along, 1.0))) / 2


@torch.no_grad()
def update_average(ema: dict[str, Tensor], model: nn.Module, decay: float, step: int) -> None:
    """Move the averaged weights towards the model's, in place; early steps count more so that they start unbiased."""
    weight = min(decay, (1 + step) / (10 + step))
    for name, value in model.state_dict().items():
        if value.dtype.is_floating_point:
            ema[name].lerp_(value, 1 - weight)
        else:
            ema[name].copy_(value)


def autocast(config: Recipe, device: torch.device) -> AbstractContextManager[Any]:
    """Half of the arithmetic in bfloat16 if the recipe asks for it; without a setting on CUDA only."""
    bf16 = device.type == "cuda" if config.bf16 is None else config.bf16
    return torch.autocast(device.type, torch.bfloat16) if bf16 else nullcontext()
