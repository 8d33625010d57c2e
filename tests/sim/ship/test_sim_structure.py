import numpy as np
import pytest

from deckline.sim.ship.clearance import CLEAR_M, runway_distance
from deckline.sim.ship.layout import class_layout, random_layout
from deckline.sim.ship.ship_class import SHIP_CLASSES, load_class
from deckline.sim.ship.structure import build_structure


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
