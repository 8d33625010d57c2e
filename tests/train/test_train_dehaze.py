"""The dehazing recipe: data as the scattering model says, a loss that is PSNR, a loop that learns and resumes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from clear_scene import CAMERA, QUICK, clear_frame, clear_recording, interrupting

from deckline.dehaze import OnnxDehazer
from deckline.evaluation.metrics import psnr_db
from deckline.geometry import Camera
from deckline.haze import beta_from_visibility, transmission
from deckline.runtime import load_session
from deckline.train import training
from deckline.train.checkpoint import read_progress
from deckline.train.dehaze import DehazeTrainConfig, dehaze_loss, psnr_loss, train_dehaze
from deckline.train.dehaze_data import (
    ClearView,
    ClearViews,
    clear_view,
    hazy_pair,
    horizon_colour,
    random_window,
    training_batch,
)
from deckline.train.dehaze_haze import HazeAugmentation, random_airlight
from deckline.types import Truth


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clear_recording(tmp_path_factory.mktemp("clear"), frames=8)


def test_view_holds_ranges_along_the_ray() -> None:
    view = clear_view(clear_frame(0), 640)
    frame = clear_frame(0)
    assert frame.depth_m is not None
    np.testing.assert_allclose(view.range_m[40], frame.depth_m[40] * CAMERA.ray_lengths()[40], rtol=1e-3)  # half floats
    assert np.isinf(view.range_m[:16]).all()
    assert view.horizon_rgb is not None
    np.testing.assert_allclose(view.horizon_rgb, (150, 170, 200))


def test_large_view_is_averaged_down() -> None:
    view, small = clear_view(clear_frame(0, Camera.from_fov(192, 128, 1.2)), 96), clear_frame(0, CAMERA)
    assert view.clear_rgb.shape == small.image_rgb.shape
    assert view.range_m.shape == small.image_rgb.shape[:2]


def test_frame_without_depth_or_clear_image_is_refused() -> None:
    frame = clear_frame(0)
    with pytest.raises(ValueError, match=r"000\.png: no depth"):
        clear_view(replace(frame, depth_m=None), 640)
    with pytest.raises(ValueError, match=r"000\.png: no clear image"):
        clear_view(replace(frame, truth=Truth(visibility_m=900.0)), 640)
    with pytest.raises(ValueError, match=r"000\.png: no clear image"):
        clear_view(replace(frame, truth=None), 640)


def test_recorded_clear_image_is_preferred() -> None:
    clear = np.full_like(clear_frame(0).image_rgb, 7)
    frame = replace(clear_frame(0), truth=Truth(visibility_m=900.0, clear_rgb=clear))
    np.testing.assert_array_equal(clear_view(frame, 640).clear_rgb, clear)


def test_hazy_pair_follows_the_scattering_model() -> None:
    """At one visibility, airlight and range: I = J t + A (1 - t), the same t everywhere."""
    clear = np.random.default_rng(0).integers(0, 256, (30, 40, 3), dtype=np.uint8)
    view = ClearView(clear, np.full((30, 40), 400, dtype=np.float16), None, Camera.from_fov(40, 30, 1.2))
    haze = HazeAugmentation(visibility_m=(800.0, 800.0), clear_share=0, noise_share=0, flip_horizontal=0)
    window = (slice(0, 30), slice(0, 40))
    hazy, kept, t, prior = hazy_pair(view, window, haze, np.random.default_rng(1))
    np.testing.assert_array_equal(kept, clear)
    np.testing.assert_array_equal(prior, hazy)
    np.testing.assert_allclose(t, transmission(400.0, beta_from_visibility(800.0)), rtol=1e-6)
    slope, offset = np.polyfit(clear[..., 0].ravel(), hazy[..., 0].ravel(), 1)
    assert slope == pytest.approx(0.02**0.5, abs=2e-3)  # Koschmieder: half of the visibility leaves sqrt(2 %)
    assert 40 <= offset / (1 - slope) <= 250


def test_flips_move_image_and_transmission_together() -> None:
    view = clear_view(clear_frame(3), 640)
    window = (slice(0, 64), slice(0, 96))
    keys = {"clear_share": 0.0, "noise_share": 0.0, "visibility_m": (500.0, 500.0)}
    plain = hazy_pair(view, window, HazeAugmentation(flip_horizontal=0, **keys), np.random.default_rng(5))
    flipped = hazy_pair(
        view, window, HazeAugmentation(flip_horizontal=1, flip_vertical=1, **keys), np.random.default_rng(5)
    )
    for a, b in zip(plain, flipped, strict=True):
        np.testing.assert_array_equal(a, b[::-1, ::-1])


def test_clear_share_leaves_images_alone() -> None:
    view = clear_view(clear_frame(0), 640)
    window = (slice(16, 64), slice(0, 96))  # below the sky, which any haze hides
    haze = HazeAugmentation(clear_share=1.0, noise_share=0, flip_horizontal=0, clear_visibility_m=(1e5, 1e6))
    hazy, clear, *_ = hazy_pair(view, window, haze, np.random.default_rng(0))
    assert np.abs(hazy.astype(int) - clear).max() <= 13  # 5.7 % of the way to the airlight at 1.5 km


def test_horizon_colour_is_the_lowest_sky() -> None:
    image = np.zeros((20, 10, 3), dtype=np.uint8)
    image[:8], image[8:10] = 30, 200
    ranges = np.full((20, 10), 100.0)
    ranges[:10] = np.inf
    np.testing.assert_allclose(horizon_colour(image, ranges), 200)
    assert horizon_colour(image, np.full((20, 10), 100.0)) is None


def test_airlight_is_a_possible_colour() -> None:
    rng = np.random.default_rng(0)
    drawn = np.array([random_airlight(np.array([200, 100, 50], np.float32), 0.5, rng) for _ in range(300)])
    assert drawn.min() >= 40
    assert drawn.max() <= 250
    assert drawn.std(axis=0).min() > 20


def test_exact_airlight_is_the_horizons() -> None:
    horizon = np.array([200, 100, 50], np.float32)
    drawn = np.array([random_airlight(horizon, 1.0, np.random.default_rng(k), exact_share=1.0) for k in range(200)])
    np.testing.assert_allclose(drawn.mean(axis=0), horizon, rtol=0.01)
    np.testing.assert_allclose(drawn.std(axis=0), 0.02 * horizon, rtol=0.25)


def test_windows_fit() -> None:
    rng = np.random.default_rng(0)
    for size in [(64, 96), (30, 200), (48, 64)]:
        for _ in range(50):
            rows, columns = random_window(size, (48, 64), (0.5, 2.0), rng)
            assert 0 <= rows.start < rows.stop <= size[0]
            assert 0 <= columns.start < columns.stop <= size[1]


def test_batches_repeat_for_the_same_seed(recording: Path) -> None:
    views = ClearViews([recording], 640, 0.25)
    first, second, other = (training_batch(views, 3, (48, 64), HazeAugmentation(), [0, k]) for k in (7, 7, 8))
    assert [tuple(x.shape) for x in first] == [(3, 3, 48, 64), (3, 3, 48, 64), (3, 1, 48, 64), (3, 3, 48, 64)]
    torch.testing.assert_close(first, second, rtol=0, atol=0)
    assert not torch.equal(first[0], other[0])


def test_held_out_views_are_no_training_views(recording: Path) -> None:
    assert len(ClearViews([recording], 640, 0.25)) == 6
    assert len(ClearViews([recording, recording], 640, 0.25)) == 12
    assert len(ClearViews([recording, recording], 640, 0.25, train=False)) == 2
    with pytest.raises(ValueError, match="no held-out views in"):
        ClearViews([recording], 640, 0.0, train=False)


def test_unreadable_frames_are_named_and_others_drawn(tmp_path: Path) -> None:
    clear_recording(tmp_path, frames=4)
    images = sorted((tmp_path / "images").glob("*.ppm"))
    images[1].write_bytes(images[1].read_bytes()[:100])
    views = ClearViews([tmp_path], 640, 0.0)
    rng = np.random.default_rng(0)
    assert all(views.draw(rng).clear_rgb.shape == (64, 96, 3) for _ in range(20))
    assert list(views.skipped) == [images[1].name]
    for image in images:
        image.write_bytes(b"P6")
    with pytest.raises(ValueError, match="20 frames in a row cannot be used"):
        ClearViews([tmp_path], 640, 0.0).draw(rng)


def test_loss_is_minus_psnr() -> None:
    rng = np.random.default_rng(0)
    clear = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
    noisy = np.clip(clear + rng.normal(0, 12, clear.shape), 0, 255).astype(np.uint8)
    a, b = (torch.from_numpy(x / 255).permute(2, 0, 1)[None] for x in (noisy, clear))
    assert psnr_loss(a, b).item() == pytest.approx(-psnr_db(noisy, clear), abs=0.03)  # the floor: 1e-5 on 2e-3
    visible = torch.zeros(1, 1, 24, 32)
    visible[..., 16:] = 1
    assert psnr_loss(a, b, visible).item() == pytest.approx(-psnr_db(noisy[:, 16:], clear[:, 16:]), abs=0.03)
    mixed = (psnr_loss(a, b) + psnr_loss(a, b, visible)) / 2
    torch.testing.assert_close(dehaze_loss(a, b, visible, 0.5), mixed)


def test_training_learns_exports_and_reports(recording: Path, tmp_path: Path) -> None:
    config = replace(QUICK, steps=40)
    figures = train_dehaze(config, [recording], tmp_path)
    assert figures["psnr_db_surface.mean"] > figures["psnr_db_surface_hazy.mean"] + 1  # a few steps do not learn skies
    dehazer = OnnxDehazer(tmp_path / "dehaze.onnx", threads=1)
    assert dehazer.session.config["step"] == 40
    assert dehazer.session.config["recipe"]["batch"] == 2
    assert dehazer(clear_frame(0).image_rgb).shape == (64, 96, 3)


def test_a_network_with_a_prior_trains_and_runs_with_and_without_a_pose(recording: Path, tmp_path: Path) -> None:
    haze = HazeAugmentation(prior_share=1, physical_share=0.5)
    figures = train_dehaze(replace(QUICK, steps=3, prior=True, haze=haze), [recording], tmp_path)
    assert np.isfinite(figures["psnr_db_with_prior.mean"])
    dehazer = OnnxDehazer(tmp_path / "dehaze.onnx", threads=1)
    frame = clear_frame(0)
    restored = dehazer.restore(replace(frame, deck_z_m=-5.0))
    assert restored.image_rgb.shape == (64, 96, 3)
    np.testing.assert_array_equal(
        dehazer.restore(replace(frame, world_from_body=None)).image_rgb, dehazer(frame.image_rgb)
    )
    assert dehazer.cost is not None
    assert dehazer.cost[0] == pytest.approx(478_468)


def test_interrupted_run_resumes_to_the_same_weights(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    train_dehaze(QUICK, [recording], tmp_path / "whole")
    monkeypatch.setattr(training, "_step", interrupting(training._step, at=5))
    assert train_dehaze(QUICK, [recording], tmp_path / "parts") == {}
    progress = read_progress(tmp_path / "parts")
    assert progress is not None
    assert progress["step"] == 5
    assert not (tmp_path / "parts" / "dehaze.onnx").exists()
    monkeypatch.undo()
    train_dehaze(QUICK, [recording], tmp_path / "parts")
    image = torch.rand(1, 3, 64, 96).numpy()
    results = [load_session(tmp_path / p / "dehaze.onnx", 1)(image=image, working=image)[0] for p in ("whole", "parts")]
    np.testing.assert_array_equal(*results)


def test_training_starts_from_an_earlier_ones_averaged_weights(recording: Path, tmp_path: Path) -> None:
    train_dehaze(replace(QUICK, steps=3), [recording], tmp_path / "first")
    still = replace(QUICK, steps=1, lr=1e-12, lr_end=1e-12, batch=1)
    train_dehaze(still, [recording], tmp_path / "second", start_from=tmp_path / "first")
    image = torch.rand(1, 3, 64, 96).numpy()
    first, second = (
        load_session(tmp_path / p / "dehaze.onnx", 1)(image=image, working=image)[0] for p in ("first", "second")
    )
    np.testing.assert_allclose(first, second, atol=1e-5)
    assert np.abs(first - image).max() > 1e-3, "the first run must have learned something"
    with pytest.raises(ValueError, match="holds no checkpoint to start from"):
        train_dehaze(QUICK, [recording], tmp_path / "third", start_from=tmp_path / "none")


def test_another_recipe_does_not_go_on(recording: Path, tmp_path: Path) -> None:
    train_dehaze(replace(QUICK, steps=1), [recording], tmp_path)
    with pytest.raises(ValueError, match=r"checkpoint of another recipe \(batch, haze differ\)"):
        train_dehaze(replace(QUICK, batch=3, haze=HazeAugmentation(noise_share=0)), [recording], tmp_path)


def test_a_loss_that_is_no_number_stops_the_run(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deckline.train.dehaze.dehaze_loss", lambda *args: torch.tensor(float("nan")))
    with pytest.raises(FloatingPointError, match="loss is nan at step 0"):
        train_dehaze(QUICK, [recording], tmp_path)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"batch": 0}, "batch must be at least 1, got 0"),
        ({"minutes": 0.0}, "minutes must be positive, got 0.0"),
        ({"size": "xl"}, "size must be one of t, s, b, got 'xl'"),
        ({"network": "ffa-net"}, "network must be one of deckline, aod-net, gca-net, .*, got 'ffa-net'"),
    ],
)
def test_config_errors(keys: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DehazeTrainConfig(**keys)


def test_haze_config_errors() -> None:
    with pytest.raises(ValueError, match="visibility_m must be 0 < low <= high, got 9"):
        HazeAugmentation(visibility_m=(9.0, 3.0))
    with pytest.raises(ValueError, match=r"clear_share must lie in 0\.\.1, got 2"):
        HazeAugmentation(clear_share=2)
