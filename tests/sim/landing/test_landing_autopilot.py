"""The autopilot: what guidance it follows, and how it moves that on to now."""

from dataclasses import replace

import pytest

from deckline.config import Approach
from deckline.types import Diagnostic, Reason, Status
from deckline_sim.landing.aircraft import AircraftState
from deckline_sim.landing.autopilot import Autopilot, Fix
from deckline_sim.landing.deviations import Deviations, stated_guidance

TRIM = AircraftState((0.0, 0.0, -50.0), (0.0, 0.1, 0.0), (50.0, 0.0, 3.0), (0.0, 0.0, 0.0), 60.0, 1.0)
PLACE = Deviations(2.0, 40.0, 0.0, 500.0, 0.0, -3.0, 50.0)
FLAG = Diagnostic(Reason.PAINT, "paint under the lines")


def answer(status=Status.OK, place=PLACE, time_s=0.0):
    return stated_guidance(time_s, place, Deviations(*[0.1] * 7), status, None, Approach())


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
    assert pilot.deviations(TRIM, 0.1).lateral_m == pytest.approx(2.0)


@pytest.mark.parametrize("status", [Status.ONE_LINE, Status.COASTING, Status.STALE])
def test_what_is_not_of_both_lines_is_not_followed(status):
    pilot = autopilot()
    pilot.hear(answer(status), TRIM, is_of_picture=True)
    assert pilot.flown is None
