"""From an address to a camera."""

import re
from collections.abc import Callable, Iterator
from functools import partial
from urllib.parse import parse_qsl, urlsplit

import av

from deckline.live.clock import WallClock
from deckline.live.datagrams import LOST_S, Receiver, is_transport
from deckline.live.decoding import BOUNDS, MPEG_TS, Picture, decode_container, decode_stream
from deckline.live.source import Pinhole, StreamCamera
from deckline.live.tally import Log
from deckline.recording import RecordingError
from deckline.recording.camera_file import MountedCamera

SECRET = re.compile(r"(?i)((?:user|pass|pwd|token|key)[^=&]*=)[^&]*")  # in a query
OPEN_S = 5.0  # for a source to begin
LOW_DELAY = {"fflags": "nobuffer", "flags": "low_delay", "probesize": "500000", "analyzeduration": "500000"}
RTSP = {"protocol_whitelist": "rtsp,rtp,udp,tcp,tls", "rtsp_transport": "tcp"}  # no way to local files
SRT = {"protocol_whitelist": "srt"}
DEVICE_OPTIONS = ("video_size", "framerate", "input_format")
EXAMPLES = {  # by scheme
    "udp": "udp://0.0.0.0:5600",
    "rtp": "rtp://0.0.0.0:5004",
    "rtsp": "rtsp://10.0.0.2/cam",
    "rtsps": "rtsps://10.0.0.2/cam",
    "srt": "srt://10.0.0.2:9000",
}
SCHEMES = ("camera", *EXAMPLES)


class NetworkStream(StreamCamera):
    """MPEG-TS over UDP, bare or in RTP; the socket stays open from one sender to the next.

    The first sender of transport packets is received; datagrams of others are dropped until it is silent for 0.5 s.
    A sender is an IP address and a port, and whoever forges both is not detected.
    """

    def __init__(
        self,
        address: str,
        mounted: MountedCamera | None,
        wall: WallClock,
        latency_s: float,
        log: Log,
        pinhole: Pinhole | None = None,
    ) -> None:
        super().__init__(address, self._listen, mounted, wall, latency_s, log, pinhole)
        self._receiver = Receiver(address, self.stopped, log, is_transport)

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
    pinhole: Pinhole | None = None,
) -> StreamCamera:
    """A camera or a stream. No address leads to a file or a playlist.

    Args:
        address: camera:N or /dev/videoN, with options as ?video_size=1280x720&framerate=30&input_format=mjpeg;
            rtsp://...; udp://HOST:PORT of MPEG-TS; rtp://HOST:PORT of MPEG-TS in RTP; srt://HOST:PORT of MPEG-TS,
            where FFmpeg has SRT.
        mounted, wall, latency_s, log, pinhole: as of `StreamCamera`.
        rate_hz: frames a second that are asked of a device.

    Raises:
        ValueError: no such kind of address.
        RecordingError: the port is taken, or this FFmpeg has no SRT.
    """
    scheme, same = urlsplit(address).scheme, (mounted, wall, latency_s, log, pinhole)
    if scheme in EXAMPLES and not (address.startswith(f"{scheme}://") and urlsplit(address).netloc):
        raise ValueError(f"{address}: expected an address such as {EXAMPLES[scheme]}")
    if scheme in ("udp", "rtp"):
        return NetworkStream(address, *same)
    if scheme in ("rtsp", "rtsps"):
        return StreamCamera(hide_credentials(address), _decode(address, "rtsp", LOW_DELAY | RTSP | BOUNDS), *same)
    if scheme == "srt":
        name = hide_credentials(address).partition("?")[0]  # a query may hold the passphrase
        _check_srt(name)
        return StreamCamera(name, _decode(address, "mpegts", MPEG_TS | SRT), *same)
    path, options = _device(address, mounted, rate_hz)
    return StreamCamera(path, _decode(path, "v4l2", options | BOUNDS), *same)


def is_camera(address: str) -> bool:
    """Whether `open_camera` takes this address."""
    return address.startswith(("/dev/video", *(f"{scheme}:" for scheme in SCHEMES)))


def hide_credentials(address: str) -> str:
    """An address without user name and password, before the host or in its query."""
    parts = urlsplit(address)
    return SECRET.sub(r"\1...", parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl())


def _decode(address: str, kind: str, options: dict[str, str]) -> Callable[[], Iterator[Picture]]:
    """Opens an address as this kind of FFmpeg's, whenever it is called, and decodes it to its end."""
    container = partial(av.open, address, format=kind, options=options, timeout=(OPEN_S, LOST_S))
    return partial(decode_container, container)


def _check_srt(name: str) -> None:
    try:
        av.open("srt://", format="mpegts", options=SRT)  # every build refuses it; one without SRT names the protocol
    except av.error.ProtocolNotFoundError:
        raise RecordingError(f"{name}: the FFmpeg in PyAV has no SRT: send MPEG-TS over udp:// or rtp://") from None
    except av.error.FFmpegError:
        return


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
