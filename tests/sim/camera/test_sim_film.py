import numpy as np
import pytest

from deckline.geometry import Camera
from deckline.sim.camera.exposure import Exposure
from deckline.sim.camera.film import Film, bright
from deckline.sim.scene.gl import RendererError, open_context

CAMERA = Camera(160, 96, 120.0, 120.0, 79.5, 47.5)
FLAT = np.full((96, 160), 30.0, np.float32)


@pytest.fixture(scope="module")
def film():
    try:
        context = open_context()
    except RendererError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")
    yield Film(context)
    context.release()


def dot(u=80, v=48, light=8.0):
    picture = np.zeros((96, 160, 3), np.float32)
    picture[v, u] = light
    return picture


def texture_picture(seed=0):
    return np.random.default_rng(seed).random((96, 160, 3), np.float32)


def test_a_moving_dot_becomes_a_streak_with_the_same_light(film):
    # 2.5 m to the right at 30 m is 10 px to the left in the picture.
    out = film.expose(dot(), FLAT, CAMERA, Exposure(exposure_s=0.1, moved_m=(2.5, 0.0, 0.0)))[..., 0].astype(float)
    row = out[48]
    assert out.sum() == pytest.approx(8.0, rel=1e-4)
    assert row.sum() == pytest.approx(8.0, rel=1e-4)
    np.testing.assert_allclose(row[76:85], 0.8, rtol=1e-3)
    assert row[75] + row[85] == pytest.approx(0.8, rel=1e-3)
    assert (row @ np.arange(160)) / row.sum() == pytest.approx(80.0, abs=0.01)
    assert not row[:75].any() and not row[86:].any()


def test_near_things_blur_and_far_ones_do_not_when_the_camera_moves(film):
    depth = FLAT.copy()
    depth[:48] = np.nan
    exposure = Exposure(moved_m=(1.0, 0.0, 0.0))
    picture = texture_picture()
    out = film.expose(picture, depth, CAMERA, exposure)
    np.testing.assert_array_equal(out[:48], picture[:48])
    assert out[49:].std() < 0.7 * picture[49:].std()


def test_turning_blurs_the_sky_too(film):
    sky = np.full_like(FLAT, np.nan)
    yaw = 6.0 / CAMERA.fx  # about the optical y axis: 6 px at the middle
    row = film.expose(dot(), sky, CAMERA, Exposure(turned_rad=(0.0, yaw, 0.0)))[48, :, 0]
    assert np.count_nonzero(row > 0.05 * row.max()) == 7
    assert row.sum() == pytest.approx(8.0, rel=0.01)
    roll = film.expose(dot(), sky, CAMERA, Exposure(turned_rad=(0.0, 0.0, 0.1)))
    assert roll[48, 80, 0] > 7.0  # the middle stays


def test_nothing_moves_nothing_changes(film):
    picture = texture_picture()
    assert film.expose(picture, FLAT, CAMERA, Exposure(exposure_s=0.02)) is picture
    hardly = film.expose(picture, FLAT, CAMERA, Exposure(turned_rad=(1e-7, 0.0, 0.0)))
    np.testing.assert_array_equal(hardly, picture)


def test_rain_changes_the_picture_and_follows_its_seed(film):
    picture, depth = texture_picture() * 0.2, FLAT.copy()
    rain = Exposure(rain_mm_h=40.0, streak_contrast=10.0, seed=3)
    wet, again = (film.expose(picture, depth, CAMERA, rain) for _ in range(2))
    np.testing.assert_array_equal(wet, again)
    np.testing.assert_array_equal(depth, FLAT)
    changed = np.any(wet != picture, axis=2)
    assert 0.001 < changed.mean() < 0.9
    other = film.expose(picture, FLAT, CAMERA, Exposure(rain_mm_h=40.0, streak_contrast=10.0, seed=4))
    assert np.any(other != wet)


def test_a_streak_brightens_by_its_opacity(film):
    wet = film.expose(np.full((96, 160, 3), 1.0, np.float32), FLAT, CAMERA, Exposure(rain_mm_h=40.0, seed=3))
    np.testing.assert_allclose(wet, 1.0, rtol=1e-5)  # drops as bright as an even picture do not show


def test_drops_on_the_lens_turn_the_picture_upside_down_and_stay_local(film):
    picture = np.zeros((96, 160, 3), np.float32)
    picture[:48] = 1.0
    out = film.expose(picture, FLAT, CAMERA, Exposure(lens_drops=150, lens_seed=8))
    changed = np.any(np.abs(out - picture) > 1e-3, axis=2)
    assert 0.02 < changed.mean() < 0.5
    assert out.min() >= 0.0 and out.max() <= 1.0 + 1e-5
    assert out[:40].min() < 0.9 and out[56:].max() > 0.1


def test_bright_is_the_mean_of_the_brightest_part():
    picture = np.zeros((40, 40, 3), np.float32)
    picture[:12] = [0.2, 0.4, 0.6]
    np.testing.assert_allclose(bright(picture), [0.2, 0.4, 0.6], rtol=1e-6)


def test_wrong_use_is_named(film):
    with pytest.raises(ValueError, match=r"film needs a pinhole of the picture's size \(96, 160\)"):
        film.expose(dot(), FLAT, Camera.from_fov(64, 40, 1.0), Exposure(lens_drops=2))
