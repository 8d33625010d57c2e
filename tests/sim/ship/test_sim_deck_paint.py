from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.sim.ship.deck_paint import (
    WIDENED,
    build_coat,
    number_coat,
    paint_catapult,
    paint_damage,
    paint_edge,
    paint_fixtures,
    paint_line,
    paint_plates,
    paint_rubber,
    paint_runway,
    paint_smear,
    paint_stains,
    panel_coat,
    random_edge,
    spot_coat,
)
from deckline.sim.ship.layout import class_layout, random_layout, runway_distance
from deckline.sim.ship.mesh import box
from deckline.sim.ship.paint import axes, layers
from deckline.sim.ship.random_plan import random_surface
from deckline.sim.ship.ship import Ship
from deckline.sim.ship.ship_class import (
    SHIP_CLASSES,
    Catapult,
    DeckSurface,
    LineStyle,
    Number,
    Panel,
    Plan,
    Spot,
    Stripe,
    load_class,
)

SUN = np.array([0.6, 0.0, 0.8])
DARK = DeckSurface((0.1, 0.1, 0.1), grain=0.0, wear=0.0)
CVN = load_class("cvn")
LAYOUT = class_layout(CVN)
WHITE = (1.0, 1.0, 1.0)


def area_and_middle(coat):
    corners = coat[:, :2].astype(float).reshape(-1, 3, 2)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    return areas.sum(), areas @ corners.mean(axis=1) / areas.sum()


def decks():
    for name in SHIP_CLASSES:
        spec = load_class(name)
        yield pytest.param(class_layout(spec), spec.plan.edge, id=name)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        yield pytest.param(random_layout(rng), replace(random_edge(rng), smear=0.0, opacity=1.0), id=f"random {seed}")


@pytest.mark.parametrize(("layout", "style"), list(decks()))
def test_the_painted_middle_is_the_line_on_the_texture(renderer, layout, style):
    coat = layers([paint_edge(line, style) for line in (layout.left_m, layout.right_m)])
    texels = min(8.0, 4096.0 / layout.length_m)
    crate = box(layout.length_m - 2.0, 0.0, 0.0, (1.0, 1.0, 1.0), 0.0, (0.1, 0.1, 0.1))
    renderer.load(Ship(layout, coat, DARK, crate, 15.0, texels), SUN)
    texture = renderer.paint_map
    level = (
        np.frombuffer(texture.read(), dtype=np.uint8).reshape(texture.height, texture.width, 4)[..., 0].astype(float)
    )
    low, high = layout.outline_m.min(axis=0), layout.outline_m.max(axis=0)
    step = (high - low) / [texture.width, texture.height]
    x, y = (low[k] + (np.arange(n) + 0.5) * step[k] for k, n in enumerate((texture.width, texture.height)))
    paint = np.clip(level - 0.1 * 255 - 2.0, 0.0, None)
    for line in (layout.left_m, layout.right_m):
        across = y[:, None] - np.interp(x, line[:, 0], line[:, 1])
        weight = paint * (np.abs(across) < style.width_m) * (x > line[0, 0] + 2.0) * (x < line[1, 0] - 2.0)
        assert weight.sum() > 1e4
        painted = weight.sum(axis=0) > 100.0
        offsets = (weight * across).sum(axis=0)[painted] / weight.sum(axis=0)[painted]
        assert np.mean(offsets) == pytest.approx(0.0, abs=step[1] / 8)  # four samples a texel: quarters, rounded
        assert np.median(offsets) == pytest.approx(0.0, abs=step[1] / 8)


def test_deck_without_runway_shows_none_of_its_paint():
    lone = replace(CVN.plan, catapults=(), panels=(), numbers=(), port_border_m=0.0, starboard_border_m=0.0)
    rng = np.random.default_rng
    coat = build_coat(LAYOUT, replace(lone, paint_rgb=(0.11, 0.91, 0.13)), DARK, False, False, rng(0))
    style_rgb = np.float32(CVN.plan.edge.rgb)
    assert not np.any(np.all(np.isclose(coat[:, 2:5], style_rgb), axis=1))
    assert not np.any(np.isclose(coat[:, 3], 0.91))
    painted = build_coat(LAYOUT, lone, DARK, True, False, rng(0))
    assert np.any(np.all(np.isclose(painted[:, 2:5], style_rgb), axis=1))


def test_only_worn_decks_lose_edge_paint():
    whole, worn = (build_coat(LAYOUT, CVN.plan, DARK, True, worn, np.random.default_rng(2)) for worn in (False, True))
    np.testing.assert_array_equal(worn[: len(whole)], whole)
    assert len(worn) > len(whole)


def test_fixtures_are_painted_where_the_plan_says():
    stripe = Stripe((10.0, 2.0), (30.0, 2.0), LineStyle(0.5, (WHITE,)))
    plan = Plan(edge=CVN.plan.edge, stripes=(stripe,))
    area, middle = area_and_middle(paint_fixtures(LAYOUT, plan))
    assert area == pytest.approx(10.0)
    np.testing.assert_allclose(middle, [20.0, 2.0], atol=1e-5)


def test_stern_stripe_and_borders_follow_the_deck():
    plan = Plan(edge=CVN.plan.edge, stern_m=3.0)
    area, middle = area_and_middle(paint_fixtures(LAYOUT, plan))
    width = LAYOUT.starboard_m[0] - LAYOUT.port_m[0]
    assert area == pytest.approx(3.0 * width, rel=1e-5)
    np.testing.assert_allclose(middle, [1.5, (LAYOUT.starboard_m[0] + LAYOUT.port_m[0]) / 2], atol=1e-4)
    border = paint_fixtures(LAYOUT, Plan(edge=CVN.plan.edge, port_border_m=0.5))
    edge = np.interp(border[:, 0], LAYOUT.stations_m, LAYOUT.port_m)
    assert np.median(border[:, 1] - edge) == pytest.approx(0.8 + 0.25, abs=0.3)


def test_catapult_has_slot_lines_and_deflector():
    bare = Catapult((100.0, 0.0), (200.0, 0.0), 1.2, WHITE, slot_m=0.0)
    area, middle = area_and_middle(paint_catapult(bare))
    assert area == pytest.approx(120.0, rel=1e-5)
    np.testing.assert_allclose(middle, [150.0, 0.0], atol=1e-4)
    full = paint_catapult(replace(bare, slot_m=0.4, border_m=2.0, deflector_m=10.0))
    assert len(full) == 5 * 6
    assert full[-6:, 0].max() < 100.0  # the deflector stands behind the track
    assert np.ptp(full[-6:, 1]) == pytest.approx(10.0, abs=1e-4)
    assert full[6:12, 2].max() < 0.1


def test_panel_turns_about_its_middle():
    panel = Panel((50.0, -10.0), 20.0, 8.0, WHITE, opacity=0.5, yaw_deg=30.0)
    coat = panel_coat(panel)
    area, middle = area_and_middle(coat)
    assert area == pytest.approx(160.0, rel=1e-5)
    np.testing.assert_allclose(middle, [50.0, -10.0], atol=1e-4)
    np.testing.assert_allclose(coat[:, 5], 0.5)
    along = axes(*coat[:2, :2])[0]
    assert np.degrees(np.arctan2(along[1], along[0])) == pytest.approx(30.0, abs=1e-3)
    assert len(panel_coat(replace(panel, border=LineStyle(0.3, (WHITE,))))) == 6 + 4 * 6


def test_spot_has_circle_lead_and_bar():
    plain = spot_coat(Spot((80.0, 5.0), 6.0, 0.5, WHITE))
    np.testing.assert_allclose(np.hypot(*(plain[:, :2] - [80.0, 5.0]).T).max(), 6.25, atol=1e-3)
    full = spot_coat(Spot((80.0, 5.0), 6.0, 0.5, WHITE, lead_m=20.0, cross_m=3.0))
    assert full[:, 0].min() == pytest.approx(60.0)
    assert len(full) == len(plain) + 12


def test_numbers_stand_upright_seen_from_astern():
    coat = number_coat(Number("7", (200.0, -4.0), 10.0, WHITE))
    low, high = coat[:, :2].min(axis=0), coat[:, :2].max(axis=0)
    assert low[0] == pytest.approx(200.0, abs=1e-4)
    assert high[0] == pytest.approx(210.0, abs=1e-4)
    assert low[1] == pytest.approx(-4.0, abs=1e-4)
    top = coat[coat[:, 0] > 209.0]
    assert np.ptp(top[:, 1]) == pytest.approx(6.0, abs=1e-4)  # the seven's bar is ahead


seeds = st.integers(0, 2**32 - 1)
CVN = load_class("cvn")
CVN_EDGE = CVN.plan.edge
LAYOUT = class_layout(CVN)
NO_RUBBER = layers([])


@pytest.mark.parametrize("kind", ["ladder", "stripe", "double", "dashed"])
def test_every_kind_of_edge_has_its_middle_on_the_line(kind):
    coat = paint_edge(LAYOUT.left_m, replace(CVN_EDGE, kind=kind))
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
    coat = paint_edge(LAYOUT.left_m, replace(CVN_EDGE, opacity=0.3))
    np.testing.assert_allclose(coat[:, 5], 0.3)


@pytest.mark.parametrize(("line", "inward"), [(LAYOUT.left_m, 1.0), (LAYOUT.right_m, -1.0)])
def test_smeared_paint_keeps_its_outer_edge(line, inward):
    style = replace(CVN_EDGE, smear=0.5, smear_m=4.0)
    coat = paint_smear(line, inward, style, np.random.default_rng(0))
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
        coat = paint_edge(line, style)
        area, aside = moments(coat, line)
        assert area > 0.2 * style.rail_m * 200.0
        assert abs(aside) < 1e-4
        across = np.unique(np.round((coat[:, :2] - line[0]) @ axes(*line)[1], 3))
        np.testing.assert_allclose(across, -across[::-1], atol=2e-3)


def test_edges_are_the_topmost_paint_of_the_runway():
    edges = [paint_edge(line, CVN_EDGE) for line in (LAYOUT.left_m, LAYOUT.right_m)]
    coat = paint_runway(LAYOUT, CVN.plan, NO_RUBBER, np.random.default_rng(3))
    np.testing.assert_array_equal(coat[-len(edges[1]) :], edges[1])
    np.testing.assert_array_equal(coat[-len(edges[1]) - len(edges[0]) : -len(edges[1])], edges[0])


def test_uneven_edges_have_a_style_each():
    other = replace(CVN_EDGE, kind="stripe", width_m=0.8)
    coat = paint_runway(LAYOUT, replace(CVN.plan, right_edge=other), NO_RUBBER, np.random.default_rng(3))
    np.testing.assert_array_equal(coat[-6:], paint_edge(LAYOUT.right_m, other))


def test_the_landing_area_leaves_the_deck_beside_the_edges_alone():
    plan = replace(CVN.plan, area_opacity=1.0, area_rgb=(0.5, 0.4, 0.3))
    coat = paint_runway(LAYOUT, plan, NO_RUBBER, np.random.default_rng(0))
    inside = -runway_distance(LAYOUT, coat[:6, :2].astype(float))
    assert tuple(coat[0, 2:5]) == tuple(np.float32([0.5, 0.4, 0.3]))
    assert inside.min() == pytest.approx(CVN_EDGE.width_m / 2 + 0.3, abs=1e-3)


def test_wires_cross_at_their_distances():
    plan = replace(CVN.plan, edge=CVN_EDGE, centre=None, ramp_m=0.0, fouls=(), wires_m=(40.0, 60.0))
    coat = paint_runway(LAYOUT, plan, NO_RUBBER, np.random.default_rng(0))[:12]
    start, end = LAYOUT.centre_m
    reach = np.round((coat[:, :2] - start) @ axes(start, end)[0], 3)
    expected = [40.0, 40.0 + plan.wire_width_m, 60.0, 60.0 + plan.wire_width_m]
    np.testing.assert_allclose(np.unique(reach), expected, atol=2e-3)


def test_foul_lines_lie_outside_on_their_side():
    style = LineStyle(0.5, ((0.6, 0.1, 0.1),))
    plan = replace(CVN.plan, area_opacity=0.0, fouls=((5.0, style), (-3.0, style)))
    coat = paint_runway(LAYOUT, plan, NO_RUBBER, np.random.default_rng(0))[:12]
    right, left = (
        (part[:, :2] - line[0]) @ axes(*line)[1]
        for part, line in ((coat[:6], LAYOUT.right_m), (coat[6:], LAYOUT.left_m))
    )
    assert right.mean() == pytest.approx(5.0, abs=1e-3)
    assert left.mean() == pytest.approx(-3.0, abs=1e-3)


def test_a_line_of_one_colour_without_gaps_is_one_stripe():
    start, end = np.array([0.0, 0.0]), np.array([50.0, 0.0])
    assert len(paint_line(start, end, LineStyle(0.5, ((1, 1, 1),)))) == 6
    assert len(paint_line(start, end, LineStyle(0.5, ((1, 1, 1), (1, 1, 0)), dash_m=10.0))) == 30
    assert len(paint_line(start, end, LineStyle(0.5, ((1, 1, 1),), dash_m=10.0, gap_m=15.0))) == 12


LAYOUT = class_layout(load_class("cvn"))
SURFACE = DeckSurface((0.3, 0.3, 0.3), grain=0.2, wear=0.2)


@pytest.mark.parametrize("seed", range(20))
def test_every_stain_is_valid_paint(seed):
    rng = np.random.default_rng(seed)
    coats = [paint_rubber(LAYOUT, rng), paint_stains(LAYOUT, rng), paint_plates(LAYOUT, SURFACE, rng)]
    coats.append(paint_damage(LAYOUT, 3.4, SURFACE.rgb, rng))
    for coat in coats:
        assert coat.dtype == np.float32
        assert coat.shape[1] == 7
        assert len(coat) % 3 == 0
        assert np.isfinite(coat).all()
        assert np.all((coat[:, 2:] >= 0.0) & (coat[:, 2:] <= 1.0))


@pytest.mark.parametrize("seed", range(20))
def test_rubber_is_dark_and_stays_within_the_landing_area(seed):
    coat = paint_rubber(LAYOUT, np.random.default_rng(seed))
    if not len(coat):
        return
    assert coat[:, 2:5].max() <= 0.12
    assert runway_distance(LAYOUT, coat[:, :2].astype(float)).max() < 2.0
    reach = (coat[:, :2] - LAYOUT.centre_m[0]) @ axes(*LAYOUT.centre_m)[0]
    assert reach.min() > -0.5
    assert reach.max() < axes(*LAYOUT.centre_m)[2] + 1.0


def test_damage_lies_on_the_edge_markings_and_hides_little():
    hidden = []
    for seed in range(40):
        coat = paint_damage(LAYOUT, 3.4, SURFACE.rgb, np.random.default_rng(seed)).astype(float)
        if not len(coat):
            continue
        for line in (LAYOUT.left_m, LAYOUT.right_m):
            along, right, length = axes(*line)
            on_line = coat[np.abs((coat[:, :2] - line[0]) @ right) < 5.0]
            assert np.all(np.abs((on_line[:, :2] - line[0]) @ right) <= 1.8 + 1e-3)
            reach = ((on_line[:, :2] - line[0]) @ along).reshape(-1, 6)
            assert reach.size == 0 or (reach.min() > -1e-3 and reach.max() < length + 1e-3)
            hidden.append(np.ptp(reach, axis=1).sum() / length)
    assert 0.05 < np.mean(hidden) < 0.2
    assert np.max(hidden) < 0.5


def test_damage_keeps_half_of_a_marking_at_times():
    sides = set()
    for seed in range(20):
        coat = paint_damage(LAYOUT, 3.4, SURFACE.rgb, np.random.default_rng(seed)).astype(float)
        right = axes(*LAYOUT.left_m)[1]
        across = ((coat[:, :2] - LAYOUT.left_m[0]) @ right).reshape(-1, 6)
        near = across[np.abs(across).max(axis=1) < 5.0]
        sides |= set(np.round(near.mean(axis=1), 1))
    assert {0.0, 0.9} <= {abs(side) for side in sides}
