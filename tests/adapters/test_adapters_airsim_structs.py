import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.adapters.airsim.structs import camera_info, geo_point, multirotor_state, no_pose, pose_struct, read_pose
from deckline.geometry import Camera, pose

numbers = st.floats(-1000.0, 1000.0)
HERE = pose((1.0, 2.0, -3.0), (0.5, 0.5, 0.5, 0.5))
NAN = math.nan


@given(st.tuples(numbers, numbers, numbers), st.integers(0, 2**32 - 1))
def test_poses_come_back(position, seed):
    given_pose = RigidTransform.from_components(position, Rotation.random(rng=np.random.default_rng(seed)))
    back = read_pose(pose_struct(given_pose), HERE)
    np.testing.assert_allclose(back.as_matrix(), given_pose.as_matrix(), atol=1e-12)


def test_nan_keeps_each_part():
    np.testing.assert_allclose(read_pose(no_pose(), HERE).as_matrix(), HERE.as_matrix(), atol=1e-12)
    one = pose_struct(pose((7.0, 8.0, -9.0), (1.0, 0.0, 0.0, 0.0)))
    one["orientation"]["x_val"] = NAN
    mixed = read_pose(one, HERE)
    np.testing.assert_allclose(mixed.translation, [7.0, 8.0, -9.0])
    np.testing.assert_allclose(mixed.rotation.as_matrix(), HERE.rotation.as_matrix(), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"position": {"x_val": 1e7, "y_val": 0, "z_val": 0}}, "farther than 1e"),
        ({"position": {"x_val": math.inf, "y_val": 0, "z_val": 0}}, "position is not finite"),
        ({"position": {"x_val": "1", "y_val": 0, "z_val": 0}}, "position.x_val must be a number, got str"),
        ({"position": [1, 2, 3]}, "a pose needs position with x_val, y_val, z_val"),
        ({"orientation": dict.fromkeys(("w_val", "x_val", "y_val", "z_val"), 0)}, "length 0"),
    ],
)
def test_what_is_no_pose_is_named(change, says):
    with pytest.raises(ValueError, match=says):
        read_pose(pose_struct(HERE) | change, HERE)
    with pytest.raises(ValueError, match="a pose needs position"):
        read_pose(None, HERE)


def test_the_projection_matrix_is_airsims():
    camera = Camera.from_fov(1280, 720, math.radians(70.0))
    matrix = np.array(camera_info(HERE, camera)["proj_mat"]["matrix"])
    ahead, right, down = 30.0, 4.0, -2.0
    x, y, _, w = matrix @ [ahead, right, down, 1.0]
    u, v = camera.project([[right, down, ahead]])[0]
    # AirSim's w points backwards: the pixel is at the negative of both, y upwards
    assert -x / w == pytest.approx((u + 0.5) / 640.0 - 1.0)
    assert -y / w == pytest.approx(1.0 - (v + 0.5) / 360.0)


def test_geo_points_are_where_the_sphere_has_them():
    mile = geo_point((1852.0, 0.0, -100.0), (45.0, 10.0, 5.0))
    assert mile["latitude"] == pytest.approx(45.0 + 1 / 60, rel=1e-4) and mile["altitude"] == 105.0
    east = geo_point((0.0, 1852.0, 0.0), (60.0, 10.0, 5.0))
    assert east["longitude"] - 10.0 == pytest.approx(2 / 60, rel=5e-3)  # the parallel is half as long there


def test_states_have_the_fields_of_the_published_client():
    airsim = pytest.importorskip("cosysairsim")
    state = airsim.MultirotorState.from_msgpack(multirotor_state(HERE, (45.0, 10.0, 5.0), 9))
    assert {name for name in dir(airsim.MultirotorState) if not name.startswith(("_", "to_", "from_"))} == set(
        vars(state)
    )
    assert {name for name in dir(airsim.CollisionInfo()) if not name.startswith(("_", "to_", "from_"))} == set(
        vars(state.collision)
    )
    assert state.kinematics_estimated.linear_velocity.get_length() == 0.0
