from dataclasses import asdict

import numpy as np
import pytest

from deckline.sim.scene.weather import WeatherConfig, random_weather, sun_direction

DRAWN = [random_weather(np.random.default_rng(k)) for k in range(80)]


def test_weather_varies():
    assert min(np.mean(w.horizon_rgb) for w in DRAWN) < 0.05 < 0.4 < max(np.mean(w.horizon_rgb) for w in DRAWN)
    assert sum(w.wake == 0.0 for w in DRAWN) > 3
    assert sum(w.cloud_cover > 0.7 for w in DRAWN) > 8
    assert {w.sea_state for w in DRAWN} == set(range(7))
    assert sum(w.lamps > 0 for w in DRAWN) > 3


def test_fair_weather_is_fair():
    for k in range(40):
        weather = random_weather(np.random.default_rng(k), fair=True)
        assert weather.cloud_cover <= 0.4
        assert 1 <= weather.sea_state <= 4
        assert weather.lamps == 0.0
        assert np.mean(weather.horizon_rgb) > 0.2


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


def test_weather_is_plain_numbers():
    for value in asdict(DRAWN[0]).values():
        for number in value if isinstance(value, tuple) else (value,):
            assert type(number) in (int, float)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"time_of_day": "noon"}, r"time_of_day must be one of \('day', 'dusk', 'night'\) or None, got 'noon'"),
        ({"sky": "green"}, "sky must be one of .* got 'green'"),
        ({"sea_state": 7}, "sea_state must lie between 0 and 6, got 7"),
        ({"wind_m_s": -1.0}, "wind_m_s must lie between 0 and 40, got -1.0"),
    ],
)
def test_wrong_settings_are_named(settings, message):
    with pytest.raises(ValueError, match=message):
        WeatherConfig(**settings)
