import numpy as np
import pytest

from deckline.geometry import Camera, camera_mount
from deckline.sim.camera.exposure import Exposure, FilmConfig, draw_exposure

CAMERA = Camera.from_fov(640, 360, 1.0)
LEVEL = camera_mount()  # looks north: optical z is world x
VELOCITY, STEADY = np.array([60.0, 2.0, 3.0]), np.zeros(3)


def drawn(config, seed=0, wide=True):
    rngs = [np.random.default_rng([seed, k]) for k in range(2)]
    return draw_exposure(config, CAMERA, LEVEL, VELOCITY, STEADY, *rngs, wide)


def test_named_presets_are_still_and_dry():
    exposure = drawn(FilmConfig(), wide=False)
    assert exposure.still
    assert (exposure.exposure_s, exposure.rain_mm_h, exposure.lens_drops) == (0.0, 0.0, 0)


def test_flight_becomes_motion_in_the_optical_frame():
    exposure = drawn(FilmConfig(exposure_s=0.01), wide=False)
    np.testing.assert_allclose(exposure.moved_m, [0.02, 0.03, 0.6], atol=1e-12)
    assert exposure.turned_rad == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(exposure.rain_m_s, [-2.0, 9.0 - 3.0, -60.0], atol=1e-9)
    assert not exposure.still


def test_training_draws_some_of_each():
    exposures = [drawn(FilmConfig(), seed) for seed in range(400)]
    assert 0.15 < np.mean([e.exposure_s > 0 for e in exposures]) < 0.3
    assert 0.03 < np.mean([e.rain_mm_h > 0 for e in exposures]) < 0.14
    assert 0.03 < np.mean([e.lens_drops > 0 for e in exposures]) < 0.16
    turned = np.array([np.linalg.norm(e.turned_rad) for e in exposures])
    assert 0.0 < turned.max() * CAMERA.fx <= 0.02 * CAMERA.width + 1e-6


def test_given_shake_has_its_sigma():
    config = FilmConfig(exposure_s=0.02, shake_deg_s=3.0)
    turned = np.array([drawn(config, seed, wide=False).turned_rad for seed in range(2000)])
    np.testing.assert_allclose(np.rad2deg(turned).std(axis=0), 0.06, rtol=0.06)


def test_flight_turns_the_camera_in_the_optical_frame():
    rngs = [np.random.default_rng(k) for k in range(2)]
    turning = np.array([0.1, 0.2, 0.3])  # about north, east and down: rolling, pitching up, yawing right
    exposure = draw_exposure(FilmConfig(exposure_s=0.01), CAMERA, LEVEL, VELOCITY, turning, *rngs, wide=False)
    np.testing.assert_allclose(exposure.turned_rad, [0.002, 0.003, 0.001], atol=1e-12)


def test_stillness():
    assert Exposure().still
    assert not Exposure(turned_rad=(0.0, 1e-4, 0.0)).still
    assert not Exposure(lens_drops=1).still


def test_wrong_settings_are_named():
    with pytest.raises(ValueError, match=r"exposure_s must lie between 0 and 1\.0, got 2\.0"):
        FilmConfig(exposure_s=2.0)
    with pytest.raises(ValueError, match=r"rain_mm_h must lie between 0 and 500\.0, got -1\.0"):
        FilmConfig(rain_mm_h=-1.0)


def test_a_recording_keeps_its_shutter_and_the_drops_on_its_lens():
    config = FilmConfig(exposure_s=0.01, rain_mm_h=20.0, lens_drops=9)
    first, second = (
        draw_exposure(
            config, CAMERA, LEVEL, VELOCITY, STEADY, np.random.default_rng(1), np.random.default_rng(k), wide=True
        )
        for k in (2, 3)
    )
    assert (first.lens_seed, first.streak_contrast) == (second.lens_seed, second.streak_contrast)
    assert first.seed != second.seed
    assert first.turned_rad != second.turned_rad
