from dataclasses import replace

import numpy as np
import pytest

from deckline.localize.observations import initial_height, initial_line, observe
from deckline.localize.ransac import fit_pixel_line
from deckline.types import Reason
from runway_scene import DECK_Z_M, LEFT, LENS, approach, azimuth, detection, observe_lines, with_depth

FRAME = approach(80.0, 8.0)


def observe_20(frame, mode="auto"):
    return observe_lines(frame, detection(frame, count=20), mode)


def test_rays_meet_the_line_and_steps_are_those_of_the_detector():
    frame = approach(80.0, 8.0, camera=LENS)
    observations, diagnostics, _ = observe_20(frame)
    assert (observations.names, diagnostics) == (("left", "right"), ())
    left = observations.world_rays[observations.line == 0]
    ground = observations.camera_m + left * ((DECK_Z_M - observations.camera_m[2]) / left[:, 2:])
    along = (LEFT.p1_m - LEFT.p0_m) / np.linalg.norm(LEFT.p1_m - LEFT.p0_m)
    assert np.abs(np.cross(ground - LEFT.p0_m, along)).max() < 1e-6
    pixels = frame.camera.project(observations.rays)
    shifted = frame.camera.project(observations.rays + np.column_stack([observations.steps, np.zeros(40)]))
    np.testing.assert_allclose(shifted - pixels, np.tile([0.5, 0.0], (40, 1)), atol=2e-3)  # 1-sigma is 0.5 px


def test_depth_is_used_where_there_is_one():
    frame = with_depth(FRAME, 150.0)
    observations, *_ = observe_20(frame)
    valid = np.isfinite(observations.log_depth)
    assert 0 < valid.sum() < len(valid)
    heights = observations.camera_m[2] + np.exp(observations.log_depth[valid]) * observations.world_rays[valid, 2]
    np.testing.assert_allclose(heights, DECK_Z_M, atol=1e-3)
    assert not np.isfinite(observe_20(frame, "coarse")[0].log_depth).any()


def test_lines_are_selected_in_the_order_given():
    observations, *_ = observe_20(with_depth(FRAME))
    right = observations.select(("right",))
    assert right.names == ("right",)
    np.testing.assert_array_equal(right.rays, observations.rays[observations.line == 1])
    np.testing.assert_array_equal(observations.select(("right", "left")).line, np.repeat([0, 1], 20))


def test_points_above_the_horizon_are_left_out():
    level = replace(FRAME, world_from_body=type(FRAME.world_from_body).identity())
    left = detection(FRAME).left
    lines = {"left": fit_pixel_line(left, FRAME.camera, np.random.default_rng(0))}
    high = replace(left, points_px=left.points_px - [0.0, 400.0])
    observations, diagnostics = observe(level, {"left": high}, lines, "auto")
    assert observations.names == ()
    assert [diagnostic.reason for diagnostic in diagnostics] == [Reason.NO_POINTS]
    assert "left" in diagnostics[0].message


def test_initial_height():
    observations, *_ = observe_20(with_depth(FRAME))
    assert initial_height(observations, 7.0, fine=True) == pytest.approx(DECK_Z_M, abs=1e-3)
    assert initial_height(observations, 7.0, fine=False) == 7.0
    assert initial_height(observations, None, fine=False) == pytest.approx(DECK_Z_M, abs=1e-3)
    assert initial_height(observations, -50.0, fine=False) is None  # above the camera
    bare = replace(observations, log_depth=np.full(len(observations.line), np.nan))
    assert initial_height(bare, None, fine=False) is None


def test_initial_line_is_the_image_line_on_the_plane():
    observations, _, lines = observe_20(FRAME)
    normal = observations.rotation @ (FRAME.camera.matrix.T @ lines["left"].coefficients)
    point, angle = initial_line(observations, 0, normal, DECK_Z_M)
    assert angle % (2 * np.pi) == pytest.approx(azimuth(LEFT) % (2 * np.pi), abs=1e-6)
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    assert abs(np.cross(point - LEFT.p0_m, along)[2]) < 1e-6
    assert initial_line(observations, 0, np.array([0.0, 0.0, 1.0]), DECK_Z_M) is None  # the horizon


def test_frame_without_a_pose_is_refused():
    with pytest.raises(ValueError, match=r"exact\.png.*pose"):
        observe(replace(FRAME, world_from_body=None), {}, {}, "auto")
