import numpy as np
import pytest
from mesh_volume import volume

from deckline.sim.ship.layout import CLEAR_M, class_layout, random_layout, runway_distance
from deckline.sim.ship.mesh import rectangle
from deckline.sim.ship.ship_class import SHIP_CLASSES, Island, load_class
from deckline.sim.ship.structure import build_island, build_structure, build_support, random_islands


@pytest.fixture(scope="module")
def ships():
    made = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        layout = random_layout(rng)
        made.append((layout, build_structure(layout, True, rng)))
    return made


def fill(mesh, steps=4):
    """Points all over the triangles of a mesh: corners and everything between, (N, M, 3)."""
    corners = mesh[:, :3].reshape(-1, 3, 3).astype(float)
    weights = [(a, b, steps - a - b) for a in range(steps + 1) for b in range(steps + 1 - a)]
    return np.einsum("mk,nkc->nmc", np.array(weights) / steps, corners)


def test_nothing_stands_on_the_runway_or_close_to_it(ships):
    for layout, structure in ships:
        points = fill(structure.mesh).reshape(-1, 3)
        centre = layout.centre_m
        along = (centre[1] - centre[0]) / np.linalg.norm(centre[1] - centre[0])
        lines = (layout.left_m, layout.right_m)
        reach = max(np.linalg.norm(line[1] - line[0]) for line in lines)
        s = (points[:, :2] - centre[0]) @ along
        beside = (s > 0.5) & (s < reach + 3.0)  # beyond the runway's end a ski jump may rise
        above = points[beside & (points[:, 2] < -0.03)]
        if len(above):
            assert runway_distance(layout, above[:, :2]).min() > CLEAR_M - 1e-3


def test_nothing_hides_the_runway_from_astern(ships):
    for layout, structure in ships:
        behind = structure.mesh[structure.mesh[:, 0] < min(layout.left_m[0, 0], layout.right_m[0, 0])]
        above = behind[behind[:, 2] < -0.03]
        if len(above):
            assert runway_distance(layout, above[:, :2].astype(float)).min() > CLEAR_M - 1e-3


def test_solids_are_finite_moderate_and_coloured(ships):
    for _, structure in ships:
        mesh = structure.mesh
        assert mesh.dtype == np.float32 and mesh.shape[1] == 9 and len(mesh) % 3 == 0
        assert np.isfinite(mesh).all()
        assert len(mesh) < 3 * 30_000
        assert mesh[:, 6:].min() >= 0.0 and mesh[:, 6:].max() <= 1.0
        np.testing.assert_allclose(np.linalg.norm(mesh[:, 3:6], axis=1), 1.0, atol=1e-4)


def test_normals_follow_the_winding(ships):
    for _, structure in ships[:20]:
        a, b, c = (structure.mesh[k::3, :3].astype(float) for k in range(3))
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal, axis=1)
        large = area > 0.05  # float32 positions leave thin ones uncertain
        cosine = np.sum(normal * structure.mesh[::3, 3:6], axis=1)[large] / area[large]
        assert cosine.min() > 0.99


def test_the_same_seed_builds_the_same_ship():
    layout = random_layout(np.random.default_rng(1))
    first, second = (build_structure(layout, True, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(first.mesh, second.mesh)
    assert first.stern_half_m == second.stern_half_m


@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_every_class_gets_its_islands_where_its_file_puts_them(name):
    spec = load_class(name)
    layout = class_layout(spec)
    structure = build_structure(layout, True, np.random.default_rng(0), spec)
    if spec.on_land:
        assert structure.stern_half_m == 0.0
        return
    assert 0.3 * spec.hull.beam_m < structure.stern_half_m < 0.6 * spec.hull.beam_m
    for island in spec.islands:
        near = np.linalg.norm(structure.mesh[:, :2] - island.middle_m, axis=1) < 0.6 * island.length_m
        assert -structure.mesh[near, 2].min() > island.height_m + 0.5 * island.mast_m


def test_most_random_ships_have_an_island(ships):
    tall = [structure.mesh[:, 2].min() < -9.0 for layout, structure in ships if not layout.on_land]
    assert 0.8 < np.mean(tall) < 1.0


def test_hulls_reach_the_water(ships):
    for layout, structure in ships:
        if not layout.on_land:
            assert structure.mesh[:, 2].max() >= layout.deck_height_m - 1e-3
            assert structure.stern_half_m > 2.0


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
            -build_island(layout, isl, True, paint, np.random.default_rng(seed))[:, 2].min() for isl in (plain, masted)
        )
        assert 18.0 < low < 18.0 + 14.0  # funnel, radomes, whips
        assert 0.9 * 38.0 < high < 38.0 + 5.0


def test_a_support_is_built_only_under_an_overhang():
    layout = class_layout(load_class("cvn"))
    edge = layout.edges_at(150.0)[1]
    paint = np.full(3, 0.5)
    assert len(build_support(layout, Island((150.0, edge - 8.0), 30.0, 8.0, 18.0), paint)) == 0
    mesh = build_support(layout, Island((150.0, edge + 1.0), 30.0, 8.0, 18.0), paint)
    assert mesh[:, 1].max() > edge + 4.0
    assert mesh[:, 2].min() < 0.0 < mesh[:, 2].max()
    assert volume(mesh) > 0


def test_a_lattice_closes_towards_its_top():
    mesh = build_lattice(0.0, 0.0, -10.0, 12.0, 2.0, np.full(3, 0.5))
    assert mesh[:, 2].min() < -21.9
    top, foot = mesh[mesh[:, 2] < -21.5], mesh[mesh[:, 2] > -10.5]
    assert np.abs(top[:, 0]).max() < 0.5 * np.abs(foot[:, 0]).max()
