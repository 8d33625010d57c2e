import numpy as np
import pytest
from airsim_stand_in import BGR, DEPTH, HALF, StandIn, pose, quaternion, response, vector
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.adapters.airsim.client import Connection
from deckline.adapters.airsim.protocol import read_pose
from deckline.adapters.airsim.source import (
    MountMeasurement,
    interpolate_middle,
    measure_still_mount,
    name_frame,
    read_frame,
    update_mount,
)
from deckline.geometry import Camera, attitude, camera_mount

LEVEL = camera_mount()


def read(scene, depth, mount=LEVEL):
    return read_frame(name_frame("front", scene), scene, depth, mount, np.pi / 2, -18.0, 2.0)


def test_raw_bytes_are_blue_green_red_with_the_top_row_first():
    data = bytes([255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 9, 9, 9, 255, 255, 255])  # blue, green, red / ...
    size = {"width": 3, "height": 2}
    frame = read(response(0, image_data_uint8=data, **size), response(1, image_data_float=[1.0] * 6, **size))
    assert frame.image_rgb.tolist() == [
        [[0, 0, 255], [0, 255, 0], [255, 0, 0]],
        [[0, 0, 0], [9, 9, 9], [255, 255, 255]],
    ]
    assert frame.image_rgb.dtype == np.uint8


def test_a_frame_is_picture_depth_camera_and_pose_of_its_image():
    frame = read(response(0), response(1))
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
    frame = read(response(0, **east), response(1, **east), mount)
    np.testing.assert_allclose(frame.world_from_camera.translation, [10.0, 20.0, -30.0], atol=1e-9)
    np.testing.assert_allclose(frame.world_from_camera.apply([0.0, 0.0, 1.0]), [10.0, 21.0, -30.0], atol=1e-9)
    np.testing.assert_allclose(frame.world_from_body.apply([2.0, 0.0, 0.5]), [10.0, 20.0, -30.0], atol=1e-9)
    nose = frame.world_from_body.rotation.apply([1.0, 0.0, 0.0])  # 0.2 rad above the camera's level view
    np.testing.assert_allclose(nose, [0.0, np.cos(0.2), -np.sin(0.2)], atol=1e-9)


def test_half_precision_far_depth_and_no_distance_are_unknown():
    numbers = DEPTH.ravel().tolist()
    numbers[:4] = [65504.0, float("inf"), 0.0, float("nan")]
    frame = read(response(0), response(1, image_data_float=numbers))
    np.testing.assert_array_equal(np.isnan(frame.depth_m), [[True] * 4, [False] * 4, [False] * 4])


@pytest.mark.parametrize(
    ("scene", "depth", "text"),
    [
        ({"image_data_uint8": BGR.tobytes()[:-1]}, {}, r"Scene of 4x3 px.*36.*35 bytes"),
        ({"image_data_uint8": "text"}, {}, "Scene.*str"),
        ({"width": 0, "height": 0, "message": "camera is not set"}, {}, r"Scene.*\(camera is not set\)"),
        ({"width": -4}, {}, "Scene"),
        ({"time_stamp": None}, {}, "time stamp.*None"),
        ({"camera_position": vector(float("nan"), 0, 0)}, {}, "Scene: position.*nan"),
        ({"camera_orientation": quaternion(0, 0, 0, 0)}, {}, "Scene: quaternion.*0"),
        ({"camera_orientation": None}, {}, "Scene: orientation.*None"),
        ({}, {"image_data_float": [0.0], "image_data_uint8": BGR.tobytes()}, "DepthPlanar of 4x3 px.*grey"),
        ({}, {"image_data_float": [1.0] * 11}, "DepthPlanar.*12.*11"),
        ({}, {"image_data_float": ["x"] * 12}, "DepthPlanar"),
        ({}, {"width": 3, "height": 4}, "DepthPlanar.*3x4.*4x3"),
        ({}, {"width": 0}, "DepthPlanar"),
    ],
)
def test_broken_answers_name_the_broken_part(scene, depth, text):
    with pytest.raises(ValueError, match=text):
        read(response(0, **scene), response(1, **depth))


@pytest.mark.parametrize(
    ("turn", "position", "apart"),
    [((1, 0, 0, 0), (1.33, 2, -3), "0.33 m and 0 deg"), ((HALF, 0, 0, HALF), (1, 2, -3), "0 m and 90 deg")],
)
def test_picture_and_depth_of_two_instants_are_refused(turn, position, apart):
    later = {"camera_position": vector(*position), "camera_orientation": quaternion(*turn)}
    with pytest.raises(ValueError, match=f"picture and depth were taken {apart} apart"):
        read(response(0), response(1, **later))


def test_single_precision_of_a_pose_far_from_the_origin_is_no_difference():
    at = {"camera_position": vector(5000.0001, 2, -3), "camera_orientation": quaternion(1, 1e-7, 0, 0)}
    near = response(0, camera_position=vector(5000, 2, -3))
    assert read(near, response(1, **at)).world_from_body is not None


def measure(**methods):
    with StandIn(**methods) as server, Connection("127.0.0.1", server.port) as connection:
        return measure_still_mount(connection, "0", ""), len(server.calls)


def test_the_mount_of_a_vehicle_that_stands_still_is_exact_at_once():
    turned = (HALF, 0.0, 0.0, HALF)  # vehicle and camera look east; the camera sits 2 m ahead and 0.5 m below
    found, calls = measure(
        simGetVehiclePose=lambda *_params: pose((10, 20, -30), turned),
        simGetCameraInfo=lambda *_params: {"pose": pose((10, 22, -29.5), turned), "fov": 60.0},
    )
    assert calls == 3
    assert (found.motion_m, found.rotation_rad) == (0.0, 0.0)
    np.testing.assert_allclose(found.fov_rad, np.pi / 3)
    np.testing.assert_allclose(found.body_from_camera.translation, [2.0, 0.0, 0.5], atol=1e-9)
    np.testing.assert_allclose(found.body_from_camera.rotation.apply([0.0, 0.0, 1.0]), [1.0, 0.0, 0.0], atol=1e-9)


def test_of_a_moving_vehicle_the_calmest_measurement_counts_half_way():
    steps = [0.4] * 6 + [0.1] * 3 + [0.4] * 90  # metres between two questions
    place = iter(np.cumsum(steps))
    found, calls = measure(
        simGetVehiclePose=lambda *_params: pose((next(place), 0, 0)),
        simGetCameraInfo=lambda *_params: {"pose": pose((next(place) + 1.5, 0, 0)), "fov": 90.0},
    )
    assert calls == 60
    np.testing.assert_allclose(found.motion_m, 0.2)
    np.testing.assert_allclose(found.body_from_camera.translation, [1.5, 0.0, 0.0], atol=1e-9)


def test_only_a_sharp_enough_part_of_a_new_measurement_is_taken():
    before = camera_mount([1.0, 0.0, 0.0])
    after = camera_mount([1.2, 0.0, 0.0], attitude(0.0, -0.3, 0.0))
    still = update_mount(before, MountMeasurement(after, 1.0, 0.0, 0.0))
    np.testing.assert_allclose(still.as_matrix(), after.as_matrix(), atol=1e-12)
    fast = update_mount(before, MountMeasurement(after, 1.0, 0.3, 0.0))
    np.testing.assert_allclose(fast.translation, [1.0, 0.0, 0.0])
    assert (fast.rotation.inv() * after.rotation).magnitude() < 1e-12
    turning = update_mount(before, MountMeasurement(after, 1.0, 0.3, 0.01))
    np.testing.assert_allclose(turning.as_matrix(), before.as_matrix())


def test_half_way_between_two_poses():
    first = read_pose(pose((0, 0, 0)), "")
    half = interpolate_middle(first, read_pose(pose((2, 4, 6), (HALF, 0, 0, HALF)), ""))
    assert half.translation.tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(half.rotation.as_euler("ZYX", degrees=True), [45.0, 0.0, 0.0], atol=1e-9)
    negated = RigidTransform.from_rotation(Rotation.from_quat(-half.rotation.as_quat()))  # the same rotation
    same = interpolate_middle(RigidTransform.from_rotation(half.rotation), negated)
    assert (same.rotation.inv() * half.rotation).magnitude() < 1e-9
