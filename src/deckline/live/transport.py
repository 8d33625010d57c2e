"""MPEG transport streams: each coded picture as soon as its last packet is there.

FFmpeg's demultiplexer and parser give a picture away one or two pictures later, which at 30 Hz costs up to 67 ms.
Source: ISO/IEC 13818-1 (packets, tables, PES); RFC 3550 and 3551 (RTP).
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from threading import Event
from typing import Any

import av
from av.codec.context import Flags

from deckline.files import MOST_PIXELS
from deckline.live.datagrams import LOST_S, Receiver

PACKET, SYNC, CLOCK_HZ = 188, b"\x47", 90_000
CODECS = {0x01: "mpeg2video", 0x02: "mpeg2video", 0x10: "mpeg4", 0x1B: "h264", 0x24: "hevc"}  # by stream type
VIDEO = 0xE0  # stream id of pictures
LARGEST_PICTURE = 16 << 20  # bytes
RTP_VERSION, RTP_HEADER, RTP_TS = 2, 12, 33


@dataclass(frozen=True, eq=False)
class Picture:
    """A decoded picture, or none and the damage."""

    image: Any  # av.VideoFrame; None: it could not be decoded
    damage: str  # what is wrong with its data; empty: nothing is known to be wrong
    presented_s: float | None  # the stream's clock; None: it has none
    arrival_s: float  # when its data were there, monotonic clock
    waited: bool  # whether they were waited for


@dataclass(frozen=True, eq=False)
class Unit:
    """A coded picture."""

    data: bytes
    presented: int | None  # 90 kHz
    arrival_s: float  # of its first packet
    damaged: bool  # packets are missing in it or before it


def transport_packets(datagram: bytes) -> bytes:
    """MPEG-TS packets of a datagram, bare or in RTP; empty for anything else."""
    if len(datagram) > RTP_HEADER and datagram[0] >> 6 == RTP_VERSION and datagram[1] & 0x7F == RTP_TS:
        datagram = datagram[RTP_HEADER + 4 * (datagram[0] & 0x0F) :]
    return datagram if datagram[:1] == SYNC and len(datagram) % PACKET == 0 else b""


class Demultiplexer:
    """Coded pictures of the first video stream of the first program.

    A picture ends with stuffing in its last packet, or where the next one begins. Should a stream stuff in the middle,
    one picture is damaged, and from then on only the next one's beginning counts.

    Attributes:
        codec: FFmpeg's name of it; None: not known yet.
    """

    def __init__(self) -> None:
        self.codec: str | None = None
        self._tables = self._video = -1  # packet identifiers of the program's table and of its pictures
        self._count = -1  # continuity counter of the last packet of the pictures
        self._data: bytearray | None = None  # of the picture that is arriving
        self._presented: int | None = None
        self._arrival_s = 0.0
        self._damaged = False
        self._ends_with_stuffing, self._ended_early = True, False

    def feed(self, packets: bytes, arrival_s: float) -> Iterator[Unit]:
        """The pictures that end in these packets."""
        for start in range(0, len(packets), PACKET):
            packet = packets[start : start + PACKET]
            identifier, begins = (packet[1] & 0x1F) << 8 | packet[2], bool(packet[1] & 0x40)
            stuffing = _count_stuffing(packet) if packet[3] & 0x20 else 0
            begin = 5 + packet[4] if packet[3] & 0x20 else 4
            if packet[:1] != SYNC or packet[1] & 0x80 or not packet[3] & 0x10 or begin >= PACKET:
                continue
            if identifier == self._video:
                yield from self._take(packet, begin, begins, stuffing > 0, arrival_s)
            elif identifier == 0 and begins:
                self._tables = _first_program(_section(packet[begin:]))
            elif identifier == self._tables and begins:
                self._choose(_section(packet[begin:]))

    def _choose(self, table: bytes) -> None:
        stream = _first_video(table)
        if stream is not None and stream != (self._video, self.codec):
            self._video, self.codec = stream
            self._data, self._count = None, -1

    def _take(self, packet: bytes, begin: int, begins: bool, stuffed: bool, arrival_s: float) -> Iterator[Unit]:
        """One packet of the pictures."""
        count = packet[3] & 0x0F
        if count == self._count:
            return  # sent twice
        self._damaged |= self._count >= 0 and count != (self._count + 1) % 16
        self._count = count
        if begins:
            yield from self._end()
            payload = packet[begin:]
            if len(payload) < 9 or payload[:3] != b"\0\0\1" or payload[3] & 0xF0 != VIDEO:
                return
            self._data, self._presented, self._arrival_s = bytearray(), _presentation_time(payload), arrival_s
            self._ended_early = False
            begin += 9 + payload[8]
        if self._data is None:
            self._damaged = True
            self._ends_with_stuffing &= not self._ended_early
            return
        self._data += packet[begin:]
        if len(self._data) > LARGEST_PICTURE:
            self._data, self._damaged = None, True
        elif stuffed and self._ends_with_stuffing:
            self._ended_early = True
            yield from self._end()

    def _end(self) -> Iterator[Unit]:
        if self._data:
            yield Unit(bytes(self._data), self._presented, self._arrival_s, self._damaged)
            self._damaged = False
        self._data = None


def decode_stream(receiver: Receiver, stopped: Event) -> Iterator[Picture]:
    """Pictures of a receiver's sender, until it falls silent or another one takes its place; waits for the first."""
    demultiplexer, decoder, heard = Demultiplexer(), None, False
    while not stopped.is_set():
        received = receiver.receive(LOST_S)
        if received is None:
            if heard:
                return
            continue
        packets, is_new = received
        if is_new and heard:
            demultiplexer, decoder = Demultiplexer(), None
        heard = True
        for unit in demultiplexer.feed(packets, time.monotonic()):
            if decoder is None or decoder.name != demultiplexer.codec:
                decoder = make_decoder(str(demultiplexer.codec))
            yield from _decode(decoder, unit)


def make_decoder(codec: str) -> Any:
    """FFmpeg's decoder, told to hold no picture back."""
    decoder = av.CodecContext.create(codec, "r")
    decoder.thread_type = "SLICE"
    decoder.options = {"max_pixels": str(MOST_PIXELS)}
    decoder.flags |= Flags.low_delay
    return decoder


def _decode(decoder: Any, unit: Unit) -> Iterator[Picture]:
    packet = av.Packet(unit.data)
    packet.pts, packet.time_base = unit.presented, Fraction(1, CLOCK_HZ)
    damage = "data are missing" if unit.damaged else ""
    try:
        images = decoder.decode(packet)
    except av.error.FFmpegError as error:
        yield Picture(None, f"a picture cannot be decoded: {error.strerror or error}", None, unit.arrival_s, True)
        return
    for image in images:
        presented_s = None if image.pts is None else image.pts / CLOCK_HZ
        yield Picture(image, damage, presented_s, unit.arrival_s, True)
    if damage and not images:
        yield Picture(None, damage, None, unit.arrival_s, True)


def _count_stuffing(packet: bytes) -> int:
    """Stuffing bytes of the packet's adaptation field, 0 where other things may fill it."""
    length = packet[4]
    if length == 0:
        return 1
    flags = packet[5]
    if flags & 0x07:  # private data, extension, splice countdown
        return 0
    return length - 1 - 6 * bool(flags & 0x10) - 6 * bool(flags & 0x08)


def _section(payload: bytes) -> bytes:
    """The table section that begins in a packet; empty where it goes on in the next one."""
    section = payload[1 + payload[0] :]
    length = 3 + (int.from_bytes(section[1:3]) & 0x0FFF)
    return section[: length - 4] if 3 < len(section) >= length else b""  # without its checksum


def _first_program(table: bytes) -> int:
    """Packet identifier of the first program's table; -1: there is none."""
    for start in range(8, len(table) - 3, 4):
        if int.from_bytes(table[start : start + 2]):
            return int.from_bytes(table[start + 2 : start + 4]) & 0x1FFF
    return -1


def _first_video(table: bytes) -> tuple[int, str] | None:
    """Packet identifier and codec of a program's first pictures; None: there are none that can be decoded."""
    start = 12 + (int.from_bytes(table[10:12]) & 0x0FFF)
    while start + 5 <= len(table):
        if table[start] in CODECS:
            return int.from_bytes(table[start + 1 : start + 3]) & 0x1FFF, CODECS[table[start]]
        start += 5 + (int.from_bytes(table[start + 3 : start + 5]) & 0x0FFF)
    return None


def _presentation_time(payload: bytes) -> int | None:
    """Presentation time, 90 kHz, of a PES header; None without one."""
    if len(payload) < 14 or not payload[7] & 0x80:
        return None
    high, middle, low = payload[9] >> 1 & 7, int.from_bytes(payload[10:12]) >> 1, int.from_bytes(payload[12:14]) >> 1
    return high << 30 | middle << 15 | low
