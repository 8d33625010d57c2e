from dataclasses import replace

import pytest

from deckline.sim.ship.plan import LineStyle, Plan
from deckline.sim.ship.ship_class import load_class

EDGE = load_class("cvn").plan.edge


def test_both_edges_share_a_style_unless_the_right_one_has_its_own():
    other = replace(EDGE, kind="stripe")
    assert Plan(edge=EDGE).edges == (EDGE, EDGE)
    assert Plan(edge=EDGE, right_edge=other).edges == (EDGE, other)


def test_an_empty_plan_paints_nothing_beside_its_edges():
    plan = Plan(edge=EDGE)
    assert not any((plan.catapults, plan.panels, plan.spots, plan.stripes, plan.numbers, plan.wires_m, plan.fouls))
    assert plan.area_opacity == plan.ramp_m == plan.stern_m == plan.port_border_m == plan.starboard_border_m == 0.0


def test_impossible_styles_are_refused():
    with pytest.raises(ValueError, match=r"pitch > bar > 0, got width, rail, bar, pitch \(3.4, 0.75, 4.0, 3.6\)"):
        replace(EDGE, bar_m=4.0)
    with pytest.raises(ValueError, match=r"got 0 colours and \(0.5, 5.0, 0.0\)"):
        LineStyle(0.5, ())
    with pytest.raises(ValueError, match=r"dash > 0 and gap >= 0, got 1 colours and \(0.5, 5.0, -1.0\)"):
        LineStyle(0.5, ((1, 1, 1),), gap_m=-1.0)
