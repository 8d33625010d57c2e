import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline_sim.ship import layout as ly
from deckline_sim.ship.mesh import boxes, join
from deckline_sim.ship.paint_shapes import axes
from deckline_sim.ship.ship_class import SHIP_CLASSES, load_class

LINES = np.array([[2.0, -9.0], [150.0, -25.0]]), np.array([[2.0, 9.0], [150.0, -7.0]])


def angle_deg(line):
    along = axes(*line)[0]
    return np.degrees(np.arctan2(-along[1], along[0]))


def test_paper_lines_are_the_published_ones():
    layout = ly.class_layout(load_class("paper"))
    for line, (slope, constant) in ((layout.left_m, (0.163, -35.788523)), (layout.right_m, (0.15632, -20.889669))):
        world = ly.world_points(layout, line)
        np.testing.assert_allclose(slope * world[:, 0] + world[:, 1] + constant, 0.0, atol=1e-9)
        np.testing.assert_allclose(world[:, 2], 6.08)
        assert np.linalg.norm(world[1] - world[0]) == pytest.approx(220.0)
        assert world[1, 0] < world[0, 0]  # landing runs towards -x
    assert layout.sea_z_m == pytest.approx(26.08)
    assert layout.world_from_ship.apply([0.0, 0.0, 0.0])[0] == pytest.approx(10.0)


def test_cvn_has_the_public_dimensions(cvn):
    assert [angle_deg(cvn.left_m), angle_deg(cvn.right_m)] == pytest.approx([8.49, 8.49])
    assert -ly.runway_distance(cvn, cvn.centre_m)[0] == pytest.approx(10.9)
    assert [axes(*line)[2] for line in (cvn.left_m, cvn.right_m)] == pytest.approx([218.0, 239.0])
    assert np.ptp(cvn.outline_m, axis=0) == pytest.approx([332.85, 76.8], abs=1.0)
    assert cvn.sea_z_m == pytest.approx(0.0)


def assert_lines_lie_on_deck(layout, margin_m):
    for line in (layout.left_m, layout.right_m):
        points = line[0] + np.linspace(0, 1, 40)[:, None] * (line[1] - line[0])
        port, starboard = layout.edges_at(points[:, 0])
        assert np.all((port + margin_m <= points[:, 1]) & (points[:, 1] <= starboard - margin_m))
        assert np.all((points[:, 0] >= 0) & (points[:, 0] <= layout.length_m))


@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_named_ships_carry_their_lines(name):
    spec = load_class(name)
    layout = ly.class_layout(spec)
    assert_lines_lie_on_deck(layout, 1.5 + spec.plan.edge.width_m / 2)
    assert layout.sea_z_m - layout.world_from_ship.translation[2] == pytest.approx(spec.deck_height_m)
    assert layout.on_land == (name == "runway")


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_random_ships_carry_their_lines_left_left_of_right(seed):
    layout = ly.random_layout(np.random.default_rng(seed))
    assert_lines_lie_on_deck(layout, 1.5)
    _, right, _ = axes(*layout.centre_m)
    spacing = (layout.right_m - layout.left_m) @ right
    assert np.all((spacing > 8.0) & (spacing < (46.0 if layout.on_land else 32.0)))
    assert np.all(np.diff(layout.stations_m) > 0)
    assert np.all(layout.port_m < layout.starboard_m)


@pytest.mark.parametrize("name", ["cvn", "axial", "small"])
def test_variants_of_a_class_are_ships_like_it(name):
    spec = load_class(name)
    mirrored = 0
    for seed in range(40):
        variant = ly.class_variant(spec, np.random.default_rng(seed))
        layout = ly.class_layout(variant)
        assert_lines_lie_on_deck(layout, 1.5)
        assert 0.8 < layout.length_m / spec.length_m < 1.1
        assert 0.75 < layout.spacing_m / spec.strip.spacing_m[0] < 1.3
        assert layout.sea_z_m == 0.0
        assert np.all(layout.port_m < layout.starboard_m)
        mirrored += np.sign(variant.strip.start_m[1]) != np.sign(spec.strip.start_m[1])
    assert 0 < mirrored < 12


def test_a_ship_without_a_strip_has_no_variants():
    with pytest.raises(ValueError, match="strip None"):
        ly.class_variant(load_class("paper"), np.random.default_rng(0))


def test_deck_edges_go_through_their_corners_and_make_room_for_the_lines():
    stations, port, starboard = ly.deck_edges(200.0, ([(0, -15), (200, -15)], [(0, 15), (100, 25), (200, 15)]), LINES)
    assert np.interp(100.0, stations, starboard) == pytest.approx(25.0)
    assert np.interp([198.0, 150.0], stations, port) == pytest.approx([-15.0, -25.0 - ly.WIDE_MARGIN_M])


def test_runway_distance_is_the_distance_to_the_nearer_line(cvn):
    right = axes(*cvn.right_m)[1]
    points = cvn.right_m.mean(axis=0) + np.outer([5.0, 0.0, -3.0], right)
    np.testing.assert_allclose(ly.runway_distance(cvn, points), [5.0, 0.0, -3.0], atol=1e-9)
    assert ly.runway_distance(cvn, cvn.left_m.mean(axis=0) - 7.0 * right) == pytest.approx(7.0)


def test_edge_distance_changes_sign_at_the_edge(cvn):
    port, starboard = cvn.edges_at(120.0)
    points = np.array([[120.0, port + 2.0], [120.0, starboard + 1.0], [3.0, 0.0]])
    np.testing.assert_allclose(ly.edge_distance(cvn, points), [2.0, -1.0, 3.0])


def test_before_end_follows_the_runway(cvn):
    reach = max(axes(*line)[2] for line in (cvn.left_m, cvn.right_m))
    points = cvn.centre_m[0] + np.outer([-500.0, reach + 1.9, reach + 2.1], axes(*cvn.centre_m)[0])
    np.testing.assert_array_equal(ly.before_end(cvn, points, 2.0), [True, True, False])


def test_clear_runway_drops_what_stands_there_and_keeps_the_rest(cvn):
    middle = cvn.centre_m.mean(axis=0)
    places = ((*middle, 0.0), (*middle, 5.0), (150.0, 28.0, 0.0))
    offending, below, beside = (boxes(at, (2, 2, 2), (1, 1, 1)) for at in places)
    floor = offending[np.repeat(np.all(offending[:, 2].reshape(-1, 3) == 0, axis=1), 3)]
    kept = ly.clear_runway(cvn, join([offending, below, beside]))
    np.testing.assert_array_equal(kept, join([floor, below, beside]))
