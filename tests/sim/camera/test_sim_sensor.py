"""The sensor: development, tone curves, noise, JPEG."""

from dataclasses import replace

import numpy as np
import pytest
from undo_sensor import undo_sensor

from deckline_sim.camera.sensor import (
    DISPLAY_GAMMA,
    STEPS,
    TARGET,
    WHITE,
    Sensor,
    add_noise,
    blur,
    develop,
    draw_sensor,
    falloff,
    finish,
    jpeg,
    light_of_levels,
    meter,
    noise_sigma,
    tone_level,
    tone_table,
)
from deckline_sim.config import SensorConfig

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def light_of(levels):
    """Linear light that a plain camera shows as these 8-bit levels."""
    return (np.asarray(levels, dtype=np.float32) / 255) ** DISPLAY_GAMMA


def noise_image(seed=0, shape=(20, 30, 3)):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


GREY = light_of(np.full((32, 48, 3), 100))


def test_develop_follows_gain_and_gamma():
    out = develop(GREY, Sensor(gain=(1.0, 2.0, 0.5), gamma=2.0))
    expected = 255 * (np.array([1.0, 2.0, 0.5]) * (100 / 255) ** 2.2) ** (2.0 / 2.2)
    np.testing.assert_array_equal(out[3, 4], np.rint(expected))


def test_default_sensor_changes_nothing():
    image = noise_image()
    kept = image.copy()
    np.testing.assert_array_equal(develop(light_of(image), Sensor()), image)
    np.testing.assert_array_equal(finish(image, Sensor(), np.random.default_rng(0)), image)
    np.testing.assert_array_equal(image, kept)


def test_light_beyond_white_and_below_black_is_clipped():
    out = develop(np.array([[[-1.0, 50.0, 1.0]]], dtype=np.float32), Sensor())
    np.testing.assert_array_equal(out[0, 0], [0, 255, 255])


@pytest.mark.parametrize("tone", ["gamma", "srgb", "filmic"])
def test_a_picture_can_be_undone(tone):
    sensor = Sensor(gain=(0.8, 1.1, 1.3), tone=tone, gamma=1.1, contrast=0.3, black=0.03, saturation=0.8)
    light = np.random.default_rng(2).uniform(0.1, 0.5, (10, 12, 3)).astype(np.float32)
    image = develop(light, sensor)
    np.testing.assert_allclose(undo_sensor(image, sensor), light, rtol=0.04)
    np.testing.assert_array_equal(develop(undo_sensor(image, sensor), sensor), image)


def test_saturation_keeps_the_luminance():
    light = np.full((4, 4, 3), [0.1, 0.2, 0.6], dtype=np.float32)
    back = undo_sensor(develop(light, Sensor(saturation=0.0)), Sensor())
    np.testing.assert_allclose(back[0, 0], np.full(3, [0.1, 0.2, 0.6] @ LUMINANCE), rtol=0.02)


def test_vignetting_is_cos4_in_the_corners():
    share = falloff(721, 1281, 1.0)[..., 0]
    assert share[360, 640] == 1.0
    assert share[0, 0] == pytest.approx(np.cos(np.deg2rad(30.0)) ** 4, rel=3e-3)
    np.testing.assert_allclose(share, share[::-1, ::-1], rtol=1e-6)
    assert falloff(721, 1281, 0.5)[0, 0, 0] == pytest.approx((1 + share[0, 0]) / 2)


def test_blur_keeps_the_light_and_spreads_a_point_as_a_gaussian():
    light = np.zeros((41, 41, 3), dtype=np.float32)
    light[20, 20] = 1.0
    out = blur(light, 1.5)[..., 0].astype(np.float64)
    assert out.sum() == pytest.approx(1.0, abs=1e-5)
    x = np.arange(41) - 20.0
    assert np.sqrt((out.sum(axis=0) * x**2).sum()) == pytest.approx(1.5, rel=0.03)  # cut off at 3 sigma
    np.testing.assert_allclose(blur(GREY, 1.5), GREY, rtol=1e-5)


def test_read_noise_has_its_sigma():
    noisy = add_noise(np.full((200, 200, 3), 128, np.uint8), Sensor(noise=4.0), np.random.default_rng(1))
    assert abs(noisy.astype(float).std() - 4.0) < 0.1


def test_shot_noise_is_that_of_counted_electrons():
    sensor = Sensor(gain=(4.0, 4.0, 4.0), electrons=2000.0)
    rng = np.random.default_rng(3)
    light = np.float32(0.2)  # of white, after the gain
    counted = rng.poisson(light * 1000.0, (300, 300, 1)).astype(np.float32) / 1000.0 / 4.0
    expected = develop(np.repeat(counted, 3, axis=2), sensor).astype(float).std()
    flat = np.full((300, 300, 3), develop(np.full((1, 1, 3), light / 4), sensor)[0, 0, 0], np.uint8)
    assert add_noise(flat, sensor, rng).astype(float).std() == pytest.approx(expected, rel=0.03)
    assert noise_sigma(replace(sensor, electrons=8000.0))[100] == pytest.approx(noise_sigma(sensor)[100] / 2)


def test_the_fixed_pattern_stays():
    sensor = Sensor(pattern=2.0, pattern_seed=5)
    flat = np.full((200, 300, 3), 128, np.uint8)
    first, second = (add_noise(flat, sensor, np.random.default_rng(k)).astype(float) for k in (0, 1))
    np.testing.assert_array_equal(first, second)
    assert first.mean(axis=0).std() == pytest.approx(2.0, rel=0.2)
    assert np.any(add_noise(flat, replace(sensor, pattern_seed=6), np.random.default_rng(0)) != first)


def test_jpeg_is_lossy_and_better_with_quality():
    image = np.repeat(np.clip(128 + np.cumsum(noise_image(1, (64, 64, 1)) / 8.0 - 16, axis=1), 0, 255), 3, axis=2)
    image = image.astype(np.uint8)
    errors = [np.abs(jpeg(image, quality).astype(float) - image).mean() for quality in (10, 60, 95)]
    assert 0 < errors[2] < errors[1] < errors[0]
    red = np.full((16, 16, 3), [200, 30, 20], np.uint8)
    assert np.abs(jpeg(red, 95).astype(int) - red).max() < 6  # channels keep their order


def test_metering_finds_an_even_picture_and_exposure_brings_it_to_the_target():
    assert meter(np.full((40, 40, 3), 0.3, np.float32)) == pytest.approx(0.3, rel=1e-5)
    for level in (0.02, 0.2, 2.0):
        sensors = [draw_sensor(SensorConfig(), 0.0, level, np.random.default_rng(k)) for k in range(40)]
        shown = np.array([level * sensor.gain[1] for sensor in sensors])
        assert np.all(np.abs(np.log(shown / TARGET)) <= 0.2501 * abs(np.log(level / TARGET)))


def test_given_settings_are_kept():
    config = SensorConfig(1.0, (1.0, 2.0, 4.0), 0.5, 0.7, "srgb", 1.5, 900.0, 44)
    for seed in range(5):
        sensor = draw_sensor(config, 1.0, TARGET, np.random.default_rng(seed))
        np.testing.assert_allclose(sensor.gain, [2.0, 4.0, 8.0])
        assert (sensor.vignetting, sensor.blur_px, sensor.tone) == (0.5, 0.7, "srgb")
        assert (sensor.noise, sensor.electrons, sensor.jpeg_quality) == (1.5, 900.0, 44)


CURVES = [("gamma", 1.0, 0.0, 0.0), ("srgb", 0.8, 0.4, 0.05), ("filmic", 1.2, -0.5, 0.0)]


def test_known_values():
    assert tone_level(np.array(0.25), CURVES[0]) == pytest.approx(0.25 ** (1 / DISPLAY_GAMMA))
    # IEC 61966-2-1: 18 % grey is level 0.4614 of sRGB, 0.1 % lies in the linear toe.
    srgb = tone_level(np.array([0.18, 0.001]), ("srgb", 1.0, 0.0, 0.0))
    np.testing.assert_allclose(srgb, [0.4614, 0.01292], atol=1e-4)
    filmic = tone_level(np.array([1.0, 7.3]), ("filmic", 1.0, 0.0, 0.0))
    np.testing.assert_allclose(filmic, [(2.54 / 3.16) ** (1 / DISPLAY_GAMMA), 1.0], atol=1e-3)


@pytest.mark.parametrize("curve", CURVES)
def test_curves_rise_from_black_to_white_and_can_be_undone(curve):
    light = np.linspace(0.0, WHITE[curve[0]], 5000)
    level = tone_level(light, curve)
    assert np.all(np.diff(level) > 0)
    np.testing.assert_allclose([level[0], level[-1]], [curve[3], 1.0], atol=1e-4)
    shown = np.arange(int(np.ceil(255 * curve[3])), 256)
    np.testing.assert_allclose(255 * tone_level(light_of_levels(curve)[shown], curve), shown, atol=0.02)


@pytest.mark.parametrize("curve", CURVES)
def test_the_table_is_the_rounded_curve(curve):
    index = np.arange(0, STEPS, 37)
    exact = 255 * tone_level(WHITE[curve[0]] * (index / (STEPS - 1)) ** 2, curve)
    np.testing.assert_array_equal(tone_table(curve)[index], np.rint(exact))
