"""The kinematic vehicle and its commands, on a clock that stands where the test puts it."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline_sim.airsim_server.flight_commands import climb, hold
from deckline_sim.airsim_server.kinematics import GRAVITY_M_S2, NO_TURN, VELOCITY_S, Ground, Yaw, attitude_of
from deckline_sim.airsim_server.path import ARRIVED_M, follow
from deckline_sim.airsim_server.sim_clock import SimClock
from deckline_sim.airsim_server.vehicle import GEAR_M, MAX_ACCELERATION_M_S2, MAX_AIRSPEED_M_S, Vehicle, VehicleCommand

SHIP_M_S, SEA_Z_M, HEAVE_M = 5.0, 20.0, 0.5


def ship_pose(time_s):
    """A deck 200 m long and 40 m wide, under way to the north, heaving."""
    return RigidTransform.from_translation([SHIP_M_S * time_s, 0.0, HEAVE_M * math.sin(time_s)])


def ground(position, time_s):
    x, y, z = ship_pose(time_s).inv().apply(position)
    return Ground("Deck", -z) if 0.0 < x < 200.0 and abs(y) < 20.0 else Ground("Sea", SEA_Z_M - position[2])


class Bench:
    """A vehicle and its time."""

    def __init__(self, place):
        self.time_s = 0.0
        clock = SimClock(lambda: self.time_s, epoch_ns=0)
        self.vehicle = Vehicle(RigidTransform.from_translation(place), clock, ground, ship_pose)

    def run(self, make, most_s=300.0, step_s=0.1):
        """The motions until a command ends, and its result."""
        command, motions = self.vehicle.start(make), []
        while command.result is None and len(motions) < most_s / step_s:
            self.time_s += step_s
            motions.append(self.vehicle.read())
        return command.result, motions

    def fly(self, seconds, step_s=0.1):
        for _ in range(round(seconds / step_s)):
            self.time_s += step_s
            self.vehicle.update()
        return self.vehicle.read()


@pytest.fixture
def bench():
    return Bench([-500.0, 0.0, -30.0])


def by_velocity(velocity, duration_s, yaw=NO_TURN):
    wanted = np.array(velocity)
    return VehicleCommand(lambda body: wanted, lambda body: False, yaw, duration_s, timed=True)


def down(timeout_s=60.0):
    return VehicleCommand(
        lambda body: np.array([0.0, 0.0, 2.0]), lambda body: body.landed, timeout_s=timeout_s, lands=True
    )


def test_velocity_follows_with_the_stated_time_constant(bench):
    assert bench.vehicle.start(lambda body: by_velocity([3.0, 0.0, 0.0], 0.0)).result is True
    bench.vehicle.start(lambda body: by_velocity([1.0, 0.0, 0.0], 10.0))
    for seconds in (VELOCITY_S, 2 * VELOCITY_S):
        moved = bench.fly(seconds - bench.time_s, step_s=0.02)
        assert moved.velocity[0] == pytest.approx(1.0 - math.exp(-seconds / VELOCITY_S), abs=0.02)


def test_a_path_is_flown_at_its_speed_without_overshoot_within_the_limits(bench):
    goal = np.array([300.0, 100.0, -60.0])
    result, motions = bench.run(lambda body: follow(body, [goal], 20.0, 100.0))
    assert result is True
    np.testing.assert_allclose(motions[-1].pose.translation, goal, atol=0.21)
    speeds = [np.linalg.norm(motion.velocity) for motion in motions]
    assert max(speeds) == pytest.approx(20.0, rel=0.01)
    assert all(np.linalg.norm(motion.acceleration) <= MAX_ACCELERATION_M_S2 + 1e-9 for motion in motions)
    along = (goal - [-500.0, 0.0, -30.0]) / np.linalg.norm(goal - [-500.0, 0.0, -30.0])
    ways = np.array([(motion.pose.translation - [-500.0, 0.0, -30.0]) @ along for motion in motions])
    assert np.all(np.diff(ways) > -1e-6)
    settled = bench.fly(10.0)
    np.testing.assert_allclose(settled.pose.translation, goal, atol=0.25)
    assert np.linalg.norm(settled.velocity) < 1e-3


SHARP_PATHS = {  # corners, m north and east of the start
    "triangle": [(0, 10), (10, 10), (0, 0)],
    "back on itself": [(20, 0), (5, 0)],
    "to and fro": [(3, 0), (0, 0)] * 4,
    "zigzag": [(10, 2), (0, 4), (10, 6), (0, 8)],
    "hairpins": [(30, 0), (30, 1), (0, 1), (0, 2), (30, 2)],
    "repeated": [(10, 0), (10, 0), (10, 10), (10, 10), (0, 0), (0, 0)],
    "where it is": [(0, 0), (0, 0)],
    "one": [(7, 0)],
}


@pytest.mark.parametrize("speed", [1.0, 20.0])
@pytest.mark.parametrize("corners", SHARP_PATHS.values(), ids=SHARP_PATHS)
def test_a_path_ends_at_its_last_point_and_reaches_the_corners_that_turn_back(bench, corners, speed):
    start = bench.vehicle.read().pose.translation
    points = start + np.pad(np.array(corners, dtype=float), ((0, 0), (0, 1)))
    legs = np.diff([start, *points], axis=0)
    way_s = np.linalg.norm(legs, axis=1).sum() / speed
    result, motions = bench.run(lambda body: follow(body, list(points), speed, math.inf), way_s + 6.0 * len(corners))
    assert result is True
    flown = np.array([motion.pose.translation for motion in motions])
    assert np.linalg.norm(flown[-1] - points[-1]) <= ARRIVED_M
    for before, after, corner in zip(legs, legs[1:], points, strict=False):
        if before @ after < -0.2 * np.linalg.norm(before) * np.linalg.norm(after):
            assert np.linalg.norm(flown - corner, axis=1).min() <= 1.5 * ARRIVED_M  # read every 0.1 s


@pytest.mark.parametrize("lookahead_m", [0.05, 50.0])
def test_a_path_ends_in_wind_whatever_its_lookahead(bench, lookahead_m):
    start = bench.vehicle.read().pose.translation
    points = [start + offset for offset in ([0.0, 40.0, 0.0], [40.0, 40.0, -5.0], [0.0, 1.0, 0.0])]
    bench.vehicle.set_wind(np.array([15.0, -15.0, 0.0]))
    result, motions = bench.run(lambda body: follow(body, points, 5.0, math.inf, NO_TURN, lookahead_m), 60.0)
    assert result is True and np.linalg.norm(motions[-1].pose.translation - points[-1]) <= ARRIVED_M


def test_a_slow_path_is_flown_at_its_speed(bench):
    goal = np.array([-490.0, 0.0, -30.0])
    _, motions = bench.run(lambda body: follow(body, [goal], 0.5, math.inf))
    assert np.linalg.norm(motions[50].velocity) == pytest.approx(0.5, rel=0.01)


def test_a_new_command_a_cancel_and_a_pose_end_the_old_one_as_failed(bench):
    first = bench.vehicle.start(lambda body: by_velocity([1.0, 0.0, 0.0], 10.0))
    second = bench.vehicle.start(lambda body: by_velocity([0.0, 1.0, 0.0], 10.0))
    assert first.result is False and second.result is None
    bench.fly(5.0)
    bench.vehicle.cancel()
    assert second.result is False
    assert np.linalg.norm(bench.fly(5.0).velocity) < 0.01
    third = bench.vehicle.start(lambda body: by_velocity([0.0, 1.0, 0.0], 10.0))
    put = RigidTransform.from_components([1.0, 2.0, -50.0], attitude_of(1.0, np.array([2.0, 1.0])))
    bench.vehicle.place(put)
    assert third.result is False
    np.testing.assert_array_equal(bench.fly(20.0).pose.as_matrix(), put.as_matrix())


def test_yaw_turns_to_an_angle_and_by_a_rate(bench):
    place = bench.vehicle.read().pose.translation
    bench.run(lambda body: VehicleCommand(hold(body), lambda body: False, Yaw(False, 2.0), 6.0, timed=True))
    assert bench.vehicle.yaw == pytest.approx(2.0, abs=0.01)
    before = bench.vehicle.yaw
    bench.run(lambda body: VehicleCommand(hold(body), lambda body: False, Yaw(True, -0.3), 5.0, timed=True))
    assert bench.vehicle.yaw - before == pytest.approx(-1.5, abs=0.1)
    np.testing.assert_allclose(bench.vehicle.read().pose.translation, place, atol=1e-6)


def test_lands_on_the_moving_deck_rides_along_and_lifts_off():
    bench = Bench([100.0, 0.0, -10.0])
    result, motions = bench.run(lambda body: down())
    assert result is True and motions[-1].landed
    contact = bench.vehicle.take_collision()
    assert contact.name == "Deck" and bench.vehicle.take_collision() is None
    np.testing.assert_allclose(contact.normal, [0.0, 0.0, -1.0])
    on_deck = ship_pose(bench.time_s).inv().apply(motions[-1].pose.translation)
    assert on_deck[2] == pytest.approx(-GEAR_M)
    riding = bench.fly(7.3)
    np.testing.assert_allclose(ship_pose(bench.time_s).inv().apply(riding.pose.translation), on_deck, atol=1e-9)
    np.testing.assert_allclose(riding.velocity, [SHIP_M_S, 0.0, HEAVE_M * math.cos(bench.time_s)], atol=1e-3)
    result, motions = bench.run(lambda body: climb(body, 20.0))
    assert result is True and not motions[-1].landed
    assert abs(motions[0].velocity[0] - SHIP_M_S) < 1.0  # it leaves with the deck's speed


def test_ditches_and_strikes_the_hull(bench):
    result, _ = bench.run(lambda body: down())
    assert result is True and bench.vehicle.take_collision().name == "Sea"
    assert bench.vehicle.read().pose.translation[2] == pytest.approx(SEA_Z_M - GEAR_M)
    low = Bench([-50.0, 0.0, 8.0])
    result, motions = low.run(lambda body: follow(body, [np.array([100.0, 0.0, 8.0])], 20.0, 60.0))
    assert result is False and low.vehicle.take_collision().name == "Carrier"
    assert np.linalg.norm(motions[-1].velocity) == 0.0


def test_wind_leans_the_body_and_carries_it_off_when_it_is_too_strong(bench):
    bench.run(lambda body: by_velocity([0.0, 0.0, 0.0], 0.5))
    place = bench.vehicle.read().pose.translation
    bench.vehicle.set_wind(np.array([0.0, 20.0, 0.0]))
    held = bench.fly(10.0)
    np.testing.assert_allclose(held.pose.translation, place, atol=0.01)
    down_axis = held.pose.rotation.apply([0.0, 0.0, 1.0])
    assert math.atan2(down_axis[1], down_axis[2]) == pytest.approx(math.atan(0.02 * 20.0 / GRAVITY_M_S2), rel=0.01)
    bench.vehicle.set_wind(np.array([0.0, MAX_AIRSPEED_M_S + 10.0, 0.0]))
    assert bench.fly(20.0).velocity[1] > 5.0


def test_what_nobody_looks_at_for_long_costs_little(bench):
    bench.vehicle.start(lambda body: by_velocity([50.0, 0.0, 0.0], 1e9))
    bench.time_s = 1e7
    assert np.abs(bench.vehicle.read().pose.translation).max() < 1e4
