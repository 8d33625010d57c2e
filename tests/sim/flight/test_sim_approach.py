"""Approaches and the profile: paths, winds, deviations."""

from dataclasses import replace

import numpy as np
import pytest
from deck_frame import CVN, PAPER_SHIP, over_deck, positions

from deckline.geometry import camera_mount
from deckline_sim.config import FLIGHTS, FlightConfig, SimConfig
from deckline_sim.flight.approach import (
    approach_view,
    closing_speed,
    draw_flight,
    flight_path,
    gust,
    profile_height,
    remaining_offset,
)
from deckline_sim.flight.viewpoints import ShipMotion, runway_in_view, ship_pose
from deckline_sim.ship.paint_shapes import axes

PAPER = SimConfig(preset="paper", frames=50)
PROFILE = replace(PAPER, trajectory="profile")
UNDER_WAY = ShipMotion(speed_m_s=12.9, roll_rad=0.03, pitch_rad=0.02, heave_m=1.6)
WINDY = FlightConfig(headwind_m_s=8.0, crosswind_m_s=6.0)


def sailed(layout, time_s, motion=UNDER_WAY):
    """The ship after a time, by its heading's compass angle."""
    yaw = layout.world_from_ship.rotation.as_euler("ZYX")[0]
    shift = motion.speed_m_s * time_s * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    moved = np.array(layout.world_from_ship.translation) + shift
    return layout.at_pose(type(layout.world_from_ship).from_components(moved, layout.world_from_ship.rotation))


def test_approach_follows_the_glideslope_in_equal_times():
    views = [approach_view(PAPER, PAPER_SHIP, k) for k in range(50)]
    ranges, lateral, height = over_deck(PAPER_SHIP, views)
    np.testing.assert_allclose(ranges, np.linspace(800.0, 12.0, 50), atol=1e-6)
    np.testing.assert_allclose(np.diff([view.time_s for view in views]), 788.0 / 49 / 65.0)
    assert np.abs(height - (ranges + 70.0) * np.tan(np.deg2rad(3.5))).max() < 8.0
    assert np.abs(lateral).max() < 24.0
    assert height.min() >= 3.05 - 1e-9
    assert min(runway_in_view(view, PAPER_SHIP) for view in views[:40]) == 1.0


def test_an_approach_to_a_moving_ship_keeps_the_glideslope_over_its_steady_deck():
    config = replace(PAPER, preset="cvn", frames=20)
    for k in range(20):
        still = approach_view(config, CVN, k)
        view = approach_view(config, CVN, k, UNDER_WAY)
        ranges, _, height = over_deck(sailed(CVN, view.time_s), [view])
        still_ranges, _, _ = over_deck(CVN, [still])
        np.testing.assert_allclose(ranges, still_ranges, atol=1e-6)
        assert abs(height[0] - (ranges[0] + 70.0) * np.tan(np.deg2rad(3.5))) < 8.0


def test_no_approach_meets_a_ramp_that_rises():
    motion = replace(UNDER_WAY, pitch_rad=0.03, heave_m=3.0)
    config = replace(PAPER, preset="cvn", frames=60)
    close = []
    for k in range(60):
        view = approach_view(config, CVN, k, motion)
        ramp = ship_pose(CVN, motion, view.time_s).apply([*CVN.centre_m[0], 0.0])
        close.append(ramp[2] - view.world_from_body.translation[2])
    assert min(close) >= 3.05 - 1e-9


@pytest.mark.parametrize("motion", [ShipMotion(), UNDER_WAY], ids=["still", "under way"])
def test_the_aircraft_keeps_its_speed_through_the_air(motion):
    config = SimConfig(preset="cvn", frames=400, flight=WINDY)
    path = flight_path(config, CVN, motion)
    along = np.array([np.cos(np.deg2rad(8.49)), -np.sin(np.deg2rad(8.49))])  # the class's deck, heading north
    wind = -8.0 * along - 6.0 * np.array([-along[1], along[0]])
    velocity = np.array([motion.speed_m_s, 0.0]) + path.closing_m_s * along
    assert np.linalg.norm(velocity - wind) == pytest.approx(65.0)
    views = [approach_view(config, CVN, k, motion) for k in range(0, 400, 10)]
    nose = np.mean([view.world_from_body.rotation.apply([1.0, 0.0, 0.0]) for view in views], axis=0)
    through_air = velocity - wind
    turned = np.arctan2(nose[1], nose[0]) - np.arctan2(through_air[1], through_air[0])
    assert abs(np.rad2deg(turned)) < 1.0  # no sideslip on average; the nose shakes by half a degree


def test_velocity_and_angular_rate_are_those_of_the_poses():
    flight = FlightConfig(turbulence_m_s=1.5, crosswind_m_s=5.0)
    for trajectory in FLIGHTS:
        config = SimConfig(preset="cvn", frames=100001, flight=flight, trajectory=trajectory)
        for index in (0, 50000, 99990):
            before, now, after = (approach_view(config, CVN, index + k, UNDER_WAY) for k in (-1, 0, 1))
            step = after.time_s - before.time_s
            moved = positions([after])[0] - positions([before])[0]
            np.testing.assert_allclose(now.velocity_m_s, moved / step, atol=2e-2)
            forward = np.array([0.0, 0.0, 1.0])
            sight = [view.world_from_camera.rotation.apply(forward) for view in (before, now, after)]
            rate = now.world_from_body.rotation.apply(now.angular_rate_rad_s)
            np.testing.assert_allclose(np.cross(rate, sight[1]), (sight[2] - sight[0]) / step, atol=2e-3)


def test_offsets_are_closed_on_the_way():
    layout, config = CVN, SimConfig(preset="cvn", frames=41)
    flight = FlightConfig(lateral_offset_m=60.0, vertical_offset_m=-9.0)
    configs = config, replace(config, flight=flight)
    plain, offset = ([approach_view(each, layout, k) for k in range(41)] for each in configs)
    _, lateral, height = np.array(over_deck(layout, offset)) - over_deck(layout, plain)
    assert (lateral[0], height[0]) == (pytest.approx(60.0), pytest.approx(-9.0))
    np.testing.assert_allclose(lateral[29:], 0.0, atol=1e-9)
    assert (np.diff(lateral) < 1e-9).all()
    left = np.array([remaining_offset(phase) for phase in np.linspace(0.0, 1.0, 1001)])
    assert np.abs(np.diff(left, 2)).max() * 1000**2 < 5.78 / 0.7**2  # a quintic's largest curvature
    assert left[350] == pytest.approx(0.5)


def test_profile_passes_the_papers_points():
    layout, config = PAPER_SHIP, replace(PROFILE, frames=80)
    views = [approach_view(config, layout, k) for k in range(80)]
    ranges, lateral, height = over_deck(layout, views)
    assert ranges[0] == pytest.approx(5000.0)
    assert ranges[-1] == pytest.approx(12.0)
    assert np.abs(lateral).max() < 24.0
    assert profile_height()(np.array([4000.0, 800.0, -70.0])) == pytest.approx([300.0, 60.0, 0.0])
    assert abs(np.interp(-800.0, -ranges, height) - 60.0) < 2.5  # flown about the path
    assert (np.diff(profile_height()(ranges)) < 0).all()
    speed = np.linalg.norm(np.diff(positions(views), axis=0), axis=1) / np.diff([view.time_s for view in views])
    np.testing.assert_allclose(speed, 65.0, rtol=0.02)
    offset = replace(config, frames=600, flight=FlightConfig(lateral_offset_m=100.0))
    step_s = 2 * 4988.0 / 65.0 / 599
    for first in (100, 480):  # about the points at 4000 and 800 m
        velocity = np.array([approach_view(offset, layout, k).velocity_m_s for k in range(first, first + 50, 2)])
        assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() / step_s < 0.5 * 9.81  # no kinks


def test_a_landing_comes_from_the_holding_track_with_most_frames_near_the_deck():
    layout, config = PAPER_SHIP, replace(PROFILE, trajectory="landing", frames=40)
    ranges, _, height = over_deck(layout, [approach_view(config, layout, k) for k in range(40)])
    np.testing.assert_allclose(ranges[1:] / ranges[:-1], (12.0 / 10000.0) ** (1 / 39), rtol=1e-6)
    np.testing.assert_allclose(height[ranges > 5000], 400.0, atol=5.0)  # flown about the path
    assert abs(np.interp(-800.0, -ranges, height) - 60.0) < 4.0


def test_a_flight_that_ends_before_it_begins_is_refused():
    config = SimConfig(trajectory="profile", start_m=9000.0, end_m=6000.0)
    with pytest.raises(ValueError, match=r"profile .*5000 .*end_m 6000"):
        approach_view(config, PAPER_SHIP, 0)


def test_the_profiles_camera_points_at_the_touchdown_point_with_a_level_horizon():
    layout, config = PAPER_SHIP, replace(PROFILE, frames=12, flight=WINDY)
    along, _, _ = axes(*layout.centre_m)
    spot = layout.world_from_ship.apply([*(layout.centre_m[0] + 70.0 * along), 0.0])
    for k in range(12):
        view = approach_view(config, layout, k)
        u, v = view.camera.project(view.world_from_camera.inv().apply(spot[None]))[0]
        np.testing.assert_allclose([u, v], [639.5, 359.5], atol=1e-6)
        assert abs(view.world_from_camera.rotation.apply([1.0, 0.0, 0.0])[2]) < 1e-12
        through_air = view.velocity_m_s[:2] - path_wind(layout)
        nose = view.world_from_body.rotation.apply([1.0, 0.0, 0.0])[:2]
        assert abs(np.cross(np.append(nose, 0.0), np.append(through_air, 0.0))[2]) / np.linalg.norm(through_air) < 0.05


def path_wind(layout):
    ends = layout.world_from_ship.apply(np.column_stack([layout.centre_m, np.zeros(2)]))
    along = (ends[1] - ends[0])[:2] / np.linalg.norm(ends[1] - ends[0])
    return -8.0 * along - 6.0 * np.array([-along[1], along[0]])


def test_an_approach_looks_along_the_aircraft_by_default():
    configs = [replace(PAPER, preset="cvn", flight=FlightConfig(pointing=p)) for p in (None, "runway")]
    fixed, pointed = (approach_view(config, CVN, 20) for config in configs)
    np.testing.assert_allclose(fixed.body_from_camera.as_matrix(), camera_mount().as_matrix())
    assert np.abs(pointed.body_from_camera.as_matrix() - camera_mount().as_matrix()).max() > 1e-3


ALONG, ACROSS = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
STILL_AIR = np.zeros(2)


def test_too_much_wind_is_named():
    with pytest.raises(ValueError, match=r"20 m/s .*30\.0 m/s"):
        closing_speed(ALONG, STILL_AIR, -30.0 * ALONG, 20.0)
    with pytest.raises(ValueError, match=r"20 m/s .*30\.0 m/s"):
        closing_speed(ALONG, STILL_AIR, 30.0 * ACROSS, 20.0)


def test_gusts_have_the_sigma_asked_for_and_move_the_aircraft_as_its_pilot_lets_them():
    times = np.linspace(0.0, 1000.0, 5001)
    both = np.array([gust(t, 1.5, 65.0, np.random.default_rng(2)) for t in times])
    velocity, moved = both.T
    assert np.std(velocity) == pytest.approx(1.5, rel=0.05)
    rate = np.gradient(moved, times)
    np.testing.assert_allclose(rate[1:-1], (velocity - 0.5 * moved)[1:-1], atol=0.2)
    assert np.std(moved) < 1.5 / 0.5


def test_gusts_follow_drydens_spectrum():
    times = np.arange(0.0, 8000.0, 0.8)
    velocity = np.array([gust(t, 1.0, 65.0, np.random.default_rng(5))[0] for t in times])
    power = np.abs(np.fft.rfft(velocity)) ** 2
    frequency = np.fft.rfftfreq(len(times), 0.8)

    def share(low, high):
        return power[(frequency >= low) & (frequency < high)].sum()

    def dryden(low, high):  # integral of 1 / (1 + (L w / V)^2)
        return np.diff(np.arctan(200.0 / 65.0 * 2 * np.pi * np.array([low, high])))[0]

    edges = np.geomspace(0.02, 0.6, 25)
    low, high = edges[12], edges[24]
    assert share(low, high) / share(0.01, 0.7) == pytest.approx(dryden(low, high) / dryden(0.02, 0.6), rel=0.05)


def test_named_presets_fly_in_still_air_by_default():
    rng = np.random.default_rng
    still = draw_flight(FlightConfig(), False, rng(1))
    assert (still.headwind_m_s, still.crosswind_m_s, still.lateral_offset_m, still.turbulence_m_s) == (0, 0, 0, 0)
    given = draw_flight(FlightConfig(crosswind_m_s=-3.0), True, rng(1))
    assert given.crosswind_m_s == -3.0
    assert given.turbulence_m_s > 0
    assert given.headwind_m_s == draw_flight(FlightConfig(), True, rng(1)).headwind_m_s
