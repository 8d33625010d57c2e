"""Checkpoints without pickle: one safetensors file holds model, optimizer and averaged weights, progress as JSON.

One file, written beside its final name and renamed, so a killed run leaves the whole old or the whole new one.
"""

import json
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

CHECKPOINT_FILE = "checkpoint.safetensors"
PROGRESS_KEY = "deckline_progress"


def save_checkpoint(
    folder: Path,
    model: torch.nn.Module,
    optimizer: torch.optim.Optimizer,
    ema: dict[str, torch.Tensor] | None,
    progress: dict[str, Any],
) -> Path:
    """Write `folder`/checkpoint.safetensors.

    Args:
        folder: made if it does not exist.
        model, optimizer: as `load_checkpoint` gets them again.
        ema: averaged weights by the model's own names, or None.
        progress: anything JSON can hold: config, step, time used, state of generators.
    """
    tensors = {f"model.{name}": value for name, value in model.state_dict().items()}
    tensors |= {f"ema.{name}": value for name, value in (ema or {}).items()}
    for index, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{name}": torch.as_tensor(value) for name, value in state.items()}
    # Copies: safetensors refuses tensors that share memory or are not contiguous.
    plain = {name: value.detach().cpu().contiguous().clone() for name, value in tensors.items()}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / CHECKPOINT_FILE
    partial = path.with_name(path.name + ".part")
    save_file(plain, partial, metadata={PROGRESS_KEY: json.dumps(progress)})
    partial.replace(path)
    return path


def load_checkpoint(
    folder: Path, model: torch.nn.Module, optimizer: torch.optim.Optimizer | None
) -> tuple[dict[str, torch.Tensor] | None, dict[str, Any]] | None:
    """Fill model and optimizer from `folder`'s checkpoint.

    Returns:
        (averaged weights or None, progress), or None when the folder has no checkpoint.

    Raises:
        ValueError: an unreadable file, or weights of another model.
    """
    path = folder / CHECKPOINT_FILE
    if not path.is_file():
        return None
    groups: dict[str, dict[str, torch.Tensor]] = {"model": {}, "ema": {}, "optimizer": {}}
    try:
        with safe_open(path, framework="pt") as file:
            progress = json.loads((file.metadata() or {})[PROGRESS_KEY])
            for name in file.keys():  # noqa: SIM118 - the handle is no mapping
                group, rest = name.split(".", 1)
                groups[group][rest] = file.get_tensor(name)
    except (SafetensorError, KeyError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is not a deckline checkpoint: {error}") from error
    try:
        model.load_state_dict(groups["model"])
    except RuntimeError as error:
        raise ValueError(f"{path} holds another model: {str(error).splitlines()[-1].strip()}") from error
    if optimizer is not None:
        _load_optimizer(optimizer, groups["optimizer"])
    return groups["ema"] or None, progress


def read_progress(folder: Path) -> dict[str, Any] | None:
    """Progress alone of `folder`'s checkpoint (to know the config before the model is built), None without one.

    Raises:
        ValueError: an unreadable file.
    """
    path = folder / CHECKPOINT_FILE
    if not path.is_file():
        return None
    try:
        with safe_open(path, framework="pt") as file:
            return json.loads((file.metadata() or {})[PROGRESS_KEY])
    except (SafetensorError, KeyError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is not a deckline checkpoint: {error}") from error


def _load_optimizer(optimizer: torch.optim.Optimizer, tensors: dict[str, torch.Tensor]) -> None:
    state: dict[int, dict[str, torch.Tensor]] = {}
    for name, value in tensors.items():
        index, key = name.split(".", 1)
        state.setdefault(int(index), {})[key] = value
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})


@contextmanager
def stop_on_interrupt() -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets, so that a loop ends between two steps; a second one interrupts at once.

    Outside the main thread, where Python delivers no signals, the event is simply never set.
    """
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return

    def stop(number: int, frame: FrameType | None) -> None:
        stopped.set()
        signal.signal(signal.SIGINT, before)

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield stopped
    finally:
        signal.signal(signal.SIGINT, before)
