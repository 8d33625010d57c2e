import numpy as np
import pytest

from deckline_sim.ship import clutter as cl
from deckline_sim.ship.layout import edge_distance, runway_distance
from deckline_sim.ship.mesh import join, rectangle
from deckline_sim.ship.structure import random_islands


def test_a_lot_gives_a_place_once(cvn):
    lot = cl.DeckOccupancy(cvn, True)
    at = ((150.0, 28.0), (151.0, 28.0), (170.0, 28.0), cvn.centre_m.mean(axis=0), (150.0, 60.0))
    assert [lot.reserve(rectangle(*middle, 6.0, 3.0)) for middle in at] == [True, False, True, False, False]


@pytest.mark.parametrize("runway", [True, False])
def test_what_is_parked_stands_on_the_deck_and_off_the_runway(runway, afloat):
    built = 0
    for layout, rng in afloat(38):
        islands = random_islands(layout, runway, rng)
        lot = cl.DeckOccupancy(layout, runway)
        aircraft = cl.park_aircraft(lot, islands, 1.0, rng)
        gear = [*cl.park_vehicles(lot, islands, 1.0, rng), *cl.place_crew(lot, rng), *cl.build_deflectors(lot, rng)]
        for mesh, over in ((aircraft, 2.5), (join(gear), 0.0)):
            if len(mesh):
                built += 1
                points = mesh[:, :2].astype(float)
                assert edge_distance(layout, points).min() > -over - 1e-3
                assert mesh[:, 2].max() < 0.2  # on the deck, wheels aside
                assert not runway or runway_distance(layout, points).min() > 3.5 - 1e-3
    assert built > 40


@pytest.mark.parametrize("kind", cl.load_aircraft()["kinds"])
def test_prototypes_stand_on_their_wheels_and_are_about_one_long(kind):
    mesh = cl.prototype(kind)
    assert mesh[:, 2].max() == pytest.approx(0.0, abs=0.02)
    assert 0.15 < -mesh[:, 2].min() < 0.6
    assert 0.9 < np.ptp(mesh[:, 0]) < 1.2
    assert len(mesh) < 3 * 600
    np.testing.assert_allclose(np.linalg.norm(mesh[:, 3:6], axis=1), 1.0, atol=1e-4)
    assert np.all(np.abs(mesh[:, :2]).max(axis=0) <= np.array(cl.extents(kind)) / 2 + 1e-6)
    if not kind.startswith("helicopter"):
        assert mesh[:, 1].max() == pytest.approx(-mesh[:, 1].min(), abs=0.05)
