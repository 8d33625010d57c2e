import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deckline.geometry import Camera, attitude, camera_mount, intersect_plane, pose, wrap_angle

LENSES = [(0.0,) * 5, (-0.12, 0.03, 0.001, -0.0005, 0.002), (0.1, -0.02, -0.002, 0.001, 0.0)]
CAMERA = Camera(1280, 720, 640.0, 620.0, 639.5, 350.0)
finite = st.floats(-100, 100)


def lens(distortion):
    return Camera(1280, 720, 640.0, 620.0, 639.5, 350.0, distortion)


@pytest.mark.parametrize("distortion", LENSES)
def test_projection_agrees_with_opencv(distortion):
    points = np.random.default_rng(0).uniform([-8, -5, 10], [8, 5, 30], (200, 3))
    camera = lens(distortion)
    peer, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, np.array(distortion))
    np.testing.assert_allclose(camera.project(points), peer[:, 0], atol=1e-9)


@pytest.mark.parametrize("distortion", LENSES)
@settings(max_examples=60, deadline=None)
@given(st.floats(0, 1279), st.floats(0, 719), st.floats(0.1, 1e4))
def test_rays_undo_projection(distortion, u, v, depth):
    camera = lens(distortion)
    ray = camera.rays([[u, v]])
    assert ray[0, 2] == 1.0
    np.testing.assert_allclose(camera.project(ray * depth), [[u, v]], atol=1e-6)


def test_points_behind_the_camera_have_no_pixel():
    pixels = CAMERA.project([[1.0, 1.0, -2.0], [0.0, 0.0, 0.0], [0.0, 0.0, 5.0]])
    assert np.isnan(pixels[:2]).all()
    np.testing.assert_allclose(pixels[2], [639.5, 350.0])


def test_a_pixel_that_no_ray_reaches_is_nan_and_the_others_stay_exact():
    camera = lens((-0.28, 0.08, 0.0, 0.0, -0.01))
    rays = camera.rays([[0.0, 0.0], [640.0, 600.0]])
    assert np.isnan(rays[0, :2]).all()
    np.testing.assert_allclose(camera.project(rays[1:]), [[640.0, 600.0]], atol=1e-6)


def test_airsim_field_of_view():
    camera = Camera.from_fov(1280, 720, np.deg2rad(90))
    assert camera.fx == camera.fy == pytest.approx(640.0)
    # From outer edge to outer edge (half a pixel beyond the pixels' centres) the image spans the field of view.
    left, right = camera.rays([[-0.5, 359.5], [1279.5, 359.5]])
    assert np.arctan(right[0]) - np.arctan(left[0]) == pytest.approx(np.pi / 2)
    assert camera.cx == 639.5
    assert camera.cy == 359.5


@pytest.mark.parametrize("distortion", LENSES)
def test_resizing_leaves_what_a_direction_sees(distortion):
    camera = lens(distortion)
    small = camera.resized(320, 360)
    point = [[1.0, 0.5, 4.0]]
    u, v = camera.project(point)[0]
    np.testing.assert_allclose(small.project(point)[0], [(u + 0.5) / 4 - 0.5, (v + 0.5) / 2 - 0.5], atol=1e-9)


def test_ray_lengths_turn_depth_into_range():
    camera = Camera(5, 4, 3.0, 3.0, 2.0, 1.5)
    lengths = camera.ray_lengths()
    assert lengths.shape == (4, 5)
    assert lengths.dtype == np.float32
    assert lengths[0, 4] == pytest.approx(np.sqrt(1 + (2 / 3) ** 2 + (1.5 / 3) ** 2), rel=1e-6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Camera(0, 10, 1, 1, 0, 0), r"camera\.width.* 0"),
        (lambda: Camera(10, 10, -1, 1, 0, 0), r"camera\.fx.*-1"),
        (lambda: Camera(10, 10, 1, 1, float("nan"), 0), r"camera\.cx.*nan"),
        (lambda: Camera(10, 10, 1, 1, 0, 0, (float("inf"), 0, 0, 0, 0)), r"camera\.distortion.*inf"),
        (lambda: Camera(10, 10, 1, 1, 0, 0, (0.1, 0.2)), "distortion.* 2 "),
        (lambda: Camera.from_fov(10, 10, 4.0), r"field of view.*4\.0"),
        (lambda: CAMERA.rays(np.zeros(3)), r"\(N, 2\).*\(3,\)"),
        (lambda: CAMERA.project([[1.0, 2.0]]), r"\(N, 3\).*\(1, 2\)"),
        (lambda: pose([0, 0], [1, 0, 0, 0]), r"\(2,\) and \(4,\)"),
        (lambda: pose([0, 0, np.nan], [1, 0, 0, 0]), "position.*nan"),
        (lambda: pose([0, 0, 0], [1, 0, 0, np.inf]), "quaternion.*inf"),
        (lambda: pose([0, 0, 0], [0, 0, 0, 0]), "quaternion.*length 0,"),
        (lambda: pose([0, 0, 0], [0.52, 0, 0, 0]), "quaternion.*0.52"),
    ],
)
def test_impossible_cameras_points_and_poses_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_pose_reads_a_scalar_first_quaternion():
    quarter = pose([1, 2, 3], [np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)])
    np.testing.assert_allclose(quarter.apply([1.0, 0, 0]), [1, 3, 3], atol=1e-12)


def test_attitude_turns_yaw_right_pitch_up_roll_right():
    np.testing.assert_allclose(attitude(0, 0, np.pi / 2).apply([1, 0, 0]), [0, 1, 0], atol=1e-12)  # north to east
    np.testing.assert_allclose(attitude(0, np.pi / 2, 0).apply([1, 0, 0]), [0, 0, -1], atol=1e-12)  # nose up
    np.testing.assert_allclose(attitude(np.pi / 2, 0, 0).apply([0, 1, 0]), [0, 0, 1], atol=1e-12)  # right wing down
    # Yaw first, then pitch: the nose of a yawed and pitched aircraft has the yaw's heading.
    nose = attitude(0.3, 0.2, 1.0).apply([1, 0, 0])
    assert np.arctan2(nose[1], nose[0]) == pytest.approx(1.0)
    assert np.arcsin(-nose[2]) == pytest.approx(0.2)


def test_the_mounted_camera_points_forward_with_right_and_down():
    body_from_camera = camera_mount([1.0, 0.5, -0.2])
    np.testing.assert_allclose(body_from_camera.apply([0, 0, 2.0]), [3.0, 0.5, -0.2])
    np.testing.assert_allclose(body_from_camera.apply([2.0, 0, 0]), [1.0, 2.5, -0.2])
    np.testing.assert_allclose(body_from_camera.apply([0, 2.0, 0]), [1.0, 0.5, 1.8])
    tilted = camera_mount(mount=Rotation.from_euler("y", -np.pi / 2))
    np.testing.assert_allclose(tilted.apply([0, 0, 1.0]), [0, 0, 1.0], atol=1e-12)  # looks straight down


def test_the_reach_of_a_pinhole_is_its_field_of_view():
    low, high = Camera.from_fov(101, 51, np.pi / 2).reach
    np.testing.assert_allclose([low, high], [[-100 / 101, -50 / 101], [100 / 101, 50 / 101]])


slopes = st.one_of(st.just(0.0), st.floats(1e-9, 100), st.floats(-100, -1e-9))


@given(st.tuples(finite, finite, finite), st.tuples(finite, finite, slopes), finite)
def test_intersections_lie_on_the_plane_ahead_of_the_origin(origin, direction, plane_z):
    hit = intersect_plane(origin, [direction], plane_z)[0]
    if np.isnan(hit).any():
        assert direction[2] == 0 or (plane_z - origin[2]) / direction[2] <= 0
        return
    step = (plane_z - origin[2]) / direction[2]
    assert step > 0
    assert hit[2] == pytest.approx(plane_z, abs=1e-6)
    np.testing.assert_allclose(hit, np.asarray(origin) + step * np.asarray(direction), atol=1e-6, rtol=1e-9)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_are_the_same_direction(angle):
    wrapped = float(wrap_angle(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-9)
