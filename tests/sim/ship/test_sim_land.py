import numpy as np
import pytest
from mesh_volume import volume

from deckline.sim.ship.clearance import runway_distance
from deckline.sim.ship.land import CLEAR_M, land_mesh, shed, tree
from deckline.sim.ship.layout import class_layout
from deckline.sim.ship.mesh import join
from deckline.sim.ship.ship_class import load_class


@pytest.fixture(scope="module")
def runway():
    return class_layout(load_class("runway"))


def test_everything_stands_on_the_ground_away_from_the_strip(runway):
    sizes = []
    for seed in range(30):
        mesh = land_mesh(runway, np.random.default_rng(seed))
        sizes.append(len(mesh))
        if len(mesh):
            assert runway_distance(runway, mesh[:, :2].astype(float)).min() > 0.5 * CLEAR_M
            assert mesh[:, 2].max() == pytest.approx(runway.deck_height_m, abs=0.5)
            assert mesh[:, 6:].min() >= 0.0 and mesh[:, 6:].max() <= 1.0
    assert max(sizes) < 3 * 30_000
    assert np.mean(np.array(sizes) > 0) > 0.8


def test_a_shed_is_a_closed_hall_under_an_arch():
    hall = shed(np.zeros(3), np.array([30.0, 20.0, 10.0]), 0.0, np.full(3, 0.5))
    walls = hall[: -3 * 24]  # without the doors
    assert 0.7 * 30 * 20 * 10 < volume(walls) < 30 * 20 * 10


@pytest.mark.parametrize("pointed", [True, False])
def test_trees_have_unit_height(pointed):
    mesh = tree(pointed)
    assert -mesh[:, 2].min() == pytest.approx(1.0)
    assert np.abs(mesh[:, :2]).max() <= 0.5 + 1e-6
    assert len(join([mesh])) < 3 * 80
