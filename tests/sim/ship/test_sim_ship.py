import numpy as np
import pytest
from mesh_volume import volume

from deckline.sim.ship.layout import class_layout, random_layout, runway_distance
from deckline.sim.ship.mesh import box, join
from deckline.sim.ship.paint import axes
from deckline.sim.ship.ship import (
    CENTRE_STRENGTH,
    CLEAR_M,
    DROP_STRENGTH,
    EDGE_STRENGTH,
    FLOOD_STRENGTH,
    NO_RUNWAY,
    RED,
    build_airfield,
    build_lights,
    build_ship,
    shed,
    tree,
)
from deckline.sim.ship.ship_class import SHIP_CLASSES, load_class


@pytest.mark.parametrize("name", [*SHIP_CLASSES, "train"])
def test_the_same_seed_builds_the_same_ship(name):
    first, second = (build_ship(name, np.random.default_rng([7, 2, 1])) for _ in range(2))
    for part in ("coat", "solids", "lights"):
        np.testing.assert_array_equal(getattr(first, part), getattr(second, part))
    assert first.surface == second.surface
    assert first.layout.on_land == (name == "runway") or name == "train"


def test_building_leaves_the_generator_where_it_was():
    rng = np.random.default_rng(3)
    build_ship("train", rng)
    assert rng.random() == np.random.default_rng(3).random()


@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_named_ships_have_a_runway_lamps_and_paint(name):
    ship = build_ship(name, np.random.default_rng(0))
    assert ship.runway
    assert ship.lights.shape[1] == 7
    assert len(ship.coat) > 100
    assert ship.texels_per_m * ship.layout.length_m <= 4096.0


def test_one_random_ship_in_eight_has_no_runway_but_never_a_land_runway():
    ships = [build_ship("train", np.random.default_rng(seed)) for seed in range(150)]
    bare = [ship for ship in ships if not ship.runway]
    assert len(bare) / 150 == pytest.approx(NO_RUNWAY, abs=3 * np.sqrt(NO_RUNWAY / 150))
    assert not any(ship.layout.on_land for ship in bare)


def test_an_unknown_preset_is_named():
    with pytest.raises(ValueError, match=r"ship class must be one of .* got 'raft'"):
        build_ship("raft", np.random.default_rng(0))


CVN = class_layout(load_class("cvn"))
ISLAND = box(30.0, 5.0, 0.0, (12.0, 6.0, 15.0), 0.0, (0.5, 0.5, 0.5))


@pytest.mark.parametrize("seed", range(20))
def test_lamps_are_on_the_ship(seed):
    layout = random_layout(np.random.default_rng(seed))
    lamps = build_lights(layout, seed % 4 > 0, ISLAND, np.random.default_rng(seed))
    low, high = layout.outline_m.min(axis=0), layout.outline_m.max(axis=0)
    assert lamps.dtype == np.float32
    assert lamps.shape[1] == 7
    assert np.all(lamps[:, :2] >= low - [0.1, 5.0])  # the landing aid may stand on an outrigger
    assert np.all(lamps[:, :2] <= high + 0.1)
    assert np.all((lamps[:, 2] > -21.0) & (lamps[:, 2] < layout.deck_height_m))
    assert np.all((lamps[:, 3:6] >= 0.0) & (lamps[:, 3:6] <= 1.0))
    assert np.all(lamps[:, 6] > 0.0)


def lamps_near(lamps, line, strength):
    along, right, length = axes(*line)
    delta = lamps[:, :2] - line[0]
    near = (
        (np.abs(delta @ right) < 1e-3)
        & (delta @ along > 0.01)
        & (delta @ along < length)
        & (lamps[:, 6] == np.float32(strength))
    )
    return np.sort(delta[near] @ along)


def test_runway_lamps_stand_on_their_lines_at_one_pitch():
    lamps = build_lights(CVN, True, ISLAND, np.random.default_rng(1))
    pitches = [
        np.unique(np.round(np.diff(lamps_near(lamps, line, EDGE_STRENGTH)), 2)) for line in (CVN.left_m, CVN.right_m)
    ]
    assert len(pitches[0]) == 1
    np.testing.assert_array_equal(pitches[0], pitches[1])
    assert np.diff(lamps_near(lamps, CVN.centre_m, CENTRE_STRENGTH)).mean() == pytest.approx(
        pitches[0][0] / 2, abs=0.01
    )


def test_drop_line_hangs_below_the_centre_line():
    lamps = build_lights(CVN, True, ISLAND, np.random.default_rng(1))
    drop = lamps[(lamps[:, 2] > 0.0) & (lamps[:, 6] == DROP_STRENGTH)]
    assert len(drop) >= 3
    np.testing.assert_allclose(drop[:, 1], CVN.centre_m[0, 1], atol=1e-5)
    np.testing.assert_allclose(drop[:, 3:6], np.broadcast_to(np.float32(RED), (len(drop), 3)))


def test_a_deck_without_runway_marks_none_with_lamps():
    with_runway, without = (build_lights(CVN, runway, ISLAND, np.random.default_rng(4)) for runway in (True, False))
    assert len(with_runway) > len(without) + 40
    for line in (CVN.left_m, CVN.right_m):
        assert not len(lamps_near(without, line, EDGE_STRENGTH))


def test_lamps_on_land_have_no_stern():
    layout = class_layout(load_class("runway"))
    assert build_lights(layout, True, ISLAND, np.random.default_rng(0))[:, 2].max() <= 0.0


def test_flood_lamps_hang_on_the_islands_near_sides():
    found = []
    for seed in range(20):
        lamps = build_lights(CVN, False, ISLAND, np.random.default_rng(seed))
        floods = lamps[lamps[:, 6] == FLOOD_STRENGTH]
        on_port, astern = np.isclose(floods[:, 1], 2.0 - 0.3), np.isclose(floods[:, 0], 24.0 - 0.3)
        assert np.all(on_port | astern)
        np.testing.assert_allclose(floods[:, 2], -15.0, atol=1e-5)
        found += [len(floods)]
    assert max(found) > 2
    bare = build_lights(CVN, False, join([]), np.random.default_rng(0))
    assert not np.any(bare[:, 6] == FLOOD_STRENGTH)


@pytest.fixture(scope="module")
def runway():
    return class_layout(load_class("runway"))


def test_everything_stands_on_the_ground_away_from_the_strip(runway):
    sizes = []
    for seed in range(30):
        mesh = build_airfield(runway, np.random.default_rng(seed))
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
