from collections import Counter

import numpy as np
import pytest

from deckline.sim.ship.layout import class_layout, random_layout
from deckline.sim.ship.paint import axes
from deckline.sim.ship.random_plan import UNEVEN, random_centre, random_plan, random_surface
from deckline.sim.ship.ship_class import load_class

CVN = class_layout(load_class("cvn"))
MANY = 300


def plans(runway):
    for seed in range(MANY):
        rng = np.random.default_rng(seed)
        layout = random_layout(rng)
        yield layout, random_plan(layout, runway, rng)


def test_random_plans_span_the_styles():
    seen = [plan for _, plan in plans(True)]
    kinds = Counter(plan.edge.kind for plan in seen)
    assert all(kinds[kind] > 0.05 * MANY for kind in ("ladder", "stripe", "double", "dashed"))
    assert kinds["ladder"] < 0.65 * MANY
    for part in ("centre", "wires_m", "fouls", "catapults", "panels", "spots", "stripes", "numbers"):
        filled = np.mean([bool(getattr(plan, part)) for plan in seen])
        assert 0.2 < filled < 0.95, part
    uneven = np.mean([plan.right_edge is not None for plan in seen])
    assert uneven == pytest.approx(UNEVEN, abs=3 * np.sqrt(UNEVEN / MANY))


def test_wires_lie_on_the_runway():
    for layout, plan in plans(True):
        assert all(0.0 < wire < axes(*layout.centre_m)[2] for wire in plan.wires_m)


def test_some_catapults_cross_the_left_edge():
    crossing = 0
    for seed in range(MANY):
        for catapult in random_plan(CVN, True, np.random.default_rng(seed)).catapults:
            _, right, _ = axes(*CVN.left_m)
            begin, end = ((np.array(p) - CVN.left_m[0]) @ right for p in (catapult.start_m, catapult.end_m))
            crossing += begin * end < 0.0
    assert 0.1 < crossing / MANY < 0.6


def test_a_deck_without_runway_has_no_two_long_lines():
    for layout, plan in plans(False):
        if layout.on_land:
            continue
        long = sum(abs(s.end_m[0] - s.start_m[0]) > 0.3 * layout.length_m for s in plan.stripes)
        long += (plan.port_border_m > 0.0) + (plan.starboard_border_m > 0.0)
        assert long <= 1


def test_some_decks_without_runway_are_bare_and_some_confusing():
    lines = [len(plan.stripes) + len(plan.catapults) + len(plan.spots) for _, plan in plans(False)]
    assert np.mean(np.array(lines) == 0) > 0.1
    assert np.mean(np.array(lines) >= 6) > 0.3


def test_land_runways_are_painted_as_such():
    layout = class_layout(load_class("runway"))
    for seed in range(20):
        plan = random_plan(layout, True, np.random.default_rng(seed))
        assert plan.edge.kind in ("stripe", "double")
        assert not plan.catapults
        assert not plan.wires_m
        assert plan.centre is not None
        assert plan.centre.gap_m > 0.0


def test_centre_lines_are_of_every_kind():
    drawn = [random_centre((1.0, 1.0, 1.0), np.random.default_rng(seed)) for seed in range(MANY)]
    assert 0.05 < np.mean([style is None for style in drawn]) < 0.25
    styles = [style for style in drawn if style is not None]
    assert {len(style.rgbs) for style in styles} == {1, 2}
    assert {style.gap_m > 0.0 for style in styles} == {True, False}


def test_surfaces_are_grey_with_some_colour():
    rgbs = np.array([random_surface(np.random.default_rng(seed)).rgb for seed in range(MANY)])
    assert rgbs.min() > 0.08
    assert rgbs.max() < 0.8
    redness = rgbs[:, 0] / rgbs[:, 1]
    assert np.mean(redness > 1.3) == pytest.approx(0.07, abs=0.045)
    assert np.percentile(redness, 5) < 0.97
