"""What is carried from frame to frame, on exact estimates of a runway along world x."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.detect.last_seen import DRIFT_M_S, LastSeen
from deckline.detect.prior import RunwaySurvey, expected_box, surveyed
from deckline.geometry import Camera, attitude
from deckline.types import DepthMode, Detection, Frame, LinePoints, PixelLine, RunwayEstimate, RunwayLine, Status

CAMERA = Camera.from_fov(1280, 720, np.deg2rad(90))
RUNWAY = surveyed(RunwaySurvey((0.0, 0.0, -20.0), sigma_m=0.0, heading_sigma_deg=0.0))


def frame_at(x_m: float, time_s: float, pose: bool = True) -> Frame:
    there = RigidTransform.from_components(np.array([x_m, 5.0, -70.0]), attitude(0.0, -0.05, 0.01)) if pose else None
    return Frame("f", time_s, np.zeros((720, 1280, 3), np.uint8), CAMERA, world_from_body=there)


def exact(frame: Frame, localized: bool = True) -> tuple[Detection, RunwayEstimate]:
    """What a perfect detector and localization say of a frame (with a pose)."""
    points, pixel_lines, lines = {}, {}, {}
    camera_from_world = frame_at(-800.0, 0.0).world_from_camera.inv()
    for side, ends in (("left", RUNWAY.left_m), ("right", RUNWAY.right_m)):
        pixels = CAMERA.project(camera_from_world.apply(np.linspace(ends[0], ends[1], 8)))
        points[side] = LinePoints(pixels, np.ones(8), np.full(8, 0.3))
        along = (pixels[-1] - pixels[0]) / np.linalg.norm(pixels[-1] - pixels[0])
        normal = np.array([-along[1], along[0]])
        coefficients = np.array([*normal, -normal @ pixels[0]])
        pixel_lines[side] = PixelLine(coefficients, np.ones(8, bool), pixels[[0, -1]], 0.3)
        covariance = np.diag([0.5**2, 0.01**2, 0.1**2])
        lines[side] = RunwayLine(ends.mean(axis=0), 0.0, covariance)
    mode = DepthMode.COARSE if localized else DepthMode.NONE
    estimate = RunwayEstimate(Status.OK, mode, pixel_lines, lines if localized else {})
    return Detection(points["left"], points["right"]), estimate


def test_the_seen_ends_are_expected_again_where_they_are():
    memory, frame = LastSeen(), frame_at(-800.0, 10.0)
    memory.update(frame, *exact(frame))
    expected = memory.expected(frame_at(-790.0, 10.2))
    np.testing.assert_allclose(expected.left_m, RUNWAY.left_m, atol=1e-6)
    np.testing.assert_allclose(expected.right_m, RUNWAY.right_m, atol=1e-6)
    # The line's own 0.5 m, half a degree over 801.7 m to the nearer end, and what a ship sails in 0.2 s.
    still = 0.5 + np.deg2rad(0.5) * np.linalg.norm([800.0, 7.0, 50.0])
    assert expected.sigma_m == pytest.approx(np.hypot(still, 0.2 * DRIFT_M_S), rel=1e-6)


def test_the_box_holds_the_runway_some_seconds_later():
    memory, frame = LastSeen(), frame_at(-800.0, 0.0)
    memory.update(frame, *exact(frame))
    later = frame_at(-700.0, 2.0)
    box = np.array(expected_box(later, memory.expected(later)))
    pixels = CAMERA.project(later.world_from_camera.inv().apply(np.concatenate([RUNWAY.left_m, RUNWAY.right_m])))
    assert np.all((pixels >= box[:2]) & (pixels <= box[2:]))
    assert box[2] - box[0] < 250  # of 1280: still a close look


def test_without_a_pose_the_last_box_is_carried_with_a_margin():
    memory, frame = LastSeen(), frame_at(-800.0, 0.0, pose=False)
    detection, estimate = exact(frame, localized=False)
    memory.update(frame, detection, estimate)
    later = frame_at(-790.0, 0.2, pose=False)
    assert memory.expected(later) is None
    u0, v0, u1, v1 = memory.image_box(later)
    points = np.concatenate([detection.left.points_px, detection.right.points_px])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.5 * (high - low).max()
    np.testing.assert_allclose([u0, v0, u1, v1], [*(low - margin), *(high + margin)])
    smaller = replace(later, camera=CAMERA.resized(640, 360), image_rgb=later.image_rgb[::2, ::2])
    assert memory.image_box(smaller) is None


@pytest.mark.parametrize("time_s", [9.9, 15.1, np.nan])
def test_what_is_old_or_of_another_flight_is_forgotten(time_s):
    memory, frame = LastSeen(), frame_at(-800.0, 10.0)
    memory.update(frame, *exact(frame))
    assert memory.expected(frame_at(-800.0, time_s)) is None
    assert memory.expected(frame) is None and memory.image_box(frame) is None


@pytest.mark.parametrize("status", [Status.ONE_LINE, Status.NOT_SEEN])
def test_what_was_not_seen_whole_replaces_nothing(status):
    memory, first, second = LastSeen(), frame_at(-800.0, 0.0), frame_at(-790.0, 1.0)
    assert memory.expected(first) is None
    memory.update(first, *exact(first))
    before = memory.expected(second)
    detection, estimate = exact(second)
    memory.update(second, detection, replace(estimate, status=status))
    np.testing.assert_array_equal(memory.expected(second).left_m, before.left_m)
    assert memory.expected(second).sigma_m == before.sigma_m
