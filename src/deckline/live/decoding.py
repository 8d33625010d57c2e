"""Pictures of cameras and streams, decoded by FFmpeg (PyAV).

FFmpeg never receives the address of an MPEG transport stream: it reads the bytes of one sender, as MPEG-TS and nothing
else, so a stream leads to no playlist and to no file. It returns a picture of unstated length when the next one begins,
one frame interval late; the capture time comes from the arrival of the picture's first datagram and is not late.
"""

import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from threading import Event
from typing import Any

import av
from av.codec.context import Flags

from deckline.files import MOST_PIXELS
from deckline.live.datagrams import LOST_S, Receiver
from deckline.recording import RecordingError
from deckline.recording.upright import read_pixel_aspect

BOUNDS = {"max_pixels": str(MOST_PIXELS)}
# Without FFmpeg's parser, which delays by one more picture. The least probesize ends the analysis with the first
# picture; "nobuffer" would drop that picture. A picture beyond max_packet_size (bytes) arrives in parts.
MPEG_TS = {"fflags": "noparse+nofillin", "probesize": "32", "max_packet_size": str(16 << 20), **BOUNDS}
WAITED_S = 2e-3  # for data that were not there yet, at least
SETTLED_S = 1.0  # after opening, when a stream that nobody had to wait for is taken as it comes
ANEW_S = 30.0  # without a picture, after which a stream is opened anew: its codec or its tables may have changed


@dataclass(frozen=True, eq=False)
class Picture:
    """A decoded picture, or none and the damage."""

    image: Any
    """av.VideoFrame; None: it could not be decoded."""
    damage: str
    """What is wrong with its data; empty: no damage is known."""
    presented_s: float | None
    """Presentation time on the stream's clock; None: it has none."""
    arrival_s: float
    """When its data arrived, monotonic clock."""
    waited: bool
    """Whether the receiver waited for the data; else they may have waited for the receiver."""
    pixel_aspect: float = 1.0
    """Width over height of a pixel."""


class DatagramFile:
    """The datagrams of one sender as a file without an end until the sender is silent for `LOST_S`.

    Args:
        receiver: delivers the datagrams.
        first: the sender's first datagram.

    Attributes:
        ended: whether the sender fell silent, gave way to another one, or the receiver was stopped.
        next_first: first datagram of the sender that took its place; empty: there is none.
        picture_s: when the last picture was decoded, monotonic clock.
    """

    def __init__(self, receiver: Receiver, first: bytes) -> None:
        self.ended, self.next_first, self.picture_s = False, b"", time.monotonic()
        self._receiver = receiver
        self._rest, self._length = first, len(first)
        self._starts, self._arrivals_s = [0], [self.picture_s]  # of the datagrams since the last picture

    def read(self, size: int) -> bytes:
        """The next bytes, at most `size`; none at the end."""
        if not self._rest and not self.ended:
            self._rest = self._receive()
            self.ended = not self._rest
        data, self._rest = self._rest[:size], self._rest[size:]
        return data

    def arrival_s(self, position: int | None) -> float:
        """When the byte at a position arrived, monotonic clock; positions ascend. None: unknown, the last datagram."""
        index = len(self._starts) - 1 if position is None else max(bisect_right(self._starts, position) - 1, 0)
        del self._starts[:index], self._arrivals_s[:index]
        return self._arrivals_s[0]

    def _receive(self) -> bytes:
        received = self._receiver.receive(LOST_S)
        if received is None or time.monotonic() - self.picture_s > ANEW_S:
            return b""
        data, is_new = received
        if is_new:
            self.next_first = data
            return b""
        self._starts.append(self._length)
        self._arrivals_s.append(time.monotonic())
        self._length += len(data)
        return data


def decode_stream(receiver: Receiver, stopped: Event) -> Iterator[Picture]:
    """Pictures of a receiver's MPEG-TS until its senders are silent for `LOST_S`; waits for the first sender.

    Raises:
        av.error.FFmpegError: the data are no MPEG-TS.
        RecordingError: the stream has no pictures.
    """
    first = b""
    while not first and not stopped.is_set():
        first = (receiver.receive(LOST_S) or (b"", True))[0]
    while first and not stopped.is_set():
        file = DatagramFile(receiver, first)
        try:
            yield from _decode_file(file)
        except (av.error.FFmpegError, RecordingError):
            if not file.ended:
                raise
        first = file.next_first


def _decode_file(file: DatagramFile) -> Iterator[Picture]:
    with av.open(file, "r", format="mpegts", options={**MPEG_TS, "protocol_whitelist": "none"}) as container:
        stream = _choose_stream(container)
        for packet in container.demux(stream):
            if file.ended:
                return  # FFmpeg returns the last picture when its successor is overdue
            for picture in _decode_packet(packet, file.arrival_s(packet.pos), True):
                file.picture_s = picture.arrival_s if picture.image is not None else file.picture_s
                yield picture


def decode_container(open_container: Callable[[], Any]) -> Iterator[Picture]:
    """Pictures of what FFmpeg opens, to its end. Raises FFmpegError, OSError or RecordingError."""
    with open_container() as container:
        packets, opened_s = container.demux(_choose_stream(container)), time.monotonic()
        while True:
            asked_s = time.monotonic()
            if (packet := next(packets, None)) is None:
                return
            arrival_s = time.monotonic()
            waited = arrival_s - asked_s > WAITED_S or arrival_s - opened_s > SETTLED_S > asked_s - opened_s
            yield from _decode_packet(packet, arrival_s, waited)


def _choose_stream(container: Any) -> Any:
    """The first picture stream, decoded without delay and within bounds."""
    if not container.streams.video:
        raise RecordingError("there is no picture stream")
    stream = container.streams.video[0]
    stream.codec_context.options = BOUNDS
    stream.codec_context.flags |= Flags.low_delay
    stream.thread_type = "SLICE"  # threads by frames would hold pictures back
    return stream


def _decode_packet(packet: Any, arrival_s: float, waited: bool) -> Iterator[Picture]:
    """Pictures of a packet. A damaged one is not decoded: FFmpeg's H.264 decoder mixes it into the next key picture."""
    if packet.is_corrupt:
        yield Picture(None, "data are missing", None, arrival_s, waited)
        return
    try:
        images = packet.decode()
    except av.error.FFmpegError as error:
        yield Picture(None, f"a picture cannot be decoded: {error.strerror or error}", None, arrival_s, waited)
        return
    for image in images:
        damage = "the decoder concealed missing data" if image.is_corrupt else ""
        yield Picture(image, damage, image.time, arrival_s, waited, read_pixel_aspect(packet.stream))
