"""AirSim's structures as maps, to and from deckline's types.

A pose is world_from_body, or for a camera the pose of its mount, whose x axis is the viewing axis: North-East-Down and
forward-right-down, metres, quaternions by name.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from deckline.geometry import BODY_FROM_OPTICAL, Camera, pose

FARTHEST_M = 1e6  # a position beyond this is a mistake, and more than the renderer's single precision can place
NEAR_PLANE = 10.0  # of AirSim's projection matrix, centimetres
EARTH_M = 6378137.0  # equatorial radius, WGS 84
MOUNT_FROM_OPTICAL = RigidTransform.from_rotation(BODY_FROM_OPTICAL)

Struct = dict[str, Any]


def vector(values: ArrayLike) -> Struct:
    """Vector3r of (3,)."""
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return {"x_val": x, "y_val": y, "z_val": z}


def pose_struct(transform: RigidTransform) -> Struct:
    """Pose."""
    x, y, z, w = transform.rotation.as_quat().tolist()
    turned = {"w_val": w, "x_val": x, "y_val": y, "z_val": z}
    return {"position": vector(transform.translation), "orientation": turned}


def no_pose() -> Struct:
    """What AirSim answers for an object that is not there: NaN everywhere."""
    nan = {"x_val": math.nan, "y_val": math.nan, "z_val": math.nan}
    return {"position": nan, "orientation": nan | {"w_val": math.nan}}


def read_pose(value: Any, kept: RigidTransform) -> RigidTransform:
    """A Pose. A position or an orientation with NaN is taken from `kept`.

    Raises:
        ValueError: no Pose, infinite numbers, a quaternion whose length is not near 1, or a position too far away.
    """
    position = _numbers(value, "position", "xyz")
    orientation = _numbers(value, "orientation", "wxyz")
    if np.isnan(position).any():
        position = kept.translation
    if np.isnan(orientation).any():
        orientation = kept.rotation.as_quat(scalar_first=True)
    if np.isfinite(position).all() and np.abs(position).max() > FARTHEST_M:
        raise ValueError(f"position {position.tolist()} is farther than {FARTHEST_M:g} m from the origin")
    return pose(position, orientation)


def camera_info(world_from_mount: RigidTransform, camera: Camera) -> Struct:
    """CameraInfo: pose in the world, horizontal field of view in degrees, projection matrix.

    The matrix takes (north, east, down, 1) of the mount to clip space, w to the back, as AirSim has it.
    """
    matrix = [
        [0.0, 2.0 * camera.fx / camera.width, 0.0, 0.0],
        [0.0, 0.0, -2.0 * camera.fy / camera.height, 0.0],
        [0.0, 0.0, 0.0, NEAR_PLANE],
        [-1.0, 0.0, 0.0, 0.0],
    ]
    fov_deg = math.degrees(2.0 * math.atan(camera.width / (2.0 * camera.fx)))
    return {"pose": pose_struct(world_from_mount), "fov": fov_deg, "proj_mat": {"matrix": matrix}}


def kinematics(world_from_body: RigidTransform) -> Struct:
    """KinematicsState of a vehicle that is put where it is: it has no speed."""
    names = ("linear_velocity", "angular_velocity", "linear_acceleration", "angular_acceleration")
    return pose_struct(world_from_body) | {name: vector((0.0, 0.0, 0.0)) for name in names}


def geo_point(position_m: ArrayLike, origin: tuple[float, float, float]) -> Struct:
    """GeoPoint of a world position on a sphere: good to a metre or two within 10 km.

    Args:
        origin: latitude, deg, longitude, deg, and altitude, m, of the world's origin.
    """
    north, east, down = np.asarray(position_m, dtype=np.float64).tolist()
    latitude = origin[0] + math.degrees(north / EARTH_M)
    longitude = origin[1] + math.degrees(east / (EARTH_M * math.cos(math.radians(origin[0]))))
    return {"latitude": latitude, "longitude": longitude, "altitude": origin[2] - down}


def collision(time_ns: int) -> Struct:
    """CollisionInfo: vehicles fly through everything."""
    zero = vector((0.0, 0.0, 0.0))
    return {
        "has_collided": False,
        "normal": zero,
        "impact_point": zero,
        "position": zero,
        "penetration_depth": 0.0,
        "time_stamp": time_ns,
        "object_name": "",
        "object_id": -1,
    }


def multirotor_state(world_from_body: RigidTransform, origin: tuple[float, float, float], time_ns: int) -> Struct:
    """MultirotorState of a vehicle in flight."""
    channels = dict.fromkeys(("pitch", "roll", "throttle", "yaw"), 0.0)
    switches = dict.fromkeys((f"switch{number}" for number in range(1, 9)), 0)
    return {
        "collision": collision(time_ns),
        "kinematics_estimated": kinematics(world_from_body),
        "gps_location": geo_point(world_from_body.translation, origin),
        "timestamp": time_ns,
        "landed_state": 1,
        "rc_data": {"timestamp": 0, "is_initialized": False, "is_valid": False} | channels | switches,
        "ready": True,
        "ready_message": "",
        "can_arm": True,
    }


def _numbers(value: Any, name: str, axes: str) -> np.ndarray:
    part = value.get(name) if isinstance(value, Mapping) else None
    if not isinstance(part, Mapping):
        raise ValueError(f"a pose needs {name} with {', '.join(f'{axis}_val' for axis in axes)}")
    return np.array([real(part.get(f"{axis}_val"), f"{name}.{axis}_val") for axis in axes])


def real(value: Any, name: str) -> float:
    """A number, NaN and infinity included.

    Raises:
        ValueError: anything else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} must be a number, got {type(value).__name__}")
    return float(value)
