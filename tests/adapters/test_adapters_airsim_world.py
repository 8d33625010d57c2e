import math
from dataclasses import replace

import numpy as np
import pytest
from airsim_serving import CONFIG
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim import images
from deckline.adapters.airsim.clock import Clock
from deckline.adapters.airsim.images import read_requests, shown_depth, stored_depth, take_images
from deckline.adapters.airsim.settings import PERSPECTIVE, PLANAR, SCENE, Capture, default_settings
from deckline.adapters.airsim.world import RAIN_MM_H, World, foggy_visibility
from deckline.geometry import Camera
from deckline.haze import beta_from_visibility
from deckline.sim import RendererError, frames
from deckline.sim.camera.lens import LensConfig

SETTINGS = default_settings(Capture(CONFIG.width, CONFIG.height, CONFIG.fov_deg))


@pytest.fixture(scope="module")
def world():
    try:
        with World(CONFIG, SETTINGS, Clock(lambda: 0.0, epoch_ns=0)) as made:
            yield made
    except RendererError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")


def test_fog_adds_to_the_air_that_is_there():
    assert foggy_visibility(math.inf, 0.0) == math.inf
    assert foggy_visibility(800.0, 0.0) == pytest.approx(800.0)
    assert foggy_visibility(math.inf, 1.0) == pytest.approx(50.0)
    both = beta_from_visibility(foggy_visibility(800.0, 0.1))
    assert both == pytest.approx(beta_from_visibility(800.0) + beta_from_visibility(500.0))


def test_it_begins_where_a_recording_does(world):
    first = next(frames(CONFIG))
    np.testing.assert_allclose(world.state.world_from_body.as_matrix(), first.world_from_body.as_matrix())
    seen = world.picture("front_center", SCENE, world.state, 0.0)
    np.testing.assert_array_equal(seen.image_rgb, first.image_rgb)
    np.testing.assert_array_equal(seen.depth_m, first.depth_m)
    assert seen.truth.left.p0_m == pytest.approx(first.truth.left.p0_m)


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
    with World(sailing, SETTINGS, Clock(lambda: ticks[0], epoch_ns=0)) as world:
        before = world.ship_pose()
        ticks[0] = 3.0
        moved = world.ship_pose().translation - before.translation
        np.testing.assert_allclose(moved, 30.0 * before.rotation.apply([1.0, 0.0, 0.0]), atol=1e-9)


def test_pictures_of_one_call_are_drawn_once_a_camera(world, monkeypatch):
    drawn, depths = [], []
    picture, depth = world.picture, world.depth
    monkeypatch.setattr(world, "picture", lambda *args: drawn.append(args[0]) or picture(*args))
    monkeypatch.setattr(world, "depth", lambda *args: depths.append(args[0]) or depth(*args))
    asked = [{"camera_name": name, "image_type": kind} for name in ("0", "front_center", "1") for kind in (0, 1, 2, 3)]
    answers = take_images(world, read_requests(asked, SETTINGS))
    assert drawn == ["front_center", "front_right"] and len(answers) == 12
    assert [answer["camera_name"] for answer in answers[::4]] == ["0", "front_center", "1"]
    alone = take_images(world, read_requests(asked[1:3], SETTINGS))
    assert depths == ["front_center"] and len(drawn) == 2
    for shown, measured in zip(answers[1:3], alone, strict=True):
        np.testing.assert_array_equal(shown["image_data_uint8"], measured["image_data_uint8"])


def test_depth_is_the_same_with_and_without_its_picture(world):
    whole = world.picture("front_left", PLANAR, world.state, 0.0).depth_m
    np.testing.assert_array_equal(world.depth("front_left", PLANAR, world.state, 0.0), whole)
    assert not world.bends


def test_depth_goes_through_lenses_that_bend():
    asked = [{"camera_name": "0", "image_type": PERSPECTIVE, "pixels_as_float": True}]
    lens = LensConfig(distortion=(-0.05, 0.0, 0.0, 0.0, 0.0))
    with World(replace(CONFIG, lens=lens), SETTINGS, Clock(lambda: 0.0)) as bent:
        assert bent.bends
        frame = bent.picture("front_center", SCENE, bent.state, 0.0)
        (answer,) = take_images(bent, read_requests(asked, SETTINGS))
    v, u = np.argwhere(frame.depth_m < 1000.0)[100]
    length = np.linalg.norm(frame.camera.rays([[u, v]])[0])
    stored = answer["image_data_float"].reshape(CONFIG.height, CONFIG.width)
    assert stored[v, u] == pytest.approx(length * frame.depth_m[v, u], rel=1e-5)


def test_depth_is_stored_and_shown_as_airsim_does():
    depth = np.full((54, 96), np.nan, np.float32)
    depth[0, :4] = 0.0, 50.0, 100.0, 70000.0
    stored = stored_depth(depth, Camera.from_fov(96, 54, 1.0), PLANAR)
    np.testing.assert_array_equal(stored[0, :5], np.float32([0.0, 50.0, 100.0, 65504.0, 65504.0]))
    np.testing.assert_array_equal(shown_depth(stored)[0, :5, 0], [0, 128, 255, 255, 255])


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ("0", "must be a list of at most 64"),
        ([{}] * 65, "must be a list of at most 64"),
        ([5], "an image request must be a map, got int"),
        ([{"image_type": True}], "no image type True"),
        ([{"image_type": 0, "pixels_as_float": True}], "Scene has no float pixels"),
        ([{"camera_name": "9"}], "no camera '9'"),
    ],
)
def test_what_cannot_be_asked_for_is_named(values, says):
    with pytest.raises(ValueError, match=says):
        read_requests(values, SETTINGS)


def test_answers_do_not_grow_without_limit(world, monkeypatch):
    monkeypatch.setattr(images, "MOST_PIXELS", 3 * CONFIG.width * CONFIG.height)
    three = read_requests(3 * [{"image_type": PLANAR}], SETTINGS)
    assert len(take_images(world, three)) == 3
    with pytest.raises(ValueError, match=r"may have 15552 pixels together"):
        take_images(world, [*three, *three[:1]])


def test_a_camera_below_the_water_is_refused(world):
    sunk = replace(world.state, world_from_body=RigidTransform.from_translation([0.0, 0.0, 1000.0]))
    with pytest.raises(ValueError, match="above the sea"):
        world.picture("front_center", SCENE, sunk, 0.0)
