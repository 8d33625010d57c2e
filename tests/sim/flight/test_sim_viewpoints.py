"""Motion of the ship, unrelated views, and where a camera looks."""

from dataclasses import replace

import numpy as np
import pytest
from deck_frame import CVN, PAPER_SHIP, over_deck
from pixel_truth import moved_ship

from deckline.geometry import Camera
from deckline_sim.config import MotionConfig, SimConfig
from deckline_sim.flight.viewpoints import (
    APPARENT_WIDTH,
    STILL,
    ShipMotion,
    Viewpoint,
    away_view,
    deck_amplitudes,
    deck_rise,
    deck_view,
    draw_motion,
    draw_range,
    from_any_side,
    middle_m,
    pose_towards,
    random_view,
    runway_in_view,
    runway_point,
    ship_pose,
    ship_velocity,
    steady_pose,
)
from deckline_sim.ship.layout import class_layout, random_layout
from deckline_sim.ship.paint_shapes import axes
from deckline_sim.ship.ship_class import load_class

ROUGH = draw_motion(MotionConfig(sea_state=6, ship_speed_m_s=12.9), False, np.random.default_rng(3))
LAYOUTS = [PAPER_SHIP, CVN]
RISING = ShipMotion(pitch_rad=0.0216, heave_m=1.63, phases_rad=(0.0, np.pi, 0.0))
UNDER_WAY = ShipMotion(speed_m_s=10.0, roll_rad=0.02)
TRAIN = SimConfig(preset="train", trajectory="random", width=640, height=360)


@pytest.mark.parametrize("motion", [STILL, ROUGH], ids=["still", "rough"])
@pytest.mark.parametrize("layout", LAYOUTS, ids=["paper", "cvn"])
def test_the_ship_swings_about_its_middle_at_the_waterline(layout, motion):
    for time_s in (0.0, 3.0, 7.5, 123.0):
        np.testing.assert_allclose(
            ship_pose(layout, motion, time_s).as_matrix(), moved_ship(layout, motion, time_s), atol=1e-9
        )
    assert layout.world_from_ship.apply(middle_m(layout))[2] == pytest.approx(layout.sea_z_m)


@pytest.mark.parametrize("layout", LAYOUTS, ids=["paper", "cvn"])
def test_velocity_is_the_derivative_of_the_pose(layout):
    for time_s in (0.0, 4.3, 17.0):
        for point in ([0.0, 0.0, 0.0], [300.0, -20.0, -5.0], middle_m(layout)):
            after, before = (ship_pose(layout, ROUGH, time_s + step).apply(point) for step in (1e-3, -1e-3))
            np.testing.assert_allclose(ship_velocity(layout, ROUGH, time_s, point), (after - before) / 2e-3, atol=1e-6)


def test_smaller_seas_move_the_deck_less():
    swings = np.array([deck_amplitudes(state) for state in np.linspace(0.0, 6.0, 25)])
    assert (np.diff(swings, axis=0) > 0).all()
    np.testing.assert_allclose(swings[0], 0.0)
    np.testing.assert_allclose(deck_amplitudes(2), np.array(deck_amplitudes(4)) * 0.3 / 1.875)
    np.testing.assert_allclose(deck_amplitudes(4.5), (np.array(deck_amplitudes(4)) + deck_amplitudes(5)) / 2)


def test_presets_decide_what_is_not_given():
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


def test_views_of_named_ships_stay_in_range_and_mostly_show_the_runway():
    layout, config = CVN, SimConfig(preset="cvn", trajectory="random")
    shown = []
    for k in range(60):
        view = random_view(config, layout, k, np.random.default_rng(k))
        range_m, lateral, height = over_deck(layout, [view])
        assert 60.0 <= range_m <= 800.0
        assert abs(lateral) <= 0.2 * range_m + 1e-9
        assert height >= 3.05
        assert view.camera.fx == pytest.approx(640.0)
        shown.append(runway_in_view(view, layout))
    assert np.mean(np.array(shown) > 0.6) > 0.8


def test_training_sees_ships_from_everywhere_but_mostly_from_the_glide_path():
    views = [random_view(TRAIN, CVN, k, np.random.default_rng(k)) for k in range(600)]
    range_m, lateral, height = over_deck(CVN, views)
    shown = np.array([runway_in_view(view, CVN) for view in views])
    over_the_deck = (range_m <= 0.0) & (range_m >= -60.0) & (np.abs(lateral) < 10.0)
    assert 0.03 < over_the_deck.mean() < 0.10
    assert (height[over_the_deck] <= 30.0).all()
    assert 0.03 < np.mean((shown == 0.0) & ~over_the_deck) < 0.10
    before = (range_m > 0) & (np.abs(lateral) <= 0.25 * range_m + 1e-9)
    assert before.mean() > 0.8
    elevation = np.rad2deg(np.arctan(height / (range_m + 70.0)))[before]
    assert elevation.min() < 2.0
    assert elevation.max() > 9.0
    assert height.min() >= 3.05 - 1e-9


def test_views_come_down_the_glide_angle_that_is_asked_for():
    config = SimConfig(preset="axial", trajectory="random", elevation_deg=(3.0, 4.0))
    layout = class_layout(load_class("axial"))
    views = [random_view(config, layout, k, np.random.default_rng(k)) for k in range(40)]
    range_m, _, height = over_deck(layout, views)
    elevation = np.rad2deg(np.arctan(height / (range_m + 70.0)))
    assert ((elevation > 2.99) & (elevation < 4.01)).all()
    assert np.ptp(elevation) > 0.5


def test_no_view_is_inside_the_ship_or_the_sea():
    for seed in range(150):
        rng = np.random.default_rng(seed)
        layout = random_layout(rng)
        view = away_view(TRAIN, layout, rng) if seed % 2 else from_any_side(TRAIN, layout, rng, 0.0)
        x, y, z = layout.world_from_ship.inv().apply(view.world_from_body.translation)
        assert np.hypot(x - layout.length_m / 2, y) >= layout.length_m / 2 + 79.0
        assert z < 0.0  # above the deck's height


def test_views_past_the_ship_show_no_runway_and_views_from_any_side_do():
    away = [runway_in_view(away_view(TRAIN, CVN, np.random.default_rng(k)), CVN) for k in range(60)]
    odd = [runway_in_view(from_any_side(TRAIN, CVN, np.random.default_rng(k), 0.0), CVN) for k in range(60)]
    assert max(away) == 0.0
    assert np.mean(np.array(odd) > 0.3) > 0.9


def test_views_over_the_deck_look_ahead():
    along, _, _ = axes(*CVN.centre_m)
    for k in range(60):
        view = deck_view(TRAIN, CVN, np.random.default_rng(k))
        nose = view.world_from_body.rotation.apply([1.0, 0.0, 0.0])[:2]
        assert nose @ along > np.cos(np.deg2rad(30.0)) * np.hypot(*nose)


def test_views_follow_the_ship_under_way_but_not_its_swing():
    layout, config = CVN, SimConfig(preset="cvn", trajectory="random")
    still = random_view(config, layout, 30, np.random.default_rng(1))
    moved = random_view(config, layout, 30, np.random.default_rng(1), UNDER_WAY)
    shift = np.array(moved.world_from_body.translation) - still.world_from_body.translation
    np.testing.assert_allclose(shift, [300.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(moved.velocity_m_s - still.velocity_m_s, [10.0, 0.0, 0.0], atol=1e-9)
    assert (still.time_s, np.linalg.norm(still.velocity_m_s)) == (30.0, pytest.approx(65.0))


def test_views_stay_clear_of_a_ramp_that_rises():
    for k in range(40):
        view = random_view(TRAIN, CVN, k, np.random.default_rng(k), RISING)
        ramp = ship_pose(CVN, RISING, float(k)).apply([*CVN.centre_m[0], 0.0])
        assert ramp[2] - view.world_from_body.translation[2] > 3.0


def test_training_draws_fields_of_view_that_show_something():
    for seed in range(40):
        rng = np.random.default_rng(seed)
        layout = random_layout(rng)
        range_m, fov = draw_range(TRAIN, layout, rng)
        assert 30.0 <= range_m <= 1500.0
        assert np.deg2rad(10.0) <= fov <= np.deg2rad(90.0)
        width = np.hypot(*(layout.right_m[0] - layout.left_m[0]))
        apparent = width * Camera.from_fov(100, 50, fov).fx / range_m / 100
        assert APPARENT_WIDTH[0] <= apparent <= APPARENT_WIDTH[1]
    fixed = replace(TRAIN, fixed_fov=True, fov_deg=33.0)
    views = [random_view(fixed, CVN, k, np.random.default_rng(k)) for k in range(30)]
    np.testing.assert_allclose([view.camera.fx for view in views], 320.0 / np.tan(np.deg2rad(16.5)))


def test_part_of_the_runway_in_view():
    camera = Camera.from_fov(640, 360, np.deg2rad(60.0))

    def seen(along_m, up_m, ahead_m):
        position = runway_point(CVN, along_m, 0.0, up_m)
        return runway_in_view(
            Viewpoint(pose_towards(position, runway_point(CVN, ahead_m), np.zeros(3)), camera, 0.0), CVN
        )

    assert seen(-400.0, 30.0, 100.0) == 1.0
    assert seen(-400.0, 30.0, -900.0) == 0.0
    assert 0.1 < seen(100.0, 20.0, 200.0) < 0.9
