import numpy as np
import pytest
from mesh_volume import volume

from deckline.sim.ship.background import VESSELS, background_mesh, blocks_approach, build_foam, vessel_mesh
from deckline.sim.ship.hull import DRAUGHT_M
from deckline.sim.ship.layout import class_layout, random_layout
from deckline.sim.ship.ship_class import SHIP_CLASSES, load_class


def surroundings(kind, count=40):
    for seed in range(count):
        rng = np.random.default_rng(seed)
        layout = random_layout(rng)
        yield layout, background_mesh(layout, rng, kind)


def polar(layout, mesh):
    """Distance from the runway's beginning, and the angle off the path astern, 0..pi, of a mesh's corners."""
    ramp, end = layout.world_from_ship.apply(np.column_stack([layout.centre_m, np.zeros(2)]))[:, :2]
    delta = mesh[:, :2] - ramp
    back = (ramp - end) / np.linalg.norm(end - ramp)
    cosine = delta @ back / np.linalg.norm(delta, axis=1)
    beside = np.abs(delta @ np.array([-back[1], back[0]]))
    return np.linalg.norm(delta, axis=1), np.arccos(np.clip(cosine, -1, 1)), beside


@pytest.mark.parametrize("kind", ["ships", "coast", "random"])
def test_the_approach_stays_clear(kind):
    for layout, mesh in surroundings(kind):
        if len(mesh):
            distance, off_axis, beside = polar(layout, mesh)
            astern = off_axis < np.pi / 2
            assert not np.any((off_axis < np.deg2rad(20.0)) & (distance < 6000.0))
            assert not np.any(astern & (beside < 150.0) & (distance < 6000.0))


@pytest.mark.parametrize("kind", ["ships", "coast"])
def test_everything_stands_on_the_water(kind):
    for layout, mesh in surroundings(kind):
        if len(mesh):
            assert mesh[:, 2].min() < layout.sea_z_m
            assert mesh[:, 2].max() < layout.sea_z_m + 6.0  # hulls may reach below the water, no further


def test_other_ships_keep_their_distance():
    seen = 0
    for layout, mesh in surroundings("ships"):
        if len(mesh):
            seen += 1
            outline = layout.world_from_ship.apply(np.column_stack([layout.outline_m, np.zeros(len(layout.outline_m))]))
            gap = np.linalg.norm(mesh[::7, None, :2] - outline[None, ::5, :2], axis=2)
            assert gap.min() > 300.0
            assert gap.min() < 6000.0
    assert seen > 30


def test_the_shore_lies_two_to_sixteen_kilometres_off():
    for layout, mesh in surroundings("coast"):
        distance = polar(layout, mesh)[0]
        assert distance.min() > 1150.0  # rocks
        assert 2000.0 < distance.max() < 25_000.0


def test_hills_look_up():
    for _, mesh in surroundings("coast", 10):
        assert np.mean(mesh[:, 5] < 0) > 0.6


def test_most_training_ships_sail_alone():
    empty = [len(mesh) == 0 for _, mesh in surroundings("random", 200)]
    assert 0.35 < np.mean(empty) < 0.65


@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_none_is_none_and_land_has_no_ships(name):
    layout = class_layout(load_class(name))
    assert len(background_mesh(layout, np.random.default_rng(0), "none")) == 0
    found = len(background_mesh(layout, np.random.default_rng(0), "ships"))
    assert (found == 0) == layout.on_land


def test_in_the_way_is_the_sector_and_the_corridor():
    layout = class_layout(load_class("cvn"))
    ramp, end = layout.world_from_ship.apply(np.column_stack([layout.centre_m, np.zeros(2)]))[:, :2]
    ahead = (end - ramp) / np.linalg.norm(end - ramp)
    right = np.array([-ahead[1], ahead[0]])

    def at(distance_m, angle_deg):
        angle = np.deg2rad(angle_deg)
        return (ramp - distance_m * (np.cos(angle) * ahead + np.sin(angle) * right))[None]

    assert blocks_approach(layout, at(3000.0, 19.0), 1.0)
    assert not blocks_approach(layout, at(3000.0, 21.0), 1.0)
    assert blocks_approach(layout, at(3000.0, 21.0), 100.0)
    assert blocks_approach(layout, at(-1000.0, 0.0), 1.0)
    assert not blocks_approach(layout, at(-4000.0, 0.0), 1.0)
    assert blocks_approach(layout, at(100.0, 60.0), 100.0)


def test_an_unknown_kind_is_named():
    with pytest.raises(ValueError, match=r"kind must be one of .*, got 'sea'"):
        background_mesh(class_layout(load_class("cvn")), np.random.default_rng(0), "sea")


@pytest.mark.parametrize("kind", VESSELS)
def test_vessels_float_on_their_waterline_and_have_their_length(kind):
    for seed in range(5):
        mesh, length = vessel_mesh(kind, np.random.default_rng(seed))
        assert mesh[:, 2].max() >= -1e-3  # reaches the water
        assert mesh[:, 2].min() < -0.02 * length
        assert 0.9 * length < np.ptp(mesh[:, 0]) < 1.35 * length
        assert mesh[:, 6:].min() >= 0.0 and mesh[:, 6:].max() <= 1.0
        assert len(mesh) < 3 * 30_000
        np.testing.assert_allclose(np.linalg.norm(mesh[:, 3:6], axis=1), 1.0, atol=1e-4)


def test_a_hull_is_closed_and_displaces_less_than_its_box():
    mesh = build_body(100.0, 12.0, 6.0, (0.5, 0.5, 0.5), (0.1, 0.1, 0.1))
    box = 100 * 12 * (6 + DRAUGHT_M)
    assert 0.5 * box < volume(mesh) < box


def test_foam_lies_on_the_water_astern_and_looks_up():
    mesh = build_foam(100.0, 12.0, np.random.default_rng(0))
    assert mesh[:, 0].max() <= -50.0
    np.testing.assert_allclose(mesh[:, 2], -0.03)
    np.testing.assert_allclose(mesh[:, 5], -1.0)


def test_an_unknown_vessel_is_named():
    with pytest.raises(ValueError, match=r"a vessel must be one of .*, got 'raft'"):
        vessel_mesh("raft", np.random.default_rng(0))
