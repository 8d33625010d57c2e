"""Video files, decoded frame by frame: memory does not grow with the film.

A picture is bad when its decoder says so; films carry no checksums, so damage that still decodes cannot be told.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av

from deckline.recording.camera_file import MountedCamera, make_plain_frame
from deckline.recording.poses import Poses
from deckline.recording.source import BadFrame, FrameError, RecordingError, Source, check_index
from deckline.types import Frame


class Video(Source):
    """A video file. Frame n is called <video>#<n>, counted from 0; without poses its time is the film's own clock.

    Iterating streams. `load` decodes from the last frame it gave, or from the beginning: going backwards is slow.
    `mounted` is None without a camera file; `poses` are rows by frame number; `count` is what `count_frames` found.
    """

    def __init__(self, path: Path, mounted: MountedCamera | None, poses: Poses | None, count: int) -> None:
        self.path = path
        self.name = str(path)
        self._mounted = mounted
        self._poses = poses
        self._count = count
        self._cursor: Iterator[tuple[int, Frame | BadFrame]] = iter(())
        self._next = -1
        no_poses = (f"{path}: no poses.csv: no positions of the aircraft",)
        self.notes = no_poses if poses is None else poses.notes

    def __len__(self) -> int:
        return self._count

    def load(self, index: int) -> Frame:
        check_index(index, len(self), self.name)
        if not 0 <= self._next <= index:
            self._cursor = enumerate(self.items())
        for number, item in self._cursor:
            self._next = number + 1
            if number == index:
                if isinstance(item, BadFrame):
                    raise FrameError(item.file, item.reason)
                return item
        self._next = -1
        raise FrameError(self._file(index), "the film ends before this frame")

    def items(self) -> Iterator[Frame | BadFrame]:
        count = 0
        for count, decoded in enumerate(_decode(self.path), 1):
            if isinstance(decoded, str):
                yield BadFrame(self._file(count - 1), decoded)
                continue
            try:
                yield self._frame(count - 1, decoded)
            except ValueError as error:
                yield BadFrame(self._file(count - 1), str(error))
        if count < self._count:
            yield BadFrame(self._file(count), f"only {count} of {self._count} frames can be decoded")

    def _file(self, index: int) -> str:
        return f"{self.path.name}#{index}"

    def _frame(self, index: int, decoded: Any) -> Frame:
        world_from_body = None
        if self._poses is not None:
            time_s, world_from_body = self._poses.at(str(index))
        elif decoded.time is None:
            raise ValueError("the film gives this frame no time; write poses.csv with its time_s")
        else:
            time_s = float(decoded.time)
        image = decoded.to_ndarray(format="rgb24")
        if self._mounted is None:
            return make_plain_frame(self._file(index), time_s, image)
        return self._mounted.frame(self._file(index), time_s, image, world_from_body=world_from_body)


def count_frames(path: Path) -> int:
    """Number of coded frames, without decoding them; a RecordingError for no video, or one without frames."""
    with _open(path) as container:
        count = sum(1 for packet in _read_packets(container) if packet is not None and packet.size)
    if count == 0:
        raise RecordingError(f"{path}: zero frames: the video holds no pictures")
    return count


def _open(path: Path) -> Any:
    try:
        container = av.open(str(path))
    except (av.error.FFmpegError, OSError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RecordingError(f"{path}: not a video, or cut short: {reason}") from None
    if not container.streams.video:
        container.close()
        raise RecordingError(f"{path}: not a video: it has no picture stream")
    return container


def _read_packets(container: Any) -> Iterator[Any]:
    """Packets of the picture stream; None once where reading breaks off."""
    stream = container.streams.video[0]
    stream.thread_type = "AUTO"
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
                pictures = packet.decode()
            except av.error.FFmpegError as error:
                yield f"cannot be decoded: {error.strerror or error}"
                continue
            for picture in pictures:
                yield "its data are damaged" if picture.is_corrupt else picture
