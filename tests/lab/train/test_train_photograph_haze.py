"""Haze in photographs of no known depth, for training."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deckline_lab.train.clear_views import ClearView
from deckline_lab.train.dehaze_samples import HazeAugmentation, make_pair
from deckline_lab.train.photographs import add_camera_air, made_up_ranges, open_photographs

SKY, SEA = (150, 190, 230), (40, 60, 70)
HEIGHT, WIDTH, HORIZON = 120, 200, 50


def photograph(seed: int = 0) -> np.ndarray:
    """A plain sky with a dark cloud above a rough sea."""
    rng = np.random.default_rng(seed)
    picture = np.empty((HEIGHT, WIDTH, 3), np.float64)
    picture[:HORIZON], picture[HORIZON:] = SKY, SEA
    picture[15:25, 60:90] = 90
    picture[HORIZON:] += rng.normal(0, 12, (HEIGHT - HORIZON, WIDTH, 1))
    return picture.clip(0, 255).astype(np.uint8)


@pytest.fixture
def view(tmp_path: Path) -> ClearView:
    Image.fromarray(photograph()).save(tmp_path / "sea.png")
    return open_photographs(tmp_path, WIDTH, 0.0)[0]


def test_sky_has_no_end_and_the_sea_comes_nearer_downwards(view: ClearView) -> None:
    ranges = view.range_m.astype(np.float64)
    assert np.isinf(ranges[: HORIZON - 6]).all()  # its cloud too
    sea = ranges[HORIZON + 4 :].mean(axis=1)
    assert np.isfinite(sea).all()
    assert sea[0] > 2 * sea[-1]
    assert np.median(ranges[np.isfinite(ranges)]) == pytest.approx(300, rel=0.05)


def test_a_picture_without_sky_has_an_end_everywhere() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    assert np.isfinite(made_up_ranges(noise, np.random.default_rng(1))).all()


def test_what_haze_hides_is_not_asked_back_and_what_shows_is(view: ClearView) -> None:
    errors = {"sky": [], "near": []}
    for seed in range(8):
        hazy, wanted, t = add_camera_air(view, 800.0, np.full(3, 200.0), np.random.default_rng(seed))
        assert hazy.shape == wanted.shape == view.clear_rgb.shape and hazy.dtype == wanted.dtype == np.uint8
        assert (t[: HORIZON - 6] == 0).all() and (t[-1] > 0.1).all()
        difference = np.abs(hazy.astype(float) - wanted).mean(axis=(1, 2))
        errors["sky"].append(difference[:40].mean())
        errors["near"].append(difference[-20:].mean())
    assert np.median(errors["sky"]) < 5 < np.median(errors["near"])


def test_pairs_of_photographs_start_from_what_flight_has(view: ClearView) -> None:
    whole = (slice(0, HEIGHT), slice(0, WIDTH))
    rng = np.random.default_rng(3)
    hazy, _, _, prior = make_pair(view, whole, HazeAugmentation(veil_share=1.0, flip_horizontal=0.0), rng, prior=True)
    assert not np.array_equal(hazy, prior)
    hazy, _, _, prior = make_pair(view, whole, HazeAugmentation(veil_share=0.0), rng, prior=True)
    np.testing.assert_array_equal(hazy, prior)
