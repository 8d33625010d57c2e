import math
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from airsim_serving import CONFIG, WORLD_SETTINGS

from deckline.haze import beta_from_visibility
from deckline_sim.airsim_server.settings import PLANAR, SCENE
from deckline_sim.airsim_server.sim_clock import SimClock
from deckline_sim.airsim_server.world import RAIN_MM_H, World, foggy_visibility


def test_fog_adds_to_the_air_that_is_there():
    assert foggy_visibility(math.inf, 0.0) == math.inf
    assert foggy_visibility(800.0, 0.0) == pytest.approx(800.0)
    assert foggy_visibility(math.inf, 1.0) == pytest.approx(50.0)
    both = beta_from_visibility(foggy_visibility(800.0, 0.1))
    assert both == pytest.approx(beta_from_visibility(800.0) + beta_from_visibility(500.0))


def test_rain_and_wetness_count_once_weather_is_on(world):
    dry = world.picture("front_center", SCENE, world.state, 0.0)
    off = world.picture("front_center", SCENE, replace(world.state, rain=0.4, wet=1.0), 0.0)
    on = world.picture("front_center", SCENE, replace(world.state, rain=0.4, wet=1.0, weather=True), 0.0)
    np.testing.assert_array_equal(dry.image_rgb, off.image_rgb)
    assert dry.truth.conditions["exposure"]["rain_mm_h"] == 0.0
    assert on.truth.conditions["exposure"]["rain_mm_h"] == pytest.approx(0.4 * RAIN_MM_H)
    assert on.truth.conditions["weather"]["wet"] == 1.0
    assert (on.image_rgb != dry.image_rgb).any()


def test_the_ship_moves_with_the_time():
    ticks = [0.0]
    sailing = replace(CONFIG, motion=replace(CONFIG.motion, ship_speed_m_s=10.0))
    with closing(World(sailing, WORLD_SETTINGS, SimClock(lambda: ticks[0], epoch_ns=0))) as world:
        before = world.ship_pose()
        ticks[0] = 3.0
        moved = world.ship_pose().translation - before.translation
        np.testing.assert_allclose(moved, 30.0 * before.rotation.apply([1.0, 0.0, 0.0]), atol=1e-9)


def test_depth_is_the_same_with_and_without_its_picture(world):
    whole = world.picture("front_left", PLANAR, world.state, 0.0).depth_m
    np.testing.assert_array_equal(world.depth("front_left", PLANAR, world.state, 0.0)[1], whole)
