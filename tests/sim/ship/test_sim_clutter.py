import numpy as np
import pytest
from mesh_volume import volume

from deckline.sim.ship.clutter import (
    KINDS,
    Lot,
    build_clutter,
    build_deflectors,
    extents,
    park_aircraft,
    park_vehicles,
    place_crew,
    prototype,
    row_spots,
)
from deckline.sim.ship.layout import class_layout, edge_distance, random_layout, runway_distance
from deckline.sim.ship.mesh import rectangle
from deckline.sim.ship.ship_class import load_class
from deckline.sim.ship.structure import random_islands


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
            (park_aircraft(lot, islands, 1.0, rng), 2.5),
            (park_vehicles(lot, islands, 1.0, rng), 0.0),
            (place_crew(lot, rng), 0.0),
            (build_deflectors(lot, rng), 0.0),
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
        len(build_clutter(cvn, True, load_class("cvn").islands, np.random.default_rng(seed))) for seed in range(40)
    ]
    assert min(counts) < 3 * 800
    assert max(counts) > 3 * 4000


@pytest.mark.parametrize("kind", KINDS)
def test_prototypes_stand_on_their_wheels_and_are_about_one_long(kind):
    mesh = prototype(kind)
    assert mesh[:, 2].max() == pytest.approx(0.0, abs=0.02)
    assert 0.15 < -mesh[:, 2].min() < 0.6
    assert 0.9 < np.ptp(mesh[:, 0]) < 1.2
    assert len(mesh) < 3 * 600
    np.testing.assert_allclose(np.linalg.norm(mesh[:, 3:6], axis=1), 1.0, atol=1e-4)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.startswith("helicopter")])
def test_prototypes_are_symmetric_in_extent(kind):
    y = prototype(kind)[:, 1]
    assert y.max() == pytest.approx(-y.min(), abs=0.05)


@pytest.mark.parametrize("kind", ["propeller", "helicopter"])
def test_folded_ones_are_narrower(kind):
    assert extents(f"{kind} folded")[1] < 0.75 * extents(kind)[1]
    assert extents("folded")[1] < extents("swept")[1]


def test_extents_bound_the_prototype():
    for kind in KINDS:
        along, across = extents(kind)
        assert np.abs(prototype(kind)[:, 0]).max() <= along / 2 + 1e-6
        assert np.abs(prototype(kind)[:, 1]).max() <= across / 2 + 1e-6


def test_a_fuselage_of_equal_sections_has_the_volume_of_a_prism():
    mesh = build_body([0.0, 2.0], [0.5, 0.5], [0.0, 0.0])
    assert volume(mesh) == pytest.approx(2.0 * 1.5 * np.sqrt(3) * 0.25, rel=1e-5)


def test_an_unknown_kind_is_named():
    with pytest.raises(ValueError, match=r"an aircraft's kind must be one of .*, got 'balloon'"):
        prototype("balloon")
