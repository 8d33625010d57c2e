"""Training curves: rows, resumed runs, the held-out loss, and what is missing."""

import sys
from pathlib import Path

import pytest
import torch
from rich.console import Console

from clear_scene import interrupting
from deckline_lab.train import loop
from deckline_lab.train.curves import CSV_FILE, PICTURE_FILE, Curves, read_curves
from deckline_lab.train.loop import Recipe, TrainingRun, held_out_loss, open_run, train

RECIPE = Recipe(steps=40, batch=1)


def new_run(out: Path) -> TrainingRun:
    torch.manual_seed(0)
    model = torch.nn.Sequential(
        torch.nn.Linear(3, 4), torch.nn.BatchNorm1d(4), torch.nn.Dropout(), torch.nn.Linear(4, 1)
    )
    return open_run(RECIPE, model, torch.optim.AdamW(model.parameters()), out)


def make(step: int) -> torch.Tensor:
    return torch.randn(8, 3, generator=torch.Generator().manual_seed(step))


def run_loop(run: TrainingRun, held_out: tuple[torch.Tensor, ...] = ()) -> None:
    def loss(batch: torch.Tensor, fraction: float) -> tuple[torch.Tensor, dict[str, float]]:
        value = (run.model(batch) - batch.sum(1, keepdim=True)).square().mean()
        return value, {"half": float(value.detach()) / 2}

    train(RECIPE, run, map(make, range(run.step, RECIPE.steps + 1)), loss, Console(quiet=True), held_out)


def test_rows_are_the_smoothed_losses_and_now_and_then_the_held_out_one(tmp_path: Path) -> None:
    run = new_run(tmp_path)
    run_loop(run, (make(1000), make(1001)))
    rows = list(read_curves(tmp_path))
    assert [row["step"] for row in rows] == list(range(1, 41))
    assert rows[-1]["total"] == pytest.approx(run.recent["total"], rel=1e-5)
    assert all(row["half"] == pytest.approx(row["total"] / 2, rel=1e-4) for row in rows)
    measured = {row["step"]: row["held_out"] for row in rows if "held_out" in row}
    assert list(measured) == list(range(4, 41, 4))
    assert (tmp_path / CSV_FILE).read_text().splitlines()[0] == "step,minutes,lr,total,half,held_out"
    assert (tmp_path / PICTURE_FILE).read_bytes().startswith(b"\x89PNG")


def test_the_held_out_loss_is_that_of_the_averaged_weights_and_changes_nothing(tmp_path: Path) -> None:
    run = new_run(tmp_path)
    run.ema = {name: torch.zeros_like(value) for name, value in run.model.state_dict().items()}
    before = {name: value.clone() for name, value in run.model.state_dict().items()}
    rng = torch.random.get_rng_state()
    batch = make(7)
    found = held_out_loss(run, [batch], lambda b, _: ((run.model(b) - b.sum(1, keepdim=True)).square().mean(), {}), 0.5)
    assert found == pytest.approx(float(batch.sum(1).square().mean()))
    torch.testing.assert_close(run.model.state_dict(), before, rtol=0, atol=0)
    assert torch.equal(torch.random.get_rng_state(), rng)


def test_measuring_on_held_out_batches_changes_no_training(tmp_path: Path) -> None:
    with_held_out, without = new_run(tmp_path / "with"), new_run(tmp_path / "without")
    torch.manual_seed(1)
    run_loop(with_held_out, (make(1000),))
    torch.manual_seed(1)
    run_loop(without)
    torch.testing.assert_close(with_held_out.ema, without.ema, rtol=0, atol=0)


def test_a_resumed_run_keeps_the_rows_up_to_its_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(loop, "_step", interrupting(loop._step, at=10))
        with pytest.raises(KeyboardInterrupt):
            run_loop(new_run(tmp_path))
    with (tmp_path / CSV_FILE).open("a") as file:
        file.write("12,0.1,0.001,9,4.5,\n")  # of a run that was killed after its checkpoint
    run_loop(new_run(tmp_path))
    rows = list(read_curves(tmp_path))
    assert [row["step"] for row in rows] == list(range(1, 41))
    assert all(row["total"] != 9 for row in rows)


def test_what_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    monkeypatch.delitem(sys.modules, "torch.utils.tensorboard", raising=False)
    with pytest.raises(ImportError, match=r'tensorboard is not installed; run: pip install "deckline\[tensorboard\]"'):
        Curves(tmp_path, 0, tensorboard=True)
    curves = Curves(tmp_path, 0)
    curves.add({"step": 1.0, "minutes": 0.1, "lr": 1e-3, "total": 2.0})
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ImportError, match=r"deckline\[viz\]"):
        curves.draw()
