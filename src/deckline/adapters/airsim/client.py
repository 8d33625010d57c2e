"""AirSim's remote calls from the client's side: one connection, and the few calls that deckline makes.

Source: SPEC section 5; tried against this package's server and the published client's messages.
"""

import math
import socket
import threading
import time
from collections.abc import Mapping
from typing import Any, Self
from urllib.parse import urlsplit

from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim import PORT
from deckline.adapters.airsim.protocol import Decoder, ProtocolError, Response, encode_request, quoted
from deckline.geometry import pose

SCHEME = "airsim"
SCENE, DEPTH_PLANAR = 0, 1  # AirSim's image types
ANSWER_LIMIT = 256 * 1024 * 1024  # bytes; picture and float depth at 4096x2160 px take 71 million
POLL_S = 0.2  # how soon a wait notices that it is to end
ERROR_LENGTH = 300  # characters of a server's error that are passed on
CHUNK = 1 << 20  # bytes read at once
CONNECT_S = 3.0
TIMEOUT_S = 10.0  # of an answer: a simulator that loads a level is late


class Lost(ConnectionError):  # noqa: N818
    """The simulator cannot be reached, went away, stays silent, or speaks something else."""


class Refused(ValueError):  # noqa: N818
    """The simulator answered a call with an error."""


class Stopped(Exception):  # noqa: N818 (it is no error)
    """A wait was ended on request."""


class Connection:
    """One TCP connection to a simulator, a context manager. Not for several threads at once.

    Args:
        host, port: where it listens.
        stopped: when set, a wait for an answer ends with Stopped.
        timeout_s: how long to wait for each answer.

    Raises:
        Lost: nobody answers there.
    """

    def __init__(
        self, host: str, port: int, stopped: threading.Event | None = None, timeout_s: float = TIMEOUT_S
    ) -> None:
        self.address = f"{host}:{port}"
        self._stopped = stopped or threading.Event()
        self._timeout_s = timeout_s
        self._decoder = Decoder(ANSWER_LIMIT, items_limit=None)
        self._number = 0
        self._classic = False  # whether calls about cameras end with classic AirSim's argument `external`
        try:
            self._socket = socket.create_connection((host, port), min(timeout_s, CONNECT_S))
        except OSError as error:
            raise Lost(f"{self.address}: {error.strerror or error}") from None
        self._socket.settimeout(POLL_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def call(self, method: str, *params: Any) -> Any:
        """The result of a remote call.

        Raises:
            Refused: the simulator answered with an error.
            Lost: no answer; the connection is of no use any more.
            Stopped: the wait was ended.
        """
        self._number += 1
        end_s = time.monotonic() + self._timeout_s
        try:
            self._send(encode_request(self._number, method, params), end_s)
            answer = self._answer(end_s)
        except Lost:
            raise
        except OSError as error:
            raise Lost(f"{self.address}: {error.strerror or error}") from None
        except ProtocolError as error:
            raise Lost(f"{self.address}: what answers there is no AirSim: {error}") from None
        if answer.id != self._number:
            raise Lost(f"{self.address}: answer {answer.id} came to call {self._number}")
        if answer.error is not None:
            words = _words(answer.error)
            raise Refused(words if words.startswith(method) else f"{method}: {words}")
        return answer.result

    def camera_call(self, method: str, *params: Any) -> Any:
        """Like `call`; classic AirSim wants one more argument here than Cosys-AirSim, which of them is found out.

        Raises:
            Refused, Lost, Stopped: as `call`.
        """
        try:
            return self.call(method, *params, *((False,) if self._classic else ()))
        except Refused as error:
            if "number of arguments" not in str(error):
                raise
        self._classic = not self._classic
        return self.call(method, *params, *((False,) if self._classic else ()))

    def close(self) -> None:
        """Hang up. A second call does nothing."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def _send(self, data: bytes, end_s: float) -> None:
        rest = memoryview(data)
        while rest:
            try:
                rest = rest[self._socket.send(rest) :]
            except TimeoutError:
                self._check_wait(end_s)

    def _answer(self, end_s: float) -> Response:
        while True:
            try:
                data = self._socket.recv(CHUNK)
            except TimeoutError:
                self._check_wait(end_s)
                continue
            if not data:
                raise Lost(f"{self.address}: it hung up")
            for message in self._decoder.feed(data):
                if isinstance(message, Response):
                    return message

    def _check_wait(self, end_s: float) -> None:
        if self._stopped.is_set():
            raise Stopped
        if time.monotonic() > end_s:
            raise Lost(f"{self.address}: no answer in {self._timeout_s:g} s")


def parse_address(address: str) -> tuple[str, int, str]:
    """airsim://HOST[:PORT][/VEHICLE] -> host, port, and the vehicle's name ("" is the first one).

    Raises:
        ValueError: it is no such address.
    """
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ValueError(f"{address}: {error}") from None
    if parts.scheme != SCHEME or not host or parts.query or parts.fragment or parts.username:
        raise ValueError(
            f"{address}: a simulator's address is {SCHEME}://HOST:PORT, such as {SCHEME}://127.0.0.1:{PORT}"
        )
    return host, PORT if port is None else port, parts.path.strip("/")


def image_request(camera: str, image_type: int, as_float: bool) -> dict[str, Any]:
    """One of the requests that simGetImages takes; pictures come as raw bytes."""
    return {
        "camera_name": camera,
        "image_type": image_type,
        "pixels_as_float": as_float,
        "compress": False,
        "annotation_name": "",
    }


def take_images(connection: Connection, camera: str, vehicle: str) -> tuple[Mapping, Mapping]:
    """Picture and planar depth of one instant: both are asked for in one call.

    Raises:
        Refused, Lost, Stopped: as Connection.call.
        ValueError: an answer that is not two images.
    """
    requests = [image_request(camera, SCENE, False), image_request(camera, DEPTH_PLANAR, True)]
    answer = connection.camera_call("simGetImages", requests, vehicle)
    if not isinstance(answer, list) or len(answer) != 2 or not all(isinstance(part, Mapping) for part in answer):
        raise ValueError(f"two images were asked for, got {quoted(answer)}")
    return answer[0], answer[1]


def camera_info(connection: Connection, camera: str, vehicle: str) -> tuple[RigidTransform, float]:
    """Where a camera is and looks (world_from_mount: x along its view), and its horizontal field of view in rad.

    Raises:
        Refused, Lost, Stopped: as Connection.call.
        ValueError: an answer without these numbers.
    """
    answer = connection.camera_call("simGetCameraInfo", camera, vehicle)
    fov_deg = answer.get("fov") if isinstance(answer, Mapping) else None
    if not isinstance(fov_deg, int | float) or not 0.0 < fov_deg < 180.0:
        raise ValueError(f"camera {camera!r} has no field of view between 0 and 180 deg, got {quoted(answer)}")
    return pose_from(answer.get("pose"), f"camera {camera!r}"), math.radians(fov_deg)


def vehicle_pose(connection: Connection, vehicle: str) -> RigidTransform:
    """world_from_body of a vehicle, of no instant in particular.

    Raises:
        Refused, Lost, Stopped: as Connection.call.
        ValueError: an answer that is no pose.
    """
    return pose_from(connection.call("simGetVehiclePose", vehicle), f"vehicle {vehicle!r}")


def pose_from(value: Any, what: str) -> RigidTransform:
    """AirSim's pose of position and orientation, forward-right-down axes.

    Raises:
        ValueError: it is no pose, or not finite.
    """
    if not isinstance(value, Mapping):
        raise ValueError(f"{what} has no pose, got {quoted(value)}")
    return pose_of(value.get("position"), value.get("orientation"), what)


def pose_of(position: Any, orientation: Any, what: str) -> RigidTransform:
    """A pose from AirSim's maps {x_val, y_val, z_val} and {w_val, x_val, y_val, z_val}.

    Raises:
        ValueError: numbers are missing or not finite, or the quaternion has no length.
    """
    try:
        place = [float(position[f"{axis}_val"]) for axis in "xyz"]
        turn = [float(orientation[f"{axis}_val"]) for axis in "wxyz"]
    except (TypeError, KeyError, ValueError):
        raise ValueError(f"{what} has no pose, got {quoted(position)}, {quoted(orientation)}") from None
    try:
        return pose(place, turn)
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None


def _words(error: Any) -> str:
    """The text of an answered error, which some servers wrap, as one line of plain text."""
    if isinstance(error, list | tuple) and error:
        return _words(error[0])
    return ascii(error if isinstance(error, str) else repr(error))[1:-1][:ERROR_LENGTH]
