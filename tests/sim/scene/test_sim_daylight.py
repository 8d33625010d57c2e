import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline.sim.scene.daylight import ELEVATION_DEG, random_daylight, random_sky, random_time_of_day, sun_direction


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


def test_fair_days_are_days_without_an_overcast():
    rng = np.random.default_rng(1)
    assert {random_time_of_day(rng, fair=True) for _ in range(100)} == {"day"}
    assert {random_time_of_day(rng) for _ in range(200)} == {"day", "dusk", "night"}
    assert {random_sky(rng, True) for _ in range(100)} == {"clear", "broken"}
    assert {random_sky(rng, False) for _ in range(100)} == {"clear", "broken", "overcast"}


def test_lamps_burn_when_it_is_dark():
    rng = np.random.default_rng(2)
    sun = sun_direction(rng)
    assert random_daylight(rng, "day", "clear", sun, False).lamps == 0.0
    assert random_daylight(rng, "night", "clear", sun, False).lamps > 0.0
