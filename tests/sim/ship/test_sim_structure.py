from dataclasses import replace

import numpy as np
import pytest

from deckline_sim.ship import structure as sr
from deckline_sim.ship.hull import SLAB_M
from deckline_sim.ship.layout import CLEAR_M, before_end, class_layout, runway_distance
from deckline_sim.ship.mesh import rectangle
from deckline_sim.ship.paint_shapes import axes
from deckline_sim.ship.ship_class import SHIP_CLASSES, Hull, Island, load_class

GREY = np.full(3, 0.5)


@pytest.fixture(scope="module")
def ships(afloat):
    return [(layout, *sr.build_structure(layout, True, rng)) for layout, rng in afloat(60)]


def fill(mesh, steps=4):
    """Points all over the triangles of a mesh: corners and everything between, (N, 3)."""
    corners = mesh[:, :3].reshape(-1, 3, 3).astype(float)
    weights = [(a, b, steps - a - b) for a in range(steps + 1) for b in range(steps + 1 - a)]
    return np.einsum("mk,nkc->nmc", np.array(weights) / steps, corners).reshape(-1, 3)


def test_nothing_stands_on_the_runway_or_close_to_it_or_hides_it_from_astern(ships):
    for layout, mesh, _ in ships:
        points = fill(mesh)
        along = (points[:, :2] - layout.centre_m[0]) @ axes(*layout.centre_m)[0]
        beside = (along > 0.5) & before_end(layout, points[:, :2], 3.0)  # beyond the runway's end a ski jump may rise
        astern = points[:, 0] < min(layout.left_m[0, 0], layout.right_m[0, 0])
        above = points[(beside | astern) & (points[:, 2] < -0.03)]
        assert runway_distance(layout, above[:, :2]).min(initial=np.inf) > CLEAR_M - 1e-3


def test_solids_are_finite_moderate_and_coloured_and_reach_the_water(ships):
    for layout, mesh, stern_half_m in ships:
        assert mesh.dtype == np.float32 and mesh.shape[1] == 9 and len(mesh) % 3 == 0
        assert np.isfinite(mesh).all()
        assert len(mesh) < 3 * 30_000
        assert mesh[:, 6:].min() >= 0.0 and mesh[:, 6:].max() <= 1.0
        np.testing.assert_allclose(np.linalg.norm(mesh[:, 3:6], axis=1), 1.0, atol=1e-4)
        assert mesh[:, 2].max() >= layout.deck_height_m - 1e-3
        assert stern_half_m > 2.0


def test_normals_follow_the_winding(ships):
    for _, mesh, _ in ships[:20]:
        a, b, c = (mesh[k::3, :3].astype(float) for k in range(3))
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal, axis=1)
        large = area > 0.05  # float32 positions leave thin ones uncertain
        assert np.min(np.sum(normal * mesh[::3, 3:6], axis=1)[large] / area[large]) > 0.99


@pytest.mark.parametrize("name", [name for name in SHIP_CLASSES if name != "runway"])
def test_every_class_gets_its_islands_where_its_file_puts_them(name):
    spec = load_class(name)
    mesh, stern_half_m = sr.build_structure(class_layout(spec), True, np.random.default_rng(0), spec)
    assert 0.3 * spec.hull.beam_m < stern_half_m < 0.6 * spec.hull.beam_m
    for island in spec.islands:
        near = np.linalg.norm(mesh[:, :2] - island.middle_m, axis=1) < 0.6 * island.length_m
        assert -mesh[near, 2].min() > island.height_m + 0.5 * island.mast_m


def test_the_slab_closes_the_deck_from_below_and_slopes_astern_only(afloat):
    for layout, rng in afloat(20):
        mesh = sr.build_slab(layout, True, GREY, rng)
        x, z = mesh[:, [0, 2]].T
        assert -3.01 < x.min() <= 0.0 and x.max() == pytest.approx(layout.length_m, abs=1e-3)
        assert z.min() == 0.0
        assert np.any((mesh[:, 5] > 0.99) & (np.abs(z - SLAB_M) < 1e-4))  # it looks down


def test_the_ski_jump_rises_to_its_height_at_the_bow(volume):
    layout = class_layout(load_class("axial"))
    hull = Hull(beam_m=30.0, bow="ski-jump", rgb=(0.5, 0.5, 0.5), ramp_height_m=5.0, ramp_length_m=20.0)
    mesh = sr.build_ski_jump(layout, False, hull, GREY)
    assert mesh[:, 2].min() == -5.0
    assert mesh[:, 0].min() == pytest.approx(layout.length_m - 20.0, abs=1e-3)
    np.testing.assert_allclose(mesh[mesh[:, 2] == -5.0, 0], layout.length_m, atol=1e-3)
    assert volume(mesh) > 0
    assert len(sr.build_ski_jump(layout, False, replace(hull, ramp_height_m=0.0), GREY)) == 0


def test_ski_jumps_keep_off_the_lines(afloat):
    built = 0
    for layout, _ in afloat(60):
        hull = Hull(20.0, "ski-jump", (0.5, 0.5, 0.5), ramp_height_m=5.0, ramp_length_m=0.25 * layout.length_m)
        mesh = sr.build_ski_jump(layout, True, hull, GREY)
        port, starboard = layout.edges_at(mesh[:, 0])
        assert np.all((mesh[:, 1] >= port - 1e-3) & (mesh[:, 1] <= starboard + 1e-3))
        points = fill(mesh)[:, :2]
        beside = points[before_end(layout, points, 0.0)]
        assert runway_distance(layout, beside).min(initial=np.inf) >= CLEAR_M
        built += len(mesh) > 0
    assert built > 20


def test_random_islands_stand_off_the_runway_and_apart(afloat):
    counts = []
    for layout, rng in afloat(60):
        islands = sr.random_islands(layout, True, rng)
        counts.append(len(islands))
        for island in islands:
            corners = rectangle(*island.middle_m, island.length_m, island.width_m)
            assert runway_distance(layout, corners).min() >= CLEAR_M
        if len(islands) == 2:
            apart = abs(islands[0].middle_m[0] - islands[1].middle_m[0])
            assert apart > (islands[0].length_m + islands[1].length_m) / 2
    assert set(counts) == {0, 1, 2}
    assert np.mean(np.array(counts) > 0) > 0.75


@pytest.mark.parametrize(("mast_m", "least", "most"), [(0.0, 18.0, 18.0 + 14.0), (20.0, 0.9 * 38.0, 38.0 + 5.0)])
def test_an_island_reaches_its_height_and_its_mast_higher(cvn, mast_m, least, most):
    island = Island((150.0, 29.0), 30.0, 8.0, 18.0, mast_m)
    for seed in range(20):  # funnel, radomes and whips stand on the roof
        assert least < -sr.build_island(cvn, island, True, GREY, np.random.default_rng(seed))[:, 2].min() < most


def test_a_support_is_built_only_under_an_overhang(cvn, volume):
    edge = cvn.edges_at(150.0)[1]
    islands = (Island((150.0, edge + out), 30.0, 8.0, 18.0) for out in (-8.0, 1.0))
    inboard, overhung = (sr.build_support(cvn, island, GREY) for island in islands)
    assert len(inboard) == 0
    assert overhung[:, 1].max() > edge + 4.0
    assert overhung[:, 2].min() < 0.0 < overhung[:, 2].max()
    assert volume(overhung) > 0
