"""The airlight of one image: its sky, the surface through it, and where it follows the sky's own colour."""

import numpy as np

from deckline.dehaze.airlight import estimate_airlight_surface, find_sky, find_smooth_top, fit_airlight

AIRLIGHT = np.array([0.70, 0.74, 0.80])
HEIGHT, WIDTH, HORIZON = 180, 320, 60


def sky_over_patchwork(colour=AIRLIGHT, dark=0.0) -> np.ndarray:
    image = np.broadcast_to(colour, (HEIGHT, WIDTH, 3)).astype(np.float32)
    image[HORIZON:] = np.random.default_rng(0).uniform(dark, dark + 0.4, (HEIGHT - HORIZON, WIDTH, 3))
    return image


def test_the_airlight_follows_the_sky():
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    sky_colour = 0.6 + 0.1 * (y / HEIGHT)[..., None] + 0.15 * (x / WIDTH)[..., None] * AIRLIGHT
    image = sky_over_patchwork(sky_colour)
    sky = find_sky(image, find_smooth_top(image))
    assert sky[: HORIZON - 8].all() and not sky[HORIZON + 4 :].any()
    np.testing.assert_allclose(fit_airlight(image, sky)[: HORIZON - 8], sky_colour[: HORIZON - 8], atol=0.01)


def test_a_dark_top_is_no_sky():
    image = sky_over_patchwork(0.05, dark=0.4)
    assert not find_sky(image, find_smooth_top(image)).any()


def test_the_airlight_follows_a_dark_corner_and_a_dark_horizon() -> None:
    image = sky_over_patchwork()
    y, x = np.mgrid[:HEIGHT, :WIDTH] / WIDTH
    darker = 0.12 * np.exp(-np.hypot(x, y) / 0.06) + 0.1 * np.exp((y - HORIZON / WIDTH) / 0.03)
    image[:HORIZON] *= 1 - darker[:HORIZON, :, None]
    sky = find_sky(image, find_smooth_top(image))
    inside = np.s_[4 : HORIZON - 8, 4:-4]
    surface_error = np.abs(fit_airlight(image, sky) - image)[inside].max()
    assert np.abs(estimate_airlight_surface(image).colour - image)[inside].max() < 0.7 * surface_error


def test_a_ship_in_fog_does_not_darken_the_airlight() -> None:
    image = sky_over_patchwork()
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    ship = np.exp(-np.square((x - 160) / 24) - np.square((y - 28) / 14))
    image[:HORIZON] -= 0.06 * ship[:HORIZON, :, None].astype(np.float32)
    np.testing.assert_allclose(estimate_airlight_surface(image).colour[28, 160], AIRLIGHT, atol=0.02)


def test_airlight_is_less_certain_where_the_sky_is_off_its_surface() -> None:
    image = sky_over_patchwork()
    even = estimate_airlight_surface(image).sigma
    y, x = np.mgrid[:HORIZON, :WIDTH]
    image[:HORIZON] += 0.1 * np.exp(-np.square((x - 160) / 40) - np.square(y / 40))[..., None].astype(np.float32)
    uneven = estimate_airlight_surface(image).sigma
    assert uneven[:HORIZON].max() > 1.2 * even[:HORIZON].max()


def test_a_white_frame_hides_no_sky() -> None:
    image = sky_over_patchwork().repeat(2, axis=0).repeat(2, axis=1)
    image[:2] = 1
    assert find_smooth_top(image)[12 : 2 * HORIZON - 8].mean() > 0.9
