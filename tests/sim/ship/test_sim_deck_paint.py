from dataclasses import replace

import numpy as np
import pytest

from deckline.sim.ship.deck_paint import catapult_coat, deck_coat, fixture_coat, number_coat, panel_coat, spot_coat
from deckline.sim.ship.layout import class_layout, random_layout
from deckline.sim.ship.markings import edge_coat, random_edge
from deckline.sim.ship.mesh import box
from deckline.sim.ship.paint import axes, layers
from deckline.sim.ship.plan import Catapult, DeckSurface, LineStyle, Number, Panel, Plan, Spot, Stripe
from deckline.sim.ship.ship import Ship
from deckline.sim.ship.ship_class import SHIP_CLASSES, load_class

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
    coat = layers([edge_coat(line, style) for line in (layout.left_m, layout.right_m)])
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
    coat = deck_coat(LAYOUT, replace(lone, paint_rgb=(0.11, 0.91, 0.13)), DARK, False, False, rng(0))
    style_rgb = np.float32(CVN.plan.edge.rgb)
    assert not np.any(np.all(np.isclose(coat[:, 2:5], style_rgb), axis=1))
    assert not np.any(np.isclose(coat[:, 3], 0.91))
    painted = deck_coat(LAYOUT, lone, DARK, True, False, rng(0))
    assert np.any(np.all(np.isclose(painted[:, 2:5], style_rgb), axis=1))


def test_only_worn_decks_lose_edge_paint():
    whole, worn = (deck_coat(LAYOUT, CVN.plan, DARK, True, worn, np.random.default_rng(2)) for worn in (False, True))
    np.testing.assert_array_equal(worn[: len(whole)], whole)
    assert len(worn) > len(whole)


def test_fixtures_are_painted_where_the_plan_says():
    stripe = Stripe((10.0, 2.0), (30.0, 2.0), LineStyle(0.5, (WHITE,)))
    plan = Plan(edge=CVN.plan.edge, stripes=(stripe,))
    area, middle = area_and_middle(fixture_coat(LAYOUT, plan))
    assert area == pytest.approx(10.0)
    np.testing.assert_allclose(middle, [20.0, 2.0], atol=1e-5)


def test_stern_stripe_and_borders_follow_the_deck():
    plan = Plan(edge=CVN.plan.edge, stern_m=3.0)
    area, middle = area_and_middle(fixture_coat(LAYOUT, plan))
    width = LAYOUT.starboard_m[0] - LAYOUT.port_m[0]
    assert area == pytest.approx(3.0 * width, rel=1e-5)
    np.testing.assert_allclose(middle, [1.5, (LAYOUT.starboard_m[0] + LAYOUT.port_m[0]) / 2], atol=1e-4)
    border = fixture_coat(LAYOUT, Plan(edge=CVN.plan.edge, port_border_m=0.5))
    edge = np.interp(border[:, 0], LAYOUT.stations_m, LAYOUT.port_m)
    assert np.median(border[:, 1] - edge) == pytest.approx(0.8 + 0.25, abs=0.3)


def test_catapult_has_slot_lines_and_deflector():
    bare = Catapult((100.0, 0.0), (200.0, 0.0), 1.2, WHITE, slot_m=0.0)
    area, middle = area_and_middle(catapult_coat(bare))
    assert area == pytest.approx(120.0, rel=1e-5)
    np.testing.assert_allclose(middle, [150.0, 0.0], atol=1e-4)
    full = catapult_coat(replace(bare, slot_m=0.4, border_m=2.0, deflector_m=10.0))
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
