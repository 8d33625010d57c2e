"""Haze that training adds to clear views follows the scattering laws; the prior is what geometry alone can give."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from clear_scene import QUICK, clear_frame, clear_recording, pair_folder
from deckline.dehaze.pixel_map import linear_levels
from deckline.geometry import Camera, camera_mount
from deckline.haze import beta_from_visibility, transmission
from deckline_lab.datasets.tiles import tile_corners
from deckline_lab.evaluation.metrics import psnr_db
from deckline_lab.train.airlight import random_airlight
from deckline_lab.train.clear_views import ClearView, lowest_z, make_clear_view
from deckline_lab.train.dehaze_samples import (
    HazeAugmentation,
    add_physical_haze,
    add_random_haze,
    geometry_prior,
    make_batch,
    make_pair,
    random_tile,
    random_window,
)
from deckline_lab.train.pair_views import PairView, open_clear_views
from dehaze.sea_scene import AIRLIGHT, CAMERA, ray_z, sea_pair, world_from_body

EYE_M, DECK_Z_M, SEA_Z_M = 60.0, -8.0, 12.0
BODY = world_from_body(eye_z_m=SEA_Z_M - EYE_M)
POSE = BODY * camera_mount()
PLAIN = HazeAugmentation(clear_share=0, noise_share=0)


@pytest.fixture(scope="module")
def view() -> ClearView:
    """A dark textured sea under a bright sky, seen from above."""
    down = ray_z(BODY)
    with np.errstate(over="ignore"):
        ranges = np.where(down > 0, EYE_M / np.maximum(down, 1e-9), np.inf).astype(np.float16)
    return ClearView(sea_pair(0.0)[1], ranges, AIRLIGHT.astype(np.float32), CAMERA, POSE, DECK_Z_M, SEA_Z_M)


def test_the_sea_is_the_lowest_thing_in_view(view: ClearView) -> None:
    """Half-precision ranges are right to 0.05 %, so the water's height is, of the 60 m it lies below."""
    assert lowest_z(view.range_m.astype(float), CAMERA, POSE) == pytest.approx(SEA_Z_M, abs=0.05)
    assert lowest_z(np.full((180, 320), np.inf), CAMERA, POSE) == SEA_Z_M - EYE_M


def test_the_prior_brings_the_clear_picture_nearer_wherever_the_sea_lies(view: ClearView) -> None:
    hazy, _ = add_random_haze(view, replace(PLAIN, visibility_m=(700, 700), exact_share=1, horizon_share=1), rng(3))
    assert psnr_db(geometry_prior(view, hazy, rng(0)), view.clear_rgb) > psnr_db(hazy, view.clear_rgb) + 8
    for without in (replace(view, world_from_camera=None), replace(view, deck_z_m=None)):
        np.testing.assert_array_equal(geometry_prior(without, hazy, rng(0)), hazy)


def test_recorded_haze_is_kept_when_asked_for(view: ClearView) -> None:
    seen = np.full_like(view.clear_rgb, 77)
    recorded = replace(view, hazy_rgb=seen, visibility_m=900.0)
    hazy, t = add_random_haze(recorded, replace(PLAIN, recorded_share=1), rng(0))
    np.testing.assert_array_equal(hazy, seen)
    np.testing.assert_allclose(t, transmission(view.range_m, 3.912 / 900), atol=1e-5)
    plain = [add_random_haze(each, PLAIN, rng(4))[0] for each in (view, recorded)]
    np.testing.assert_array_equal(*plain)


def test_physical_haze_hides_the_sky_and_spares_what_is_near(view: ClearView) -> None:
    """Air that thins with height is seen through upwards, so the sky is judged in even air only."""
    for seed in range(30):
        hazy, t = add_physical_haze(view, 400.0, np.array([150.0, 165.0, 180.0]), rng(seed))
        assert t.shape == (180, 320)
        assert ((t >= 0) & (t <= 1)).all()
        near, far = t[-1].mean(), t[np.isfinite(view.range_m)].min()
        assert far < near
        light = linear_levels(np.arange(256))[hazy[-1]].mean(axis=0)
        assert (light > linear_levels(np.arange(256))[view.clear_rgb[-1]].mean(axis=0) * near - 1).all()
    with pytest.raises(ValueError, match="pose"):
        add_physical_haze(replace(view, world_from_camera=None), 400.0, np.ones(3), rng(0))


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_make_pair_follows_the_scattering_model() -> None:
    """At one visibility, airlight and range: I = J t + A (1 - t), the same t everywhere, also without a pose."""
    clear = np.random.default_rng(0).integers(0, 256, (30, 40, 3), dtype=np.uint8)
    view = ClearView(clear, np.full((30, 40), 400, dtype=np.float16), None, Camera.from_fov(40, 30, 1.2))
    haze = replace(PLAIN, visibility_m=(800.0, 800.0), physical_share=1, flip_horizontal=0)
    hazy, kept, t, prior = make_pair(view, (slice(0, 30), slice(0, 40)), haze, rng(1))
    np.testing.assert_array_equal(kept, clear)
    np.testing.assert_array_equal(prior, hazy)
    np.testing.assert_allclose(t, transmission(400.0, beta_from_visibility(800.0)), rtol=1e-6)
    slope, offset = np.polyfit(clear[..., 0].ravel(), hazy[..., 0].ravel(), 1)
    assert slope == pytest.approx(0.02**0.5, abs=2e-3)  # Koschmieder: half of the visibility leaves sqrt(2 %)
    assert 40 <= offset / (1 - slope) <= 250


def test_flips_move_image_and_transmission_together() -> None:
    view = make_clear_view(clear_frame(3), 640)
    window = (slice(0, 64), slice(0, 96))
    hazes = (replace(PLAIN, visibility_m=(500, 500), flip_horizontal=flip, flip_vertical=flip) for flip in (0, 1))
    plain, flipped = (make_pair(view, window, haze, rng(5)) for haze in hazes)
    for a, b in zip(plain, flipped, strict=True):
        np.testing.assert_array_equal(a, b[::-1, ::-1])


def test_a_pair_retains_its_haze_and_gets_noise() -> None:
    clear, hazy = (rng(k).integers(20, 230, (30, 40, 3), dtype=np.uint8) for k in (0, 1))
    window = (slice(2, 30), slice(0, 24))
    haze = replace(PLAIN, prior_share=1, flip_horizontal=0)
    mine, kept, t, prior = make_pair(PairView(clear, hazy), window, haze, rng(0), prior=True)
    for got, expected in ((mine, hazy), (kept, clear), (prior, hazy)):
        np.testing.assert_array_equal(got, expected[window])
    assert t.shape == (28, 24) and (t == 1).all()
    noisy, _ = add_random_haze(PairView(clear, hazy), HazeAugmentation(noise_share=1, noise_max=9), rng(1))
    sigma = (noisy.astype(float) - hazy).std()
    assert 1 < sigma < 9.1 and abs((noisy.astype(float) - hazy).mean()) < 0.3


def test_clear_share_leaves_images_alone() -> None:
    view = make_clear_view(clear_frame(0), 640)
    window = (slice(16, 64), slice(0, 96))  # below the sky, which any haze hides
    haze = HazeAugmentation(clear_share=1.0, noise_share=0, flip_horizontal=0, clear_visibility_m=(1e5, 1e6))
    hazy, clear, *_ = make_pair(view, window, haze, np.random.default_rng(0))
    assert np.abs(hazy.astype(int) - clear).max() <= 13  # 5.7 % of the way to the airlight at 1.5 km


def test_airlight_is_a_possible_colour_or_exactly_the_horizons() -> None:
    horizon = np.array([200, 100, 50], np.float32)
    drawn = np.array([random_airlight(horizon, 0.5, rng(k)) for k in range(300)])
    assert drawn.min() >= 40 and drawn.max() <= 250 and drawn.std(axis=0).min() > 20
    exact = np.array([random_airlight(horizon, 1.0, rng(k), exact_share=1.0) for k in range(200)])
    np.testing.assert_allclose(exact.mean(axis=0), horizon, rtol=0.01)
    np.testing.assert_allclose(exact.std(axis=0), 0.02 * horizon, rtol=0.25)


def test_windows_fit() -> None:
    for size in [(64, 96), (30, 200), (48, 64)]:
        for seed in range(50):
            rows, columns = random_window(size, (48, 64), (0.5, 2.0), rng(seed))
            assert 0 <= rows.start < rows.stop <= size[0]
            assert 0 <= columns.start < columns.stop <= size[1]


def test_sub_images_are_the_papers_eight_squares(tmp_path: Path) -> None:
    drawn = {(w[0].start, w[1].start) for w in (random_tile((360, 640), 256, rng(k)) for k in range(200))}
    assert drawn == {(top, left) for top in (0, 104) for left in (0, 128, 256, 384)}
    views = open_clear_views([pair_folder(tmp_path, pairs=3)], 640, 0.0)
    haze = HazeAugmentation(noise_share=0.0, flip_horizontal=0.0)
    hazy, clear, *_ = make_batch(views, 6, (48, 48), haze, [0, 0], False, sub_images=True)
    corners = tile_corners(96, 64, 48)
    possible = {
        tuple(image[top : top + 48, left : left + 48].tobytes() for image in (view.hazy_rgb, view.clear_rgb))
        for view in (views[k] for k in range(3))
        for left, top in corners
    }
    for pair in zip(hazy, clear, strict=True):
        assert tuple((255 * x).round().byte().permute(1, 2, 0).numpy().tobytes() for x in pair) in possible


def test_sub_images_are_squares_that_fit(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"crop_height 48.*crop_width 64"):
        replace(QUICK, sub_images=True)
    views = open_clear_views([pair_folder(tmp_path, pairs=1)], 640, 0.0)
    with pytest.raises(ValueError, match=r"65.*96x64"):
        make_batch(views, 1, (65, 65), HazeAugmentation(), [0, 0], False, sub_images=True)


def test_batches_repeat_for_the_same_seed(tmp_path: Path) -> None:
    views = open_clear_views([clear_recording(tmp_path, frames=8)], 640, 0.25)
    first, second, other = (make_batch(views, 3, (48, 64), HazeAugmentation(), [0, k], False) for k in (7, 7, 8))
    assert [tuple(x.shape) for x in first] == [(3, 3, 48, 64), (3, 3, 48, 64), (3, 1, 48, 64), (3, 3, 48, 64)]
    torch.testing.assert_close(first, second, rtol=0, atol=0)
    assert not torch.equal(first[0], other[0])


@pytest.mark.parametrize(("name", "value"), [("visibility_m", (9.0, 3.0)), ("clear_share", 2), ("flip_vertical", -1)])
def test_haze_config_errors(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"{name}.*{np.ravel(value)[-1]}"):
        HazeAugmentation(**{name: value})
