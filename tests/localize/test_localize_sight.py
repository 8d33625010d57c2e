from dataclasses import replace

import numpy as np
import pytest

from deckline.localize import LocalizeConfig
from deckline.localize.ransac import fit_pixel_line
from deckline.localize.sight import first_height, first_line, sight
from deckline.types import SIDES
from runway_scene import DECK_Z_M, LEFT, LENS, approach, azimuth, detection, with_depth

CONFIG = LocalizeConfig()


def seen(frame, config=CONFIG, count=20):
    found = detection(frame, count=count)
    points = {side: getattr(found, side) for side in SIDES}
    lines = {
        side: fit_pixel_line(points[side], frame.camera, config.ransac, np.random.default_rng(0)) for side in SIDES
    }
    return sight(frame, points, lines, config), lines


def test_rays_look_at_the_line_and_steps_are_those_of_half_a_pixel():
    frame = approach(80.0, 8.0, camera=LENS)
    (view, missing), _ = seen(frame)
    assert (view.names, missing) == (("left", "right"), [])
    left = view.world_rays[view.line == 0]
    ground = view.camera_m + left * ((DECK_Z_M - view.camera_m[2]) / left[:, 2:])
    along = (LEFT.p1_m - LEFT.p0_m) / np.linalg.norm(LEFT.p1_m - LEFT.p0_m)
    assert np.abs(np.cross(ground - LEFT.p0_m, along)).max() < 1e-6
    pixels = frame.camera.project(view.rays)
    moved = frame.camera.project(view.rays + np.column_stack([view.steps, np.zeros(len(view.steps))]))
    np.testing.assert_allclose(moved - pixels, np.tile([0.5, 0.0], (40, 1)), atol=2e-3)


def test_depth_is_taken_where_there_is_one():
    frame = with_depth(approach(80.0, 8.0), 150.0)
    (view, _), _ = seen(frame)
    has = np.isfinite(view.log_depth)
    assert 0 < has.sum() < len(has)
    heights = view.camera_m[2] + np.exp(view.log_depth[has]) * view.world_rays[has, 2]
    np.testing.assert_allclose(heights, DECK_Z_M, atol=1e-3)
    assert not np.isfinite(seen(frame, LocalizeConfig(mode="coarse"))[0][0].log_depth).any()


def test_some_lines_of_a_sight_in_another_order():
    (view, _), _ = seen(with_depth(approach(80.0, 8.0)))
    other = view.take(("right",))
    assert other.names == ("right",)
    np.testing.assert_array_equal(other.rays, view.rays[view.line == 1])
    np.testing.assert_array_equal(view.take(("right", "left")).line, np.repeat([0, 1], 20))


def test_points_above_the_horizon_are_on_no_deck():
    frame = approach(80.0, 8.0)
    up = replace(frame, world_from_body=type(frame.world_from_body).identity())
    found = detection(frame)
    lines = {"left": fit_pixel_line(found.left, frame.camera, CONFIG.ransac, np.random.default_rng(0))}
    high = replace(found.left, points_px=found.left.points_px - [0.0, 400.0])
    view, missing = sight(up, {"left": high}, lines, CONFIG)
    assert view.names == ()
    assert missing == ["the left line has too few points on the deck"]


def test_the_height_to_begin_with():
    frame = with_depth(approach(80.0, 8.0))
    (view, _), _ = seen(frame)
    assert first_height(view, 7.0, fine=True) == pytest.approx(DECK_Z_M, abs=1e-3)
    assert first_height(view, 7.0, fine=False) == 7.0
    assert first_height(view, None, fine=False) == pytest.approx(DECK_Z_M, abs=1e-3)
    assert first_height(view, -50.0, fine=False) is None
    bare = replace(view, log_depth=np.full(len(view.line), np.nan))
    assert first_height(bare, None, fine=False) is None


def test_the_line_to_begin_with_is_the_image_line_on_the_plane():
    frame = approach(80.0, 8.0)
    (view, _), lines = seen(frame)
    normal = view.turn @ (frame.camera.matrix.T @ lines["left"].coefficients)
    point, angle = first_line(view, 0, normal, DECK_Z_M)
    assert angle == pytest.approx(azimuth(LEFT) % (2 * np.pi), abs=1e-6) or angle == pytest.approx(azimuth(LEFT))
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    assert abs(np.cross(point - LEFT.p0_m, along)[2]) < 1e-6
    assert first_line(view, 0, np.array([0.0, 0.0, 1.0]), DECK_Z_M) is None  # the horizon


def test_a_frame_without_a_pose_is_refused():
    frame = replace(approach(80.0, 8.0), world_from_body=None)
    with pytest.raises(ValueError, match=r"exact\.png: no pose"):
        sight(frame, {}, {}, CONFIG)
