import numpy as np
import pytest

from deckline.sim.camera.air import draw_air, draw_airlight, draw_model, draw_waves, rain_extinction
from deckline.sim.camera.config import AirConfig

HORIZON, SUN = np.array([0.6, 0.7, 0.8]), np.array([0.6, 0.0, 0.8])


def drawn(config, seed, visibility_m=500.0, rain_mm_h=0.0, wide=True):
    return draw_air(config, visibility_m, rain_mm_h, HORIZON, SUN, 0.0, np.random.default_rng(seed), wide)


def test_named_presets_have_the_papers_model_and_training_has_both():
    fair, wide = ({draw_model(AirConfig(), np.random.default_rng(k), w) for k in range(30)} for w in (False, True))
    assert fair == {"paper"}
    assert wide == {"paper", "physical"}
    assert draw_model(AirConfig(model="physical"), np.random.default_rng(0), wide=False) == "physical"


def test_defaults_are_as_documented():
    air = drawn(AirConfig(), 0, wide=False)
    np.testing.assert_allclose(air.extinction_per_m, np.full(3, -np.log(0.02) / 500.0))
    assert (air.scale_height_m, air.waves, air.glow, air.sun) == (1000.0, (), 1.0, (0.6, 0.0, 0.8))
    np.testing.assert_allclose(air.airlight, HORIZON, rtol=0.15)


def test_rain_thickens_the_air():
    # 25 mm/h: 1.076 * 25^0.67 = 9.30 dB/km, a 2 % visibility of 1.83 km.
    assert rain_extinction(25.0) == pytest.approx(2.141e-3, rel=1e-3)
    assert rain_extinction(0.0) == 0.0
    dry, wet = (drawn(AirConfig(), 3, float("inf"), rain, wide=False) for rain in (0.0, 25.0))
    assert dry.extinction_per_m == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(wet.extinction_per_m, np.full(3, 2.141e-3), rtol=1e-3)


def test_small_drops_dim_blue_most():
    red, green, blue = drawn(AirConfig(angstrom=1.0), 0, wide=False).extinction_per_m
    assert green == pytest.approx(-np.log(0.02) / 500.0)
    assert (red / green, blue / green) == (pytest.approx(550 / 610), pytest.approx(550 / 465))


def test_training_draws_widely():
    airs = [drawn(AirConfig(), seed, 2000.0) for seed in range(80)]
    heights = np.array([air.scale_height_m for air in airs])
    assert 0.2 < np.mean(np.isinf(heights)) < 0.6
    assert heights.min() < 100.0 < 1000.0 < heights[np.isfinite(heights)].max()
    assert 0.3 < np.mean([len(air.waves) > 0 for air in airs]) < 0.7
    assert len({air.airlight for air in airs}) == 80
    assert {drawn(AirConfig(), seed, 300.0).extinction_per_m for seed in range(5)} == {(-np.log(0.02) / 300.0,) * 3}


def test_given_settings_are_kept():
    config = AirConfig(scale_height_m=77.0, patchiness=0.5, patch_m=300.0, angstrom=0.0, glow=0.25)
    for wide in (False, True):
        air = drawn(config, 1, wide=wide)
        assert (air.scale_height_m, air.glow) == (77.0, 0.25)
        assert sum(wave[3] for wave in air.waves) == pytest.approx(0.5)


def test_waves_have_about_the_wavelength():
    waves = np.array(draw_waves(0.6, 400.0, np.random.default_rng(0)))
    length = 2 * np.pi / np.hypot(waves[:, 0], waves[:, 1])
    assert np.all((length > 190.0) & (length < 810.0))
    assert waves[:, 3].sum() == pytest.approx(0.6)
    assert draw_waves(0.0, 400.0, np.random.default_rng(0)) == ()


def test_thick_air_is_pale_under_a_gaudy_sky():
    gaudy = np.array([0.05, 0.5, 0.8])
    air = np.array([draw_airlight(gaudy, np.random.default_rng(k), wide=True) for k in range(100)])
    assert np.abs(air / air.mean(axis=1, keepdims=True) - 1).max() < 0.55
    pale = np.array([draw_airlight(HORIZON, np.random.default_rng(k), wide=True) for k in range(200)])
    assert 0.1 < pale.min() < pale.max() < 1.4
    assert np.all(draw_airlight(gaudy, np.random.default_rng(0), wide=False)[[0, 2]] / gaudy[[0, 2]] < 1.2)
