"""Exposure: motion blur, rain, drops on the lens."""

import numpy as np
import pytest

from deckline.geometry import Camera, camera_mount
from deckline_sim.camera import exposure as rain
from deckline_sim.camera.exposure import (
    Exposure,
    ExposurePass,
    draw_exposure,
    streak_quads,
    streaks,
)
from deckline_sim.config import ExposureConfig
from deckline_sim.scene.view import Rendering

CAMERA = Camera.from_fov(640, 360, 1.0)
LEVEL = camera_mount()  # looks north: optical z is world x
VELOCITY, STEADY = np.array([60.0, 2.0, 3.0]), np.zeros(3)


def drawn(config, seed=0, wide=True, turning=STEADY, frame_seed=1):
    rngs = [np.random.default_rng([seed, k]) for k in (0, frame_seed)]
    return draw_exposure(config, CAMERA, LEVEL, VELOCITY, turning, *rngs, wide)


def test_flight_becomes_motion_in_the_optical_frame():
    turning = np.array([0.1, 0.2, 0.3])  # about north, east and down: rolling, pitching up, yawing right
    exposure = drawn(ExposureConfig(exposure_s=0.01), wide=False, turning=turning)
    np.testing.assert_allclose(exposure.moved_m, [0.02, 0.03, 0.6], atol=1e-12)
    np.testing.assert_allclose(exposure.turned_rad, [0.002, 0.003, 0.001], atol=1e-12)
    np.testing.assert_allclose(exposure.rain_m_s, [-2.0, 9.0 - 3.0, -60.0], atol=1e-9)
    assert not exposure.still and drawn(ExposureConfig(), wide=False).still


def test_given_shake_has_its_sigma():
    config = ExposureConfig(exposure_s=0.02, shake_deg_s=3.0)
    turned = np.array([drawn(config, seed, wide=False).turned_rad for seed in range(2000)])
    np.testing.assert_allclose(np.rad2deg(turned).std(axis=0), 0.06, rtol=0.06)


def test_a_recording_keeps_its_shutter_and_the_drops_on_its_lens():
    config = ExposureConfig(exposure_s=0.01, rain_mm_h=20.0, lens_drops=9)
    first, second = (drawn(config, frame_seed=k) for k in (2, 3))
    assert (first.lens_seed, first.streak_contrast) == (second.lens_seed, second.streak_contrast)
    assert first.seed != second.seed
    assert first.turned_rad != second.turned_rad


SMALL = Camera(160, 96, 120.0, 120.0, 79.5, 47.5)
FLAT = np.full((96, 160), 30.0, np.float32)


@pytest.fixture(scope="module")
def exposure_pass(context):
    return ExposurePass(context)


def expose(exposure_pass, picture, depth, camera=None, **exposure):
    return exposure_pass.expose(Rendering(picture, depth), camera or SMALL, Exposure(**exposure)).radiance


def dot(u=80, v=48, light=8.0):
    picture = np.zeros((96, 160, 3), np.float32)
    picture[v, u] = light
    return picture


def texture_picture(seed=0):
    return np.random.default_rng(seed).random((96, 160, 3), np.float32)


def test_a_moving_dot_becomes_a_streak_with_the_same_light(exposure_pass):
    # 2.5 m to the right at 30 m is 10 px to the left in the picture.
    out = expose(exposure_pass, dot(), FLAT, exposure_s=0.1, moved_m=(2.5, 0.0, 0.0))[..., 0].astype(float)
    row = out[48]
    assert out.sum() == pytest.approx(8.0, rel=1e-4)
    assert row.sum() == pytest.approx(8.0, rel=1e-4)
    np.testing.assert_allclose(row[76:85], 0.8, rtol=1e-3)
    assert row[75] + row[85] == pytest.approx(0.8, rel=1e-3)
    assert (row @ np.arange(160)) / row.sum() == pytest.approx(80.0, abs=0.01)
    assert not row[:75].any() and not row[86:].any()


def test_near_things_blur_and_far_ones_do_not_when_the_camera_moves(exposure_pass):
    depth = FLAT.copy()
    depth[:48] = np.nan
    picture = texture_picture()
    out = expose(exposure_pass, picture, depth, moved_m=(1.0, 0.0, 0.0))
    np.testing.assert_array_equal(out[:48], picture[:48])
    assert out[49:].std() < 0.7 * picture[49:].std()


def test_turning_blurs_the_sky_too(exposure_pass):
    sky = np.full_like(FLAT, np.nan)
    yaw = 6.0 / SMALL.fx  # about the optical y axis: 6 px at the middle
    row = expose(exposure_pass, dot(), sky, turned_rad=(0.0, yaw, 0.0))[48, :, 0]
    assert np.count_nonzero(row > 0.05 * row.max()) == 7
    assert row.sum() == pytest.approx(8.0, rel=0.01)
    roll = expose(exposure_pass, dot(), sky, turned_rad=(0.0, 0.0, 0.1))
    assert roll[48, 80, 0] > 7.0  # the middle stays


def test_nothing_moves_nothing_changes(exposure_pass):
    picture = texture_picture()
    assert expose(exposure_pass, picture, FLAT, exposure_s=0.02) is picture
    hardly = expose(exposure_pass, picture, FLAT, turned_rad=(1e-7, 0.0, 0.0))
    np.testing.assert_array_equal(hardly, picture)


def test_rain_changes_the_picture_and_follows_its_seed(exposure_pass):
    picture, depth = texture_picture() * 0.2, FLAT.copy()
    wet, again = (expose(exposure_pass, picture, depth, rain_mm_h=40.0, streak_contrast=10.0, seed=3) for _ in range(2))
    np.testing.assert_array_equal(wet, again)
    np.testing.assert_array_equal(depth, FLAT)
    changed = np.any(wet != picture, axis=2)
    assert 0.001 < changed.mean() < 0.9
    other = expose(exposure_pass, picture, FLAT, rain_mm_h=40.0, streak_contrast=10.0, seed=4)
    assert np.any(other != wet)


def test_a_streak_brightens_by_its_opacity(exposure_pass):
    wet = expose(exposure_pass, np.full((96, 160, 3), 1.0, np.float32), FLAT, rain_mm_h=40.0, seed=3)
    np.testing.assert_allclose(wet, 1.0, rtol=1e-5)  # drops as bright as an even picture do not show


def test_drops_on_the_lens_turn_the_picture_upside_down_and_stay_local(exposure_pass):
    picture = np.zeros((96, 160, 3), np.float32)
    picture[:48] = 1.0
    out = expose(exposure_pass, picture, FLAT, lens_drops=150, lens_seed=8)
    changed = np.any(np.abs(out - picture) > 1e-3, axis=2)
    assert 0.02 < changed.mean() < 0.5
    assert out.min() >= 0.0 and out.max() <= 1.0 + 1e-5
    assert out[:40].min() < 0.9 and out[56:].max() > 0.1


def test_wrong_use_is_named(exposure_pass):
    with pytest.raises(ValueError, match=r"\(96, 160\)"):
        expose(exposure_pass, dot(), FLAT, Camera.from_fov(64, 40, 1.0), lens_drops=2)


def rain_streaks(rain_mm_h, velocity=(0.0, 9.0, 0.0), exposure_s=1e-3, seed=0):
    return streaks(CAMERA, np.array(velocity), exposure_s, rain_mm_h, np.random.default_rng(seed)).astype(float)


def lengths(quads):
    """Length (N,) of each streak along its axis."""
    return np.linalg.norm(quads[:, 5, :2] - quads[:, 0, :2], axis=1)


def test_drops_before_the_lens_are_as_many_as_marshall_and_palmer_count(monkeypatch):
    assert len(rain_streaks(25.0)) == pytest.approx(4000, rel=0.05)
    monkeypatch.setattr(rain, "MOST_STREAKS", 10**6)
    reach = CAMERA.fx * 0.002 / 0.35
    volume = 640 * 360 / CAMERA.fx**2 * (reach**3 - 0.25**3) / 3
    for rain_mm_h in (1.0, 25.0):
        slope = 4.1 * rain_mm_h**-0.21
        expected = 8000.0 / slope * np.exp(-slope * 0.5) * volume
        got = np.mean([len(rain_streaks(rain_mm_h, seed=seed)) for seed in range(4)])
        assert got == pytest.approx(expected, rel=0.05)


def test_a_streak_covers_its_path_and_conserves_what_the_drop_hides():
    quads = streak_quads(np.array([[10.0, 20.0]]), np.array([[10.0, 50.0]]), np.array([3.0])).astype(float)
    np.testing.assert_allclose([quads[0, :, 0].min(), quads[0, :, 0].max()], [8.5, 11.5])
    np.testing.assert_allclose([quads[0, :, 1].min(), quads[0, :, 1].max()], [18.5, 51.5])
    assert quads[0, 0, 4] == pytest.approx(3.0 / 33.0)
    thin = streak_quads(np.array([[10.0, 20.0]]), np.array([[10.0, 50.0]]), np.array([0.5])).astype(float)
    assert np.ptp(thin[0, :, 0]) == pytest.approx(1.0)
    assert thin[0, 0, 4] == pytest.approx(0.5 * 0.5 / 30.5)


def test_falling_drops_draw_upright_streaks_as_long_as_they_fall():
    quads = rain_streaks(25.0, exposure_s=0.01)
    path = quads[:, 5, :2] - quads[:, 0, :2]
    np.testing.assert_allclose(path[:, 0], 0.0, atol=1e-3)
    longest = CAMERA.fx * 0.09 / 0.25 + CAMERA.fx * 0.02 / 0.25
    assert 5.0 < np.median(lengths(quads)) < lengths(quads).max() < longest


def test_flying_through_rain_draws_it_away_from_where_one_flies_to():
    quads = rain_streaks(25.0, velocity=(0.0, 0.0, -60.0), exposure_s=2e-3)
    middle = quads[:, :, :2].mean(axis=1) - [CAMERA.cx, CAMERA.cy]
    path = quads[:, 5, :2] - quads[:, 0, :2]
    long = lengths(quads) > 8.0
    across = (path[:, 0] * middle[:, 1] - path[:, 1] * middle[:, 0]) / np.linalg.norm(middle, axis=1) / lengths(quads)
    assert long.sum() > 20
    assert np.abs(across[long]).max() < 0.05
