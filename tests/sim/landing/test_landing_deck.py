import numpy as np
import pytest

from deckline.geometry import attitude
from deckline_sim.flight.viewpoints import ShipMotion, runway_point, ship_pose, steady_pose, swing
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.deck import Deck, rotation_matrix
from deckline_sim.landing.surroundings import surroundings
from deckline_sim.landing.touchdown import Outcome, Touchdown, outcome_of, strikes_ramp, touch
from deckline_sim.ship.layout import class_layout
from deckline_sim.ship.ship_class import load_class

ROUGH = ShipMotion(12.0, 0.03, 0.02, 1.5, (0.3, 1.0, 2.0))
WIRES_M = (52.0, 64.4, 76.8)


@pytest.fixture(scope="module")
def deck():
    return Deck(class_layout(load_class("cvn")), ROUGH, 70.0, WIRES_M)


@pytest.fixture(scope="module")
def still():
    return Deck(class_layout(load_class("cvn")), ShipMotion(), 70.0, WIRES_M)


def test_an_attitudes_matrix_is_the_simulators():
    np.testing.assert_allclose(rotation_matrix(0.3, -0.2, 1.1), attitude(0.3, -0.2, 1.1).as_matrix(), atol=1e-12)


@pytest.mark.parametrize("time_s", [0.0, 4.0, 61.5])
def test_the_deck_moves_as_the_simulators_ship(deck, time_s):
    turn, place = deck.pose(time_s)
    expected = ship_pose(deck.layout, deck.motion, time_s).as_matrix()
    np.testing.assert_allclose(turn, expected[:3, :3], atol=1e-12)
    np.testing.assert_allclose(place, expected[:3, 3], atol=1e-9)


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_a_ships_periods_scale(factor):
    usual, scaled = (surroundings(LandingConfig(deck_period_factor=f), 3).deck for f in (1.0, factor))
    for time_s in (0.0, 2.5, 7.0):
        (swing_then, rate_then), (now, rate_now) = (
            swing(usual.layout, usual.motion, time_s),
            swing(scaled.layout, scaled.motion, factor * time_s),
        )
        np.testing.assert_allclose(now, swing_then, rtol=1e-9)
        np.testing.assert_allclose(factor * rate_now, rate_then, rtol=1e-9)


def test_the_centre_line_begins_at_the_ramp_and_leads_to_the_touchdown_point(deck):
    moved = deck.layout.at_pose(ship_pose(deck.layout, deck.motion, 7.0))
    expected = [runway_point(moved, 0.0), runway_point(moved, 70.0)]
    np.testing.assert_allclose(deck.centre_line(7.0), expected, atol=1e-9)
    np.testing.assert_allclose(deck.moved_layout(7.0).world_from_ship.as_matrix(), moved.world_from_ship.as_matrix())


def test_the_steady_centre_line_sails_on(deck):
    expected = steady_pose(deck.layout, deck.motion, 10.0).apply([*deck.layout.centre_m[0], 0.0])
    np.testing.assert_allclose(deck.centre_line(10.0, steady=True)[0], expected, atol=1e-9)


def test_the_touchdown_point_rises_as_its_height_changes(deck):
    heights = [-deck.centre_line(5.0 + step)[1, 2] for step in (-0.01, 0.01)]
    assert deck.rise_m_s(5.0) == pytest.approx(np.diff(heights)[0] / 0.02, abs=0.01)
    gained = np.diff([deck.rise_m_s(time_s) for time_s in (4.99, 5.01)])[0] / 0.02
    assert deck.acceleration_m_s2(5.0) == pytest.approx(gained, abs=1e-4)


def test_points_come_into_the_ships_frame_and_back(deck):
    points = np.array([[10.0, 2.0, -1.0], [200.0, -8.0, 3.0]])
    world = ship_pose(deck.layout, deck.motion, 3.0).apply(points)
    np.testing.assert_allclose(deck.in_ship_frame(world, 3.0), points, atol=1e-9)


def _on_runway(deck, along_m, right_m=0.0, below_m=0.0):
    at = deck.layout.centre_m[0] + along_m * deck.along + right_m * deck.right
    return np.array([*at, below_m])


@pytest.mark.parametrize(
    ("along_m", "wire", "outcome"), [(40.0, 1, "wire"), (53.0, 2, "wire"), (70.0, 3, "wire"), (90.0, None, "bolter")]
)
def test_the_hook_takes_the_next_wire(still, along_m, wire, outcome):
    before, now = (_on_runway(still, along_m - step, 1.0, 0.01 - step / 20) for step in (0.5, 0.0))
    contact = touch(before[None], now[None], 1 / 120, 5.0, still)
    assert contact.wire == wire
    assert contact.beyond_aim_m == pytest.approx(along_m - 70.0)
    assert contact.right_m == pytest.approx(1.0)
    assert contact.sink_m_s == pytest.approx(0.025 * 120)
    assert outcome_of(contact, 7.0) == outcome


def test_a_hook_that_is_high_when_the_wheels_touch_takes_no_wire(still):
    before, now = (
        np.stack([_on_runway(still, 60.0, 0.0, -0.5), _on_runway(still, 63.0, 0.0, z)]) for z in (-0.02, 0.01)
    )
    assert touch(before, now, 1 / 120, 5.0, still).wire is None


def test_above_or_beside_the_deck_nothing_touches(still):
    for place in (_on_runway(still, 60.0, 0.0, -0.01), _on_runway(still, 60.0, 80.0, 1.0), np.array([-1.0, 0.0, 1.0])):
        assert touch(place[None], place[None], 1 / 120, 5.0, still) is None


@pytest.mark.parametrize(
    ("before", "now", "struck"),
    [
        ((-0.3, 5.0, 0.2), (0.2, 5.0, 0.25), True),
        ((-0.3, 5.0, -0.3), (0.2, 5.0, -0.25), False),  # over it
        ((-0.8, 5.0, 0.2), (-0.3, 5.0, 0.25), False),  # not there yet
        ((-0.3, 60.0, 0.2), (0.2, 60.0, 0.25), False),  # past the ship
    ],
)
def test_the_ramp_is_struck_below_the_deck(still, before, now, struck):
    assert strikes_ramp(np.array(before), np.array(now), still) is struck


@pytest.mark.parametrize(
    ("beside_m", "below_m", "struck"),
    [
        ((-0.3, 0.2), (5.0, 5.0), True),  # in through the port edge
        ((-0.3, 0.2), (-0.1, 0.1), False),  # from above: a touchdown
        ((-0.8, -0.3), (5.0, 5.0), False),  # not there yet
        ((-0.3, 0.2), (-5.0, -5.0), False),  # over the edge
    ],
)
def test_the_hull_is_struck_from_the_side(still, beside_m, below_m, struck):
    port, _ = still.layout.edges_at(60.0)
    before, now = (np.array([60.0, port + y, z]) for y, z in zip(beside_m, below_m, strict=True))
    assert strikes_ramp(before, now, still) is struck


@pytest.mark.parametrize(
    ("sink", "right", "outcome"), [(7.5, 0.0, Outcome.HARD_LANDING), (3.0, -6.5, Outcome.OFF_CENTRE)]
)
def test_hard_and_off_centre_landings_are_named(sink, right, outcome):
    assert outcome_of(Touchdown(1.0, 0.0, right, sink, 2), 7.3) is outcome
