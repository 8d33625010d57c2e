from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import FrameNoise
from deckline.localize import depth
from deckline.localize.depth import WINDOW, choose_mode, locate_points, sample_depth, select_independent
from deckline.types import SIDES, DepthMode, LineVisibility, Reason
from runway_scene import DECK_Z_M, LEFT, NOISE, approach, detection, line_points, locate, off_camera, with_depth

BARE = approach(60.0, 8.0)
DEEP = with_depth(BARE)
SHALLOW = with_depth(BARE, 20.0)  # no point of a line has a depth
INLIERS = [detection(BARE).left.points_px, detection(BARE).right.points_px]
POINTS = line_points(BARE, LEFT)


def place(mode, frame=DEEP, points_px=POINTS.points_px, sigma_px=POINTS.sigma_px, noise=NOISE):
    return locate_points(frame, points_px, sigma_px, np.arange(40), mode, noise)


def test_depth_between_pixels_is_that_of_the_plane():
    def inverse(u, v):
        return 0.02 + 1e-5 * (u - 600) + 3e-5 * (v - 400)

    points = np.random.default_rng(0).uniform([5, 450], [1270, 710], (300, 2))
    v, u = np.mgrid[0:720, 0:1280]
    image = (1 / np.maximum(inverse(u, v), 1e-3)).astype(np.float32)
    np.testing.assert_allclose(sample_depth(image, points), 1 / inverse(*points.T), rtol=1e-6)


def test_window_tolerates_gaps_and_an_outlier_but_needs_six_samples():
    image = np.full((20, 20), 50.0, dtype=np.float32)
    image[4, 4], image[4, 5], image[5, 6] = np.nan, 900.0, np.inf
    image[13:16, 14] = np.nan
    image[15, 13] = np.nan
    sampled = sample_depth(image, np.array([[5.2, 4.8], [14.0, 14.0], [0.0, 0.0], [-5.0, 3.0]]))
    np.testing.assert_allclose(sampled[0], 50.0, rtol=1e-6)
    assert np.isnan(sampled[1:]).all()  # 5 of 9 valid; a corner has 4; outside the image none


def test_windows_of_selected_points_share_no_pixel():
    rows = np.column_stack([np.linspace(100, 110, 21), np.linspace(200, 220, 21)])  # a row apart
    kept = select_independent(rows, np.ones(21, dtype=bool))
    np.testing.assert_array_equal(np.flatnonzero(kept), [2, 5, 8, 11, 14, 17, 20])  # from the near end on
    windows = (np.rint(rows[kept]).astype(int)[:, None] + WINDOW).reshape(-1, 2)
    assert len(np.unique(windows, axis=0)) == len(windows)
    flat = rows[:, ::-1] * [1.0, 0.1]
    np.testing.assert_array_equal(np.flatnonzero(select_independent(flat, np.arange(21) < 7)), [0, 3, 6])
    assert not select_independent(rows, np.zeros(21, dtype=bool)).any()


@pytest.mark.parametrize(
    ("frame", "mode", "expected", "reason"),
    [
        (DEEP, "auto", DepthMode.FINE, None),
        (BARE, "auto", DepthMode.COARSE, None),
        (DEEP, "coarse", DepthMode.COARSE, None),
        (DEEP, "fine", DepthMode.FINE, None),
        (BARE, "fine", DepthMode.NONE, Reason.NO_DEPTH),
        (SHALLOW, "auto", DepthMode.COARSE, None),
        (SHALLOW, "fine", DepthMode.NONE, Reason.NO_DEPTH),
        (replace(BARE, deck_z_m=None), "auto", DepthMode.NONE, Reason.NO_DECK_HEIGHT),
        (replace(DEEP, deck_z_m=None), "auto", DepthMode.FINE, None),
        (replace(SHALLOW, deck_z_m=None), "auto", DepthMode.NONE, Reason.NO_DECK_HEIGHT),
        (replace(DEEP, deck_z_m=None), "coarse", DepthMode.NONE, Reason.NO_DECK_HEIGHT),
        (replace(DEEP, world_from_body=None), "auto", DepthMode.NONE, Reason.NO_POSE),
    ],
)
def test_mode_is_chosen_and_never_replaced_silently(frame, mode, expected, reason):
    chosen, diagnostic = choose_mode(frame, INLIERS, mode)
    assert (chosen, diagnostic and diagnostic.reason) == (expected, reason)
    named = {Reason.NO_DECK_HEIGHT: "--deck-z-m", Reason.NO_POSE: "--poses"}
    assert diagnostic is None or named.get(reason, "") in diagnostic.message


def test_lines_that_are_too_unsure_in_a_picture_with_depth_are_not_seen():
    """None is left whose depths could be counted."""
    found = detection(SHALLOW)
    vague = {side: replace(getattr(found, side), sigma_px=np.full(len(getattr(found, side)), 1e3)) for side in SIDES}
    assert locate(SHALLOW, replace(found, **vague)).seen is LineVisibility.NONE


def test_auto_prefers_coarse_when_most_points_have_no_depth(monkeypatch):
    depths = sample_depth(DEEP.depth_m, INLIERS[0])
    short = with_depth(BARE, float(np.sort(depths)[9]))  # 9 or 10 of 40 have a depth: enough, but few
    assert choose_mode(short, INLIERS, "auto")[0] is DepthMode.COARSE
    assert choose_mode(replace(short, deck_z_m=None), INLIERS, "auto")[0] is DepthMode.FINE
    monkeypatch.setattr(depth, "MIN_DEPTH_SHARE", 0.0)
    assert choose_mode(short, INLIERS, "auto")[0] is DepthMode.FINE


@pytest.mark.parametrize("mode", [DepthMode.FINE, DepthMode.COARSE])
def test_displacements_equal_finite_differences(mode, monkeypatch):
    """Pose, deck, calibration and pixels are changed by a small step each."""
    monkeypatch.setattr(depth, "MIN_SIGMA_PX", 1e-4)
    noise = FrameNoise(1e-5, 1e-3, 1e-3, 0.0, focal_fraction=1e-5, depth_fraction=0.01, depth_scale=1e-4)
    sigma = np.full(40, 1e-3)
    base = place(mode, sigma_px=sigma, noise=noise)
    pose = DEEP.world_from_body
    turns = [Rotation.from_rotvec(axis * noise.attitude_rad) * pose.rotation for axis in np.eye(3)]
    poses = [RigidTransform.from_components(pose.translation, turn) for turn in turns]
    shifts = [pose.translation + axis * noise.position_m for axis in np.eye(3)]
    poses += [RigidTransform.from_components(shift, pose.rotation) for shift in shifts]
    frames = [
        *(replace(DEEP, world_from_body=p) for p in poses),
        replace(DEEP, deck_z_m=DECK_Z_M + noise.deck_z_m),
        replace(DEEP, camera=off_camera(DEEP.camera, noise.focal_fraction)),
        replace(DEEP, depth_m=DEEP.depth_m * np.float32(1 + noise.depth_scale)),
    ]
    scale = np.abs(base.common_m).max()
    for expected, frame in zip(base.common_m, frames, strict=True):
        change = place(mode, frame, sigma_px=sigma, noise=noise).points_m - base.points_m
        np.testing.assert_allclose(change, expected, atol=2e-3 * scale)
    if mode is DepthMode.COARSE:
        change = place(mode, points_px=POINTS.points_px + np.array([1e-3, 0.0]), sigma_px=sigma, noise=noise).points_m
        np.testing.assert_allclose(change - base.points_m, base.pixel_m, atol=1e-3 * np.abs(base.pixel_m).max())


def test_heading_and_position_errors_vanish_relative_to_the_aircraft():
    found = place(DepthMode.FINE)
    np.testing.assert_allclose(found.relative_m[2:7], 0, atol=1e-12)
    assert np.abs(found.relative_m[:2]).max() > 0.05


@pytest.mark.parametrize(
    ("frame", "mode", "named"),
    [(BARE, DepthMode.FINE, "fine"), (replace(BARE, world_from_body=None), DepthMode.COARSE, "pose")],
)
def test_frame_without_what_the_mode_needs_is_refused(frame, mode, named):
    with pytest.raises(ValueError, match=rf"exact\.png.*{named}"):
        place(mode, frame)
