import numpy as np
import pytest
from airsim_stand_in import BGR, DEPTH, HALF, pose, quaternion, response, vector

from deckline.adapters.airsim.client import pose_from
from deckline.adapters.airsim.frames import View, float_image, live_frame, raw_image
from deckline.geometry import Camera, attitude, camera_mount

VIEW = View("front", camera_mount(), np.pi / 2, deck_z_m=-18.0, sea_z_m=2.0)


def test_raw_bytes_are_blue_green_red_with_the_top_row_first():
    data = bytes([255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 9, 9, 9, 255, 255, 255])  # blue, green, red / ...
    image = raw_image(response(0, image_data_uint8=data, width=3, height=2))
    assert image.tolist() == [[[0, 0, 255], [0, 255, 0], [255, 0, 0]], [[0, 0, 0], [9, 9, 9], [255, 255, 255]]]
    assert image.dtype == np.uint8


def test_a_frame_is_picture_depth_camera_and_pose_of_its_image():
    frame = live_frame(response(0), response(1), VIEW)
    assert frame.file == "front#1700000000250000000"
    assert frame.time_s == 1_700_000_000.25
    np.testing.assert_array_equal(frame.image_rgb, BGR[:, :, ::-1])
    np.testing.assert_array_equal(frame.depth_m, DEPTH)
    assert frame.camera.__dict__ == Camera.from_fov(4, 3, np.pi / 2).__dict__
    assert (frame.deck_z_m, frame.sea_z_m) == (-18.0, 2.0)
    # AirSim's camera looks along its own x; the optical frame's z is the same direction
    np.testing.assert_allclose(frame.world_from_camera.apply([0.0, 0.0, 5.0]), [6.0, 2.0, -3.0], atol=1e-12)
    np.testing.assert_allclose(frame.world_from_body.translation, [1.0, 2.0, -3.0])


def test_the_body_stands_where_the_mount_says_while_the_camera_is_where_the_image_was_taken():
    mount = camera_mount([2.0, 0.0, 0.5], attitude(0.0, -0.2, 0.0))
    east = {"camera_position": vector(10, 20, -30), "camera_orientation": quaternion(HALF, 0, 0, HALF)}
    frame = live_frame(response(0, **east), response(1, **east), View("0", mount, 1.0))
    np.testing.assert_allclose(frame.world_from_camera.translation, [10.0, 20.0, -30.0], atol=1e-9)
    np.testing.assert_allclose(frame.world_from_camera.apply([0.0, 0.0, 1.0]), [10.0, 21.0, -30.0], atol=1e-9)
    np.testing.assert_allclose(frame.world_from_body.apply([2.0, 0.0, 0.5]), [10.0, 20.0, -30.0], atol=1e-9)
    nose = frame.world_from_body.rotation.apply([1.0, 0.0, 0.0])  # 0.2 rad above the camera's level view
    np.testing.assert_allclose(nose, [0.0, np.cos(0.2), -np.sin(0.2)], atol=1e-9)


def test_half_precision_far_depth_and_no_distance_are_unknown():
    numbers = DEPTH.ravel().tolist()
    numbers[:4] = [65504.0, float("inf"), 0.0, float("nan")]
    frame = live_frame(response(0), response(1, image_data_float=numbers), VIEW)
    np.testing.assert_array_equal(np.isnan(frame.depth_m), [[True] * 4, [False] * 4, [False] * 4])


def test_depth_that_came_as_a_grey_picture_is_refused():
    grey = response(1, image_data_uint8=BGR.tobytes(), image_data_float=[0.0], pixels_as_float=False)
    with pytest.raises(ValueError, match="came without numbers: its grey levels are no metres"):
        float_image(grey)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"image_data_uint8": BGR.tobytes()[:-1]}, r"4x3 px must have 36 bytes \(B, G, R\), got 35 bytes"),
        ({"image_data_uint8": "text"}, "got str"),
        ({"width": 0, "height": 0, "message": "camera is not set"}, r"Scene came empty \(camera is not set\)"),
        ({"width": -4}, "Scene came empty"),
        ({"time_stamp": None}, "no time stamp in ns, got None"),
        ({"camera_position": vector(float("nan"), 0, 0)}, "Scene: position is not finite"),
        ({"camera_orientation": quaternion(0, 0, 0, 0)}, "Scene: quaternion has length 0"),
        ({"camera_orientation": None}, "Scene has no pose"),
    ],
)
def test_a_broken_picture_says_what_is_broken(changes, text):
    with pytest.raises(ValueError, match=text):
        live_frame(response(0, **changes), response(1), VIEW)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"image_data_float": [1.0] * 11}, "must have 12 numbers, got 11"),
        ({"image_data_float": ["x"] * 12}, "holds what is no number"),
        ({"width": 3, "height": 4}, "depth DepthPlanar is 3x4 px but the image is 4x3 px"),
        ({"width": 0}, "DepthPlanar came empty"),
    ],
)
def test_broken_depth_says_what_is_broken(changes, text):
    with pytest.raises(ValueError, match=text):
        live_frame(response(0), response(1, **changes), VIEW)


@pytest.mark.parametrize(
    ("turn", "position", "apart"),
    [((1, 0, 0, 0), (1.33, 2, -3), "0.33 m and 0 deg"), ((HALF, 0, 0, HALF), (1, 2, -3), "0 m and 90 deg")],
)
def test_picture_and_depth_of_two_instants_are_refused(turn, position, apart):
    later = {"camera_position": vector(*position), "camera_orientation": quaternion(*turn)}
    with pytest.raises(ValueError, match=f"picture and depth were taken {apart} apart"):
        live_frame(response(0), response(1, **later), VIEW)


def test_single_precision_of_a_pose_far_from_the_origin_is_no_difference():
    at = {"camera_position": vector(5000.0001, 2, -3), "camera_orientation": quaternion(1, 1e-7, 0, 0)}
    near = response(0, camera_position=vector(5000, 2, -3))
    assert live_frame(near, response(1, **at), VIEW).world_from_body is not None
    assert pose_from(pose((5000, 2, -3)), "").translation.tolist() == [5000.0, 2.0, -3.0]
