"""The training loop: its budget, its schedule, what is saved when, and its curves."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from rich.console import Console

from clear_scene import interrupting
from deckline.config_file import read_config
from deckline_lab.train import loop
from deckline_lab.train.curves import CSV_FILE, PICTURE_FILE, Curves, read_curves
from deckline_lab.train.loop import (
    Recipe,
    TrainingRun,
    held_out_figures,
    learning_rate,
    open_run,
    train,
    update_average,
)

RECIPE = Recipe(steps=6, batch=1)
LONG = Recipe(steps=40, batch=1)  # each step is a hundredth of the budget or more: a row of the curves


def new_run(out: Path, recipe: Recipe = RECIPE) -> TrainingRun:
    torch.manual_seed(0)
    hidden = [torch.nn.BatchNorm1d(4), *([torch.nn.Dropout()] if recipe is LONG else [])]
    model = torch.nn.Sequential(torch.nn.Linear(3, 4), *hidden, torch.nn.Linear(4, 1))
    return open_run(recipe, model, torch.optim.AdamW(model.parameters()), out)


def make(step: int) -> torch.Tensor:
    return torch.randn(8, 3, generator=torch.Generator().manual_seed(step))


def run_loop(
    run: TrainingRun, recipe: Recipe = RECIPE, step_s: float = 0.0, held_out: tuple[torch.Tensor, ...] = ()
) -> list[int]:
    """Train on batches that their step decides, on a clock that each step moves on; the steps that were saved."""
    saved, elapsed_s, save = [], [0.0], run.save

    def loss(batch: torch.Tensor, fraction: float) -> tuple[torch.Tensor, dict[str, float]]:
        elapsed_s[0] += step_s
        value = (run.model(batch) - batch.sum(1, keepdim=True)).square().mean()
        return value, {"half": float(value.detach()) / 2}

    run.save = lambda: (saved.append(run.step), save())  # type: ignore[method-assign]
    batches = map(make, range(run.step, recipe.steps + 1))
    train(recipe, run, batches, loss, Console(quiet=True), held_out, now=lambda: elapsed_s[0])
    return saved


@pytest.mark.parametrize(("step_s", "saved"), [(20.0, [6]), (60.0, [3, 6, 6]), (100.0, [2, 4, 6, 6])])
def test_checkpoints_are_written_every_three_minutes(step_s: float, saved: list[int], tmp_path: Path) -> None:
    assert run_loop(new_run(tmp_path), step_s=step_s) == saved


def test_a_resumed_run_ends_with_the_same_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = new_run(tmp_path / "whole")
    run_loop(whole)
    with monkeypatch.context() as patch:
        patch.setattr(loop, "_step", interrupting(loop._step, at=2))
        with pytest.raises(KeyboardInterrupt, match=f"{tmp_path}.*2"):
            run_loop(new_run(tmp_path / "parts"))
    parts = new_run(tmp_path / "parts", replace(RECIPE, threads=1, checkpoint_minutes=1.0))  # the machine may differ
    assert parts.step == 2
    run_loop(parts)
    torch.testing.assert_close(parts.ema, whole.ema, rtol=0, atol=0)
    torch.testing.assert_close(parts.model.state_dict(), whole.model.state_dict(), rtol=0, atol=0)


def test_the_recipe_lies_beside_the_checkpoint(tmp_path: Path) -> None:
    recipe = replace(RECIPE, lr=2e-3)
    run_loop(new_run(tmp_path, recipe), recipe)
    assert read_config(Recipe, tmp_path / "recipe.toml") == recipe
    with pytest.raises(ValueError, match="batch, lr"):
        new_run(tmp_path, replace(RECIPE, batch=2))


def test_budget_is_what_ends_first() -> None:
    assert Recipe(steps=100).fraction_done(50, 30.0) == 0.5
    assert Recipe(steps=100, minutes=1.0).fraction_done(50, 45.0) == 0.75
    assert Recipe(steps=100, minutes=1.0).fraction_done(200, 0.0) == 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("batch", 0), ("steps", -1), ("minutes", 0.0), ("checkpoint_minutes", -3)),
        *(("lr", -1.0), ("lr", 0.0), ("clip_norm", -1.0), ("ema_decay", 1.0), ("warm_up", 1.5), ("held_out", -0.1)),
    ],
)
def test_recipes_that_cannot_work_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name}.*{value}"):
        Recipe(**{name: value})


def test_learning_rate_warms_up_and_follows_a_cosine() -> None:
    rates = [learning_rate(f, 5e-4, 1e-7, 0.1) for f in (0.0, 0.05, 0.1, 0.55, 1.0)]
    assert rates == pytest.approx([5e-6, 2.5e-4, 5e-4, (5e-4 + 1e-7) / 2, 1e-7])
    assert learning_rate(0.0, 5e-4, 1e-7, 0.0) == pytest.approx(5e-4)


@pytest.mark.parametrize(("clip_norm", "moved"), [(0.0, 60.0), (3.0, 3.0)])
def test_a_gradient_is_cut_to_the_norm_that_the_recipe_allows(clip_norm: float, moved: float, tmp_path: Path) -> None:
    model = torch.nn.Linear(1, 1, bias=False)
    recipe = replace(RECIPE, steps=1, lr=1.0, lr_end=1.0, warm_up=0.0, clip_norm=clip_norm)
    run = open_run(recipe, model, torch.optim.SGD(model.parameters()), tmp_path)
    before = model.weight.item()
    train(recipe, run, iter([60.0, 60.0]), lambda slope, _: (slope * model.weight.sum(), {}), Console(quiet=True))
    assert before - model.weight.item() == pytest.approx(moved, rel=1e-5)


def test_averaged_weights_start_unbiased_and_then_lag() -> None:
    model = torch.nn.Linear(1, 1, bias=False)
    ema = {"weight": torch.zeros(1, 1)}
    torch.nn.init.ones_(model.weight)
    update_average(ema, model, 0.999, step=0)  # keeps 1 / 10
    assert ema["weight"].item() == pytest.approx(0.9)
    update_average(ema, model, 0.5, step=10_000)
    assert ema["weight"].item() == pytest.approx(0.95)
    update_average(ema, model, 0.0, step=10_001)
    assert ema["weight"].item() == 1.0


@pytest.fixture(scope="module")
def no_curves() -> None:
    """Here the losses are drawn."""


def test_rows_are_the_smoothed_losses_and_now_and_then_the_held_out_one(tmp_path: Path) -> None:
    run = new_run(tmp_path, LONG)
    run_loop(run, LONG, held_out=(make(1000), make(1001)))
    rows = list(read_curves(tmp_path))
    assert [row["step"] for row in rows] == list(range(1, 41))
    assert rows[-1]["total"] == pytest.approx(run.recent["total"], rel=1e-5)
    assert all(row["half"] == pytest.approx(row["total"] / 2, rel=1e-4) for row in rows)
    measured = {row["step"]: row["held_out"] for row in rows if "held_out" in row}
    assert list(measured) == list(range(4, 41, 4))
    assert (tmp_path / CSV_FILE).read_text().splitlines()[0] == "step,minutes,lr,total,half,held_out"
    assert (tmp_path / PICTURE_FILE).read_bytes().startswith(b"\x89PNG")


def test_the_held_out_loss_is_that_of_the_averaged_weights_and_changes_nothing(tmp_path: Path) -> None:
    run = new_run(tmp_path, LONG)
    run.ema = {name: torch.zeros_like(value) for name, value in run.model.state_dict().items()}
    before = {name: value.clone() for name, value in run.model.state_dict().items()}
    rng = torch.random.get_rng_state()
    batch = make(7)

    def loss(b: torch.Tensor, _: float) -> tuple[torch.Tensor, dict[str, float]]:
        return (run.model(b) - b.sum(1, keepdim=True)).square().mean(), {}

    found = held_out_figures(run, [batch], loss, lambda b: {"norm": float(run.model(b).norm())}, 0.5)
    assert found == {"held_out": pytest.approx(float(batch.sum(1).square().mean())), "held_out_norm": 0.0}
    torch.testing.assert_close(run.model.state_dict(), before, rtol=0, atol=0)
    assert torch.equal(torch.random.get_rng_state(), rng)


def test_a_resumed_run_keeps_the_rows_up_to_its_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(loop, "_step", interrupting(loop._step, at=10))
        with pytest.raises(KeyboardInterrupt):
            run_loop(new_run(tmp_path, LONG), LONG)
    with (tmp_path / CSV_FILE).open("a") as file:
        file.write("12,0.1,0.001,9,4.5,\n")  # of a run that was killed after its checkpoint
    run_loop(new_run(tmp_path, LONG), LONG)
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
