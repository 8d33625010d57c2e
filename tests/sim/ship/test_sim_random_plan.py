from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline_sim.ship.layout import class_layout, random_layout
from deckline_sim.ship.paint_shapes import axes
from deckline_sim.ship.random_plan import UNEVEN, WIDENED, random_centre, random_edge, random_plan, random_surface
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


def test_random_plans_span_the_styles(marked):
    plans = [plan for _, plan in marked]
    kinds = Counter(plan.edge.kind for plan in plans)
    assert all(kinds[kind] > 0.05 * MANY for kind in ("ladder", "stripe", "double", "dashed"))
    assert kinds["ladder"] < 0.65 * MANY
    for part in ("centre", "wires_m", "fouls", "catapults", "panels", "spots", "stripes", "numbers"):
        assert 0.2 < np.mean([bool(getattr(plan, part)) for plan in plans]) < 0.95, part
    uneven = np.mean([plan.right_edge is not None for plan in plans])
    assert uneven == pytest.approx(UNEVEN, abs=3 * np.sqrt(UNEVEN / MANY))


def test_wires_lie_on_the_runway(marked):
    for layout, plan in marked:
        assert all(0.0 < wire < axes(*layout.centre_m)[2] for wire in plan.wires_m)


def test_some_catapults_cross_the_left_edge(cvn):
    crossing, right = 0, axes(*cvn.left_m)[1]
    for seed in range(MANY):
        for catapult in random_plan(cvn, True, np.random.default_rng(seed)).catapults:
            begin, end = (np.array([catapult.start_m, catapult.end_m]) - cvn.left_m[0]) @ right
            crossing += begin * end < 0.0
    assert 0.1 < crossing / MANY < 0.6


def test_a_deck_without_runway_has_no_two_long_lines(bare):
    for layout, plan in bare:
        long = sum(abs(s.end_m[0] - s.start_m[0]) > 0.3 * layout.length_m for s in plan.stripes)
        long += (plan.port_border_m > 0.0) + (plan.starboard_border_m > 0.0)
        assert layout.on_land or long <= 1


def test_some_decks_without_runway_are_bare_and_some_confusing(bare):
    lines = np.array([len(plan.stripes) + len(plan.catapults) + len(plan.spots) for _, plan in bare])
    assert np.mean(lines == 0) > 0.1
    assert np.mean(lines >= 6) > 0.3


def test_land_runways_are_painted_as_such():
    layout = class_layout(load_class("runway"))
    for seed in range(20):
        plan = random_plan(layout, True, np.random.default_rng(seed))
        assert plan.edge.kind in ("stripe", "double")
        assert not plan.catapults and not plan.wires_m
        assert plan.centre is not None and plan.centre.gap_m > 0.0


def test_centre_lines_are_of_every_kind():
    styles = [random_centre((1.0, 1.0, 1.0), np.random.default_rng(seed)) for seed in range(MANY)]
    assert 0.05 < np.mean([style is None for style in styles]) < 0.25
    assert {len(style.rgbs) for style in styles if style} == {1, 2}
    assert {style.gap_m > 0.0 for style in styles if style} == {True, False}


def test_surfaces_are_grey_with_some_colour():
    rgbs = np.array([random_surface(np.random.default_rng(seed)).rgb for seed in range(MANY)])
    assert rgbs.min() > 0.08 and rgbs.max() < 0.8
    redness = rgbs[:, 0] / rgbs[:, 1]
    assert np.mean(redness > 1.3) == pytest.approx(0.07, abs=0.045)
    assert np.percentile(redness, 5) < 0.97
