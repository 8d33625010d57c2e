"""msgpack-rpc as AirSim speaks it: requests [0, id, method, params], answers [1, id, error, result], notes [2, ...].

Messages follow each other on the wire without length or separator. Nothing that is received is evaluated: what comes
out are None, booleans, numbers, text, bytes, lists and maps.
Source: SPEC section 5; the MessagePack-RPC specification.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.adapters.airsim.extent import Extent

try:
    import msgpack
except ImportError as error:
    raise ImportError('AirSim\'s protocol needs msgpack: pip install "deckline[sim]"') from error

REQUEST, RESPONSE, NOTIFY = 0, 1, 2
MESSAGE_LIMIT = 64 * 1024 * 1024  # bytes; a message so large, or one that says it will be, is refused
ITEMS_LIMIT = 100_000  # values in a request; one of a byte on the wire takes 8 and more in memory
CAME = 60  # characters of what came that an error quotes
_ARRAY32, _FLOAT32 = b"\xdd", 0xCA  # MessagePack's marks


class ProtocolError(ValueError):
    """What came is no msgpack-rpc; the connection cannot go on."""


@dataclass(frozen=True)
class Request:
    """A call. `id` is None for a note, which gets no answer."""

    id: int | None
    method: str
    params: tuple[Any, ...]


@dataclass(frozen=True)
class Response:
    """An answer: `error` is None or what went wrong."""

    id: int
    error: Any
    result: Any


class Decoder:
    """Bytes in, in pieces of any size; whole messages out.

    Args:
        limit: bytes of a message, also of one that only says so, from which on it is refused.
        items_limit: values in a message from which on it is refused. None: any number, as answers have a number for
            every pixel; sizes are then checked only when they have come.
    """

    def __init__(self, limit: int = MESSAGE_LIMIT, items_limit: int | None = ITEMS_LIMIT) -> None:
        self.limit = limit
        self._extent = None if items_limit is None else Extent(limit, items_limit)
        self._unpacker = msgpack.Unpacker(max_buffer_size=limit)

    @property
    def midway(self) -> bool:
        """Whether a message has begun and not ended; never, where the number of values is not limited."""
        return self._extent is not None and self._extent.midway

    @property
    def held(self) -> int:
        """Bytes that it may hold: of the largest message so far; 0 where the number of values is not limited."""
        return 0 if self._extent is None else self._extent.largest

    def feed(self, data: bytes) -> Iterator[Request | Response]:
        """The messages that `data` completes.

        Raises:
            ProtocolError: bytes that are no msgpack-rpc, or a message that is too large; nothing more may be fed.
        """
        too_large = "" if self._extent is None else self._extent.follow(data)
        if too_large:
            raise ProtocolError(too_large)
        try:
            self._unpacker.feed(data)
        except msgpack.exceptions.BufferFull:
            raise ProtocolError(f"a message of {self.limit} bytes or more") from None
        while True:
            try:
                message = self._unpacker.unpack()
            except msgpack.exceptions.OutOfData:
                return
            except msgpack.exceptions.StackError:
                raise ProtocolError("lists nested too deeply") from None
            except (ValueError, TypeError) as error:
                raise ProtocolError(f"no msgpack-rpc: {' '.join(str(error).split()) or type(error).__name__}") from None
            yield as_message(message)


def as_message(message: Any) -> Request | Response:
    """A decoded value as the call, note or answer it is.

    Raises:
        ProtocolError: it is none of them.
    """
    match message:
        case [0, int(number), str(method), list(params)]:
            return Request(number, method, tuple(params))
        case [1, int(number), error, result]:
            return Response(number, error, result)
        case [2, str(method), list(params)]:
            return Request(None, method, tuple(params))
    raise ProtocolError(f"no msgpack-rpc message: {quoted(message)}")


def encode_request(number: int, method: str, params: tuple[Any, ...]) -> bytes:
    """A call as bytes."""
    return encode([REQUEST, number, method, list(params)])


def encode_response(number: int, error: Any, result: Any) -> bytes:
    """An answer as bytes."""
    return encode([RESPONSE, number, error, result])


def encode(value: Any) -> bytes:
    """A value as MessagePack; a float array (N,) is written as a list of single-precision numbers.

    Raises:
        TypeError: a value that MessagePack has no form for.
    """
    return b"".join(_parts(value))


def quoted(value: Any) -> str:
    """What came, as one short line of plain text."""
    text = ascii(value) if not isinstance(value, str) else ascii(value)[1:-1]
    return text if len(text) <= CAME else f"{text[:CAME]}..."


def _parts(value: Any) -> Iterator[bytes]:
    """The encoding in pieces. Lists and maps are opened here, because they may hold float arrays."""
    if isinstance(value, np.ndarray):
        yield from _floats(value)
    elif isinstance(value, dict):
        yield msgpack.Packer().pack_map_header(len(value))
        for key, item in value.items():
            yield msgpack.packb(key)
            yield from _parts(item)
    elif isinstance(value, list | tuple):
        yield msgpack.Packer().pack_array_header(len(value))
        for item in value:
            yield from _parts(item)
    else:
        yield msgpack.packb(value)


def _floats(values: NDArray[np.floating]) -> Iterator[bytes]:
    """A picture's numbers at once: packing them one by one takes longer than rendering them."""
    if values.ndim != 1 or values.dtype.kind != "f":
        raise TypeError(f"only float arrays of one dimension can be sent, got {values.dtype} {values.shape}")
    packed = np.empty(len(values), dtype=[("mark", "u1"), ("value", ">f4")])
    packed["mark"], packed["value"] = _FLOAT32, values
    yield _ARRAY32 + len(values).to_bytes(4, "big")
    yield packed.tobytes()
