"""Checkpoints without pickle: one safetensors file holds model, optimizer and averaged weights, progress as JSON.

A killed run leaves the whole old file or the whole new one.
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
from safetensors.torch import save
from torch import Tensor, nn

from deckline.atomic import write_atomic

CHECKPOINT_FILE = "checkpoint.safetensors"
PROGRESS_KEY = "deckline_progress"
Tensors = dict[str, Tensor]  # by name


def save_checkpoint(
    folder: Path, model: nn.Module, optimizer: torch.optim.Optimizer, ema: Tensors, progress: dict[str, Any]
) -> Path:
    """Write `folder`/checkpoint.safetensors; `ema` are averaged weights, `progress` is anything JSON can hold."""
    tensors = {f"model.{name}": value for name, value in model.state_dict().items()}
    tensors |= {f"ema.{name}": value for name, value in ema.items()}
    for index, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{name}": torch.as_tensor(value) for name, value in state.items()}
    # Copies: safetensors refuses tensors that share memory or are not contiguous.
    plain = {name: value.detach().cpu().contiguous().clone() for name, value in tensors.items()}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / CHECKPOINT_FILE
    write_atomic(path, save(plain, metadata={PROGRESS_KEY: json.dumps(progress)}))
    return path


def load_checkpoint(folder: Path, model: nn.Module, optimizer: torch.optim.Optimizer) -> Tensors:
    """Fill model and optimizer from `folder`'s checkpoint; returns the averaged weights."""
    try:
        model.load_state_dict(read_tensors(folder, "model"))
    except RuntimeError as error:
        reason = str(error).splitlines()[-1].strip()
        raise ValueError(f"{folder / CHECKPOINT_FILE} holds another model: {reason}") from error
    state: dict[int, Tensors] = {}
    for name, value in read_tensors(folder, "optimizer").items():
        index, key = name.split(".", 1)
        state.setdefault(int(index), {})[key] = value
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
    return read_tensors(folder, "ema")


def read_tensors(folder: Path, group: str) -> Tensors:
    """Tensors of one group of `folder`'s checkpoint: model, optimizer or ema (the averaged weights)."""
    if not (folder / CHECKPOINT_FILE).is_file():
        raise ValueError(f"{folder} holds no checkpoint")
    with _open(folder) as file:
        names = [name for name in file.keys() if name.startswith(f"{group}.")]  # noqa: SIM118 - the handle is no mapping
        return {name.removeprefix(f"{group}."): file.get_tensor(name) for name in names}


def read_progress(folder: Path) -> dict[str, Any] | None:
    """Progress of `folder`'s checkpoint; None without one."""
    if not (folder / CHECKPOINT_FILE).is_file():
        return None
    with _open(folder) as file:
        return json.loads((file.metadata() or {})[PROGRESS_KEY])


@contextmanager
def _open(folder: Path) -> Iterator[Any]:
    path = folder / CHECKPOINT_FILE
    try:
        with safe_open(path, framework="pt") as file:
            yield file
    except (SafetensorError, KeyError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is not a deckline checkpoint: {error}") from error


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
