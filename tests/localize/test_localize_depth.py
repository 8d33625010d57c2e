import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.localize.config import LocalizeConfig, NoiseConfig
from deckline.localize.depth import WINDOW, choose_mode, deck_points, independent, sample_depth
from deckline.types import DepthMode
from runway_scene import DECK_Z_M, LEFT, approach, detection, line_points, with_depth

BARE = approach(60.0, 8.0)
DEEP = with_depth(BARE)
INLIERS = [detection(BARE).left.points_px, detection(BARE).right.points_px]


def without(frame, **fields):
    return replace(frame, **fields)


def test_depth_between_pixels_is_that_of_the_plane():
    def inverse(u, v):
        return 0.02 + 1e-5 * (u - 600) + 3e-5 * (v - 400)

    points = np.random.default_rng(0).uniform([5, 450], [1270, 710], (300, 2))
    v, u = np.mgrid[0:720, 0:1280]
    image = (1 / np.maximum(inverse(u, v), 1e-3)).astype(np.float32)
    np.testing.assert_allclose(sample_depth(image, points), 1 / inverse(*points.T), rtol=1e-6)


def test_a_window_survives_gaps_and_an_outlier_but_not_too_many():
    image = np.full((20, 20), 50.0, dtype=np.float32)
    image[4, 4], image[4, 5], image[5, 6] = np.nan, 900.0, np.inf
    image[13:16, 14] = np.nan
    image[15, 13] = np.nan
    depth = sample_depth(image, np.array([[5.2, 4.8], [14.0, 14.0], [0.0, 0.0], [-5.0, 3.0]]))
    np.testing.assert_allclose(depth[0], 50.0, rtol=1e-6)
    assert np.isnan(depth[1:]).all()  # 5 of 9 left; a corner has 4; outside the image none


def test_windows_that_share_pixels_are_not_counted_twice():
    rows = np.column_stack([np.linspace(100, 110, 21), np.linspace(200, 220, 21)])  # a row apart
    kept = independent(rows, np.ones(21, dtype=bool))
    np.testing.assert_array_equal(np.flatnonzero(kept), [2, 5, 8, 11, 14, 17, 20])  # from the near end on
    windows = (np.rint(rows[kept]).astype(int)[:, None] + WINDOW).reshape(-1, 2)
    assert len(np.unique(windows, axis=0)) == len(windows)
    flat = rows[:, ::-1] * [1.0, 0.1]
    np.testing.assert_array_equal(np.flatnonzero(independent(flat, np.arange(21) < 7)), [0, 3, 6])
    assert not independent(rows, np.zeros(21, dtype=bool)).any()


@pytest.mark.parametrize(
    ("frame", "mode", "expected", "reason"),
    [
        (DEEP, "auto", DepthMode.FINE, ""),
        (BARE, "auto", DepthMode.COARSE, ""),
        (DEEP, "coarse", DepthMode.COARSE, ""),
        (DEEP, "fine", DepthMode.FINE, ""),
        (BARE, "fine", DepthMode.NONE, "fine mode was asked for and the frame has no depth image"),
        (with_depth(BARE, 20.0), "auto", DepthMode.COARSE, ""),
        (with_depth(BARE, 20.0), "fine", DepthMode.NONE, "fine mode was asked for: depth at 0, 0 points"),
        (without(BARE, deck_z_m=None), "auto", DepthMode.NONE, "no depth and no deck height: give --deck-z-m"),
        (without(DEEP, deck_z_m=None), "auto", DepthMode.FINE, ""),
        (without(with_depth(BARE, 20.0), deck_z_m=None), "auto", DepthMode.NONE, "0, 0 points.*give --deck-z-m"),
        (without(DEEP, deck_z_m=None), "coarse", DepthMode.NONE, "coarse mode was asked for and there is no deck"),
        (without(DEEP, world_from_body=None), "auto", DepthMode.NONE, "no pose: give poses.csv"),
    ],
)
def test_the_mode_is_chosen_and_never_replaced_in_silence(frame, mode, expected, reason):
    chosen, why = choose_mode(frame, INLIERS, LocalizeConfig(mode=mode))
    assert chosen is expected
    if reason:
        assert re.search(reason, why), why
    else:
        assert why == ""


def test_auto_prefers_coarse_when_most_points_have_no_depth():
    depths = sample_depth(DEEP.depth_m, INLIERS[0])
    short = with_depth(BARE, float(np.sort(depths)[9]))  # 9 or 10 of 40 have a depth: enough, but few
    assert choose_mode(short, INLIERS, LocalizeConfig(min_depth_share=0.0))[0] is DepthMode.FINE
    assert choose_mode(short, INLIERS, LocalizeConfig())[0] is DepthMode.COARSE
    assert choose_mode(without(short, deck_z_m=None), INLIERS, LocalizeConfig())[0] is DepthMode.FINE


@pytest.mark.parametrize("mode", [DepthMode.FINE, DepthMode.COARSE])
def test_points_come_back_onto_the_true_line(mode):
    points = line_points(BARE, LEFT)
    found = deck_points(DEEP, points.points_px, points.sigma_px, np.arange(40), mode, NoiseConfig())
    along = (LEFT.p1_m - LEFT.p0_m) / np.linalg.norm(LEFT.p1_m - LEFT.p0_m)
    off = found.points_m - LEFT.p0_m
    assert np.abs(np.cross(off, along)).max() < (1e-6 if mode is DepthMode.COARSE else 1e-3)  # depth is float32
    assert len(found) == 40
    assert found.common_m.shape == (9, 40, 3)


@pytest.mark.parametrize("mode", [DepthMode.FINE, DepthMode.COARSE])
def test_displacements_are_those_of_really_displaced_measurements(mode):
    """Move pose, deck and pixel by a small step and compare with the derivative, a tenth of a percent."""
    points = line_points(BARE, LEFT)
    noise = NoiseConfig(
        attitude_rad=1e-5, position_m=1e-3, deck_z_m=1e-3, focal_fraction=1e-5, depth_scale=1e-4, min_pixel=1e-4
    )
    sigma = np.full(40, 1e-3)

    def at(frame, pixels):
        return deck_points(frame, pixels, sigma, np.arange(40), mode, noise)

    base = at(DEEP, points.points_px)
    pose = DEEP.world_from_body
    moved = []
    for axis in np.eye(3):
        moved.append(
            RigidTransform.from_components(
                pose.translation, Rotation.from_rotvec(axis * noise.attitude_rad) * pose.rotation
            )
        )
    for axis in np.eye(3):
        moved.append(RigidTransform.from_components(pose.translation + axis * noise.position_m, pose.rotation))
    frames = [replace(DEEP, world_from_body=p) for p in moved]
    frames.append(replace(DEEP, deck_z_m=DECK_Z_M + noise.deck_z_m))
    zoom = 1 + noise.focal_fraction
    frames.append(replace(DEEP, camera=replace(DEEP.camera, fx=DEEP.camera.fx * zoom, fy=DEEP.camera.fy * zoom)))
    frames.append(replace(DEEP, depth_m=DEEP.depth_m * np.float32(1 + noise.depth_scale)))
    for k, frame in enumerate(frames):
        change = at(frame, points.points_px).points_m - base.points_m
        scale = np.abs(base.common_m).max()
        np.testing.assert_allclose(change, base.common_m[k], atol=2e-3 * scale)
    if mode is DepthMode.COARSE:
        change = at(DEEP, points.points_px + np.array([1e-3, 0.0])).points_m - base.points_m
        np.testing.assert_allclose(change, base.pixel_m, atol=1e-3 * np.abs(base.pixel_m).max())


def test_a_wrong_heading_and_place_leave_the_relative_line_alone():
    points = line_points(BARE, LEFT)
    found = deck_points(DEEP, points.points_px, points.sigma_px, np.arange(40), DepthMode.FINE, NoiseConfig())
    np.testing.assert_allclose(found.relative_m[2:7], 0, atol=1e-12)
    assert np.abs(found.relative_m[:2]).max() > 0.05


def test_a_frame_without_what_the_mode_needs_is_refused():
    points = line_points(BARE, LEFT)
    with pytest.raises(ValueError, match=r"exact\.png: mode fine needs"):
        deck_points(BARE, points.points_px, points.sigma_px, np.arange(40), DepthMode.FINE, NoiseConfig())
    with pytest.raises(ValueError, match="no pose"):
        blind = without(BARE, world_from_body=None)
        deck_points(blind, points.points_px, points.sigma_px, np.arange(40), DepthMode.COARSE, NoiseConfig())
