from datetime import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline_sim.airsim_server.sim_clock import SimClock, SolarClock, light_at, read_time, sun_angles

NOON = datetime(2026, 3, 21, 12)


@given(st.lists(st.tuples(st.sampled_from(["on", "off", "tick", "for"]), st.floats(0.0, 50.0)), max_size=12))
def test_the_clock_runs_only_when_it_may(steps):
    ticks, expected, left = [0.0], 0.0, np.inf
    clock = SimClock(lambda: ticks[0], epoch_ns=5)
    for kind, value in steps:
        if kind == "tick":
            ticks[0] += value
            ran = min(value, left)
            expected, left = expected + ran, left - ran
        elif kind == "for":
            clock.run_for(value)
            left = value
        else:
            clock.pause(kind == "off")
            left = 0.0 if kind == "off" else np.inf
        assert clock.seconds() == pytest.approx(expected, abs=1e-9)
    assert clock.nanoseconds(2.5) == 2_500_000_005


@pytest.mark.parametrize(
    ("when", "latitude_deg", "elevation_deg", "azimuth_deg"),
    [
        (datetime(2026, 6, 21, 12), 47.6, 90 - 47.6 + 23.44, 180.0),  # solstices and equinoxes by hand
        (datetime(2026, 12, 21, 12), 47.6, 90 - 47.6 - 23.44, 180.0),
        (datetime(2026, 3, 21, 6), 30.0, 0.0, 90.0),
        (datetime(2026, 3, 21, 18), 30.0, 0.0, -90.0),
        (datetime(2026, 6, 21, 0), 70.0, 23.44 - 20.0, 0.0),  # the midnight sun
        (datetime(2026, 12, 21, 12), -47.6, 90 - 47.6 + 23.44, 0.0),
    ],
)
def test_the_sun_stands_where_the_almanac_has_it(when, latitude_deg, elevation_deg, azimuth_deg):
    elevation, azimuth = np.rad2deg(sun_angles(when, latitude_deg))
    assert elevation == pytest.approx(elevation_deg, abs=1.0)  # Cooper's declination is that good
    assert (azimuth - azimuth_deg + 180) % 360 - 180 == pytest.approx(0.0, abs=1.0)


def test_light_falls_from_the_sun_and_at_night_from_the_moon():
    time, sun = light_at(datetime(2026, 6, 21, 9), 47.6)
    assert time == "day" and np.linalg.norm(sun) == pytest.approx(1.0)
    assert sun[1] < 0 < sun[2]  # a morning sun shines from the east to the west, and down
    assert light_at(datetime(2026, 3, 21, 6, 10), 0.0)[0] == "dusk"
    time, moon = light_at(datetime(2026, 12, 21, 0), 47.6)
    assert time == "night" and moon[0] > 0 and moon[2] > 0  # opposite the sun in the north: from the south
    for hour in range(24):
        elevation_deg = np.rad2deg(np.arcsin(light_at(datetime(2026, 6, 21, hour), 47.6)[1][2]))
        assert 1.49 < elevation_deg < 75.01


def test_the_clock_moves_the_sun_in_steps():
    running = SolarClock(NOON, since_s=10.0, speed=60.0, step_s=5.0)
    assert running.at(14.9) == NOON
    assert running.at(15.0) == datetime(2026, 3, 21, 12, 5)
    assert running.at(70.0) == datetime(2026, 3, 21, 13, 0)
    assert SolarClock(NOON, 0.0, speed=0.0).at(1e6) == NOON
    with pytest.raises(ValueError, match=r"1e\+06"):
        SolarClock(NOON, 0.0, speed=1e6).at(1e9)


def test_dates_are_written_as_airsim_does():
    assert read_time("2018-02-12 15:20:00") == datetime(2018, 2, 12, 15, 20)
    assert read_time("2018-07-12 00:20:00", daylight_saving=True) == datetime(2018, 7, 11, 23, 20)
    with pytest.raises(ValueError, match=r"2026-02-12 15:20:00.*noon"):
        read_time("noon")
