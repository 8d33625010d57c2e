import numpy as np
import pytest

from deckline.geometry import Camera
from deckline.sim.camera import rain
from deckline.sim.camera.rain import drops_on_lens, streak_quads, streaks

CAMERA = Camera.from_fov(640, 360, 1.0)


def drawn(rain_mm_h, velocity=(0.0, 9.0, 0.0), exposure_s=1e-3, seed=0):
    return streaks(CAMERA, np.array(velocity), exposure_s, rain_mm_h, np.random.default_rng(seed)).astype(float)


def lengths(quads):
    """Length (N,) of each streak along its axis."""
    return np.linalg.norm(quads[:, 5, :2] - quads[:, 0, :2], axis=1)


def test_drops_before_the_lens_are_as_many_as_marshall_and_palmer_count(monkeypatch):
    assert len(drawn(25.0)) == pytest.approx(4000, rel=0.05)
    monkeypatch.setattr(rain, "MOST_STREAKS", 10**6)
    reach = CAMERA.fx * 0.002 / 0.35
    volume = 640 * 360 / CAMERA.fx**2 * (reach**3 - 0.25**3) / 3
    for rain_mm_h in (1.0, 25.0):
        slope = 4.1 * rain_mm_h**-0.21
        expected = 8000.0 / slope * np.exp(-slope * 0.5) * volume
        got = np.mean([len(drawn(rain_mm_h, seed=seed)) for seed in range(4)])
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
    quads = drawn(25.0, exposure_s=0.01)
    path = quads[:, 5, :2] - quads[:, 0, :2]
    np.testing.assert_allclose(path[:, 0], 0.0, atol=1e-3)
    longest = CAMERA.fx * 0.09 / 0.25 + CAMERA.fx * 0.02 / 0.25
    assert 5.0 < np.median(lengths(quads)) < lengths(quads).max() < longest


def test_flying_through_rain_draws_it_away_from_where_one_flies_to():
    quads = drawn(25.0, velocity=(0.0, 0.0, -60.0), exposure_s=2e-3)
    middle = quads[:, :, :2].mean(axis=1) - [CAMERA.cx, CAMERA.cy]
    path = quads[:, 5, :2] - quads[:, 0, :2]
    long = lengths(quads) > 8.0
    across = (path[:, 0] * middle[:, 1] - path[:, 1] * middle[:, 0]) / np.linalg.norm(middle, axis=1) / lengths(quads)
    assert long.sum() > 20
    assert np.abs(across[long]).max() < 0.05


def test_drops_on_the_lens_lie_in_the_picture():
    quads = drops_on_lens(CAMERA, 200, np.random.default_rng(1)).astype(float)
    assert quads.shape == (200, 6, 8)
    middle, radius = quads[:, 0, 4:6], quads[:, 0, 6]
    assert np.all((middle >= 0) & (middle <= [640, 360]))
    assert np.all((radius > 0.0059 * 640) & (radius < 0.0451 * 640))
    np.testing.assert_allclose(quads[:, :, :2].mean(axis=1), middle, atol=1e-3)
    assert drops_on_lens(CAMERA, 0, np.random.default_rng(1)).shape == (0, 6, 8)
