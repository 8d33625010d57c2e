"""The published setting: the recipe holds the paper's values, shows the recorded pairs, and takes steps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from clear_scene import clear_frame, hazy_frame, hazy_recording, interrupting
from deckline.cli.main import main
from deckline_lab.cli.recipe_flags import make_recipe
from deckline_lab.cli.train_dehaze import DehazeFlags
from deckline_lab.train import loop
from deckline_lab.train.checkpoint import read_progress, read_tensors
from deckline_lab.train.dehaze import DehazeTrainConfig
from deckline_lab.train.dehaze_samples import make_batch
from deckline_lab.train.loop import learning_rate
from deckline_lab.train.pair_views import open_clear_views

PUBLISHED = make_recipe(DehazeTrainConfig, Path("published"), DehazeFlags())
SMALL = ["--crop-height", "32", "--crop-width", "32", "--batch", "2"]


def test_values_are_those_of_the_paper() -> None:
    """Li et al. 2024, section 4.1.1."""
    assert (PUBLISHED.steps, PUBLISHED.batch, PUBLISHED.weight_decay) == (600_000, 16, 4e-3)
    assert (PUBLISHED.crop_height, PUBLISHED.crop_width, PUBLISHED.working_long_side_px) == (512, 512, 1280)
    assert (PUBLISHED.haze.flip_horizontal, PUBLISHED.haze.flip_vertical) == (0.5, 0.5)
    rates = [learning_rate(f, PUBLISHED.lr, PUBLISHED.lr_end, PUBLISHED.warm_up) for f in (0.0, 0.5, 1.0)]
    assert rates == pytest.approx([5e-4, (5e-4 + 1e-7) / 2, 1e-7])


def test_batches_are_squares_of_the_recorded_pairs_flipped(tmp_path: Path) -> None:
    views = open_clear_views([hazy_recording(tmp_path, frames=1)], PUBLISHED.working_long_side_px, PUBLISHED.held_out)
    seed = [PUBLISHED.seed, 0]
    batch = make_batch(views, 200, (48, 48), PUBLISHED.haze, seed, PUBLISHED.prior, sub_images=PUBLISHED.sub_images)
    samples = (255 * torch.cat(batch[:2], 1)).round().to(torch.uint8).permute(0, 2, 3, 1).contiguous()
    pair = np.concatenate([hazy_frame(0).image_rgb, clear_frame(0).image_rgb], axis=2)
    squares = [pair[y : y + 48, x : x + 48] for y in (0, 16) for x in (0, 16, 32, 48)]
    flips = {square[::rows, ::columns].tobytes() for square in squares for rows in (1, -1) for columns in (1, -1)}
    assert {sample.numpy().tobytes() for sample in samples} == flips


def test_five_steps_of_the_recipe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A smaller crop and batch apart; Ctrl-C ends it in the fifth, and the last weights are those to export."""
    recording, out = hazy_recording(tmp_path / "pairs", frames=4), tmp_path / "out"
    monkeypatch.setattr(loop, "_step", interrupting(loop._step, at=5))
    assert main(["train", "dehaze", str(recording), "--recipe", "published", "--out", str(out), *SMALL]) == 130
    assert "step 5" in capsys.readouterr().err and not (out / "dehaze.onnx").exists()
    progress = read_progress(out)
    assert progress is not None and progress["step"] == 5
    assert progress["recipe"] == replace(PUBLISHED, crop_height=32, crop_width=32, batch=2).identity()
    trained, averaged = read_tensors(out, "model"), read_tensors(out, "ema")
    torch.testing.assert_close(averaged, trained, rtol=0, atol=0)
    assert trained["head.1.weight"].abs().max() > 1e-4, "it is all zeros at first"


def test_without_held_out_views_a_training_ends_without_figures(tmp_path: Path) -> None:
    recording, out = hazy_recording(tmp_path / "pairs", frames=2), tmp_path / "out"
    words = ["--recipe", "published", "--out", str(out), *SMALL, "--steps", "1"]
    assert main(["train", "dehaze", str(recording), *words]) == 0
    assert (out / "dehaze.onnx").exists()
    assert (out / "figures.json").read_text().split() == ["{}"]
