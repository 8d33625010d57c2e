import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline_sim.ship.layout import class_layout, random_layout
from deckline_sim.ship.paint_shapes import axes
from deckline_sim.ship.random_plan import WIDENED, random_edge, random_plan, random_surface
from deckline_sim.ship.ship_class import load_class

MANY = 300


def draw_plans(runway):
    drawn = [(random_layout(rng), rng) for rng in map(np.random.default_rng, range(MANY))]
    return [(layout, random_plan(layout, runway, rng)) for layout, rng in drawn]


@pytest.fixture(scope="module")
def marked():
    return draw_plans(True)


@pytest.fixture(scope="module")
def bare():
    return draw_plans(False)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_random_edges_are_narrow_and_lighter_than_their_deck(seed):
    rng = np.random.default_rng(seed)
    style, surface = random_edge(rng), random_surface(rng)
    assert 0.5 <= style.width_m - WIDENED * style.smear_m <= 3.8
    assert style.pitch_m > style.bar_m
    assert np.mean(style.rgb) > np.mean(surface.rgb)


def test_wires_lie_on_the_runway(marked):
    for layout, plan in marked:
        assert all(0.0 < wire < axes(*layout.centre_m)[2] for wire in plan.wires_m)


def test_a_deck_without_runway_has_no_two_long_lines(bare):
    for layout, plan in bare:
        long = sum(abs(s.end_m[0] - s.start_m[0]) > 0.3 * layout.length_m for s in plan.stripes)
        long += (plan.port_border_m > 0.0) + (plan.starboard_border_m > 0.0)
        assert layout.on_land or long <= 1


def test_land_runways_are_painted_as_such():
    layout = class_layout(load_class("runway"))
    for seed in range(20):
        plan = random_plan(layout, True, np.random.default_rng(seed))
        assert plan.edge.kind in ("stripe", "double")
        assert not plan.catapults and not plan.wires_m
        assert plan.centre is not None and plan.centre.gap_m > 0.0
