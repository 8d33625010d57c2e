"""Datagrams of one sender at a time: MPEG-TS, bare or in RTP, and poses.

FFmpeg's own `udp:` is not used: it mixes senders, and does not report when a datagram arrived.
Source: ISO/IEC 13818-1 (transport packets); RFC 3550 and 3551 (RTP).
"""

import ipaddress
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from threading import Event
from urllib.parse import urlsplit

from deckline.live.tally import Log, Tally
from deckline.recording import RecordingError

POLL_S = 0.1  # a wait notices a stop within this time
SILENCE_S = 0.5  # of a sender, after which another one is accepted
LOST_S = 1.0  # of silence, after which a stream is over
RECEIVE_BUFFER = 4 << 20  # bytes; half a second of 60 Mbit/s
LARGEST = 65536  # bytes of a datagram
PACKET, SYNC = 188, 0x47  # length of a transport packet, bytes, and its first byte
RTP_VERSION, RTP_HEADER, RTP_MPEG_TS = 2, 12, 33


def parse_host_port(address: str, schemes: tuple[str, ...] = ("udp",)) -> tuple[str, int]:
    """SCHEME://HOST:PORT of one of these schemes -> host and port, or a ValueError."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ValueError(f"{address}: {error}") from None
    if parts.scheme not in schemes or not host or not port or parts.path or parts.query or parts.username:
        raise ValueError(f"{address}: expected {schemes[0]}://HOST:PORT, such as {schemes[0]}://127.0.0.1:5600")
    return host, port


def is_transport(datagram: bytes) -> bool:
    """Whether a datagram holds transport packets; it may begin and end within one."""
    if len(datagram) < 2 * PACKET:
        return len(datagram) == PACKET and datagram[0] == SYNC
    return any(set(datagram[start::PACKET]) == {SYNC} for start in range(PACKET))


def rtp_payload(datagram: bytes) -> bytes:
    """The transport packets in an RTP packet; empty for other datagrams."""
    is_rtp = len(datagram) > RTP_HEADER and datagram[0] >> 6 == RTP_VERSION and datagram[1] & 0x7F == RTP_MPEG_TS
    return datagram[RTP_HEADER + 4 * (datagram[0] & 0x0F) :] if is_rtp else b""


class Receiver:
    """A socket that accepts the first sender, and another one once that has been silent for `SILENCE_S`.

    Args:
        address: udp://HOST:PORT or rtp://HOST:PORT. HOST is this machine's own address, 0.0.0.0 for all of them, or a
            multicast group.
        stopped: when set, waits end.
        log: receives a line about datagrams that are left out, at most every `REPORT_EVERY_S`.
        accepts: whether a sender is accepted that begins with this datagram.

    Attributes:
        foreign: datagrams left out: of other senders, or without a payload.

    Raises:
        ValueError: a wrong address.
        RecordingError: the address cannot be opened.
    """

    def __init__(self, address: str, stopped: Event, log: Log, accepts: Callable[[bytes], bool] = bool) -> None:
        host, port = parse_host_port(address, ("udp", "rtp"))
        self.foreign = Tally(f"datagrams to {address} left out", log)
        self._stopped = stopped
        self._accepts = accepts
        self._unwrap: Callable[[bytes], bytes] = rtp_payload if address.startswith("rtp:") else bytes
        self._sender: tuple[str, int] | None = None
        self._heard_s = 0.0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._bind(socket.gethostbyname(host), port)
        except OSError as error:
            self._socket.close()
            hint = "; does another program take this stream?"
            raise RecordingError(f"{address}: cannot listen there: {error.strerror or error}{hint}") from None

    def _bind(self, host: str, port: int) -> None:
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        if ipaddress.ip_address(host).is_multicast:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            group = socket.inet_aton(host) + socket.inet_aton("0.0.0.0")
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        self._socket.bind((host, port))
        self._socket.settimeout(POLL_S)

    def receive(self, timeout_s: float) -> tuple[bytes, bool] | None:
        """The next datagram's payload, and whether a sender begins with it; None: none in time, or stopped."""
        end_s = time.monotonic() + timeout_s
        while not self._stopped.is_set():
            try:
                data, sender = self._socket.recvfrom(LARGEST)
            except TimeoutError:
                if time.monotonic() >= end_s:
                    return None
                continue
            now_s, data, is_new = time.monotonic(), self._unwrap(data), sender != self._sender
            is_other = is_new and now_s - self._heard_s < SILENCE_S
            if not data or is_other or (is_new and not self._accepts(data)):
                why = "another sender is received" if is_other else "it is not of the kind that is awaited"
                self.foreign.add(f"of {sender[0]}:{sender[1]}, {why}")
                if now_s >= end_s:
                    return None
                continue
            self._sender, self._heard_s = sender, now_s
            return data, is_new
        return None

    def drain(self) -> None:
        """Discard the datagrams that have arrived."""
        self._socket.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                self._socket.recvfrom(LARGEST)
        self._socket.settimeout(POLL_S)

    def close(self) -> None:
        self._socket.close()
        self.foreign.close()
