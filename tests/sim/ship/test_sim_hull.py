import numpy as np
import pytest
from mesh_volume import volume

from deckline.sim.ship.hull import (
    DRAUGHT_M,
    SLAB_M,
    build_fittings,
    build_hull,
    build_side_number,
    build_ski_jump,
    build_slab,
    build_walk,
    clear_span,
    facing,
    half_width,
    points_on_side,
    random_form,
    random_hull,
    recess,
)
from deckline.sim.ship.layout import CLEAR_M, class_layout, random_layout, runway_distance
from deckline.sim.ship.ship_class import Hull, load_class


def afloat(count):
    """Random layouts that have a hull, each with its generator."""
    found = 0
    for seed in range(10 * count):
        rng = np.random.default_rng(seed)
        layout = random_layout(rng)
        if not layout.on_land:
            found += 1
            yield layout, rng
        if found == count:
            return


def test_hulls_are_closed_but_for_a_hall_in_the_stern():
    for layout, rng in afloat(30):
        hull = random_hull(layout, rng)
        mesh = build_hull(layout, hull, random_form(layout, hull, rng), rng)
        depth = layout.deck_height_m + DRAUGHT_M - SLAB_M
        box = layout.length_m * float(np.max(layout.starboard_m - layout.port_m)) * depth
        assert 0.15 * box < volume(mesh) < box


def test_hulls_stay_under_their_deck():
    for layout, rng in afloat(30):
        hull = random_hull(layout, rng)
        mesh = build_hull(layout, hull, random_form(layout, hull, rng), rng)
        x, y, z = mesh[:, :3].T.astype(float)
        port, starboard = (np.interp(x, layout.stations_m, edge) for edge in (layout.port_m, layout.starboard_m))
        assert np.all(y > port) and np.all(y < starboard)
        assert z.min() >= SLAB_M - 1e-4
        assert z.max() == pytest.approx(layout.deck_height_m + DRAUGHT_M, abs=1e-3)


def test_hulls_flare_upwards_and_have_their_beam_at_the_water():
    layout = class_layout(load_class("cvn"))
    hull = load_class("cvn").hull
    form = random_form(layout, hull, np.random.default_rng(0))
    x = np.full(3, 0.45 * layout.length_m)
    water, middle, top = half_width(form, x, np.array([layout.deck_height_m, 10.0, SLAB_M]), 1.0)
    assert water == pytest.approx(hull.beam_m / 2, rel=1e-6)
    assert water <= middle <= top


def test_the_slab_closes_the_deck_from_below_and_slopes_astern_only():
    for layout, rng in afloat(20):
        mesh = build_slab(layout, True, np.full(3, 0.5), rng)
        x, z = mesh[:, [0, 2]].T
        assert -3.01 < x.min() <= 0.0 and x.max() == pytest.approx(layout.length_m, abs=1e-3)
        assert z.min() == 0.0
        under = mesh[(mesh[:, 5] > 0.99) & (np.abs(mesh[:, 2] - SLAB_M) < 1e-4)]
        assert len(under) and np.all(under[:, 5] > 0)  # it looks down


def test_a_hall_is_seen_from_within():
    hole = np.array([[0.0, -5, 2], [0, 5, 2], [0, 5, 8], [0, -5, 8]])
    mesh = recess(hole, 6.0, np.full(3, 0.3))
    inwards = np.array([3.0, 0.0, 5.0]) - mesh[:, :3]
    assert np.all(np.sum(inwards * mesh[:, 3:6], axis=1) > 0)
    assert np.ptp(mesh[:, 0]) == 6.0


def test_the_ski_jump_rises_to_its_height_at_the_bow():
    layout = class_layout(load_class("axial"))
    hull = Hull(beam_m=30.0, bow="ski-jump", rgb=(0.5, 0.5, 0.5), ramp_height_m=5.0, ramp_length_m=20.0)
    mesh = build_ski_jump(layout, False, hull, np.full(3, 0.3))
    assert mesh[:, 2].min() == -5.0
    assert mesh[:, 0].min() == pytest.approx(layout.length_m - 20.0, abs=1e-3)
    highest = mesh[mesh[:, 2] == -5.0]
    np.testing.assert_allclose(highest[:, 0], layout.length_m, atol=1e-3)
    assert volume(mesh) > 0


def test_no_ramp_without_a_height():
    layout = class_layout(load_class("cvn"))
    assert len(build_ski_jump(layout, True, load_class("cvn").hull, np.full(3, 0.3))) == 0


def test_clear_span_keeps_off_the_lines():
    for layout, _ in afloat(60):
        x = np.linspace(0.75, 1.0, 9) * layout.length_m
        port, starboard = (np.interp(x, layout.stations_m, edge) for edge in (layout.port_m, layout.starboard_m))
        low, high = clear_span(layout, x, port, starboard)
        assert np.all(low >= port - 1e-9) and np.all(high <= starboard + 1e-9)
        centre = layout.centre_m
        along = (centre[1] - centre[0]) / np.linalg.norm(centre[1] - centre[0])
        reach = max(np.linalg.norm(line[1] - line[0]) for line in (layout.left_m, layout.right_m))
        for k in np.flatnonzero(high - low > 1.0):
            across = np.column_stack([np.full(50, x[k]), np.linspace(low[k], high[k], 50)])
            before = (across - centre[0]) @ along < reach
            assert not np.any(before & (runway_distance(layout, across) < CLEAR_M))


@pytest.fixture(scope="module")
def form():
    spec = load_class("cvn")
    return random_form(class_layout(spec), spec.hull, np.random.default_rng(0))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_panels_stand_just_off_the_hull_and_look_outwards(form, side):
    rng = np.random.default_rng(3)
    for mesh in (
        build_bay(form, side, np.full(3, 0.5), rng),
        build_side_number(form, side, "68", rng),
        build_streaks(form, side, rng),
    ):
        x, y, z = mesh[:, :3].T.astype(float)
        off = side * y - half_width(form, x, z, side)
        assert np.all((off > 0.05) & (off < 0.2))
        assert np.all(mesh[:, 4] * side > 0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_number_is_read_from_outside(form, side):
    mesh = build_side_number(form, side, "81", np.random.default_rng(0))
    x = mesh[:, 0].reshape(-1, 3).mean(axis=1)
    aft, forward = (np.sum(half) for half in (x < (x.min() + x.max()) / 2, x > (x.min() + x.max()) / 2))
    # From starboard the bow is to the right, so that the 8, which has the more strokes, lies aft.
    assert (aft > forward) == (side > 0)


def test_on_side_stands_off_by_what_is_asked(form):
    near, far = (points_on_side(form, [100.0], [8.0], 1.0, out)[0, 1] for out in (0.0, 0.5))
    assert far - near == pytest.approx(0.5)


def test_facing_turns_quads_to_a_direction():
    quad = np.array([[[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]], dtype=float)
    for away in ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        np.testing.assert_allclose(facing(quad, (1, 1, 1), away)[:, 3:6], np.tile(away, (6, 1)), atol=1e-7)
        np.testing.assert_allclose(facing(quad[:, ::-1], (1, 1, 1), away)[:, 3:6], np.tile(away, (6, 1)), atol=1e-7)


def test_walks_hang_below_the_deck_outside_its_edge(form):
    layout = form.layout
    mesh = build_walk(layout, 1.0, np.full(3, 0.5), np.random.default_rng(1), True)
    x, y, z = mesh[:, :3].T.astype(float)
    assert np.all(y > np.interp(x, layout.stations_m, layout.starboard_m) - 6.0)
    assert z.min() >= -0.05


def test_railings_are_a_bit_over_a_metre_high():
    mesh = build_railing(np.array([[0.0, 0, 3], [10, 0, 3]]), (1, 1, 1))
    assert 3.0 - mesh[:, 2].min() == pytest.approx(1.1, abs=0.06)


def test_both_sides_and_the_stern_stay_below_the_deck_but_for_gear(form):
    for seed in range(10):
        mesh = build_fittings(form.layout, form, "68", np.full(3, 0.5), np.random.default_rng(seed))
        assert mesh[:, 2].max() <= form.layout.deck_height_m + 1.0
        assert np.mean(mesh[:, 2] > 0.0) > 0.9
        assert np.mean(mesh[:, 2] > SLAB_M) > 0.3
