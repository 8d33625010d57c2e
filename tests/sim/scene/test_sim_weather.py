"""Weather and light: ranges, plain numbers, what is given."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline_sim.config import WeatherConfig
from deckline_sim.scene.weather import (
    ELEVATION_DEG,
    random_daylight,
    random_weather,
    sun_direction,
)


def test_what_is_configured_is_not_drawn():
    config = WeatherConfig("night", "overcast", 5, 17.0)
    for k in range(20):
        weather = random_weather(np.random.default_rng(k), fair=True, config=config)
        assert weather.lamps > 0.0 and np.mean(weather.horizon_rgb) < 0.1
        assert weather.cloud_cover >= 0.7
        assert (weather.sea_state, weather.wind_m_s) == (5, 17.0)
        assert 0.75 * 3.25 <= weather.wave_height_m <= 1.25 * 3.25


def test_configuring_one_thing_leaves_the_others_as_drawn():
    for k in range(10):
        free, calm = (
            random_weather(np.random.default_rng(k), config=c) for c in (WeatherConfig(), WeatherConfig(sea_state=0))
        )
        assert free.horizon_rgb == calm.horizon_rgb
        assert (free.sea_rgb, free.wake, free.offset) == (calm.sea_rgb, calm.wake, calm.offset)


def test_a_given_sun_is_kept_and_a_low_one_makes_dusk():
    for time, dark in (("day", False), ("dusk", True)):
        sun = sun_direction(np.random.default_rng(3), time)
        weather = random_weather(np.random.default_rng(4), sun=sun)
        np.testing.assert_array_equal(weather.sun, sun)
        assert (weather.lamps > 0) == dark


@pytest.mark.parametrize("time", ["day", "dusk", "night"])
@given(st.integers(0, 2**32 - 1))
def test_sun_shines_down_from_where_it_may_stand(time, seed):
    direction = sun_direction(np.random.default_rng(seed), time)
    low, high = np.sin(np.deg2rad(ELEVATION_DEG[time]))
    assert np.isclose(np.linalg.norm(direction), 1.0)
    assert low - 1e-9 <= direction[2] <= high + 1e-9


def mean_light(time, sky):
    levels = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        sun = sun_direction(rng, time)
        light = random_daylight(rng, time, sky, sun, False)
        levels.append(np.mean(light.ambient_rgb) + np.mean(light.sun_rgb) * sun[2])
    return np.mean(levels)


def test_light_falls_from_day_to_dusk_to_night_and_under_clouds():
    assert 0.5 < mean_light("day", "clear") < 1.2
    assert mean_light("day", "clear") > 1.5 * mean_light("day", "overcast")
    assert mean_light("day", "overcast") > mean_light("dusk", "clear") > 3 * mean_light("night", "clear")


def test_full_daylight_on_a_white_horizontal_surface_is_about_one():
    sun = np.array([0.5, 0.0, np.sqrt(0.75)])
    drawn = [random_daylight(np.random.default_rng(k), "day", "clear", sun, True) for k in range(200)]
    whites = [np.mean(light.ambient_rgb) + sun[2] * np.mean(light.sun_rgb) for light in drawn]
    assert np.mean(whites) == pytest.approx(0.9, abs=0.12)
