from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.sim.ship.layout import (
    DECKS,
    EDGE_MARGIN_M,
    before_end,
    class_layout,
    class_variant,
    clear_runway,
    edge_distance,
    has_room,
    random_edges,
    random_layout,
    runway_distance,
    ship_layout,
    sponson_edge,
    stepped_edge,
    straight_edge,
    tapered_edge,
    world_points,
)
from deckline.sim.ship.mesh import box, join, rectangle
from deckline.sim.ship.paint import axes
from deckline.sim.ship.ship_class import SHIP_CLASSES, LineEnds, load_class


def angle_deg(line):
    along = axes(*line)[0]
    return np.degrees(np.arctan2(-along[1], along[0]))


def test_paper_lines_are_the_published_ones():
    layout = class_layout(load_class("paper"))
    for line, (slope, constant) in ((layout.left_m, (0.163, -35.788523)), (layout.right_m, (0.15632, -20.889669))):
        world = world_points(layout, line)
        np.testing.assert_allclose(slope * world[:, 0] + world[:, 1] + constant, 0.0, atol=1e-9)
        np.testing.assert_allclose(world[:, 2], 6.08)
        assert np.linalg.norm(world[1] - world[0]) == pytest.approx(220.0)
        assert world[1, 0] < world[0, 0]  # landing runs towards -x
    assert layout.sea_z_m == pytest.approx(26.08)
    assert layout.world_from_ship.apply([0.0, 0.0, 0.0])[0] == pytest.approx(10.0)


def test_cvn_has_the_public_dimensions():
    layout = class_layout(load_class("cvn"))
    assert angle_deg(layout.left_m) == pytest.approx(8.49)
    assert angle_deg(layout.right_m) == pytest.approx(8.49)
    assert -runway_distance(layout, layout.centre_m)[0] == pytest.approx(10.9)
    assert [axes(*line)[2] for line in (layout.left_m, layout.right_m)] == pytest.approx([218.0, 239.0])
    assert np.ptp(layout.outline_m, axis=0) == pytest.approx([332.85, 76.8], abs=1.0)
    assert layout.sea_z_m == pytest.approx(0.0)


def assert_lines_lie_on_deck(layout, margin_m):
    for line in (layout.left_m, layout.right_m):
        for point in line[0] + np.linspace(0, 1, 40)[:, None] * (line[1] - line[0]):
            port, starboard = layout.edges_at(point[0])
            assert port + margin_m <= point[1] <= starboard - margin_m
            assert 0 <= point[0] <= layout.length_m


@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_named_ships_carry_their_lines(name):
    spec = load_class(name)
    layout = class_layout(spec)
    assert_lines_lie_on_deck(layout, 1.5 + spec.plan.edge.width_m / 2)
    assert layout.sea_z_m - layout.world_from_ship.translation[2] == pytest.approx(spec.deck_height_m)
    assert layout.on_land == (name == "runway")


def test_classes_have_the_sizes_they_were_made_for():
    axial, small, land = (class_layout(load_class(name)) for name in ("axial", "small", "runway"))
    assert 230 <= axial.length_m <= 260
    assert angle_deg(axial.centre_m) == pytest.approx(0.0, abs=1e-9)
    assert axial.centre_m[0, 1] < 0.0  # to port of the island
    assert 90 <= small.length_m <= 130
    assert 10 <= small.deck_height_m <= 13
    assert 12 <= small.spacing_m <= 14
    assert land.deck_height_m == pytest.approx(0.3)


def test_lines_given_by_their_ends_are_taken_as_they_are():
    ends = LineEnds(((3.0, -12.0), (180.0, -14.0)), ((3.0, 8.0), (170.0, 6.0)))
    layout = class_layout(replace(load_class("cvn"), strip=None, lines=ends))
    np.testing.assert_array_equal(layout.left_m, ends.left_m)
    np.testing.assert_array_equal(layout.right_m, ends.right_m)
    assert layout.spacing_m == 20.0


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_random_ships_carry_their_lines_left_left_of_right(seed):
    layout = random_layout(np.random.default_rng(seed))
    assert_lines_lie_on_deck(layout, 1.5)
    _, right, _ = axes(*layout.centre_m)
    for k in (0, 1):
        assert 8.0 < (layout.right_m[k] - layout.left_m[k]) @ right < (46.0 if layout.on_land else 32.0)
    assert np.all(np.diff(layout.stations_m) > 0)
    assert np.all(layout.port_m < layout.starboard_m)


@pytest.mark.parametrize(
    ("kind", "longest_m", "steepest_deg"),
    [("large", 345, 11), ("medium", 270, 11), ("axial", 285, 2.5), ("small", 140, 6)],
)
def test_kinds_of_decks_differ(kind, longest_m, steepest_deg):
    for seed in range(30):
        layout = ship_layout(kind, np.random.default_rng(seed))
        assert layout.length_m <= longest_m
        assert abs(angle_deg(layout.centre_m)) <= steepest_deg + 1e-6
        assert not layout.on_land


@pytest.mark.parametrize("name", ["cvn", "axial", "small"])
def test_variants_of_a_class_are_ships_like_it(name):
    spec = load_class(name)
    mirrored = 0
    for seed in range(40):
        variant = class_variant(spec, np.random.default_rng(seed))
        layout = class_layout(variant)
        assert_lines_lie_on_deck(layout, 1.5)
        assert 0.8 < layout.length_m / spec.length_m < 1.1
        assert 0.75 < layout.spacing_m / spec.strip.spacing_m[0] < 1.3
        assert layout.sea_z_m == 0.0
        assert np.all(layout.port_m < layout.starboard_m)
        mirrored += np.sign(variant.strip.start_m[1]) != np.sign(spec.strip.start_m[1])
    assert 0 < mirrored < 12


def test_a_ship_without_a_strip_has_no_variants():
    with pytest.raises(ValueError, match="only a ship with a strip can be varied, got paper"):
        class_variant(load_class("paper"), np.random.default_rng(0))


def test_a_few_runways_lie_on_land():
    on_land = [random_layout(np.random.default_rng(seed)).on_land for seed in range(1000)]
    assert np.mean(on_land) == pytest.approx(DECKS["land"], abs=3 * np.sqrt(0.04 * 0.96 / 1000))


LEFT, RIGHT = np.array([[2.0, -9.0], [150.0, -25.0]]), np.array([[2.0, 9.0], [150.0, -7.0]])


def test_outline_goes_through_its_corners_and_makes_room_for_the_lines():
    stations, port, starboard = deck_edges(200.0, [(0, -15), (200, -15)], [(0, 15), (100, 25), (200, 15)], LEFT, RIGHT)
    assert np.interp(100.0, stations, starboard) == pytest.approx(25.0)
    assert np.interp(198.0, stations, port) == pytest.approx(-15.0)
    assert np.interp(150.0, stations, port) == pytest.approx(-25.0 - EDGE_MARGIN_M - 2.0)


@pytest.mark.parametrize("shape", [stepped_edge, sponson_edge, straight_edge, tapered_edge])
def test_shapes_run_from_stern_to_bow_on_their_side(shape):
    for seed in range(50):
        corners = shape(240.0, 16.0, np.random.default_rng(seed))
        x, y = np.transpose(sorted(corners))
        assert x[0] == 0.0
        assert x[-1] == 240.0
        assert y.min() > 2.0
        assert y.max() < 2.0 * 16.0


def test_random_outlines_are_decks():
    for seed in range(100):
        stations, port, starboard = random_edges(200.0, LEFT, RIGHT, np.random.default_rng(seed))
        assert np.all(starboard - port > 3.0)
        inside = stations <= 150.0
        assert np.all(port[inside] <= np.interp(stations[inside], *LEFT.T) - EDGE_MARGIN_M)
        assert np.all(np.isfinite(port + starboard))


@pytest.fixture(scope="module")
def cvn():
    return class_layout(load_class("cvn"))


def test_runway_distance_is_the_distance_to_the_nearer_line(cvn):
    along = (cvn.right_m[1] - cvn.right_m[0]) / np.linalg.norm(cvn.right_m[1] - cvn.right_m[0])
    right = np.array([-along[1], along[0]])
    middle = cvn.right_m.mean(axis=0)
    np.testing.assert_allclose(
        runway_distance(cvn, middle + np.outer([5.0, 0.0, -3.0], right)), [5.0, 0.0, -3.0], atol=1e-9
    )
    left_middle = cvn.left_m.mean(axis=0)
    assert runway_distance(cvn, left_middle - 7.0 * right) == pytest.approx(7.0)


def test_edge_distance_changes_sign_at_the_edge(cvn):
    x = 120.0
    port, starboard = cvn.edges_at(x)
    points = np.array([[x, port + 2.0], [x, starboard + 1.0], [3.0, 0.0]])
    np.testing.assert_allclose(edge_distance(cvn, points), [2.0, -1.0, 3.0])


def test_has_room_refuses_the_runway_and_the_water(cvn):
    on_runway = rectangle(*cvn.centre_m.mean(axis=0), 5.0, 5.0)
    assert not has_room(cvn, True, on_runway)
    assert has_room(cvn, False, on_runway)
    beside = rectangle(150.0, 28.0, 5.0, 5.0)
    assert has_room(cvn, True, beside)
    assert not has_room(cvn, True, beside + np.array([0.0, 20.0]))


def test_before_end_follows_the_runway(cvn):
    along = (cvn.centre_m[1] - cvn.centre_m[0]) / np.linalg.norm(cvn.centre_m[1] - cvn.centre_m[0])
    reach = max(np.linalg.norm(line[1] - line[0]) for line in (cvn.left_m, cvn.right_m))
    points = cvn.centre_m[0] + np.outer([-500.0, reach + 1.9, reach + 2.1], along)
    np.testing.assert_array_equal(before_end(cvn, points, 2.0), [True, True, False])


def test_clear_of_runway_drops_what_stands_there_and_keeps_the_rest(cvn):
    middle = cvn.centre_m.mean(axis=0)
    offending, below, beside = (
        box(*middle, 0.0, (2, 2, 2), 0.0, (1, 1, 1)),
        box(*middle, 5.0, (2, 2, 2), 0.0, (1, 1, 1)),
        box(150.0, 28.0, 0.0, (2, 2, 2), 0.0, (1, 1, 1)),
    )
    kept = clear_runway(cvn, join([offending, below, beside]))
    floor = offending[np.repeat((offending[::3, 2] == 0) & (offending[1::3, 2] == 0) & (offending[2::3, 2] == 0), 3)]
    np.testing.assert_array_equal(kept, join([floor, below, beside]))
