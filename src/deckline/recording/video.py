"""Video files, decoded frame by frame: memory does not grow with the packets.

Frames and poses go by presentation time, never by count, so a lost packet moves nothing. A picture is bad when its
decoder reports it; videos carry no checksums, so damage that still decodes stays unnoticed.
"""

from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from deckline.files import MOST_PIXELS, check_regular
from deckline.recording.camera_file import MountedCamera
from deckline.recording.pose_track import PoseTrack
from deckline.recording.poses import drop_unknown_place
from deckline.recording.source import BadFrame, FrameError, Recording, RecordingError, check_index
from deckline.recording.upright import (
    UPRIGHT,
    read_pixel_aspect,
    read_turn,
    read_upright,
    square_size,
    upright_size,
)
from deckline.types import Frame

COUNTED = "avi"  # this container stores no presentation times, only a rate: its pictures are counted
# A file may be a list of other files or addresses under a video's name: no format that names others is opened.
FORMATS = "mov,matroska,avi,mpegts,mpeg,mpegvideo,h264,hevc,av1,obu,ivf,flv,ogg,asf,mjpeg,m4v,dv,mxf,yuv4mpegpipe,gif"
FROM_ANYWHERE = {"protocol_whitelist": "file", "format_whitelist": FORMATS}
DECODER = {"max_pixels": str(MOST_PIXELS)}  # should the size change on the way
TIME_TOLERANCE_S = 1e-6  # of equal presentation times


@dataclass(frozen=True, eq=False)
class VideoPackets:
    """Times of a video's packets, and the shape of its first picture that decodes."""

    path: Path
    """The file."""
    times_s: NDArray[np.float64]
    """(N,) presentation times in ascending order, the video's clock, s."""
    by_count: bool
    """Whether the container stores only a rate, so that pictures are counted."""
    size: tuple[int, int]
    """Width, height of the pictures as they are shown, upright and with square pixels, px."""
    stored_size: tuple[int, int]
    """The same upright, with pixels as they are stored, px."""
    pixel_aspect: float
    """Width over height of a stored pixel."""
    is_turned: bool
    """Whether metadata turn or mirror the pictures."""


class Video(Recording):
    """A video file. Frame n in order of presentation is called <video>#<n>, counted from 0.

    Its time is that of the poses' clock; without poses the video's own. Iterating streams. `load` decodes from the last
    frame it gave, or from the beginning: going backwards is slow. `mounted` is None without a camera file.
    """

    def __init__(self, packets: VideoPackets, mounted: MountedCamera | None, poses: PoseTrack | None) -> None:
        self.packets = packets
        self.name = str(packets.path)
        self._mounted = mounted
        self._poses = self.pose_track = poses
        self._cursor: Iterator[tuple[int, Any]] = iter(())
        self._next = -1
        no_poses = (f"{packets.path}: no poses.csv: the pictures alone say where the aircraft is",)
        self.notes = no_poses if poses is None else poses.notes_on(packets.times_s)
        if poses is not None and packets.by_count:
            self.notes += (
                f"{packets.path}: {COUNTED} stores no times: where a picture is lost, later ones get earlier poses",
            )
        self.notes += self._note_shape()

    def __len__(self) -> int:
        return len(self.packets.times_s)

    def times(self) -> NDArray[np.float64]:
        return self.packets.times_s

    def load(self, index: int) -> Frame:
        check_index(index, len(self), self.name)
        if not 0 <= self._next <= index:
            self._cursor = self._pictures()
        self._next = -1  # should decoding fail
        picture = next(picture for number, picture in self._cursor if number == index)
        self._next = index + 1
        return self._frame(index, picture)

    def items(self) -> Iterator[Frame | BadFrame]:
        for number, picture in self._pictures():
            try:
                yield self._frame(number, picture)
            except FrameError as error:
                yield BadFrame(error.file, error.reason)

    def _pictures(self) -> Iterator[tuple[int, Any]]:
        """Every frame's number once, with its decoded picture or the reason why there is none."""
        expected, reason = 0, "cannot be decoded"
        for decoded in _decode(self.packets.path):
            number = expected
            if isinstance(decoded, str):
                reason = decoded
                if not self.packets.by_count:
                    continue  # the time of the next picture shows which ones are missing
            elif not self.packets.by_count:
                number = bisect_left(self.packets.times_s, _seconds(decoded) - TIME_TOLERANCE_S, expected)
            if number >= len(self):
                break
            yield from ((missing, reason) for missing in range(expected, number))
            damaged = not isinstance(decoded, str) and decoded.is_corrupt
            yield number, "its data are damaged" if damaged else decoded
            expected = number + 1
        yield from ((missing, reason) for missing in range(expected, len(self)))

    def _frame(self, index: int, picture: Any) -> Frame:
        file, time_s, world_from_body = f"{self.packets.path.name}#{index}", float(self.packets.times_s[index]), None
        if isinstance(picture, str):
            raise FrameError(file, picture)
        if self._poses is not None:
            time_s, world_from_body = time_s + self._poses.offset_s, self._poses.at(time_s)
        try:
            image = read_upright(picture, self.packets.pixel_aspect)
            if self._mounted is None:
                return Frame(file, time_s, image)
            mounted = self._mounted.fit(image.shape[1], image.shape[0])
            frame = mounted.frame(file, time_s, image, world_from_body=world_from_body)
            return drop_unknown_place(frame, self._poses)
        except ValueError as error:
            raise FrameError(file, str(error)) from None

    def _note_shape(self) -> tuple[str, ...]:
        """A note where pictures are shown otherwise than they are stored."""
        (width, height), (stored_width, stored_height) = self.packets.size, self.packets.stored_size
        notes = []
        if self.packets.is_turned:
            notes.append(f"{self.name}: metadata turn the pictures: a camera file belongs to the upright picture")
        if self.packets.size != self.packets.stored_size:
            notes.append(
                f"{self.name}: pixels are not square: {stored_width}x{stored_height} px become {width}x{height} px"
            )
        return tuple(notes)


def scan_video(path: Path) -> VideoPackets:
    """Presentation times of all coded pictures; a RecordingError for no video, or one without pictures or times."""
    with _open(path) as container:
        times = [
            _seconds(packet) for packet in _read_packets(container) if packet and packet.size and not packet.is_discard
        ]
        by_count, codec = container.format.name == COUNTED, container.streams.video[0].codec_context
        pixel_aspect, coded_size = read_pixel_aspect(container.streams.video[0]), (codec.width, codec.height)
    try:
        square_size(*coded_size, pixel_aspect)  # before a picture is decoded
        shape = _read_shape(path, coded_size, pixel_aspect)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    if not times:
        raise RecordingError(f"{path}: zero frames: the video holds no pictures")
    if np.isnan(times).all():
        raise RecordingError(
            f"{path}: the video holds no presentation times; write it anew with its frame rate: "
            f"ffmpeg -framerate 30 -i {path.name} {path.stem}.mp4"
        )
    in_order_s = np.sort([time for time in times if not np.isnan(time)])
    size, stored_size, turned = shape
    return VideoPackets(path, in_order_s, by_count, size, stored_size, pixel_aspect, turned)


def _read_shape(
    path: Path, coded_size: tuple[int, int], pixel_aspect: float
) -> tuple[tuple[int, int], tuple[int, int], bool]:
    """Size with square pixels, size as stored, both upright, px, and whether it is turned: of the first that decodes.

    Raises:
        ValueError: as `read_upright`.
    """
    first = next((picture for picture in _decode(path) if not isinstance(picture, str)), None)
    if first is None:
        return square_size(*coded_size, pixel_aspect), coded_size, False
    return upright_size(first, pixel_aspect), upright_size(first, 1.0), read_turn(first) != UPRIGHT


def _seconds(timed: Any) -> float:
    """Presentation time of a packet or a picture on the video's clock, s; NaN without one."""
    return float("nan") if timed.pts is None else float(timed.pts * timed.time_base)


def _open(path: Path) -> Any:
    try:
        check_regular(path)
        container = av.open(f"file:{path}", options=FROM_ANYWHERE)
    except (av.error.FFmpegError, OSError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RecordingError(f"{path}: not a video, or cut short: {reason}") from None
    if not container.streams.video:
        container.close()
        raise RecordingError(f"{path}: not a video: it has no picture stream")
    if container.streams.video[0].codec_context is None:
        container.close()
        raise RecordingError(f"{path}: no decoder for its pictures; write it anew as H.264")
    return container


def _read_packets(container: Any) -> Iterator[Any]:
    """Packets of the picture stream; None once where reading breaks off."""
    stream = container.streams.video[0]
    stream.thread_type = "AUTO"
    stream.codec_context.options = DECODER
    try:
        yield from container.demux(stream)
    except av.error.FFmpegError:
        yield None


def _decode(path: Path) -> Iterator[Any]:
    """Decoded pictures in their order; a text where a packet cannot be decoded."""
    with _open(path) as container:
        for packet in _read_packets(container):
            if packet is None:
                yield "the file is damaged here: reading breaks off"
                return
            try:
                yield from packet.decode()
            except av.error.FFmpegError as error:
                yield f"cannot be decoded: {error.strerror or error}"
