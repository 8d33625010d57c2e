"""The autopilot: what guidance it follows, and how it moves that on to now."""

import math
from dataclasses import replace

import pytest

from deckline.config import Approach
from deckline.types import Diagnostic, Reason, Status
from deckline_sim.landing.aircraft import AircraftState
from deckline_sim.landing.autopilot import Autopilot, Fix
from deckline_sim.landing.deviations import Deviations, stated_guidance

TRIM = AircraftState((0.0, 0.0, -50.0), (0.0, 0.1, 0.0), (50.0, 0.0, 3.0), (0.0, 0.0, 0.0), 60.0, 1.0)
PLACE = Deviations(2.0, 40.0, 0.0, 500.0, 0.0, -3.0, 50.0, 0.0)
FLAG = Diagnostic(Reason.PAINT, "paint under the lines")


def answer(status=Status.OK, place=PLACE, time_s=0.0):
    return stated_guidance(time_s, place, Deviations(*[0.1] * 8), status, None, Approach())


def autopilot():
    fix = Fix(570.0, (1.0, 0.0), 0.0)
    return Autopilot(TRIM, 0.3, slope=0.06, ramp_clearance_m=4.0, rate_hz=60.0, fix=fix)


@pytest.mark.parametrize("status", [Status.OK, Status.UNVERIFIED])
def test_a_flagged_answer_is_never_followed(status):
    pilot, first = autopilot(), answer(status)
    pilot.hear(answer(status).with_flag(FLAG), TRIM, is_of_picture=True)
    assert pilot.flown is None and not pilot.has_picture(0.0)
    pilot.hear(first, TRIM, is_of_picture=True)
    pilot.hear(answer(status, replace(PLACE, lateral_m=9.0), 0.1).with_flag(FLAG), TRIM, is_of_picture=True)
    assert pilot.flown is first
    assert pilot.reckon(TRIM, 0.1).lateral_m == pytest.approx(2.0)


def test_a_late_answer_moves_on_along_the_centre_line():
    """The centre line points north-east; the aircraft turns, and gains 2 m/s across it and 3 m/s along it."""
    pilot, north_east = autopilot(), math.pi / 4
    then = replace(TRIM, attitude_rad=(0.0, 0.1, north_east + 0.05))
    across, along = 2.0 / math.sqrt(2.0), 3.0 / math.sqrt(2.0)
    north, east, down = TRIM.velocity_m_s
    now = replace(
        then,
        attitude_rad=(0.0, 0.1, north_east + 0.4),
        velocity_m_s=(north + along - across, east + along + across, down + 1.0),
    )
    pilot.hear(answer(place=replace(PLACE, heading_rad=0.05)), then, is_of_picture=True)
    found = pilot.reckon(now, 0.2)
    assert found.lateral_rate_m_s == pytest.approx(2.0)
    assert found.lateral_m == pytest.approx(2.0 + 0.2 * 2.0 / 2)
    assert found.height_rate_m_s == pytest.approx(-4.0)


def test_a_deck_that_gathers_speed_upwards_is_met_earlier():
    """An answer 0.2 s old; the deck rises faster by 1 m/s every second, so that the stick is pulled now."""
    level, rising, path = autopilot(), autopilot(), replace(PLACE, height_m=34.2)  # 0.06 of 570 m
    level.hear(answer(place=path), TRIM, is_of_picture=True)
    rising.hear(answer(place=replace(path, deck_acceleration_m_s2=1.0)), TRIM, is_of_picture=True)
    before, found = (pilot.reckon(TRIM, 0.2) for pilot in (level, rising))
    assert found.height_rate_m_s - before.height_rate_m_s == pytest.approx(-0.2)
    assert found.height_m - before.height_m == pytest.approx(-0.02)
    assert rising.fly(TRIM, 0.2).elevator < level.fly(TRIM, 0.2).elevator


@pytest.mark.parametrize("status", [Status.ONE_LINE, Status.COASTING, Status.STALE])
def test_what_is_not_of_both_lines_is_not_followed(status):
    pilot = autopilot()
    pilot.hear(answer(status), TRIM, is_of_picture=True)
    assert pilot.flown is None
