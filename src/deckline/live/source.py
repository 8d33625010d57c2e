"""Live sources: a camera, a network stream, a simulator, or a recording played at its own pace."""

import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import av

from deckline.live.clock import StreamClock, WallClock
from deckline.live.decoding import Picture
from deckline.live.tally import Log
from deckline.recording import BadFrame, Recording, RecordingError, Source
from deckline.recording.camera_file import STATED, MountedCamera, note_camera
from deckline.recording.upright import read_upright, upright_size
from deckline.types import Frame

SLICE_S = 0.05  # within which a wait notices a stop
FIRST_WAIT_S, LONGEST_WAIT_S = 0.25, 8.0  # between two tries to open a source; each wait doubles

Pinhole = Callable[[int, int], MountedCamera]


@dataclass(frozen=True, eq=False)
class Captured:
    """A frame, and when it was taken."""

    frame: Frame
    """The frame."""
    at_s: float
    """Time of capture, monotonic clock, s."""


def frame_name(number: int) -> str:
    """Of a live frame, and of its file in a recording."""
    return f"frame_{number:08d}.png"


class LiveSource(Source):
    """Frames as they are taken, until `stop`.

    Args:
        name: what people call it; without credentials.
        notes: what is odd about it but does not stop it, one line each.

    Attributes:
        restarts: times that it came back after a failure.
    """

    def __init__(self, name: str, notes: tuple[str, ...] = ()) -> None:
        self.name = name
        self.notes = notes
        self.restarts = 0
        self.stopped = threading.Event()

    @abstractmethod
    def captures(self) -> Iterator[Captured | BadFrame]:
        """Frames in the order in which they are taken, each with its time of capture, and damaged ones."""

    def items(self) -> Iterator[Frame | BadFrame]:
        return (item.frame if isinstance(item, Captured) else item for item in self.captures())

    def stop(self) -> None:
        self.stopped.set()

    def wait_for_stop(self, seconds: float) -> bool:
        """Sleep; whether `stop` ended it. In slices: a signal handler may not set an event that is waited for."""
        end_s = time.monotonic() + seconds
        while not self.stopped.is_set():
            rest_s = end_s - time.monotonic()
            if rest_s <= 0:
                return False
            time.sleep(min(rest_s, SLICE_S))
        return True


class Playback(LiveSource):
    """A recording at its own pace, once through. Its frames have their own times; a late one delays those after it."""

    def __init__(self, recording: Recording) -> None:
        super().__init__(recording.name, recording.notes)
        self.base_config = recording.base_config
        self._recording = recording

    def captures(self) -> Iterator[Captured | BadFrame]:
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


class StreamCamera(LiveSource):
    """Pictures of a device or a stream, decoded by FFmpeg.

    A source that fails or falls silent is opened again after a wait that doubles each time. Pictures are refused from a
    damaged one to the next key picture, because they are predicted from the damaged one.

    Args:
        name: what people call it.
        pictures: opens it and decodes it to its end, as `decode_stream` does.
        mounted: None: no camera file.
        wall: Unix time of the frames.
        latency_s: of exposure, coding and network, subtracted from the times of arrival.
        log: receives a line when the source is lost and when it recovers.
        pinhole: makes the camera of width and height of the first picture where there is no camera file; None: no
            field of view is stated.
    """

    def __init__(
        self,
        name: str,
        pictures: Callable[[], Iterator[Picture]],
        mounted: MountedCamera | None,
        wall: WallClock,
        latency_s: float,
        log: Log,
        pinhole: Pinhole | None = None,
    ) -> None:
        super().__init__(name)
        if not 0.0 <= latency_s < LONGEST_WAIT_S:
            raise ValueError(f"latency_s must lie between 0 and {LONGEST_WAIT_S:g}, got {latency_s}")
        self._pictures = pictures
        self._mounted = mounted
        self._pinhole = pinhole
        self._wall = wall
        self._latency_s = latency_s
        self._log = log
        self._number = 0
        self._size: tuple[int, int] | None = None

    def captures(self) -> Iterator[Captured | BadFrame]:
        wait_s, reason = FIRST_WAIT_S, ""
        while not self.stopped.is_set():
            ended = "the stream ended, or fell silent"
            try:
                for item in self._session():
                    if reason and isinstance(item, Captured):
                        self._log(f"{self.name} is back")
                        self.restarts += 1
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
        clock, damage = StreamClock(), "there was no key picture yet"
        for picture in self._pictures():
            damage = picture.damage or damage
            if picture.image is not None:
                damage = "" if picture.image.key_frame and not picture.damage else damage
            if damage:
                yield BadFrame(self._next_name(), damage)
                continue
            at_s = clock.capture_time(picture.presented_s, picture.arrival_s, picture.waited) - self._latency_s
            if clock.is_set:
                yield self._capture(picture, at_s)

    def _next_name(self) -> str:
        self._number += 1
        return frame_name(self._number)

    def _capture(self, picture: Picture, at_s: float) -> Captured | BadFrame:
        file, time_s = self._next_name(), self._wall.at(at_s)
        try:
            image = read_upright(picture.image, picture.pixel_aspect)
            size = image.shape[1], image.shape[0]
            if self._mounted is None and self._pinhole is not None:
                self._mounted = self._pinhole(*size)
                self._log(note_camera(self.name, self._mounted.camera, STATED))
            if self._mounted is None:
                return Captured(Frame(file, time_s, image), at_s)
            mounted = self._mounted.for_square_pixels(size, upright_size(picture.image, 1.0))
            mounted = self._fit(mounted, *size)
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
