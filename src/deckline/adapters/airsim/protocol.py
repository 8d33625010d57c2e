"""AirSim's wire format: msgpack-rpc messages, and AirSim's structures as maps.

Requests are [0, id, method, params], answers [1, id, error, result], notes [2, method, params]. Messages follow each
other without length or separator. Nothing that is received is evaluated: None, booleans, numbers, text, bytes, lists
and maps come out. Poses are world_from_body, or for a camera the pose of its mount, whose x axis is the viewing axis:
North-East-Down and forward-right-down, metres, quaternions by name.
Source: the MessagePack and MessagePack-RPC specifications; AirSim's API.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.motion import Collision, Motion
from deckline.extras import needs_extra
from deckline.geometry import Camera, pose

with needs_extra("sim"):
    import msgpack

REQUEST, RESPONSE = 0, 1  # types of message; a note is 2
REQUEST_LIMIT = 256 * 1024  # bytes; 64 image requests take 10,000
QUOTE_LENGTH = 60  # characters of a received value that an error quotes
NEAR_PLANE = 10.0  # of AirSim's projection matrix, centimetres
EARTH_M = 6378137.0  # equatorial radius, WGS 84
_ARRAY32, _FLOAT32 = b"\xdd", 0xCA  # MessagePack's marks

Struct = dict[str, Any]


class ProtocolError(ValueError):
    """The received bytes are no msgpack-rpc; the connection cannot go on."""


@dataclass(frozen=True)
class Request:
    """A call. `id` is None for a note, which gets no answer."""

    id: int | None
    method: str
    params: tuple[Any, ...]


@dataclass(frozen=True)
class Response:
    """An answer: `error` is None or says what went wrong."""

    id: int
    error: Any
    result: Any


class Decoder:
    """Bytes in, in pieces of at most `limit`; whole messages out.

    Args:
        limit: bytes; a message of so many or more is refused, at the latest when so many have come.
    """

    def __init__(self, limit: int = REQUEST_LIMIT) -> None:
        self.limit = limit
        self._unpacker = msgpack.Unpacker(max_buffer_size=2 * limit, max_array_len=limit, max_map_len=limit)
        self._received = self._decoded = 0  # bytes

    @property
    def unfinished(self) -> int:
        """Bytes of the message that has begun and not ended."""
        return self._received - self._decoded

    def feed(self, data: bytes) -> Iterator[Request | Response]:
        """The messages that `data` completes; after a ProtocolError nothing more may be fed."""
        try:
            self._unpacker.feed(data)
            self._received += len(data)
            while True:
                message = self._unpacker.unpack()
                self._check_size(self._unpacker.tell() - self._decoded)
                self._decoded = self._unpacker.tell()
                yield _parse_message(message)
        except msgpack.exceptions.OutOfData:
            self._check_size(self.unfinished)
        except msgpack.exceptions.BufferFull:
            self._check_size(self.unfinished + len(data))
        except msgpack.exceptions.StackError:
            raise ProtocolError("lists nested too deeply") from None
        except ProtocolError:
            raise
        except (ValueError, TypeError) as error:
            raise ProtocolError(f"no msgpack-rpc: {' '.join(str(error).split()) or type(error).__name__}") from None

    def _check_size(self, size: int) -> None:
        if size >= self.limit:
            raise ProtocolError(f"a message of {self.limit} bytes or more")


def _parse_message(message: Any) -> Request | Response:
    match message:
        case [0, int(number), str(method), list(params)]:
            return Request(number, method, tuple(params))
        case [1, int(number), error, result]:
            return Response(number, error, result)
        case [2, str(method), list(params)]:
            return Request(None, method, tuple(params))
    raise ProtocolError(f"no msgpack-rpc message: {quote(message)}")


def encode_request(number: int, method: str, params: tuple[Any, ...]) -> bytes:
    return encode([REQUEST, number, method, list(params)])


def encode(value: Any) -> bytes:
    """A value as MessagePack; a float array (N,) is written as a list of single-precision numbers."""
    return b"".join(_encode_parts(value))


def _encode_parts(value: Any) -> Iterator[bytes]:
    """The encoding in pieces. Lists and maps are opened here, because they may hold float arrays."""
    if isinstance(value, np.ndarray):
        yield from _encode_floats(value)
    elif isinstance(value, dict):
        yield msgpack.Packer().pack_map_header(len(value))
        for key, item in value.items():
            yield msgpack.packb(key)
            yield from _encode_parts(item)
    elif isinstance(value, list | tuple):
        yield msgpack.Packer().pack_array_header(len(value))
        for item in value:
            yield from _encode_parts(item)
    else:
        yield msgpack.packb(value)


def _encode_floats(values: NDArray[np.floating]) -> Iterator[bytes]:
    """All numbers of a depth map at once: packing them one by one takes longer than rendering them."""
    if values.ndim != 1 or values.dtype.kind != "f":
        raise TypeError(f"only float arrays of one dimension can be sent, got {values.dtype} {values.shape}")
    packed = np.empty(len(values), dtype=[("mark", "u1"), ("value", ">f4")])
    packed["mark"], packed["value"] = _FLOAT32, values
    yield _ARRAY32 + len(values).to_bytes(4, "big")
    yield packed.tobytes()


def quote(value: Any) -> str:
    """A received value as one short line of plain text."""
    text = ascii(value) if not isinstance(value, str) else ascii(value)[1:-1]
    return text if len(text) <= QUOTE_LENGTH else f"{text[:QUOTE_LENGTH]}..."


def read_number(value: Any, name: str, low: float, high: float) -> float:
    """A number in [low, high]; NaN, booleans and all else are a ValueError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise ValueError(f"{name} must be a number between {low:g} and {high:g}, got {value!r:.40}")
    return float(value)


def read_flag(value: Any, name: str) -> bool:
    """A boolean; all else is a ValueError."""
    if not isinstance(value, bool):
        raise ValueError(f"{name} must be true or false, got {value!r:.40}")
    return value


def read_pose(value: Any, name: str, default: RigidTransform | None = None) -> RigidTransform:
    """A Pose. A position or an orientation with NaN is that of `default`, when there is one.

    Raises:
        ValueError: no Pose, infinite numbers, or a quaternion whose length is not near 1.
    """
    parts = value if isinstance(value, Mapping) else {}
    position = _read_components(parts.get("position"), f"{name}: position", "xyz")
    orientation = _read_components(parts.get("orientation"), f"{name}: orientation", "wxyz")
    if default is not None:
        position = default.translation if np.isnan(position).any() else position
        orientation = default.rotation.as_quat(scalar_first=True) if np.isnan(orientation).any() else orientation
    try:
        return pose(position, orientation)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def read_vector(value: Any, name: str, most: float) -> NDArray[np.float64]:
    """A Vector3r (3,) of numbers up to `most`; all else is a ValueError."""
    numbers = _read_components(value, name, "xyz")
    if not np.abs(numbers).max() <= most:
        raise ValueError(f"{name} must have numbers between {-most:g} and {most:g}, got {numbers.tolist()}")
    return numbers


def _read_components(value: Any, name: str, axes: str) -> NDArray[np.float64]:
    numbers = [value.get(f"{axis}_val") if isinstance(value, Mapping) else None for axis in axes]
    if any(isinstance(number, bool) or not isinstance(number, int | float) for number in numbers):
        raise ValueError(f"{name} must have numbers {', '.join(f'{axis}_val' for axis in axes)}, got {quote(value)}")
    return np.array(numbers, dtype=np.float64)


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


def kinematics_struct(motion: Motion) -> Struct:
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


def multirotor_struct(motion: Motion, origin: tuple[float, float, float], time_ns: int) -> Struct:
    """MultirotorState. Contacts are told by simGetCollisionInfo alone, which also forgets them."""
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
