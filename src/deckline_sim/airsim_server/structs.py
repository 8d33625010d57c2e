"""AirSim's structures as maps, as its server sends them.

Source: AirSim's API.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.protocol import read_number
from deckline.geometry import Camera
from deckline_sim.airsim_server.kinematics import Collision, VehicleMotion

NEAR_PLANE = 10.0  # of AirSim's projection matrix, centimetres
EARTH_M = 6378137.0  # equatorial radius, WGS 84

Struct = dict[str, Any]


def vector_struct(values: ArrayLike) -> Struct:
    """Vector3r of (3,)."""
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return {"x_val": x, "y_val": y, "z_val": z}


def pose_struct(transform: RigidTransform) -> Struct:
    """Pose."""
    w, x, y, z = transform.rotation.as_quat(scalar_first=True).tolist()
    orientation = {"w_val": w, "x_val": x, "y_val": y, "z_val": z}
    return {"position": vector_struct(transform.translation), "orientation": orientation}


def unknown_pose_struct() -> Struct:
    """The Pose that AirSim answers for an object that is not there: NaN everywhere."""
    position = vector_struct([math.nan] * 3)
    return {"position": position, "orientation": {"w_val": math.nan} | position}


def camera_struct(world_from_mount: RigidTransform, camera: Camera) -> Struct:
    """CameraInfo: pose in the world, horizontal field of view in degrees, projection matrix.

    The matrix takes (north, east, down, 1) of the mount to clip space, with w to the back, as AirSim's does.
    """
    matrix = [
        [0.0, 2.0 * camera.fx / camera.width, 0.0, 0.0],
        [0.0, 0.0, -2.0 * camera.fy / camera.height, 0.0],
        [0.0, 0.0, 0.0, NEAR_PLANE],
        [-1.0, 0.0, 0.0, 0.0],
    ]
    fov_deg = math.degrees(2.0 * math.atan(camera.width / (2.0 * camera.fx)))
    return {"pose": pose_struct(world_from_mount), "fov": fov_deg, "proj_mat": {"matrix": matrix}}


def kinematics_struct(motion: VehicleMotion) -> Struct:
    """KinematicsState."""
    vectors = {
        "linear_velocity": motion.velocity,
        "angular_velocity": motion.rates,
        "linear_acceleration": motion.acceleration,
        "angular_acceleration": np.zeros(3),
    }
    return pose_struct(motion.pose) | {name: vector_struct(vector) for name, vector in vectors.items()}


def collision_struct(collision: Collision | None, time_ns: int) -> Struct:
    """CollisionInfo of a contact at a time stamp; None: of none."""
    position, normal = (np.zeros(3), np.zeros(3)) if collision is None else (collision.position, collision.normal)
    return {
        "has_collided": collision is not None,
        "normal": vector_struct(normal),
        "impact_point": vector_struct(position),
        "position": vector_struct(position),
        "penetration_depth": 0.0,
        "time_stamp": time_ns,
        "object_name": "" if collision is None else collision.name,
        "object_id": -1,
    }


def geo_struct(position_m: ArrayLike, origin: tuple[float, float, float]) -> Struct:
    """GeoPoint of a world position on a sphere: good to a metre or two within 10 km.

    Args:
        position_m: (3,), world NED.
        origin: latitude, deg, longitude, deg, and altitude, m, of the world's origin.
    """
    north, east, down = np.asarray(position_m, dtype=np.float64).tolist()
    latitude = origin[0] + math.degrees(north / EARTH_M)
    longitude = origin[1] + math.degrees(east / (EARTH_M * math.cos(math.radians(origin[0]))))
    return {"latitude": latitude, "longitude": longitude, "altitude": origin[2] - down}


def read_geo(latitude: Any, longitude: Any, altitude: Any, origin: tuple[float, float, float]) -> NDArray[np.float64]:
    """The world position (3,) of a GeoPoint: the inverse of `geo_struct`. No number is a ValueError."""
    north = math.radians(read_number(latitude, "latitude", -90.0, 90.0) - origin[0]) * EARTH_M
    east = math.radians(read_number(longitude, "longitude", -180.0, 180.0) - origin[1]) * EARTH_M
    down = origin[2] - read_number(altitude, "altitude", -1e5, 1e5)
    return np.array([north, east * math.cos(math.radians(origin[0])), down])


def multirotor_struct(motion: VehicleMotion, origin: tuple[float, float, float], time_ns: int) -> Struct:
    """MultirotorState. Only simGetCollisionInfo reports contacts, each once."""
    channels = dict.fromkeys(("pitch", "roll", "throttle", "yaw"), 0.0)
    switches = dict.fromkeys((f"switch{number}" for number in range(1, 9)), 0)
    return {
        "collision": collision_struct(None, time_ns),
        "kinematics_estimated": kinematics_struct(motion),
        "gps_location": geo_struct(motion.pose.translation, origin),
        "timestamp": time_ns,
        "landed_state": int(not motion.landed),
        "rc_data": {"timestamp": 0, "is_initialized": False, "is_valid": False} | channels | switches,
        "ready": True,
        "ready_message": "",
        "can_arm": True,
    }
