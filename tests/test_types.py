from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera, camera_mount
from deckline.types import NO_CAMERA, Frame, LinePoints, PixelLine, RunwayLine, RunwayPrior, Segment, Truth

CAMERA = Camera(8, 6, 4.0, 4.0, 3.5, 2.5)


def image(height=6, width=8, dtype=np.uint8):
    return np.zeros((height, width, 3), dtype=dtype)


def test_a_frame_knows_where_its_camera_is():
    world_from_body = RigidTransform.from_components([1.0, 2, 3], Rotation.from_euler("z", np.pi / 2))
    frame = Frame("a.png", 0.0, image(), CAMERA, camera_mount([2.0, 0, 0]), world_from_body=world_from_body)
    np.testing.assert_allclose(frame.world_from_camera.apply([0, 0, 5.0]), [1, 9, 3], atol=1e-12)
    assert Frame("a.png", 0.0, image(), CAMERA).world_from_camera is None


def test_a_frame_without_a_camera_has_an_unknown_one_of_its_size():
    for frame in (Frame("a.png", 0.0, image(), None), Frame("a.png", 0.0, image())):
        assert (frame.camera.width, frame.camera.height, frame.camera.known) == (8, 6, False)
        assert frame.missing is NO_CAMERA


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"image_rgb": image(dtype=np.float32)}, "image_rgb.*float32"),
        ({"image_rgb": image(6, 7)}, "8x6.*7x6"),
        ({"image_rgb": image()[..., :1]}, r"image_rgb.*\(6, 8, 1\)"),
        ({"image_rgb": image()[..., 0], "camera": None}, r"image_rgb.*\(6, 8\)"),
        ({"camera": Camera.unknown(8, 6), "world_from_body": camera_mount()}, "world_from_body"),
        ({"camera": None, "world_from_body": camera_mount()}, "world_from_body"),
        ({"depth_m": np.zeros((3, 4), np.float32)}, "depth.*4x3.*8x6"),
    ],
)
def test_frames_that_do_not_fit_name_their_file(fields, message):
    with pytest.raises(ValueError, match=f"a.png.*{message}"):
        Frame(**{"file": "a.png", "time_s": 0.0, "image_rgb": image(), "camera": CAMERA} | fields)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: LinePoints(np.zeros((4, 2)), np.zeros(3), np.zeros(4)), r"LinePoints.confidence.*\(4,\).*\(3,\)"),
        (lambda: LinePoints(np.zeros((4, 3)), np.zeros(4), np.zeros(4)), r"LinePoints.points_px.*\(4, 2\).*\(4, 3\)"),
        (lambda: Segment(np.zeros(3), np.zeros(2)), r"Segment.p1_m must have shape \(3,\), got \(2,\)"),
        (lambda: PixelLine(np.zeros(2), np.ones(4, bool), np.zeros((2, 2)), 1.0), "PixelLine.coefficients"),
        (lambda: RunwayLine(np.zeros(3), 0.0, np.eye(2)), r"RunwayLine.covariance must have shape \(3, 3\)"),
        (lambda: RunwayPrior(np.zeros(3), np.zeros((2, 3)), 1.0, 0.1), r"RunwayPrior.left_m.*\(3,\)"),
        (lambda: RunwayLine(np.zeros(3), 0.0, np.eye(3), np.eye(2)), "RunwayLine.relative_covariance"),
    ],
)
def test_shapes_are_checked_once(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@given(st.floats(-1.5, 1.5), st.floats(-100, 100), st.floats(-100, 100), st.booleans())
def test_a_line_has_the_papers_slope_and_intercept(angle, x, y, reverse):
    line = RunwayLine(np.array([x, y, 6.08]), angle + np.pi * reverse, np.eye(3))
    assert line.height_m == 6.08
    assert np.linalg.norm(line.direction) == pytest.approx(1.0)
    for step in (-10.0, 0.0, 10.0):
        px, py, _ = line.point_m + step * line.direction
        assert py == pytest.approx(line.slope * px + line.intercept_m, abs=1e-6 * (1 + abs(line.slope)))


def test_true_pose_goes_before_the_measured_one():
    measured, true = RigidTransform.from_translation([1.0, 2.0, 3.0]), RigidTransform.from_translation([1.5, 2.0, 3.0])
    frame = Frame("a.png", 0.0, image(), CAMERA, world_from_body=measured)
    assert frame.true_world_from_body is measured
    known = replace(frame, truth=Truth(world_from_body=true))
    np.testing.assert_array_equal(known.true_world_from_camera.translation, [1.5, 2.0, 3.0])
    assert replace(frame, world_from_body=None).true_world_from_camera is None
