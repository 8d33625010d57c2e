from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.sim.ship.clearance import runway_distance
from deckline.sim.ship.layout import class_layout
from deckline.sim.ship.markings import WIDENED, edge_coat, line_coat, random_edge, runway_coat, smear_coat
from deckline.sim.ship.paint import axes, layers
from deckline.sim.ship.plan import LineStyle
from deckline.sim.ship.random_plan import random_surface
from deckline.sim.ship.ship_class import SHIP_CLASSES, load_class

seeds = st.integers(0, 2**32 - 1)
CVN = load_class("cvn")
CVN_EDGE = CVN.plan.edge
LAYOUT = class_layout(CVN)
NO_RUBBER = layers([])


@pytest.mark.parametrize("kind", ["ladder", "stripe", "double", "dashed"])
def test_every_kind_of_edge_has_its_middle_on_the_line(kind):
    coat = edge_coat(LAYOUT.left_m, replace(CVN_EDGE, kind=kind))
    along, right, length = axes(*LAYOUT.left_m)
    across = (coat[:, :2] - LAYOUT.left_m[0]) @ right
    assert across.min() == pytest.approx(-CVN_EDGE.width_m / 2, abs=1e-3)
    assert across.max() == pytest.approx(CVN_EDGE.width_m / 2, abs=1e-3)
    reach = (coat[:, :2] - LAYOUT.left_m[0]) @ along
    assert reach.min() == pytest.approx(0.0, abs=1e-3)
    assert length - CVN_EDGE.pitch_m <= reach.max() <= length + 1e-3


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_random_edges_are_narrow_and_lighter_than_their_deck(seed):
    rng = np.random.default_rng(seed)
    style, surface = random_edge(rng), random_surface(rng)
    assert 0.5 <= style.width_m - WIDENED * style.smear_m <= 3.8
    assert style.pitch_m > style.bar_m
    assert np.mean(style.rgb) > np.mean(surface.rgb)


def test_opacity_thins_an_edge():
    coat = edge_coat(LAYOUT.left_m, replace(CVN_EDGE, opacity=0.3))
    np.testing.assert_allclose(coat[:, 5], 0.3)


@pytest.mark.parametrize(("line", "inward"), [(LAYOUT.left_m, 1.0), (LAYOUT.right_m, -1.0)])
def test_smeared_paint_keeps_its_outer_edge(line, inward):
    style = replace(CVN_EDGE, smear=0.5, smear_m=4.0)
    coat = smear_coat(line, inward, style, np.random.default_rng(0))
    outside = runway_distance(LAYOUT, coat[:, :2].astype(float))
    assert outside.max() == pytest.approx(style.width_m / 2, abs=1e-3)
    assert outside.min() == pytest.approx(-style.width_m / 2 - style.smear_m, abs=1e-3)
    assert not coat[outside < -style.width_m / 2 - 3.9, 5].any()


def moments(coat, line):
    """Area of a coat, and how far its area's middle lies to the right of a line."""
    right = axes(*line)[1]
    corners = coat[:, :2].astype(float).reshape(-1, 3, 2)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2 * coat[::3, 5]
    return area.sum(), area @ ((corners.mean(axis=1) - line[0]) @ right) / area.sum()


def styles():
    yield from (pytest.param(load_class(name).plan.edge, id=name) for name in SHIP_CLASSES)
    for seed in range(12):
        yield pytest.param(replace(random_edge(np.random.default_rng(seed)), opacity=0.8), id=f"random {seed}")


@pytest.mark.parametrize("style", list(styles()))
def test_every_marking_is_symmetric_about_its_line(style):
    for line in (LAYOUT.left_m, LAYOUT.right_m):
        coat = edge_coat(line, style)
        area, aside = moments(coat, line)
        assert area > 0.2 * style.rail_m * 200.0
        assert abs(aside) < 1e-4
        across = np.unique(np.round((coat[:, :2] - line[0]) @ axes(*line)[1], 3))
        np.testing.assert_allclose(across, -across[::-1], atol=2e-3)


def test_edges_are_the_topmost_paint_of_the_runway():
    edges = [edge_coat(line, CVN_EDGE) for line in (LAYOUT.left_m, LAYOUT.right_m)]
    coat = runway_coat(LAYOUT, CVN.plan, NO_RUBBER, np.random.default_rng(3))
    np.testing.assert_array_equal(coat[-len(edges[1]) :], edges[1])
    np.testing.assert_array_equal(coat[-len(edges[1]) - len(edges[0]) : -len(edges[1])], edges[0])


def test_uneven_edges_have_a_style_each():
    other = replace(CVN_EDGE, kind="stripe", width_m=0.8)
    coat = runway_coat(LAYOUT, replace(CVN.plan, right_edge=other), NO_RUBBER, np.random.default_rng(3))
    np.testing.assert_array_equal(coat[-6:], edge_coat(LAYOUT.right_m, other))


def test_the_landing_area_leaves_the_deck_beside_the_edges_alone():
    plan = replace(CVN.plan, area_opacity=1.0, area_rgb=(0.5, 0.4, 0.3))
    coat = runway_coat(LAYOUT, plan, NO_RUBBER, np.random.default_rng(0))
    inside = -runway_distance(LAYOUT, coat[:6, :2].astype(float))
    assert tuple(coat[0, 2:5]) == tuple(np.float32([0.5, 0.4, 0.3]))
    assert inside.min() == pytest.approx(CVN_EDGE.width_m / 2 + 0.3, abs=1e-3)


def test_wires_cross_at_their_distances():
    plan = replace(CVN.plan, edge=CVN_EDGE, centre=None, ramp_m=0.0, fouls=(), wires_m=(40.0, 60.0))
    coat = runway_coat(LAYOUT, plan, NO_RUBBER, np.random.default_rng(0))[:12]
    start, end = LAYOUT.centre_m
    reach = np.round((coat[:, :2] - start) @ axes(start, end)[0], 3)
    expected = [40.0, 40.0 + plan.wire_width_m, 60.0, 60.0 + plan.wire_width_m]
    np.testing.assert_allclose(np.unique(reach), expected, atol=2e-3)


def test_foul_lines_lie_outside_on_their_side():
    style = LineStyle(0.5, ((0.6, 0.1, 0.1),))
    plan = replace(CVN.plan, area_opacity=0.0, fouls=((5.0, style), (-3.0, style)))
    coat = runway_coat(LAYOUT, plan, NO_RUBBER, np.random.default_rng(0))[:12]
    right, left = (
        (part[:, :2] - line[0]) @ axes(*line)[1]
        for part, line in ((coat[:6], LAYOUT.right_m), (coat[6:], LAYOUT.left_m))
    )
    assert right.mean() == pytest.approx(5.0, abs=1e-3)
    assert left.mean() == pytest.approx(-3.0, abs=1e-3)


def test_a_line_of_one_colour_without_gaps_is_one_stripe():
    start, end = np.array([0.0, 0.0]), np.array([50.0, 0.0])
    assert len(line_coat(start, end, LineStyle(0.5, ((1, 1, 1),)))) == 6
    assert len(line_coat(start, end, LineStyle(0.5, ((1, 1, 1), (1, 1, 0)), dash_m=10.0))) == 30
    assert len(line_coat(start, end, LineStyle(0.5, ((1, 1, 1),), dash_m=10.0, gap_m=15.0))) == 12
