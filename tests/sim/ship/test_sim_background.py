import numpy as np
import pytest

from deckline_sim.ship import background as bg
from deckline_sim.ship.layout import class_layout, random_layout, world_points
from deckline_sim.ship.mesh import join
from deckline_sim.ship.ship_class import SHIP_CLASSES, load_class


@pytest.fixture(scope="module")
def surroundings():
    """Layouts and what lies around them, by kind of background."""

    def draw(kind, count):
        drawn = [(random_layout(rng), rng) for rng in map(np.random.default_rng, range(count))]
        return [(layout, bg.background_mesh(layout, rng, kind)) for layout, rng in drawn]

    return {kind: draw(kind, 40) for kind in ("ships", "coast", "random")}


def polar(layout, mesh):
    """Distance from the runway's beginning, the angle off the path astern, 0..pi, and the distance from the path."""
    ramp, end = world_points(layout, layout.centre_m)[:, :2]
    delta = mesh[:, :2] - ramp
    back = (ramp - end) / np.linalg.norm(end - ramp)
    cosine = delta @ back / np.linalg.norm(delta, axis=1)
    beside = np.abs(delta @ np.array([-back[1], back[0]]))
    return np.linalg.norm(delta, axis=1), np.arccos(np.clip(cosine, -1, 1)), beside


@pytest.mark.parametrize("kind", ["ships", "coast", "random"])
def test_the_approach_stays_clear(kind, surroundings):
    for layout, mesh in surroundings[kind]:
        distance, off_axis, beside = polar(layout, mesh)
        in_the_way = (off_axis < np.deg2rad(20.0)) | ((off_axis < np.pi / 2) & (beside < 150.0))
        assert not np.any(in_the_way & (distance < 6000.0))


@pytest.mark.parametrize("kind", ["ships", "coast"])
def test_everything_stands_on_the_water(kind, surroundings):
    for layout, mesh in surroundings[kind]:
        assert mesh[:, 2].min(initial=-np.inf) < layout.sea_z_m
        assert mesh[:, 2].max(initial=-np.inf) < layout.sea_z_m + 6.0  # hulls may reach below the water, no further


def test_other_ships_keep_their_distance(surroundings):
    met = [(layout, mesh) for layout, mesh in surroundings["ships"] if len(mesh)]
    for layout, mesh in met:
        outline = world_points(layout, layout.outline_m)
        gap = np.linalg.norm(mesh[::7, None, :2] - outline[None, ::5, :2], axis=2)
        assert 300.0 < gap.min() < 6000.0
    assert len(met) > 30


def test_the_shore_lies_two_to_sixteen_kilometres_off_and_hills_look_up(surroundings):
    for layout, mesh in surroundings["coast"]:
        distance = polar(layout, mesh)[0]
        assert distance.min() > 1150.0  # rocks
        assert 2000.0 < distance.max() < 25_000.0
    assert np.mean(join([mesh for _, mesh in surroundings["coast"]])[:, 5] < 0) > 0.6


@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_none_is_none_and_land_has_no_ships(name):
    layout = class_layout(load_class(name))
    none, ships, coast = (
        bg.background_mesh(layout, np.random.default_rng(0), kind) for kind in ("none", "ships", "coast")
    )
    assert len(none) == 0 and len(coast) > 0
    assert (len(ships) == 0) == layout.on_land


@pytest.mark.parametrize("kind", bg.VESSELS)
def test_vessels_float_on_their_waterline_and_have_their_length(kind):
    for seed in range(5):
        mesh, length = bg.vessel_mesh(kind, np.random.default_rng(seed))
        assert mesh[:, 2].max() >= -1e-3  # reaches the water
        assert mesh[:, 2].min() < -0.02 * length
        assert 0.9 * length < np.ptp(mesh[:, 0]) < 1.35 * length
        assert mesh[:, 6:].min() >= 0.0 and mesh[:, 6:].max() <= 1.0
        assert len(mesh) < 3 * 30_000
        np.testing.assert_allclose(np.linalg.norm(mesh[:, 3:6], axis=1), 1.0, atol=1e-4)


def test_foam_lies_on_the_water_astern_and_looks_up():
    mesh = bg.build_foam(100.0, 12.0, np.random.default_rng(0))
    assert mesh[:, 0].max() <= -50.0
    np.testing.assert_allclose(mesh[:, [2, 5]], np.broadcast_to([-0.03, -1.0], (len(mesh), 2)))
