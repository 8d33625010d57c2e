"""The training loop: its budget, its schedule, and what is saved when."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from rich.console import Console

from clear_scene import interrupting
from deckline.config_file import read_config
from deckline_lab.train import loop
from deckline_lab.train.checkpoint import read_progress
from deckline_lab.train.loop import Recipe, TrainingRun, learning_rate, open_run, train, update_average

RECIPE = Recipe(steps=6, batch=1)


def new_run(out: Path, recipe: Recipe = RECIPE) -> TrainingRun:
    torch.manual_seed(0)
    model = torch.nn.Linear(3, 1)
    return open_run(recipe, model, torch.optim.AdamW(model.parameters()), out)


def run_loop(run: TrainingRun, recipe: Recipe = RECIPE, step_s: float = 0.0) -> list[int]:
    """Train on batches that their step decides, on a clock that each step moves on; the steps that were saved."""
    saved, elapsed_s, save = [], [0.0], run.save

    def batches() -> Iterator[torch.Tensor]:
        for step in range(run.step, recipe.steps + 1):
            yield torch.randn(4, 3, generator=torch.Generator().manual_seed(step))

    def loss(batch: torch.Tensor, fraction: float) -> tuple[torch.Tensor, dict[str, float]]:
        elapsed_s[0] += step_s
        return (run.model(batch) - batch.sum(1, keepdim=True)).square().mean(), {}

    run.save = lambda: (saved.append(run.step), save())  # type: ignore[method-assign]
    train(recipe, run, batches(), loss, Console(quiet=True), now=lambda: elapsed_s[0])
    return saved


@pytest.mark.parametrize(("step_s", "saved"), [(20.0, [6]), (60.0, [3, 6, 6]), (100.0, [2, 4, 6, 6])])
def test_checkpoints_are_written_every_three_minutes(step_s: float, saved: list[int], tmp_path: Path) -> None:
    assert run_loop(new_run(tmp_path), step_s=step_s) == saved


def test_ctrl_c_saves_the_step_and_ends_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "_step", interrupting(loop._step, at=4))
    with pytest.raises(KeyboardInterrupt, match=f"{tmp_path}.*4"):
        run_loop(new_run(tmp_path))
    progress = read_progress(tmp_path)
    assert progress is not None and progress["step"] == 4


def test_a_resumed_run_ends_with_the_same_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = new_run(tmp_path / "whole")
    run_loop(whole)
    with monkeypatch.context() as patch:
        patch.setattr(loop, "_step", interrupting(loop._step, at=2))
        with pytest.raises(KeyboardInterrupt):
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


@pytest.mark.parametrize(("name", "value"), [("batch", 0), ("steps", -1), ("minutes", 0.0), ("checkpoint_minutes", -3)])
def test_recipes_that_cannot_work_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name}.*{value}"):
        Recipe(**{name: value})


def test_learning_rate_warms_up_and_follows_a_cosine() -> None:
    rates = [learning_rate(f, 5e-4, 1e-7, 0.1) for f in (0.0, 0.05, 0.1, 0.55, 1.0)]
    assert rates == pytest.approx([5e-6, 2.5e-4, 5e-4, (5e-4 + 1e-7) / 2, 1e-7])


def test_averaged_weights_start_unbiased_and_then_lag() -> None:
    model = torch.nn.Linear(1, 1, bias=False)
    ema = {"weight": torch.zeros(1, 1)}
    torch.nn.init.ones_(model.weight)
    update_average(ema, model, 0.999, step=0)  # keeps 1 / 10
    assert ema["weight"].item() == pytest.approx(0.9)
    update_average(ema, model, 0.5, step=10_000)
    assert ema["weight"].item() == pytest.approx(0.95)
