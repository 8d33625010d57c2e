"""The dehazing recipe: data as the scattering model says, a loss that is PSNR, a loop that learns and resumes."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from clear_scene import QUICK, clear_frame, clear_recording, hazy_frame, pair_folder
from deckline.config import Engine
from deckline.dehaze import OnnxDehazer
from deckline.runtime import load_session
from deckline_lab.evaluation.metrics import psnr_db, ssim
from deckline_lab.train.curves import read_curves
from deckline_lab.train.dehaze import NETWORKS, DehazeTrainConfig, batch_figures, dehaze_loss, psnr_loss, train_dehaze
from deckline_lab.train.dehaze_samples import HazeAugmentation
from deckline_lab.train.loop import build_network


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clear_recording(tmp_path_factory.mktemp("clear"), frames=8)


def test_loss_is_minus_psnr() -> None:
    rng = np.random.default_rng(0)
    clear = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
    noisy = np.clip(clear + rng.normal(0, 12, clear.shape), 0, 255).astype(np.uint8)
    a, b = (torch.from_numpy(x / 255).permute(2, 0, 1)[None] for x in (noisy, clear))
    assert psnr_loss(a, b).item() == pytest.approx(-psnr_db(noisy, clear), abs=0.03)  # the floor: 1e-5 on 2e-3
    visible = torch.zeros(1, 1, 24, 32)
    visible[..., 16:] = 1
    assert psnr_loss(a, b, visible).item() == pytest.approx(-psnr_db(noisy[:, 16:], clear[:, 16:]), abs=0.03)
    b[..., :16] = a[..., :16]  # an error in the visible half alone
    whole, part = psnr_loss(a, b), psnr_loss(a, b, visible)
    assert part - whole > 2
    torch.testing.assert_close(dehaze_loss(a, b, visible, 0.2), 0.8 * whole + 0.2 * part)


def test_figures_of_a_batch_are_those_of_its_pictures() -> None:
    rng = np.random.default_rng(0)
    clear = rng.integers(0, 256, (2, 24, 32, 3), dtype=np.uint8)
    noisy = np.clip(clear + rng.normal(0, [[[[4]]], [[[20]]]], clear.shape), 0, 255).astype(np.uint8)
    a, b = (torch.from_numpy(x / np.float32(255)).permute(0, 3, 1, 2) for x in (noisy, clear))
    figures = batch_figures(a, b)
    assert figures["psnr_db"] == pytest.approx(np.mean([psnr_db(x, y) for x, y in zip(noisy, clear, strict=True)]))
    assert figures["ssim"] == pytest.approx(np.mean([ssim(x, y) for x, y in zip(noisy, clear, strict=True)]))
    assert batch_figures(b, b) == {"psnr_db": 60.0, "ssim": pytest.approx(1.0)}
    assert "ssim" not in batch_figures(a[..., :8], b[..., :8])


def test_the_loss_falls_on_two_pairs_without_depth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    losses: list[float] = []

    def recorded(*args: Any) -> torch.Tensor:
        value = dehaze_loss(*args)
        losses.append(value.item())
        return value

    monkeypatch.setattr("deckline_lab.train.dehaze.dehaze_loss", recorded)
    folder = pair_folder(tmp_path, 3)  # the last is held out
    figures = train_dehaze(replace(QUICK, steps=40, held_out=0.34, prior=True), [folder], tmp_path / "out")
    assert np.mean(losses[-5:]) < np.mean(losses[:5]) - 3
    assert figures["views"] == 1
    assert figures["psnr_db_hazy.mean"] == pytest.approx(psnr_db(hazy_frame(2).image_rgb, clear_frame(2).image_rgb))
    assert figures["psnr_db.mean"] > figures["psnr_db_hazy.mean"] + 1
    assert figures["psnr_db_surface.mean"] == figures["psnr_db.mean"]
    measured = [row for row in read_curves(tmp_path / "out") if "held_out" in row]
    assert len(measured) == 10
    assert measured[-1]["held_out_psnr_db"] > measured[0]["held_out_psnr_db"] + 1
    assert -1 < measured[0]["held_out_ssim"] < measured[-1]["held_out_ssim"] < 1


def test_a_network_with_a_prior_trains_and_runs_with_and_without_a_pose(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (80, 120, 3), np.uint8)).save(tmp_path / "real" / "a.png")
    haze = HazeAugmentation(prior_share=1, physical_share=0.5, photograph_share=0.5)
    config = replace(QUICK, steps=3, prior=True, haze=haze)
    figures = train_dehaze(config, [recording], tmp_path, photographs=tmp_path / "real")
    assert np.isfinite(figures["psnr_db_with_prior.mean"])
    dehazer = OnnxDehazer(tmp_path / "dehaze.onnx", engine=Engine(threads=1))
    frame = clear_frame(0)
    restored = dehazer.restore(replace(frame, deck_z_m=-5.0))
    assert restored.image_rgb.shape == (64, 96, 3)
    assert (dehazer.session.config["step"], dehazer.session.config["recipe"]["batch"]) == (3, 2)
    blind = dehazer.restore(replace(frame, world_from_body=None))
    np.testing.assert_array_equal(blind.image_rgb, dehazer(frame.image_rgb))
    assert dehazer.cost is not None and dehazer.cost[0] == pytest.approx(478_468)


def test_training_starts_from_an_earlier_ones_averaged_weights(recording: Path, tmp_path: Path) -> None:
    train_dehaze(replace(QUICK, steps=3), [recording], tmp_path / "first")
    still = replace(QUICK, steps=1, lr=1e-12, lr_end=1e-12, batch=1)
    train_dehaze(still, [recording], tmp_path / "second", start_from=tmp_path / "first")
    image = torch.rand(1, 3, 64, 96).numpy()
    files = [tmp_path / name / "dehaze.onnx" for name in ("first", "second")]
    first, second = (load_session(file, Engine(threads=1))(image=image, working=image)[0] for file in files)
    np.testing.assert_allclose(first, second, atol=1e-5)
    assert np.abs(first - image).max() > 1e-3, "the first run must have learned something"
    with pytest.raises(ValueError, match="none"):
        train_dehaze(QUICK, [recording], tmp_path / "third", start_from=tmp_path / "none")


def test_a_loss_that_is_no_number_stops_the_run(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deckline_lab.train.dehaze.dehaze_loss", lambda *args: torch.tensor(float("nan")))
    with pytest.raises(FloatingPointError, match=r"nan.*0"):
        train_dehaze(QUICK, [recording], tmp_path)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"crop_width": 0}, r"crop_width.*0"),
        ({"network": "ffa-net"}, r"network.*coarse-t, coarse-s.*'ffa-net'"),
        ({"network": "full-t", "prior": True}, r"prior.*unshuffle"),
    ],
)
def test_config_errors(keys: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build_network(NETWORKS, DehazeTrainConfig(**keys))
