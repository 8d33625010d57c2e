import numpy as np
import pytest

from deckline_sim.ship import ship as sp
from deckline_sim.ship.layout import class_layout, random_layout, runway_distance
from deckline_sim.ship.mesh import boxes, join
from deckline_sim.ship.paint_shapes import axes
from deckline_sim.ship.ship_class import SHIP_CLASSES, load_class

ISLAND = boxes((30.0, 5.0, 0.0), (12.0, 6.0, 15.0), (0.5, 0.5, 0.5))


@pytest.fixture(scope="module")
def runway():
    return class_layout(load_class("runway"))


@pytest.mark.parametrize("name", [*SHIP_CLASSES, "train"])
def test_the_same_seed_builds_the_same_ship(name):
    first, second = (sp.build_ship(name, np.random.default_rng([7, 2, 1])) for _ in range(2))
    for part in ("coat", "solids", "lights"):
        np.testing.assert_array_equal(getattr(first, part), getattr(second, part))
    assert first.surface == second.surface
    assert len(first.coat) > 100 and first.lights.shape[1] == 7
    assert first.texels_per_m * first.layout.length_m <= 4096.0
    if name != "train":
        assert first.runway
        assert first.layout.on_land == (first.stern_half_m == 0.0) == (name == "runway")


def test_building_leaves_the_generator_where_it_was():
    rng = np.random.default_rng(3)
    sp.build_ship("train", rng)
    assert rng.random() == np.random.default_rng(3).random()


@pytest.mark.parametrize("seed", range(20))
def test_lamps_are_on_the_ship(seed):
    layout = random_layout(np.random.default_rng(seed))
    lamps = sp.build_lights(layout, seed % 4 > 0, ISLAND, np.random.default_rng(seed))
    low, high = layout.outline_m.min(axis=0), layout.outline_m.max(axis=0)
    assert lamps.dtype == np.float32 and lamps.shape[1] == 7
    assert np.all(lamps[:, :2] >= low - [0.1, 5.0])  # the landing aid may stand on an outrigger
    assert np.all(lamps[:, :2] <= high + 0.1)
    assert np.all((lamps[:, 2] > -21.0) & (lamps[:, 2] < layout.deck_height_m))
    assert np.all((lamps[:, 3:6] >= 0.0) & (lamps[:, 3:6] <= 1.0))
    assert np.all(lamps[:, 6] > 0.0)


def lamps_on(lamps, line, strength):
    """Where the lamps of a strength stand along a line, from its start."""
    along, right, length = axes(*line)
    delta = lamps[lamps[:, 6] == np.float32(strength), :2] - line[0]
    reach = (delta @ along)[np.abs(delta @ right) < 1e-3]
    return np.sort(reach[(reach > 0.01) & (reach < length)])


def test_runway_lamps_stand_on_their_lines_at_one_pitch(cvn):
    lamps = sp.build_lights(cvn, True, ISLAND, np.random.default_rng(1))
    left, right = (np.diff(lamps_on(lamps, line, sp.EDGE_STRENGTH)) for line in (cvn.left_m, cvn.right_m))
    pitch = np.unique(np.round(np.concatenate([left, right]), 2))
    assert len(pitch) == 1
    assert np.diff(lamps_on(lamps, cvn.centre_m, sp.CENTRE_STRENGTH)).mean() == pytest.approx(pitch[0] / 2, abs=0.01)
    drop = lamps[(lamps[:, 2] > 0.0) & (lamps[:, 6] == sp.DROP_STRENGTH)]  # hangs below the centre line
    assert len(drop) >= 3
    np.testing.assert_allclose(drop[:, 1], cvn.centre_m[0, 1], atol=1e-5)
    np.testing.assert_allclose(drop[:, 3:6], np.broadcast_to(np.float32(sp.RED), (len(drop), 3)))


def test_a_deck_without_runway_marks_none_with_lamps(cvn):
    marked, bare = (sp.build_lights(cvn, runway, ISLAND, np.random.default_rng(4)) for runway in (True, False))
    assert len(marked) > len(bare) + 40
    assert not any(len(lamps_on(bare, line, sp.EDGE_STRENGTH)) for line in (cvn.left_m, cvn.right_m))


def test_flood_lamps_hang_on_the_islands_near_sides(cvn):
    counts = []
    for seed in range(20):
        lamps = sp.build_lights(cvn, False, ISLAND, np.random.default_rng(seed))
        floods = lamps[lamps[:, 6] == sp.FLOOD_STRENGTH]
        assert np.all(np.isclose(floods[:, 1], 2.0 - 0.3) | np.isclose(floods[:, 0], 24.0 - 0.3))  # port, astern
        np.testing.assert_allclose(floods[:, 2], -15.0, atol=1e-5)
        counts.append(len(floods))
    assert max(counts) > 2
    assert not np.any(sp.build_lights(cvn, False, join([]), np.random.default_rng(0))[:, 6] == sp.FLOOD_STRENGTH)


def test_everything_beside_a_land_runway_stands_on_the_ground_away_from_the_strip(runway):
    sizes = []
    for seed in range(30):
        mesh = sp.build_airfield(runway, np.random.default_rng(seed))
        sizes.append(len(mesh))
        if len(mesh):
            assert runway_distance(runway, mesh[:, :2].astype(float)).min() > 0.5 * sp.CLEAR_OF_STRIP_M
            assert mesh[:, 2].max() == pytest.approx(runway.deck_height_m, abs=0.5)
            assert mesh[:, 6:].min() >= 0.0 and mesh[:, 6:].max() <= 1.0
    assert max(sizes) < 3 * 30_000
    assert np.mean(np.array(sizes) > 0) > 0.8
