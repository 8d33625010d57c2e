"""Live sources: a camera, a network stream, a simulator, or a recording played at its own pace."""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import av

from deckline.live.clock import StreamClock, WallClock
from deckline.live.datagrams import LOST_S, Receiver, TransportStream, transport_packets
from deckline.recording import BadFrame, RecordingError, Source, Stream
from deckline.recording.camera_file import MountedCamera, make_plain_frame
from deckline.types import Frame

FIRST_WAIT_S, LONGEST_WAIT_S = 0.25, 8.0  # between two tries to open a source; each wait doubles
OPEN_S = 5.0  # for a source to begin
WAITED_S = 2e-3  # for data that were not there yet, at least
SETTLED_S = 1.0  # after opening, when a stream that nobody had to wait for is taken as it comes
LOW_DELAY = {"fflags": "nobuffer", "flags": "low_delay", "probesize": "500000", "analyzeduration": "500000"}
NETWORK = {"protocol_whitelist": "rtsp,rtp,udp,tcp,tls", "rtsp_transport": "tcp"}  # no way to local files
DEVICE_OPTIONS = ("video_size", "framerate", "input_format")

Log = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Captured:
    """A frame, and when it was taken."""

    frame: Frame
    at_s: float  # monotonic clock


class LiveSource(ABC):
    """Frames as they are taken.

    Attributes:
        name: what people call it; without credentials.
        notes: what is odd about it but does not stop it, one line each.
    """

    name: str
    notes: tuple[str, ...] = ()

    def __init__(self) -> None:
        self.stopped = threading.Event()

    @abstractmethod
    def items(self) -> Iterator[Captured | BadFrame]:
        """Frames in the order in which they were taken, and damaged ones, until `stop`."""

    def stop(self) -> None:
        """End a wait for the next frame; for any thread."""
        self.stopped.set()

    def close(self) -> None:  # noqa: B027 (few hold anything)
        """Give up what it holds, once nobody iterates."""

    def wait_for_stop(self, seconds: float) -> bool:
        """Sleep; whether `stop` ended it."""
        return self.stopped.wait(max(seconds, 0.0))


class Simulator(LiveSource):
    """A stream that is live already; a frame counts as taken when it is there."""

    def __init__(self, stream: Stream) -> None:
        super().__init__()
        self.name, self.notes = stream.name, stream.notes
        self._stream = stream

    def items(self) -> Iterator[Captured | BadFrame]:
        for item in self._stream.items():
            yield item if isinstance(item, BadFrame) else Captured(item, time.monotonic())

    def stop(self) -> None:
        super().stop()
        self._stream.stop()


class Playback(LiveSource):
    """A recording at its own pace, once through. Its frames keep their times; a late one delays those after it."""

    def __init__(self, recording: Source) -> None:
        super().__init__()
        self.name, self.notes = recording.name, recording.notes
        self._recording = recording

    def items(self) -> Iterator[Captured | BadFrame]:
        start_s, before_s = time.monotonic(), float("nan")
        for item in self._recording.items():
            if isinstance(item, Frame):
                step_s = item.time_s - before_s
                start_s += step_s if 0.0 < step_s < LONGEST_WAIT_S else 0.0
                before_s = item.time_s
                if self.wait_for_stop(start_s - time.monotonic()):
                    return
                start_s = max(start_s, time.monotonic())
            yield item if isinstance(item, BadFrame) else Captured(item, time.monotonic())


class Camera(LiveSource):
    """Pictures of a device or a stream, decoded by FFmpeg. One that fails or falls silent is opened again and again.

    Pictures are refused from a damaged one to the next key picture: those in between are made from the damaged one.

    Args:
        name: what people call it.
        open_container: opens it, as `av.open` does.
        listener: closed with it.
        mounted: None: no camera file, lines in pixels only.
        wall: Unix time of the frames.
        latency_s: of exposure, coding and network, subtracted from the times of arrival.
        log: gets a line when the source is lost and when it is back.
    """

    def __init__(
        self,
        name: str,
        open_container: Callable[[], Any],
        mounted: MountedCamera | None,
        wall: WallClock,
        latency_s: float,
        log: Log,
        listener: "Listener | None" = None,
    ) -> None:
        super().__init__()
        self.name = name
        self._listener = listener
        self._open = open_container
        self._mounted = mounted
        self._wall = wall
        self._latency_s = latency_s
        self._log = log
        self._number = 0
        self._size: tuple[int, int] | None = None

    def stop(self) -> None:
        super().stop()
        if self._listener is not None:
            self._listener.stopped.set()

    def close(self) -> None:
        if self._listener is not None:
            self._listener.close()

    def items(self) -> Iterator[Captured | BadFrame]:
        wait_s, reason = FIRST_WAIT_S, ""
        while not self.stopped.is_set():
            ended = "the stream ended, or fell silent"
            try:
                for item in self._session():
                    if reason and isinstance(item, Captured):
                        self._log(f"{self.name} is back")
                        wait_s, reason = FIRST_WAIT_S, ""
                    yield item
            except (av.error.FFmpegError, OSError, RecordingError) as error:
                ended = getattr(error, "strerror", None) or str(error)
            if not reason and not self.stopped.is_set():
                self._log(f"no pictures from {self.name}: {ended}; trying again")
            reason = ended
            if self.wait_for_stop(wait_s):
                return
            wait_s = min(2 * wait_s, LONGEST_WAIT_S)

    def _session(self) -> Iterator[Captured | BadFrame]:
        """Pictures from opening the source to its end. Raises FFmpegError, OSError or RecordingError."""
        with self._open() as container:
            if not container.streams.video:
                raise RecordingError("there is no picture stream")
            stream, clock = container.streams.video[0], StreamClock()
            stream.thread_type = "SLICE"  # threads by frames would hold pictures back
            damage = "there was no key picture yet"
            packets, opened_s = container.demux(stream), time.monotonic()
            while not self.stopped.is_set():
                asked_s = time.monotonic()
                if (packet := next(packets, None)) is None:
                    return
                arrival_s = time.monotonic()
                waited = arrival_s - asked_s > WAITED_S or arrival_s - opened_s > SETTLED_S > asked_s - opened_s
                try:
                    pictures = packet.decode()
                except av.error.FFmpegError as error:
                    pictures, damage = [], f"a picture cannot be decoded: {error.strerror or error}"
                    yield self._bad(damage)
                if packet.is_corrupt:
                    damage = "data are missing"
                for picture in pictures:
                    damage = "" if picture.key_frame and not packet.is_corrupt else damage
                    damage = "a picture's data are damaged" if picture.is_corrupt else damage
                    if damage:
                        yield self._bad(damage)
                        continue
                    at_s = clock.capture_time(picture.time, arrival_s, waited) - self._latency_s
                    if clock.is_set:
                        yield self._capture(picture, at_s)

    def _bad(self, reason: str) -> BadFrame:
        return BadFrame(self._next_name(), reason)

    def _next_name(self) -> str:
        """The name that a recording of the frames gives this one."""
        self._number += 1
        return f"frame_{self._number:08d}.png"

    def _capture(self, picture: Any, at_s: float) -> Captured | BadFrame:
        file, time_s = self._next_name(), self._wall.at(at_s)
        try:
            image = picture.to_ndarray(format="rgb24")
            if self._mounted is None:
                return Captured(make_plain_frame(file, time_s, image), at_s)
            mounted = self._fit(self._mounted, image.shape[1], image.shape[0])
            return Captured(mounted.frame(file, time_s, image), at_s)
        except ValueError as error:
            return BadFrame(file, str(error))

    def _fit(self, mounted: MountedCamera, width: int, height: int) -> MountedCamera:
        """The camera for pictures of this size, with a note when it is scaled; a ValueError for another shape."""
        fitted = mounted.fit(width, height)
        if self._size != (width, height) and fitted is not mounted:
            camera = mounted.camera
            self._log(f"intrinsics for {camera.width}x{camera.height} px are scaled to {width}x{height} px")
        self._size = width, height
        return fitted


class Listener:
    """Opens MPEG-TS that arrives over UDP, bare or in RTP; the socket stays open from one sender to the next."""

    def __init__(self, address: str) -> None:
        self.stopped = threading.Event()
        self._receiver = Receiver(address, self.stopped, transport_packets)
        self._stream: TransportStream | None = None

    def open(self) -> Any:
        """The next sender's stream, waited for. Raises FFmpegError, or OSError when stopped."""
        first = None if self._stream is None else self._stream.next_first
        if first is None:
            self._receiver.drain()
        while first is None:
            if self.stopped.is_set():
                raise OSError("stopped")
            received = self._receiver.receive(LOST_S)
            first = None if received is None else received[0]
        self._stream = TransportStream(self._receiver, first)
        return av.open(self._stream, format="mpegts", options=LOW_DELAY)

    def close(self) -> None:
        self._receiver.close()


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
    scheme = urlsplit(address).scheme
    if scheme in ("udp", "rtp"):
        listener = Listener(address)
        return Camera(address, listener.open, mounted, wall, latency_s, log, listener)
    if scheme in ("rtsp", "rtsps"):
        return Camera(hide_credentials(address), lambda: _open_rtsp(address), mounted, wall, latency_s, log)
    path, options = _device(address, mounted, rate_hz)
    return Camera(path, lambda: _open_device(path, options), mounted, wall, latency_s, log)


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
