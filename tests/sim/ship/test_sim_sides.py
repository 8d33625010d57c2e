import numpy as np
import pytest

from deckline.sim.ship.hull import SLAB_M, half_width, random_form
from deckline.sim.ship.layout import class_layout
from deckline.sim.ship.ship_class import load_class
from deckline.sim.ship.sides import bay, deck_walk, facing, on_side, railing, side_meshes, side_number, streaks


@pytest.fixture(scope="module")
def form():
    spec = load_class("cvn")
    return random_form(class_layout(spec), spec.hull, np.random.default_rng(0))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_panels_stand_just_off_the_hull_and_look_outwards(form, side):
    rng = np.random.default_rng(3)
    for mesh in (bay(form, side, np.full(3, 0.5), rng), side_number(form, side, "68", rng), streaks(form, side, rng)):
        x, y, z = mesh[:, :3].T.astype(float)
        off = side * y - half_width(form, x, z, side)
        assert np.all((off > 0.05) & (off < 0.2))
        assert np.all(mesh[:, 4] * side > 0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_number_is_read_from_outside(form, side):
    mesh = side_number(form, side, "81", np.random.default_rng(0))
    x = mesh[:, 0].reshape(-1, 3).mean(axis=1)
    aft, forward = (np.sum(half) for half in (x < (x.min() + x.max()) / 2, x > (x.min() + x.max()) / 2))
    # From starboard the bow is to the right, so that the 8, which has the more strokes, lies aft.
    assert (aft > forward) == (side > 0)


def test_on_side_stands_off_by_what_is_asked(form):
    near, far = (on_side(form, [100.0], [8.0], 1.0, out)[0, 1] for out in (0.0, 0.5))
    assert far - near == pytest.approx(0.5)


def test_facing_turns_quads_to_a_direction():
    quad = np.array([[[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]], dtype=float)
    for away in ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        np.testing.assert_allclose(facing(quad, (1, 1, 1), away)[:, 3:6], np.tile(away, (6, 1)), atol=1e-7)
        np.testing.assert_allclose(facing(quad[:, ::-1], (1, 1, 1), away)[:, 3:6], np.tile(away, (6, 1)), atol=1e-7)


def test_walks_hang_below_the_deck_outside_its_edge(form):
    layout = form.layout
    mesh = deck_walk(layout, 1.0, np.full(3, 0.5), np.random.default_rng(1), True)
    x, y, z = mesh[:, :3].T.astype(float)
    assert np.all(y > np.interp(x, layout.stations_m, layout.starboard_m) - 6.0)
    assert z.min() >= -0.05


def test_railings_are_a_bit_over_a_metre_high():
    mesh = railing(np.array([[0.0, 0, 3], [10, 0, 3]]), (1, 1, 1))
    assert 3.0 - mesh[:, 2].min() == pytest.approx(1.1, abs=0.06)


def test_both_sides_and_the_stern_stay_below_the_deck_but_for_gear(form):
    for seed in range(10):
        mesh = side_meshes(form.layout, form, "68", np.full(3, 0.5), np.random.default_rng(seed))
        assert mesh[:, 2].max() <= form.layout.deck_height_m + 1.0
        assert np.mean(mesh[:, 2] > 0.0) > 0.9
        assert np.mean(mesh[:, 2] > SLAB_M) > 0.3
