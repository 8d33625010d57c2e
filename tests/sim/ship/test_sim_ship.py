import numpy as np
import pytest

from deckline.sim.ship.ship import NO_RUNWAY, build_ship
from deckline.sim.ship.ship_class import SHIP_CLASSES


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
