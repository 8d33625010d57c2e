from dataclasses import replace

import numpy as np
import pytest
from coat_area import area_and_middle

from deckline_sim.ship import deck_paint as dp
from deckline_sim.ship import ship_class as sc
from deckline_sim.ship.layout import class_layout, runway_distance
from deckline_sim.ship.paint_shapes import axes, layers
from deckline_sim.ship.random_plan import random_edge

DARK = sc.DeckSurface((0.1, 0.1, 0.1), grain=0.0, wear=0.0)
CVN = sc.load_class("cvn")
EDGE = CVN.plan.edge
LAYOUT = class_layout(CVN)
LINES = LAYOUT.left_m, LAYOUT.right_m
WHITE = (1.0, 1.0, 1.0)
rng = np.random.default_rng


def across(coat, line):
    """How far a coat's corners lie to the right of a line, and how far along it."""
    along, right, _ = axes(*line)
    delta = coat[:, :2].astype(float) - line[0]
    return delta @ right, delta @ along


def paint(**plan):
    return dp.paint_fixtures(LAYOUT, sc.Plan(edge=EDGE, **plan))


def test_deck_without_runway_shows_none_of_its_paint():
    lone = replace(CVN.plan, catapults=(), panels=(), numbers=(), port_border_m=0.0, starboard_border_m=0.0)
    coat = dp.build_coat(LAYOUT, replace(lone, paint_rgb=(0.11, 0.91, 0.13)), DARK, False, False, rng(0))
    marked = dp.build_coat(LAYOUT, lone, DARK, True, False, rng(0))
    white, whiter = (np.all(np.isclose(c[:, 2:5], np.float32(EDGE.rgb)), axis=1) for c in (coat, marked))
    assert not white.any() and whiter.any()
    assert not np.any(np.isclose(coat[:, 3], 0.91))


def test_only_worn_decks_lose_edge_paint():
    whole, worn = (dp.build_coat(LAYOUT, CVN.plan, DARK, True, worn, rng(2)) for worn in (False, True))
    np.testing.assert_array_equal(worn[: len(whole)], whole)
    assert len(worn) > len(whole)


def test_stripes_and_the_stern_are_painted_where_the_plan_says():
    area, middle = area_and_middle(paint(stripes=(sc.Stripe((10.0, 2.0), (30.0, 2.0), sc.LineStyle(0.5, (WHITE,))),)))
    assert area == pytest.approx(10.0)
    np.testing.assert_allclose(middle, [20.0, 2.0], atol=1e-5)
    area, middle = area_and_middle(paint(stern_m=3.0))
    port, starboard = LAYOUT.port_m[0], LAYOUT.starboard_m[0]
    assert area == pytest.approx(3.0 * (starboard - port), rel=1e-5)
    np.testing.assert_allclose(middle, [1.5, (starboard + port) / 2], atol=1e-4)
    border = paint(port_border_m=0.5)
    inset = border[:, 1] - np.interp(border[:, 0], LAYOUT.stations_m, LAYOUT.port_m)
    assert np.median(inset) == pytest.approx(0.8 + 0.25, abs=0.3)


def test_catapult_has_slot_lines_and_deflector():
    bare = sc.Catapult((100.0, 0.0), (200.0, 0.0), 1.2, WHITE, slot_m=0.0)
    area, middle = area_and_middle(paint(catapults=(bare,)))
    assert area == pytest.approx(120.0, rel=1e-5)
    np.testing.assert_allclose(middle, [150.0, 0.0], atol=1e-4)
    full = paint(catapults=(replace(bare, slot_m=0.4, border_m=2.0, deflector_m=10.0),))
    assert len(full) == 5 * 6
    assert full[-6:, 0].max() < 100.0  # the deflector stands behind the track
    assert np.ptp(full[-6:, 1]) == pytest.approx(10.0, abs=1e-4)
    assert full[6:12, 2].max() < 0.1


def test_panel_turns_about_its_middle():
    panel = sc.Panel((50.0, -10.0), 20.0, 8.0, WHITE, opacity=0.5, yaw_deg=30.0)
    coat = paint(panels=(panel,))
    area, middle = area_and_middle(coat)
    assert area == pytest.approx(160.0, rel=1e-5)
    np.testing.assert_allclose(middle, [50.0, -10.0], atol=1e-4)
    np.testing.assert_allclose(coat[:, 5], 0.5)
    along = axes(*coat[:2, :2])[0]
    assert np.degrees(np.arctan2(along[1], along[0])) == pytest.approx(30.0, abs=1e-3)
    assert len(paint(panels=(replace(panel, border=sc.LineStyle(0.3, (WHITE,))),))) == 6 + 4 * 6


def test_spot_has_circle_lead_and_bar():
    spot = sc.Spot((80.0, 5.0), 6.0, 0.5, WHITE)
    plain, full = (paint(spots=(s,)) for s in (spot, replace(spot, lead_m=20.0, cross_m=3.0)))
    np.testing.assert_allclose(np.hypot(*(plain[:, :2] - [80.0, 5.0]).T).max(), 6.25, atol=1e-3)
    assert full[:, 0].min() == pytest.approx(60.0)
    assert len(full) == len(plain) + 12


def test_numbers_stand_upright_seen_from_astern():
    coat = paint(numbers=(sc.Number("7", (200.0, -4.0), 10.0, WHITE),))
    np.testing.assert_allclose(coat[:, :2].min(axis=0), [200.0, -4.0], atol=1e-4)
    assert coat[:, 0].max() == pytest.approx(210.0, abs=1e-4)
    assert np.ptp(coat[coat[:, 0] > 209.0, 1]) == pytest.approx(6.0, abs=1e-4)  # the seven's bar is ahead


@pytest.mark.parametrize(("line", "inward"), [(LAYOUT.left_m, 1.0), (LAYOUT.right_m, -1.0)])
def test_smeared_paint_keeps_its_outer_edge(line, inward):
    style = replace(EDGE, smear=0.5, smear_m=4.0)
    coat = dp.paint_smear(line, inward, style, rng(0))
    outside, half = runway_distance(LAYOUT, coat[:, :2].astype(float)), style.width_m / 2
    assert [outside.max(), outside.min()] == pytest.approx([half, -half - style.smear_m], abs=1e-3)
    assert not coat[outside < -half - 3.9, 5].any()


def styles():
    yield from (pytest.param(sc.load_class(name).plan.edge, id=name) for name in sc.SHIP_CLASSES)
    for seed in range(12):
        yield pytest.param(replace(random_edge(rng(seed)), opacity=0.8), id=f"random {seed}")


@pytest.mark.parametrize("style", list(styles()))
def test_every_marking_is_symmetric_about_its_line(style):
    for line in LINES:
        coat = dp.paint_edge(line, style)
        area, middle = area_and_middle(coat)
        assert area * style.opacity > 0.2 * style.rail_m * 200.0
        assert abs((middle - line[0]) @ axes(*line)[1]) < 1e-4
        np.testing.assert_allclose(coat[:, 5], style.opacity)
        aside, reach = across(coat, line)
        aside = np.unique(np.round(aside, 3))
        np.testing.assert_allclose(aside, -aside[::-1], atol=2e-3)
        assert aside[-1] == pytest.approx(style.width_m / 2, abs=1e-3)
        length = axes(*line)[2]
        assert reach.min() == pytest.approx(0.0, abs=1e-3)
        assert length - style.pitch_m <= reach.max() <= length + 1e-3


def paint_runway(**changes):
    return dp.paint_runway(LAYOUT, replace(CVN.plan, **changes), layers([]), rng(3))


def test_edges_are_the_topmost_paint_of_the_runway_each_in_its_style():
    other = replace(EDGE, kind="stripe", width_m=0.8)
    for changes, right_style in (({}, EDGE), ({"right_edge": other}, other)):
        edges = layers([dp.paint_edge(LAYOUT.left_m, EDGE), dp.paint_edge(LAYOUT.right_m, right_style)])
        np.testing.assert_array_equal(paint_runway(**changes)[-len(edges) :], edges)


def test_the_landing_area_leaves_the_deck_beside_the_edges_alone():
    coat = paint_runway(area_opacity=1.0, area_rgb=(0.5, 0.4, 0.3))
    assert tuple(coat[0, 2:5]) == tuple(np.float32([0.5, 0.4, 0.3]))
    inside = -runway_distance(LAYOUT, coat[:6, :2].astype(float))
    assert inside.min() == pytest.approx(EDGE.width_m / 2 + 0.3, abs=1e-3)


def test_wires_cross_at_their_distances():
    coat = paint_runway(centre=None, ramp_m=0.0, fouls=(), wires_m=(40.0, 60.0))[:12]
    expected = np.add.outer([40.0, 60.0], [0.0, CVN.plan.wire_width_m]).ravel()
    np.testing.assert_allclose(np.unique(np.round(across(coat, LAYOUT.centre_m)[1], 3)), expected, atol=2e-3)


def test_foul_lines_lie_outside_on_their_side():
    style = sc.LineStyle(0.5, ((0.6, 0.1, 0.1),))
    coat = paint_runway(area_opacity=0.0, fouls=((5.0, style), (-3.0, style)))
    right, left = across(coat[:6], LAYOUT.right_m)[0], across(coat[6:12], LAYOUT.left_m)[0]
    assert [right.mean(), left.mean()] == pytest.approx([5.0, -3.0], abs=1e-3)


@pytest.mark.parametrize("seed", range(20))
def test_every_stain_is_valid_paint(seed):
    draw = rng(seed)
    coats = [dp.paint_rubber(LAYOUT, draw), dp.paint_stains(LAYOUT, draw), dp.paint_plates(LAYOUT, DARK, draw)]
    for coat in (*coats, dp.paint_damage(LAYOUT, 3.4, DARK.rgb, draw)):
        assert coat.dtype == np.float32
        assert coat.shape[1] == 7 and len(coat) % 3 == 0
        assert np.isfinite(coat).all()
        assert np.all((coat[:, 2:] >= 0.0) & (coat[:, 2:] <= 1.0))


def test_rubber_is_dark_and_stays_within_the_landing_area():
    coats = [dp.paint_rubber(LAYOUT, rng(seed)) for seed in range(20)]
    coat = layers(coats)
    assert coat[:, 2:5].max() <= 0.12
    assert runway_distance(LAYOUT, coat[:, :2].astype(float)).max() < 2.0
    reach = across(coat, LAYOUT.centre_m)[1]
    assert reach.min() > -0.5 and reach.max() < axes(*LAYOUT.centre_m)[2] + 1.0


def test_damage_lies_on_the_edge_markings_and_hides_little():
    hidden, sides = [], set()
    for seed in range(40):
        coat = dp.paint_damage(LAYOUT, 3.4, DARK.rgb, rng(seed))
        for line in LINES:
            aside, reach = (values.reshape(-1, 6) for values in across(coat, line))
            near = np.abs(aside).max(axis=1) < 5.0
            aside, reach, length = aside[near], reach[near], axes(*line)[2]
            assert np.all(np.abs(aside) <= 1.8 + 1e-3)
            assert np.all((reach > -1e-3) & (reach < length + 1e-3))
            hidden.append(np.ptp(reach, axis=1).sum() / length)
            sides |= set(np.abs(np.round(aside.mean(axis=1), 1)))
    assert 0.05 < np.mean(hidden) < 0.2
    assert np.max(hidden) < 0.5
    assert {0.0, 0.9} <= sides  # whole gaps, and halves of a marking
