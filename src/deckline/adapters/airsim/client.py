"""AirSim's remote calls from the client's side: one connection, and the few calls that deckline makes."""

import math
import socket
import threading
import time
from collections.abc import Mapping
from typing import Any, Self
from urllib.parse import urlsplit

from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim import PORT
from deckline.adapters.airsim.protocol import Decoder, ProtocolError, Response, encode_request, quote, read_pose

SCHEME = "airsim"
SCENE, DEPTH_PLANAR = 0, 1  # AirSim's image types
ANSWER_LIMIT = 256 * 1024 * 1024  # bytes; picture and float depth at 4096x2160 px take 71 million
POLL_S = 0.2  # a wait notices a stop within this time
ERROR_LENGTH = 300  # characters of a server's error that are passed on
CHUNK = 1 << 20  # bytes read at once
CONNECT_S = 3.0
TIMEOUT_S = 10.0  # of an answer: a simulator that loads a level is late


class ConnectionLostError(ConnectionError):
    """The simulator cannot be reached, went away, stays silent, or speaks another protocol."""


class CallError(ValueError):
    """The simulator answered a call with an error."""


class StoppedError(Exception):
    """A wait was ended on request."""


class Connection:
    """One TCP connection to a simulator, a context manager. Not for several threads at once.

    Args:
        stopped: when set, a wait for an answer ends with StoppedError.
        timeout_s: how long to wait for each answer.

    Raises:
        ConnectionLostError: nobody answers there.
    """

    def __init__(
        self, host: str, port: int, stopped: threading.Event | None = None, timeout_s: float = TIMEOUT_S
    ) -> None:
        self.address = f"{host}:{port}"
        self._stopped = stopped or threading.Event()
        self._timeout_s = timeout_s
        self._decoder = Decoder(ANSWER_LIMIT)
        self._number = 0
        self._is_classic = False  # whether calls about cameras end with classic AirSim's argument `external`
        try:
            self._socket = socket.create_connection((host, port), min(timeout_s, CONNECT_S))
        except OSError as error:
            raise ConnectionLostError(f"{self.address}: {error.strerror or error}") from None
        self._socket.settimeout(POLL_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def call(self, method: str, *params: Any) -> Any:
        """The result of a remote call.

        Raises:
            CallError: the simulator answered with an error.
            ConnectionLostError: no answer; the connection is of no use any more.
            StoppedError: the wait was ended.
        """
        self._number += 1
        end_s = time.monotonic() + self._timeout_s
        try:
            self._send(encode_request(self._number, method, params), end_s)
            answer = self._receive(end_s)
        except ConnectionLostError:
            raise
        except OSError as error:
            raise ConnectionLostError(f"{self.address}: {error.strerror or error}") from None
        except ProtocolError as error:
            raise ConnectionLostError(f"{self.address}: what answers there is no AirSim: {error}") from None
        if answer.id != self._number:
            raise ConnectionLostError(f"{self.address}: answer {answer.id} came to call {self._number}")
        if answer.error is not None:
            text = _error_text(answer.error)
            raise CallError(text if text.startswith(method) else f"{method}: {text}")
        return answer.result

    def call_camera(self, method: str, *params: Any) -> Any:
        """Like `call`. Classic AirSim wants one more argument here than Cosys-AirSim; the first call finds out."""
        try:
            return self.call(method, *params, *((False,) if self._is_classic else ()))
        except CallError as error:
            if "number of arguments" not in str(error):
                raise
        self._is_classic = not self._is_classic
        return self.call(method, *params, *((False,) if self._is_classic else ()))

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

    def _receive(self, end_s: float) -> Response:
        while True:
            try:
                data = self._socket.recv(CHUNK)
            except TimeoutError:
                self._check_wait(end_s)
                continue
            if not data:
                raise ConnectionLostError(f"{self.address}: it hung up")
            for message in self._decoder.feed(data):
                if isinstance(message, Response):
                    return message

    def _check_wait(self, end_s: float) -> None:
        if self._stopped.is_set():
            raise StoppedError
        if time.monotonic() > end_s:
            raise ConnectionLostError(f"{self.address}: no answer in {self._timeout_s:g} s")


def parse_address(address: str) -> tuple[str, int, str]:
    """airsim://HOST[:PORT][/VEHICLE] -> host, port, and the vehicle's name ("" is the first one); or a ValueError."""
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


def get_images(connection: Connection, camera: str, vehicle: str) -> tuple[Mapping, Mapping]:
    """Raw picture and planar float depth of one instant, in one call; errors as `Connection.call`, or ValueError."""
    common = {"camera_name": camera, "compress": False, "annotation_name": ""}
    requests = [
        common | {"image_type": image_type, "pixels_as_float": image_type == DEPTH_PLANAR}
        for image_type in (SCENE, DEPTH_PLANAR)
    ]
    answer = connection.call_camera("simGetImages", requests, vehicle)
    if not isinstance(answer, list) or len(answer) != 2 or not all(isinstance(part, Mapping) for part in answer):
        raise ValueError(f"simGetImages must answer two images, got {quote(answer)}")
    return answer[0], answer[1]


def get_camera(connection: Connection, camera: str, vehicle: str) -> tuple[RigidTransform, float]:
    """world_from_mount of a camera (x along its view) and its horizontal field of view, rad; errors as `get_images`."""
    answer = connection.call_camera("simGetCameraInfo", camera, vehicle)
    fov_deg = answer.get("fov") if isinstance(answer, Mapping) else None
    if not isinstance(fov_deg, int | float) or not 0.0 < fov_deg < 180.0:
        raise ValueError(f"camera {camera!r} has no field of view between 0 and 180 deg, got {quote(answer)}")
    return read_pose(answer.get("pose"), f"camera {camera!r}"), math.radians(fov_deg)


def get_vehicle_pose(connection: Connection, vehicle: str) -> RigidTransform:
    """world_from_body of a vehicle when the simulator answers; errors as `get_images`."""
    return read_pose(connection.call("simGetVehiclePose", vehicle), f"vehicle {vehicle!r}")


def _error_text(error: Any) -> str:
    """An answered error, which some servers wrap in a list, as one line of plain text."""
    if isinstance(error, list | tuple) and error:
        return _error_text(error[0])
    return ascii(error if isinstance(error, str) else repr(error))[1:-1][:ERROR_LENGTH]
