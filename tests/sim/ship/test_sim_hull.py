import numpy as np
import pytest

from deckline_sim.ship import hull as hl
from deckline_sim.ship.ship_class import load_class

CVN_HULL = load_class("cvn").hull
GREY = np.full(3, 0.5)
SIDES = pytest.mark.parametrize("side", [-1.0, 1.0])


@pytest.fixture(scope="module")
def form(cvn):
    return hl.random_form(cvn, CVN_HULL, np.random.default_rng(0))


def test_hulls_are_closed_but_for_a_hall_in_the_stern_and_stay_under_their_deck(afloat, volume):
    for layout, rng in afloat(30):
        hull = hl.random_hull(layout, rng)
        mesh = hl.build_hull(hull, hl.random_form(layout, hull, rng), rng)
        depth = layout.deck_height_m + hl.DRAUGHT_M
        box = layout.length_m * float(np.max(layout.starboard_m - layout.port_m)) * (depth - hl.SLAB_M)
        assert 0.15 * box < volume(mesh) < box
        x, y, z = mesh[:, :3].T.astype(float)
        port, starboard = layout.edges_at(x)
        assert np.all(y > port) and np.all(y < starboard)
        assert z.min() >= hl.SLAB_M - 1e-4
        assert z.max() == pytest.approx(depth, abs=1e-3)


def test_hulls_flare_upwards_and_have_their_beam_at_the_water(form):
    x, heights = np.full(3, 0.45 * form.layout.length_m), np.array([form.layout.deck_height_m, 10.0, hl.SLAB_M])
    water, middle, top = form.half_width(x, heights, 1.0)
    assert water == pytest.approx(CVN_HULL.beam_m / 2, rel=1e-6)
    assert water <= middle <= top


def test_a_hall_is_seen_from_within():
    levels = np.array([1.0, 2.0, 8.0, 9.0])
    port, starboard = (np.column_stack([0 * levels, np.full(4, y), levels]) for y in (-10.0, 10.0))
    mesh = hl.build_transom(port, starboard, np.full((3, 3), 0.3), (2.0, 8.0), np.random.default_rng(0))
    hall = mesh[np.repeat(mesh[:, 0].reshape(-1, 3).max(axis=1) > 0, 3)]
    depth = np.ptp(hall[:, 0])
    assert 4.0 < depth < 12.0
    inwards = np.array([depth / 2, 0.0, 5.0]) - hall[:, :3]
    assert np.all(np.sum(inwards * hall[:, 3:6], axis=1) > 0)
    assert np.all(mesh[mesh[:, 0].max() == 0, 3] < 0)


@SIDES
def test_panels_stand_just_off_the_hull_and_look_outwards(form, side):
    rng = np.random.default_rng(3)
    panels = hl.build_bay(form, side, GREY, rng), hl.build_side_number(form, side, "68", rng)
    for mesh in (*panels, hl.build_streaks(form, side, rng)):
        x, y, z = mesh[:, :3].T.astype(float)
        off = side * y - form.half_width(x, z, side)
        assert np.all((off > 0.05) & (off < 0.2))
        assert np.all(mesh[:, 4] * side > 0)


@SIDES
def test_a_number_is_read_from_outside(form, side):
    mesh = hl.build_side_number(form, side, "81", np.random.default_rng(0))
    x = mesh[:, 0].reshape(-1, 3).mean(axis=1)
    middle = (x.min() + x.max()) / 2
    # From starboard the bow is to the right, so that the 8, which has the more strokes, lies aft.
    assert (np.sum(x < middle) > np.sum(x > middle)) == (side > 0)


def test_walks_hang_below_the_deck_outside_its_edge(form):
    x, y, z = hl.build_walk(form.layout, 1.0, GREY, np.random.default_rng(1), True)[:, :3].T.astype(float)
    assert np.all(y > form.layout.edges_at(x)[1] - 6.0)
    assert z.min() >= -0.05
