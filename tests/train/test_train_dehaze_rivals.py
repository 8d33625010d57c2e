"""Comparison networks go through the same training as ours, and out of it into the chain."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from clear_scene import QUICK, clear_frame, clear_recording, interrupting
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from deckline.dehaze.network import image_to_tensor
from deckline.pipeline import Pipeline, PipelineConfig
from deckline.train import training
from deckline.train.checkpoint import CHECKPOINT_FILE, PROGRESS_KEY, load_checkpoint
from deckline.train.dehaze import train_dehaze
from deckline.train.rivals import build

AOD = replace(QUICK, network="aod-net", steps=6)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clear_recording(tmp_path_factory.mktemp("clear"), frames=8)


def test_trained_network_dehazes_in_the_chain_by_its_path(recording: Path, tmp_path: Path) -> None:
    """What the chain shows is what the averaged weights say in torch, within a grey level; figures are finite."""
    figures = train_dehaze(replace(AOD, steps=60, lr=3e-2), [recording], tmp_path)
    assert all(np.isfinite(value) for value in figures.values())
    assert figures["psnr_db_surface.mean"] > figures["psnr_db_surface_hazy.mean"] + 0.5
    pipeline = Pipeline(PipelineConfig(dehazer=str(tmp_path / "dehaze.onnx")))
    frame = clear_frame(3)
    result = pipeline(frame)
    model = build("aod-net")
    loaded = load_checkpoint(tmp_path, model, None)
    assert loaded is not None and loaded[0] is not None
    model.load_state_dict(loaded[0])
    with torch.no_grad():
        expected = 255 * model(torch.from_numpy(image_to_tensor(frame.image_rgb)))[0].permute(1, 2, 0).numpy()
    assert np.abs(expected.clip(0, 255) - frame.image_rgb).max() > 20, "training must have changed what it does"
    assert np.abs(result.dehazed_rgb - expected.clip(0, 255)).max() <= 1.0


def test_statistics_of_batch_norm_survive_an_interruption(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = replace(QUICK, network="g-unet-t", steps=4)
    train_dehaze(config, [recording], tmp_path / "whole")
    monkeypatch.setattr(training, "_step", interrupting(training._step, at=2))
    assert train_dehaze(config, [recording], tmp_path / "parts") == {}
    monkeypatch.undo()
    train_dehaze(config, [recording], tmp_path / "parts")
    whole, parts = (load_file(tmp_path / name / CHECKPOINT_FILE) for name in ("whole", "parts"))
    assert "ema.bottom.0.norm.running_var" in whole
    torch.testing.assert_close(parts, whole, rtol=0, atol=0)


def test_another_network_does_not_go_on(recording: Path, tmp_path: Path) -> None:
    train_dehaze(replace(AOD, steps=1), [recording], tmp_path)
    with pytest.raises(ValueError, match=r"checkpoint of another recipe \(network differ\)"):
        train_dehaze(QUICK, [recording], tmp_path)
    with pytest.raises(ValueError, match="holds the weights of another network"):
        train_dehaze(QUICK, [recording], tmp_path / "next", start_from=tmp_path)


def test_checkpoints_from_before_there_was_a_choice_go_on(recording: Path, tmp_path: Path) -> None:
    train_dehaze(replace(QUICK, steps=1), [recording], tmp_path)
    path = tmp_path / CHECKPOINT_FILE
    with safe_open(path, framework="pt") as file:
        progress = json.loads(file.metadata()[PROGRESS_KEY])
    del progress["recipe"]["network"]
    save_file(load_file(path), path, metadata={PROGRESS_KEY: json.dumps(progress)})
    train_dehaze(replace(QUICK, steps=2), [recording], tmp_path)
    with safe_open(path, framework="pt") as file:
        assert json.loads(file.metadata()[PROGRESS_KEY])["step"] == 2
    with pytest.raises(ValueError, match=r"another recipe \(network differ\)"):
        train_dehaze(AOD, [recording], tmp_path)
