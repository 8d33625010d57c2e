import numpy as np
import pytest

from deckline.sim.ship.clearance import edge_distance, runway_distance
from deckline.sim.ship.clutter import (
    Lot,
    aircraft_mesh,
    clutter_mesh,
    deflectors_mesh,
    people_mesh,
    row_spots,
    vehicles_mesh,
)
from deckline.sim.ship.island import random_islands
from deckline.sim.ship.layout import class_layout, random_layout
from deckline.sim.ship.mesh import rectangle
from deckline.sim.ship.ship_class import load_class


@pytest.fixture(scope="module")
def cvn():
    return class_layout(load_class("cvn"))


def test_a_lot_takes_a_place_once(cvn):
    lot = Lot(cvn, True)
    assert lot.take(rectangle(150.0, 28.0, 6.0, 3.0))
    assert not lot.take(rectangle(151.0, 28.0, 6.0, 3.0))
    assert lot.take(rectangle(170.0, 28.0, 6.0, 3.0))
    assert not lot.take(rectangle(*cvn.centre_m.mean(axis=0), 6.0, 3.0))
    assert not lot.take(rectangle(150.0, 60.0, 6.0, 3.0))


@pytest.mark.parametrize("runway", [True, False])
def test_what_is_parked_stands_on_the_deck_and_off_the_runway(runway):
    built = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        layout = random_layout(rng)
        if layout.on_land:
            continue
        islands = random_islands(layout, runway, rng)
        lot = Lot(layout, runway)
        for mesh, over in (
            (aircraft_mesh(lot, islands, 1.0, rng), 2.5),
            (vehicles_mesh(lot, islands, 1.0, rng), 0.0),
            (people_mesh(lot, rng), 0.0),
            (deflectors_mesh(lot, rng), 0.0),
        ):
            if len(mesh):
                built += 1
                points = mesh[:, :2].astype(float)
                assert edge_distance(layout, points).min() > -over - 1e-3
                assert mesh[:, 2].max() < 0.2  # on the deck, wheels aside
                if runway:
                    assert runway_distance(layout, points).min() > 3.5 - 1e-3
    assert built > 40


def test_rows_follow_the_edge(cvn):
    spots = np.array(row_spots(cvn, 1.0, np.random.default_rng(0)))
    inside = edge_distance(cvn, spots[:, :2])
    assert np.all((inside > 0.0) & (inside < 10.0)) or spots[:, 0].max() > cvn.length_m - 10.0
    assert np.all(np.sin(spots[:, 2]) < 0.5)  # noses not over the starboard edge


def test_some_decks_are_empty_and_some_full(cvn):
    counts = [
        len(clutter_mesh(cvn, True, load_class("cvn").islands, np.random.default_rng(seed))) for seed in range(40)
    ]
    assert min(counts) < 3 * 800
    assert max(counts) > 3 * 4000
