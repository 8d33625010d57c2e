import numpy as np
import pytest
from mesh_volume import volume

from deckline.sim.ship.clearance import CLEAR_M, runway_distance
from deckline.sim.ship.hull import (
    DRAUGHT_M,
    SLAB_M,
    clear_span,
    half_width,
    hull_mesh,
    random_form,
    random_hull,
    recess,
    ski_jump,
    slab_mesh,
)
from deckline.sim.ship.layout import class_layout, random_layout
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
        mesh = hull_mesh(layout, hull, random_form(layout, hull, rng), rng)
        depth = layout.deck_height_m + DRAUGHT_M - SLAB_M
        box = layout.length_m * float(np.max(layout.starboard_m - layout.port_m)) * depth
        assert 0.15 * box < volume(mesh) < box


def test_hulls_stay_under_their_deck():
    for layout, rng in afloat(30):
        hull = random_hull(layout, rng)
        mesh = hull_mesh(layout, hull, random_form(layout, hull, rng), rng)
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
        mesh = slab_mesh(layout, True, np.full(3, 0.5), rng)
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
    mesh = ski_jump(layout, False, hull, np.full(3, 0.3))
    assert mesh[:, 2].min() == -5.0
    assert mesh[:, 0].min() == pytest.approx(layout.length_m - 20.0, abs=1e-3)
    highest = mesh[mesh[:, 2] == -5.0]
    np.testing.assert_allclose(highest[:, 0], layout.length_m, atol=1e-3)
    assert volume(mesh) > 0


def test_no_ramp_without_a_height():
    layout = class_layout(load_class("cvn"))
    assert len(ski_jump(layout, True, load_class("cvn").hull, np.full(3, 0.3))) == 0


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
