"""The checkpoint file, what is refused, and Ctrl-C."""

import signal
import threading
from pathlib import Path

import pytest
import torch

from deckline_lab.train import checkpoint
from deckline_lab.train.checkpoint import CHECKPOINT_FILE, load_checkpoint, read_progress, save_checkpoint


def model_and_optimizer(width: int = 4) -> tuple[torch.nn.Module, torch.optim.Optimizer]:
    model = torch.nn.Linear(3, width)
    return model, torch.optim.AdamW(model.parameters(), 1e-2)


def test_the_file_is_no_pickle_and_nothing_else_is_left(tmp_path: Path) -> None:
    path = save_checkpoint(tmp_path / "new", *model_and_optimizer(), {}, {})
    assert [item.name for item in path.parent.iterdir()] == [CHECKPOINT_FILE]
    header = int.from_bytes(path.read_bytes()[:8], "little")  # safetensors: length of a JSON header
    assert path.read_bytes()[8:9] == b"{" and 0 < header < path.stat().st_size


def test_no_checkpoint_another_model_and_a_broken_file(tmp_path: Path) -> None:
    assert read_progress(tmp_path) is None
    with pytest.raises(ValueError, match=str(tmp_path)):
        load_checkpoint(tmp_path, *model_and_optimizer())
    save_checkpoint(tmp_path, *model_and_optimizer(4), {}, {})
    with pytest.raises(ValueError, match=CHECKPOINT_FILE):
        load_checkpoint(tmp_path, *model_and_optimizer(5))
    (tmp_path / CHECKPOINT_FILE).write_bytes(b"\x80\x04garbage")
    for read in (lambda: load_checkpoint(tmp_path, *model_and_optimizer()), lambda: read_progress(tmp_path)):
        with pytest.raises(ValueError, match=CHECKPOINT_FILE):
            read()


def test_first_interrupt_sets_the_event_second_one_interrupts() -> None:
    before = signal.getsignal(signal.SIGINT)
    with checkpoint.stop_on_interrupt() as stopped:
        assert not stopped.is_set()
        signal.raise_signal(signal.SIGINT)
        assert stopped.is_set()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_other_threads_may_train_as_well() -> None:
    seen = []

    def body() -> None:
        with checkpoint.stop_on_interrupt() as stopped:
            seen.append(stopped.is_set())

    thread = threading.Thread(target=body)
    thread.start()
    thread.join()
    assert seen == [False]
