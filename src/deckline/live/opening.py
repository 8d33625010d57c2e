"""From an address to a camera."""

import time
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import av

from deckline.files import MOST_PIXELS
from deckline.live.clock import WallClock
from deckline.live.datagrams import LOST_S, Receiver
from deckline.live.source import Camera, Log
from deckline.live.transport import Picture, decode_stream, transport_packets
from deckline.recording import RecordingError
from deckline.recording.camera_file import MountedCamera

OPEN_S = 5.0  # for a source to begin
WAITED_S = 2e-3  # for data that were not there yet, at least
SETTLED_S = 1.0  # after opening, when a stream that nobody had to wait for is taken as it comes
LOW_DELAY = {"fflags": "nobuffer", "flags": "low_delay", "probesize": "500000", "analyzeduration": "500000"}
NETWORK = {"protocol_whitelist": "rtsp,rtp,udp,tcp,tls", "rtsp_transport": "tcp"}  # no way to local files
DEVICE_OPTIONS = ("video_size", "framerate", "input_format")


class NetworkStream(Camera):
    """MPEG-TS over UDP, bare or in RTP; the socket stays open from one sender to the next."""

    def __init__(
        self, address: str, mounted: MountedCamera | None, wall: WallClock, latency_s: float, log: Log
    ) -> None:
        super().__init__(address, self._listen, mounted, wall, latency_s, log)
        self._receiver = Receiver(address, self.stopped, transport_packets)

    def close(self) -> None:
        self._receiver.close()

    def _listen(self) -> Iterator[Picture]:
        self._receiver.drain()
        return decode_stream(self._receiver, self.stopped)


def open_camera(
    address: str,
    mounted: MountedCamera | None,
    wall: WallClock,
    latency_s: float = 0.0,
    rate_hz: float = 30.0,
    log: Log = print,
) -> Camera:
    """A camera or a stream.

    Args:
        address: camera:N or /dev/videoN, with options as ?video_size=1280x720&framerate=30&input_format=mjpeg;
            rtsp://...; udp://HOST:PORT of MPEG-TS; rtp://HOST:PORT of MPEG-TS in RTP.
        mounted, wall, latency_s, log: as of `Camera`.
        rate_hz: frames a second that are asked of a device.

    Raises:
        ValueError: no such kind of address.
        RecordingError: nobody can listen there.
    """
    scheme, same = urlsplit(address).scheme, (mounted, wall, latency_s, log)
    if scheme in ("udp", "rtp"):
        return NetworkStream(address, *same)
    if scheme in ("rtsp", "rtsps"):
        return Camera(hide_credentials(address), lambda: decode_container(lambda: _open_rtsp(address)), *same)
    path, options = _device(address, mounted, rate_hz)
    return Camera(path, lambda: decode_container(lambda: _open_device(path, options)), *same)


def is_camera(address: str) -> bool:
    """Whether `open_camera` takes this address."""
    return address.startswith(("camera:", "/dev/video", "udp:", "rtp:", "rtsp:", "rtsps:"))


def hide_credentials(address: str) -> str:
    """An address without user name and password."""
    parts = urlsplit(address)
    return parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl()


def _open_rtsp(address: str) -> Any:
    return av.open(address, format="rtsp", options={**LOW_DELAY, **NETWORK}, timeout=(OPEN_S, LOST_S))


def _open_device(path: str, options: dict[str, str]) -> Any:
    return av.open(path, format="v4l2", options=options, timeout=(OPEN_S, LOST_S))


def _device(address: str, mounted: MountedCamera | None, rate_hz: float) -> tuple[str, dict[str, str]]:
    """Path and options of a device; pictures of the calibration's size are asked for."""
    name, _, query = address.partition("?")
    number = name.removeprefix("camera:")
    path = f"/dev/video{number}" if number.isascii() and number.isdigit() else name
    options = dict(parse_qsl(query, keep_blank_values=True))
    unknown = sorted(set(options) - set(DEVICE_OPTIONS))
    if not path.startswith("/dev/video") or unknown:
        raise ValueError(
            f"{address}: a camera is camera:N or /dev/videoN, with the options {', '.join(DEVICE_OPTIONS)}, such as "
            f"camera:0?video_size=1280x720&framerate=30&input_format=mjpeg"
        )
    known = {} if mounted is None else {"video_size": f"{mounted.camera.width}x{mounted.camera.height}"}
    return path, {**known, "framerate": f"{rate_hz:g}", **options}


def decode_container(open_container: Callable[[], Any]) -> Iterator[Picture]:
    """Pictures of what FFmpeg opens, to its end. Raises FFmpegError, OSError or RecordingError."""
    with open_container() as container:
        if not container.streams.video:
            raise RecordingError("there is no picture stream")
        container.streams.video[0].codec_context.options = {"max_pixels": str(MOST_PIXELS)}
        container.streams.video[0].thread_type = "SLICE"  # threads by frames would hold pictures back
        packets, opened_s = container.demux(container.streams.video[0]), time.monotonic()
        while True:
            asked_s = time.monotonic()
            if (packet := next(packets, None)) is None:
                return
            arrival_s = time.monotonic()
            waited = arrival_s - asked_s > WAITED_S or arrival_s - opened_s > SETTLED_S > asked_s - opened_s
            try:
                for image in packet.decode():
                    damage = "data are missing" if packet.is_corrupt else ""
                    yield Picture(image, damage, image.time, arrival_s, waited)
            except av.error.FFmpegError as error:
                reason = f"a picture cannot be decoded: {error.strerror or error}"
                yield Picture(None, reason, None, arrival_s, waited)
