import numpy as np
from airsim_stand_in import HALF, StandIn, pose
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.adapters.airsim.client import Connection, pose_from
from deckline.adapters.airsim.mount import Look, best_look, followed, middle
from deckline.geometry import attitude, camera_mount


def best(**methods):
    with StandIn(**methods) as server, Connection("127.0.0.1", server.port) as connection:
        return best_look(connection, "0", ""), len(server.calls)


def test_the_mount_of_a_vehicle_that_stands_still_is_exact_at_once():
    turned = (HALF, 0.0, 0.0, HALF)  # vehicle and camera look east; the camera sits 2 m ahead and 0.5 m below
    found, calls = best(
        simGetVehiclePose=lambda *_params: pose((10, 20, -30), turned),
        simGetCameraInfo=lambda *_params: {"pose": pose((10, 22, -29.5), turned), "fov": 60.0},
    )
    assert calls == 3
    assert (found.moved_m, found.turned_rad) == (0.0, 0.0)
    np.testing.assert_allclose(found.fov_rad, np.pi / 3)
    np.testing.assert_allclose(found.body_from_camera.translation, [2.0, 0.0, 0.5], atol=1e-9)
    np.testing.assert_allclose(found.body_from_camera.rotation.apply([0.0, 0.0, 1.0]), [1.0, 0.0, 0.0], atol=1e-9)


def test_of_a_moving_vehicle_the_calmest_look_counts_half_way():
    steps = [0.4] * 6 + [0.1] * 3 + [0.4] * 90  # metres between two questions
    place = iter(np.cumsum(steps))
    found, calls = best(
        simGetVehiclePose=lambda *_params: pose((next(place), 0, 0)),
        simGetCameraInfo=lambda *_params: {"pose": pose((next(place) + 1.5, 0, 0)), "fov": 90.0},
    )
    assert calls == 60
    np.testing.assert_allclose(found.moved_m, 0.2)
    np.testing.assert_allclose(found.body_from_camera.translation, [1.5, 0.0, 0.0], atol=1e-9)


def looked(mount, moved_m=0.0, turned_rad=0.0):
    return Look(mount, 1.0, moved_m, turned_rad)


def test_only_what_is_sharp_enough_of_a_new_look_is_taken():
    before = camera_mount([1.0, 0.0, 0.0])
    now = camera_mount([1.2, 0.0, 0.0], attitude(0.0, -0.3, 0.0))
    still = followed(before, looked(now))
    np.testing.assert_allclose(still.as_matrix(), now.as_matrix(), atol=1e-12)
    fast = followed(before, looked(now, moved_m=0.3))
    np.testing.assert_allclose(fast.translation, [1.0, 0.0, 0.0])
    assert (fast.rotation.inv() * now.rotation).magnitude() < 1e-12
    turning = followed(before, looked(now, moved_m=0.3, turned_rad=0.01))
    np.testing.assert_allclose(turning.as_matrix(), before.as_matrix())


def test_half_way_between_two_poses():
    first = pose_from(pose((0, 0, 0)), "")
    half = middle(first, pose_from(pose((2, 4, 6), (HALF, 0, 0, HALF)), ""))
    assert half.translation.tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(half.rotation.as_euler("ZYX", degrees=True), [45.0, 0.0, 0.0], atol=1e-9)


def test_half_way_does_not_depend_on_a_quaternions_sign():
    turn = Rotation.from_rotvec([0.1, 0.2, 0.3])
    first = RigidTransform.from_components([0.0, 0.0, 0.0], turn)
    second = RigidTransform.from_components([0.0, 0.0, 0.0], Rotation.from_quat(-turn.as_quat()))
    assert (middle(first, second).rotation.inv() * turn).magnitude() < 1e-9
