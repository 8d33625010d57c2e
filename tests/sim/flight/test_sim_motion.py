from dataclasses import replace

import numpy as np
import pytest

from deckline.sim.config import MotionConfig
from deckline.sim.flight.motion import (
    STILL,
    deck_amplitudes,
    deck_rise,
    draw_motion,
    middle_m,
    ship_pose,
    ship_velocity,
    steady_pose,
)
from deckline.sim.ship.layout import class_layout
from deckline.sim.ship.ship_class import load_class

CVN = class_layout(load_class("cvn"))
PAPER_SHIP = class_layout(load_class("paper"))
ROUGH = draw_motion(MotionConfig(sea_state=6, ship_speed_m_s=12.9), False, np.random.default_rng(3))
LAYOUTS = [PAPER_SHIP, CVN]


def relative_angles_deg(layout, motion, times_s):
    """Roll and pitch (N, 2) of the ship against its steady pose, read off the deck's axes in the world."""
    angles = []
    for time_s in times_s:
        axes = steady_pose(layout, motion, time_s).rotation.inv() * ship_pose(layout, motion, time_s).rotation
        forward, starboard = axes.apply([1.0, 0.0, 0.0]), axes.apply([0.0, 1.0, 0.0])
        level = np.cross([0.0, 0.0, 1.0], forward / np.hypot(forward[0], forward[1]))
        across = np.cross(forward, level)
        angles.append([np.arctan2(starboard @ across, starboard @ level), -np.arcsin(forward[2])])
    return np.rad2deg(angles)


@pytest.mark.parametrize(("state", "roll", "pitch", "heave"), [(4, 0.62, 0.52, 0.68), (6, 1.44, 1.24, 1.63)])
def test_sea_states_swing_as_far_as_stated(state, roll, pitch, heave):
    motion = draw_motion(MotionConfig(sea_state=state), False, np.random.default_rng(0))
    layout, times = CVN, np.linspace(0.0, 22.0 * 12.0 * 18.0, 701)
    angles = relative_angles_deg(layout, motion, times)
    np.testing.assert_allclose(np.abs(angles).max(axis=0), [roll, pitch], rtol=2e-3)
    np.testing.assert_allclose(np.abs(angles).max(axis=0), -angles.min(axis=0), rtol=2e-3)
    middle = np.array([ship_pose(layout, motion, t).apply(middle_m(layout))[2] for t in times])
    np.testing.assert_allclose([middle.max(), -middle.min()], heave, rtol=2e-3)


@pytest.mark.parametrize(("period_s", "column"), [(22.0, 0), (12.0, 1)])
def test_deck_angles_repeat_after_their_period(period_s, column):
    times = np.array([0.0, 3.0, 7.5])
    now, half, whole = (
        relative_angles_deg(CVN, ROUGH, times + shift)[:, column] for shift in (0, period_s / 2, period_s)
    )
    np.testing.assert_allclose(whole, now, atol=1e-9)
    np.testing.assert_allclose(half, -now, atol=1e-9)
    assert np.abs(now).max() > 0.1


def test_heave_takes_18_seconds_and_nothing_else_moves_the_middle():
    layout = CVN
    at = [ship_pose(layout, ROUGH, t).apply(middle_m(layout)) for t in (2.0, 11.0, 20.0)]
    np.testing.assert_allclose(at[0][2], -at[1][2], atol=1e-9)
    np.testing.assert_allclose(at[0][2], at[2][2], atol=1e-9)
    np.testing.assert_allclose(at[2][:2] - at[0][:2], [18 * 12.9, 0.0], atol=1e-9)


def test_a_still_ship_stays_where_it_is_and_keeps_its_waterline():
    for layout in LAYOUTS:
        np.testing.assert_allclose(
            ship_pose(layout, STILL, 123.0).as_matrix(), layout.world_from_ship.as_matrix(), atol=1e-12
        )
        assert layout.world_from_ship.apply(middle_m(layout))[2] == pytest.approx(layout.sea_z_m)


@pytest.mark.parametrize("layout", LAYOUTS, ids=["paper", "cvn"])
def test_velocity_is_the_derivative_of_the_pose(layout):
    for time_s in (0.0, 4.3, 17.0):
        for point in ([0.0, 0.0, 0.0], [300.0, -20.0, -5.0], middle_m(layout)):
            after, before = (ship_pose(layout, ROUGH, time_s + step).apply(point) for step in (1e-3, -1e-3))
            np.testing.assert_allclose(ship_velocity(layout, ROUGH, time_s, point), (after - before) / 2e-3, atol=1e-6)


def test_a_pitching_stern_rises_with_the_lever_to_the_middle():
    pitching = replace(STILL, pitch_rad=0.02)
    quarter = 3.0  # s: the pitch of 12 s is at its largest, bow up, stern down
    half = CVN.length_m / 2
    assert deck_rise(CVN, pitching, quarter, [0.0, 0.0]) == pytest.approx(-half * np.sin(0.02), abs=0.01)
    assert deck_rise(CVN, pitching, quarter, [2 * half, 0.0]) == pytest.approx(half * np.sin(0.02), abs=0.01)
    assert deck_rise(CVN, replace(STILL, heave_m=1.5), 4.5, [30.0, 5.0]) == pytest.approx(1.5)


def test_smaller_seas_move_the_deck_less():
    swings = np.array([deck_amplitudes(state) for state in np.linspace(0.0, 6.0, 25)])
    assert (np.diff(swings, axis=0) > 0).all()
    np.testing.assert_allclose(swings[0], 0.0)
    np.testing.assert_allclose(deck_amplitudes(2), np.array(deck_amplitudes(4)) * 0.3 / 1.875)
    np.testing.assert_allclose(deck_amplitudes(4.5), (np.array(deck_amplitudes(4)) + deck_amplitudes(5)) / 2)


def test_presets_decide_what_is_not_said():
    named = [draw_motion(MotionConfig(), False, np.random.default_rng(k)) for k in range(20)]
    assert all((m.roll_rad, m.pitch_rad, m.heave_m, m.speed_m_s) == (0.0, 0.0, 0.0, 0.0) for m in named)
    drawn = np.array([draw_motion(MotionConfig(), True, np.random.default_rng(k)).heave_m for k in range(300)])
    assert 0.2 < np.mean(drawn == 0.0) < 0.4
    assert drawn.max() > 1.4
    assert draw_motion(MotionConfig(), True, np.random.default_rng(5)) == draw_motion(
        MotionConfig(), True, np.random.default_rng(5)
    )


def test_a_runway_on_land_does_not_move():
    land = class_layout(load_class("runway"))
    for time_s in (0.0, 5.0):
        np.testing.assert_allclose(
            ship_pose(land, ROUGH, time_s).as_matrix(), land.world_from_ship.as_matrix(), atol=1e-12
        )
        np.testing.assert_array_equal(ship_velocity(land, ROUGH, time_s, [900.0, 10.0, 0.0]), 0.0)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_rise_is_the_difference_of_the_poses(layout):
    point = np.array([12.0, -7.0])
    for time_s in (0.0, 3.1, 40.0):
        steady, moved = (pose(layout, ROUGH, time_s).apply([*point, 0.0])[2] for pose in (steady_pose, ship_pose))
        assert deck_rise(layout, ROUGH, time_s, point) == pytest.approx(steady - moved, abs=1e-9)
