import numpy as np
from mesh_volume import volume

from deckline.sim.ship.clearance import CLEAR_M, runway_distance
from deckline.sim.ship.island import island_mesh, lattice, random_islands, support_mesh
from deckline.sim.ship.layout import class_layout, random_layout
from deckline.sim.ship.mesh import rectangle
from deckline.sim.ship.ship_class import Island, load_class


def test_random_islands_stand_off_the_runway_and_apart():
    found = []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        layout = random_layout(rng)
        islands = random_islands(layout, True, rng)
        found.append(len(islands))
        for island in islands:
            corners = rectangle(*island.middle_m, island.length_m, island.width_m)
            assert runway_distance(layout, corners).min() >= CLEAR_M
        if len(islands) == 2:
            apart = abs(islands[0].middle_m[0] - islands[1].middle_m[0])
            assert apart > (islands[0].length_m + islands[1].length_m) / 2
    assert set(found) == {0, 1, 2}
    assert np.mean(np.array(found) > 0) > 0.75


def test_an_island_reaches_its_height_and_its_mast_higher():
    layout = class_layout(load_class("cvn"))
    for seed in range(20):
        plain, masted = (Island((150.0, 29.0), 30.0, 8.0, 18.0, mast) for mast in (0.0, 20.0))
        paint = np.full(3, 0.5)
        low, high = (
            -island_mesh(layout, isl, True, paint, np.random.default_rng(seed))[:, 2].min() for isl in (plain, masted)
        )
        assert 18.0 < low < 18.0 + 14.0  # funnel, radomes, whips
        assert 0.9 * 38.0 < high < 38.0 + 5.0


def test_a_support_is_built_only_under_an_overhang():
    layout = class_layout(load_class("cvn"))
    edge = layout.edges_at(150.0)[1]
    paint = np.full(3, 0.5)
    assert len(support_mesh(layout, Island((150.0, edge - 8.0), 30.0, 8.0, 18.0), paint)) == 0
    mesh = support_mesh(layout, Island((150.0, edge + 1.0), 30.0, 8.0, 18.0), paint)
    assert mesh[:, 1].max() > edge + 4.0
    assert mesh[:, 2].min() < 0.0 < mesh[:, 2].max()
    assert volume(mesh) > 0


def test_a_lattice_closes_towards_its_top():
    mesh = lattice(0.0, 0.0, -10.0, 12.0, 2.0, np.full(3, 0.5))
    assert mesh[:, 2].min() < -21.9
    top, foot = mesh[mesh[:, 2] < -21.5], mesh[mesh[:, 2] > -10.5]
    assert np.abs(top[:, 0]).max() < 0.5 * np.abs(foot[:, 0]).max()
