import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from deckline.sim.weather import random_airlight, random_weather, sun_direction


@given(st.integers(0, 2**32 - 1))
def test_sun_shines_down_from_above_the_horizon(seed):
    direction = sun_direction(np.random.default_rng(seed))
    assert np.isclose(np.linalg.norm(direction), 1.0)
    assert np.sin(np.deg2rad(8.0)) - 1e-9 <= direction[2] <= np.sin(np.deg2rad(75.0)) + 1e-9


@given(st.integers(0, 2**32 - 1))
def test_airlight_stays_in_range_near_the_horizon_colour(seed):
    rng = np.random.default_rng(seed)
    horizon = np.array(random_weather(rng).horizon_rgb)
    airlight = random_airlight(horizon, rng)
    assert np.all((airlight >= 40.0) & (airlight <= 250.0))
    assert 0.4 * 255 * horizon.mean() < airlight.mean() < 1.25 * 255 * horizon.mean() + 1e-6


def test_weather_varies():
    drawn = [random_weather(np.random.default_rng(k)) for k in range(60)]
    assert min(np.mean(w.horizon_rgb) for w in drawn) < 0.45 < 0.9 < max(np.mean(w.horizon_rgb) for w in drawn)
    assert sum(w.wake == 0.0 for w in drawn) > 3
    assert sum(w.cloud_cover > 0.8 for w in drawn) > 3
    assert min(np.mean(w.sea_rgb) for w in drawn) < 0.06
