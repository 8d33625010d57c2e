"""The single-image dehazer: veil, tone, and what it leaves alone."""

import numpy as np
import pytest

from deckline.dehaze.veil import LEVELS, STRENGTH, VeilDehazer, estimate_air, to_full_scale, tone_table
from deckline_lab.evaluation.metrics import psnr_db

AIRLIGHT = np.array([0.70, 0.74, 0.80])
HEIGHT, WIDTH, HORIZON = 180, 320, 60


def textured_pair(beta: float, colourless: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """A patchwork of dark and coloured things below a sky, hazy and clear (H, W, 3), near at the bottom."""
    rng = np.random.default_rng(3)
    size = HEIGHT // 6, WIDTH // 8
    patches = rng.uniform(colourless, 1, (*size, 3)) * rng.uniform(0.04, 0.9, (*size, 1)) ** 2
    scene = np.kron(patches, np.ones((6, 8, 1)))
    range_m = 40.0 * HEIGHT / np.maximum(np.arange(HEIGHT) - HORIZON, 0.5)[:, None, None]
    t = np.exp(-beta * range_m) * np.ones((HEIGHT, WIDTH, 1))
    hazy = AIRLIGHT + t * (scene - AIRLIGHT)
    for image in (scene, hazy):
        image[:HORIZON] = AIRLIGHT
    return np.rint(255 * hazy).astype(np.uint8), np.rint(255 * scene).astype(np.uint8)


def contrast(image: np.ndarray) -> float:
    return float(image.std() / image.mean())


def test_haze_is_taken_off():
    hazy, clear = textured_pair(0.004)
    below = np.s_[HORIZON + 6 :]
    result = VeilDehazer()(hazy)
    assert psnr_db(result[below], clear[below]) > psnr_db(hazy[below], clear[below]) + 1.5
    assert contrast(result[below]) > 1.15 * contrast(hazy[below])


def test_more_comes_off_in_thick_fog_than_in_haze():
    shares = []
    for beta in (0.004, 0.02):
        image = to_full_scale(textured_pair(beta)[0])
        shares.append(estimate_air(image, image, 0.004, 8).strength)
    assert shares[0] == STRENGTH[0] < shares[1] <= STRENGTH[1]


def test_a_plain_sky_stays():
    hazy, _ = textured_pair(0.004)
    change = np.abs(VeilDehazer()(hazy)[: HORIZON - 8].astype(int) - hazy[: HORIZON - 8])
    assert change.max() <= 12  # the tone's curve alone


def test_dark_places_show_that_there_is_no_haze():
    _, clear = textured_pair(0.004)
    assert psnr_db(VeilDehazer()(clear), clear) > 32


def test_colours_show_that_there_is_no_haze():
    colourful, grey = textured_pair(0.002, colourless=0.0)[0], textured_pair(0.002)[0]
    assert psnr_db(VeilDehazer()(colourful), colourful) > 32
    assert psnr_db(VeilDehazer()(grey), grey) < 28


@pytest.mark.parametrize(("first", "is_kept"), [(HORIZON, True), (HEIGHT - 11, False)])
def test_colours_in_the_distance_say_more_than_near_ones(first: int, is_kept: bool) -> None:
    tinted = textured_pair(0.002)[0].astype(float)
    tinted[first : first + 11] *= [1.0, 0.85, 0.75]
    tinted = tinted.astype(np.uint8)
    assert (psnr_db(VeilDehazer()(tinted), tinted) > 32) is is_kept


def with_airlight(colour: np.ndarray) -> np.ndarray:
    """The hazy patchwork (H, W, 3) in air of another colour."""
    hazy, _ = textured_pair(0.004)
    return np.rint(hazy / AIRLIGHT * colour).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize(("colour", "kept_db"), [((0.9, 0.7, 0.5), 40), ((0.35, 0.5, 0.8), 40)])
def test_a_low_sun_and_a_blue_sky_are_no_haze(colour: tuple[float, ...], kept_db: float) -> None:
    coloured, grey = with_airlight(np.array(colour)), with_airlight(np.full(3, 0.7))
    assert psnr_db(VeilDehazer()(coloured), coloured) > kept_db
    assert psnr_db(VeilDehazer()(grey), grey) < kept_db - 10


def test_a_mast_before_bright_haze_does_not_turn_black() -> None:
    hazy, _ = textured_pair(0.004)
    hazy[20:110, 160:162] = 75
    mast = VeilDehazer()(hazy)[30:55, 160:162]
    assert mast.min() > 25
    assert mast.mean() < 75


def test_no_dark_glow_stands_around_a_ship() -> None:
    """The water beside a ship comes out as dark as the water a tenth of the picture on, along the same rows."""
    t = np.linspace(0.05, 0.7, HEIGHT - HORIZON)[:, None, None]
    hazy = np.broadcast_to(AIRLIGHT, (HEIGHT, WIDTH, 3)).copy()
    hazy[HORIZON:] += t * (np.array([0.2, 0.3, 0.35]) - AIRLIGHT)
    ship, rows = np.s_[90:98, 150:170], np.s_[88:100]
    hazy[ship] += t[90 - HORIZON] * -0.12
    picture = np.rint(255 * hazy).astype(np.uint8)
    clear = VeilDehazer()(picture).astype(float)
    beside, farther = (clear[rows, columns].mean() for columns in (np.s_[172:180], np.s_[210:218]))
    assert beside > farther - 4  # levels; 6.4 where only what is near the ship is cleared
    assert farther - clear[ship].mean() > 1.3 * (picture[rows, 210:218].mean() - picture[ship].mean())


def test_tone_lifts_dark_places_and_not_white() -> None:
    table = tone_table(0.7, 0.8).astype(float)
    plain = 255 * np.linspace(0, 1, LEVELS)
    assert np.all(np.diff(table) >= 0)
    assert table[LEVELS // 4] > plain[LEVELS // 4] + 20
    np.testing.assert_allclose(table[plain > 0.9 * 255], plain[plain > 0.9 * 255], atol=0.5)
