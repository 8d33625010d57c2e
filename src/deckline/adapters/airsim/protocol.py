"""AirSim's wire format: msgpack-rpc messages, and what is read of AirSim's structures.

Requests are [0, id, method, params], answers [1, id, error, result], notes [2, method, params]. Messages follow each
other without length or separator. Nothing that is received is evaluated: None, booleans, numbers, text, bytes, lists
and maps come out. Poses are world_from_body, or for a camera the pose of its mount, whose x axis is the viewing axis:
North-East-Down and forward-right-down, metres, quaternions by name.
Source: the MessagePack and MessagePack-RPC specifications; AirSim's API.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.extras import needs_extra
from deckline.geometry import pose

with needs_extra("sim"):
    import msgpack

REQUEST, RESPONSE = 0, 1  # types of message; a note is 2
REQUEST_LIMIT = 256 * 1024  # bytes; 64 image requests take 10,000
QUOTE_LENGTH = 60  # characters of a received value that an error quotes
_ARRAY32, _FLOAT32 = b"\xdd", 0xCA  # MessagePack's marks


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
    """An answer: `error` is None or describes the failure."""

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
