"""The single-image dehazer: sky, airlight, veil, and what it leaves alone."""

import numpy as np
import pytest

from deckline.dehaze.veil import VeilConfig, VeilDehazer, find_sky, fit_airlight
from deckline.evaluation.metrics import psnr_db

AIRLIGHT = np.array([0.70, 0.74, 0.80])
HEIGHT, WIDTH, HORIZON = 180, 320, 60


def textured_pair(beta: float) -> tuple[np.ndarray, np.ndarray]:
    """A patchwork of dark and coloured things below a sky, hazy and clear (H, W, 3), near at the bottom."""
    rng = np.random.default_rng(3)
    patches = rng.uniform(0.0, 0.9, (HEIGHT // 6, WIDTH // 8, 3)) * rng.uniform(0.05, 1, (HEIGHT // 6, WIDTH // 8, 1))
    scene = np.kron(patches, np.ones((6, 8, 1)))
    range_m = 40.0 * HEIGHT / np.maximum(np.arange(HEIGHT) - HORIZON, 0.5)[:, None, None]
    t = np.exp(-beta * range_m) * np.ones((HEIGHT, WIDTH, 1))
    hazy = AIRLIGHT + t * (scene - AIRLIGHT)
    for image in (scene, hazy):
        image[:HORIZON] = AIRLIGHT
    return np.rint(255 * hazy).astype(np.uint8), np.rint(255 * scene).astype(np.uint8)


def test_haze_is_taken_off():
    hazy, clear = textured_pair(0.004)
    below = np.s_[HORIZON + 6 :]
    result = VeilDehazer()(hazy)
    assert psnr_db(result[below], clear[below]) > psnr_db(hazy[below], clear[below]) + 2
    assert result[below].std() > 1.1 * hazy[below].std()


def test_a_plain_sky_stays():
    hazy, _ = textured_pair(0.004)
    change = np.abs(VeilDehazer()(hazy)[: HORIZON - 8].astype(int) - hazy[: HORIZON - 8])
    assert change.max() <= 12  # the tone's curve alone


def test_dark_places_say_that_there_is_no_haze():
    _, clear = textured_pair(0.004)
    assert psnr_db(VeilDehazer()(clear), clear) > 32


@pytest.mark.parametrize("level", [0, 5, 20])
def test_night_stays(level):
    image = np.full((90, 160, 3), level, np.uint8)
    image[40:43, 70:73] = 255  # a lamp
    np.testing.assert_array_equal(VeilDehazer()(image), image)


def test_grey_stays_grey():
    grey = textured_pair(0.004)[0].mean(axis=2).astype(np.uint8)
    result = VeilDehazer()(np.repeat(grey[..., None], 3, axis=2))
    assert np.ptp(result, axis=2).max() <= 1


def test_more_strength_takes_off_more():
    hazy, _ = textured_pair(0.004)
    spreads = [VeilDehazer(VeilConfig(strength=share))(hazy)[HORIZON:].std() for share in (0.0, 0.3, 0.6, 0.9)]
    assert spreads == sorted(spreads) and len(set(spreads)) == len(spreads)


def test_the_airlight_follows_the_sky():
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    sky_colour = 0.6 + 0.1 * (y / HEIGHT)[..., None] + 0.15 * (x / WIDTH)[..., None] * AIRLIGHT
    image = sky_colour.astype(np.float32)
    image[HORIZON:] = np.random.default_rng(0).uniform(0, 0.4, (HEIGHT - HORIZON, WIDTH, 3))
    sky = find_sky(image)
    assert sky[: HORIZON - 8].all() and not sky[HORIZON + 4 :].any()
    np.testing.assert_allclose(fit_airlight(image, sky)[: HORIZON - 8], sky_colour[: HORIZON - 8], atol=0.01)


def test_a_dark_top_is_no_sky():
    image = np.full((HEIGHT, WIDTH, 3), 0.05, np.float32)
    image[HORIZON:] = np.random.default_rng(0).uniform(0.4, 0.8, (HEIGHT - HORIZON, WIDTH, 3))
    assert not find_sky(image).any()


@pytest.mark.parametrize("value", [-0.1, 1.0, float("nan")])
def test_a_strength_out_of_range_is_an_error(value):
    with pytest.raises(ValueError, match="strength"):
        VeilConfig(strength=value)
