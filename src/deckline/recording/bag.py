"""ROS bags through rosbags: MCAP, SQLite and ROS 1 files, read picture by picture; memory does not grow with them."""

import io
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from deckline.extras import needs_extra
from deckline.files import open_regular
from deckline.recording.camera_file import MountedCamera
from deckline.recording.pose_track import PoseTrack
from deckline.recording.poses import drop_unknown_place
from deckline.recording.ros_messages import decode_depth, decode_picture
from deckline.recording.source import FrameError, Recording, RecordingError, check_index
from deckline.types import Frame

SUFFIXES = (".mcap", ".db3", ".bag")
METADATA = "metadata.yaml"  # of a ROS 2 bag's folder
DEPTH_TOLERANCE_S = 0.02  # between a picture and its depth
AHEAD = 32  # pictures that are passed over rather than sought
MAGIC = b"\x89MCAP0\r\n"
ROS1_MAGIC = b"#ROSBAG V"
FOOTER = b"\x02" + (20).to_bytes(8, "little") + bytes(20) + MAGIC  # without a summary: the data are scanned
DATA_END = 0x0F


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a file, or a folder with a ROS 2 bag's metadata or with files of one."""
    return bool(_list_files(path))


def _list_files(path: Path) -> list[Path]:
    if path.is_dir() and not (path / METADATA).exists():
        kinds = (sorted(path.glob(f"*{suffix}")) for suffix in SUFFIXES)
        return next((files for files in kinds if files), [])
    return [path] if path.is_dir() or path.suffix in SUFFIXES else []


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic of a bag that holds messages."""

    name: str
    kind: str  # type of its messages
    connections: tuple[Any, ...]

    def __str__(self) -> str:
        return f"{self.name} ({self.kind.replace('/msg/', '/')})"


class MessageReader:
    """Messages of one topic, the next one read on from the last; those before it, or far ahead, are sought by time.

    Args:
        path: of the bag, opened anew: two iterators over one reader would disturb each other.
        topic: of the messages.
        log_ns: (N,) when each was recorded, ascending.
    """

    def __init__(self, path: Path, topic: Topic, log_ns: NDArray[np.int64]) -> None:
        self._reader = open_reader(path)[0]
        names = [connection.topic for connection in topic.connections]
        self._connections = [one for one in self._reader.connections if one.topic in names]
        self._log_ns = log_ns
        self._cursor: Iterator[Any] = iter(())
        self._next = -1

    def read(self, index: int) -> Any:
        """Message `index`. Raises what the parsers raise for damaged data."""
        if not self._next <= index <= self._next + AHEAD or self._next < 0:
            start = int(self._log_ns[index])
            self._cursor = self._reader.messages(self._connections, start=start)
            self._next = int(np.searchsorted(self._log_ns, start))
        passed, self._next = index - self._next, -1  # should reading fail
        connection, _, data = next(islice(self._cursor, passed, None))
        self._next = index + 1
        return deserialize(self._reader, connection, data)


def deserialize(reader: Any, connection: Any, data: Any) -> Any:
    """A message from its bytes. Raises what the parsers raise for damaged ones, a ValueError where SQLite has NULL."""
    if data is None:
        raise ValueError("a message without data (NULL)")
    return reader.deserialize(data, connection.msgtype)


class Bag(Recording):
    """Pictures of one topic. Picture n is called <bag>#<n>; its time is its header's, on the poses' clock.

    Args:
        path: of the bag.
        pictures, stamps_s: messages and their times (N,).
        mounted: None: no camera_info and no camera file.
        mount: where the camera sits while it moves on the body; None: as `mounted` states.
        track: None: no poses.
        depth: messages with depth and their times; None: there is none.
    """

    def __init__(
        self,
        path: Path,
        pictures: tuple[MessageReader, NDArray[np.float64]],
        mounted: MountedCamera | None,
        mount: PoseTrack | None,
        track: PoseTrack | None,
        depth: tuple[MessageReader, NDArray[np.float64]] | None,
    ) -> None:
        self.name = str(path)
        self._stem = path.name
        self._message_reader, self._times = pictures
        self._mounted, self._mount, self._track, self._depth = mounted, mount, track, depth
        self.pose_track = track

    def __len__(self) -> int:
        return len(self._times)

    def times(self) -> NDArray[np.float64]:
        return self._times

    def load(self, index: int) -> Frame:
        check_index(index, len(self), self.name)
        file, time_s = f"{self._stem}#{index}", float(self._times[index])
        with refuse(lambda reason: FrameError(file, reason)):
            image = decode_picture(self._message_reader.read(index))
            if self._mounted is None:
                return Frame(file, time_s, image)
            mounted, pose = self._mounted.fit(image.shape[1], image.shape[0]), None
            if self._track is not None:
                pose = self._track.at(time_s)
            if self._mount is not None:
                mount = self._mount.at(time_s)
                pose, mounted = (None, mounted) if mount is None else (pose, replace(mounted, body_from_camera=mount))
            depth, offset_s = self._find_depth(time_s), 0.0 if self._track is None else self._track.offset_s
            frame = mounted.frame(file, time_s + offset_s, image, world_from_body=pose, depth_m=depth)
            return drop_unknown_place(frame, self._track)

    def _find_depth(self, time_s: float) -> NDArray[np.float32] | None:
        if self._depth is None:
            return None
        reader, times = self._depth
        nearest = int(np.abs(times - time_s).argmin())
        return decode_depth(reader.read(nearest)) if abs(times[nearest] - time_s) <= DEPTH_TOLERANCE_S else None


@contextmanager
def refuse(make: Callable[[str], ValueError]) -> Iterator[None]:
    """Turn what parsers of damaged bytes raise into an error of ours."""
    try:
        yield
    except (RecordingError, FrameError, ImportError):
        raise
    except Exception as error:  # rosbags passes on those of struct, SQLite, lz4, zstd, lengths that lie, and its own
        raise make(" ".join(str(error).split()) or type(error).__name__) from None


def open_reader(path: Path) -> tuple[Any, list[str]]:
    """A reader of a bag, open as long as somebody holds it, and notes on what is left out.

    Raises:
        RecordingError: no bag, or one that cannot be read.
        ImportError: the extra `ros` is not installed.
    """
    with needs_extra("ros"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    files = _list_files(path)
    if files == [path] and path.is_dir() and any(_intact_bytes(file) for file in path.glob("*.mcap")):
        files = sorted(path.glob("*.mcap"))
    with refuse(lambda reason: RecordingError(f"{path}: not a ROS bag, or damaged: {reason}")):
        for file in path.iterdir() if path.is_dir() else files:
            if file.suffix in SUFFIXES and not file.is_dir():
                _check_file(file)
        repaired: list[Any] = [_TruncatedFile(file, end) if (end := _intact_bytes(file)) else file for file in files]
        reader: Any = AnyReader(repaired, default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    weakref.finalize(reader, reader.stack.close)
    truncated = (file for file in repaired if isinstance(file, _TruncatedFile))
    return reader, [f"{file.path}: cut short: its first {file.end:,} bytes are read" for file in truncated]


def _check_file(path: Path) -> None:
    """Raise OSError for no regular file, ValueError for a .bag without its magic: rosbags would wait, or read on."""
    with open_regular(path) as file:
        if path.suffix == ".bag" and file.read(len(ROS1_MAGIC)) != ROS1_MAGIC:
            raise ValueError("it does not begin as a ROS 1 bag does")


def _intact_bytes(path: Path) -> int:
    """Where the last whole record of an MCAP file that was cut short ends, bytes; 0: it is whole, or no such file.

    Source: MCAP specification (magic, records of opcode and length, Data End before the summary).
    """
    if path.suffix != ".mcap" or path.is_dir():
        return 0
    with open_regular(path) as file:
        size, at = file.seek(0, io.SEEK_END), len(MAGIC)
        file.seek(max(size - len(MAGIC), 0))
        end = file.read()
        file.seek(0)
        if end == MAGIC or file.read(len(MAGIC)) != MAGIC:
            return 0
        while len(head := file.read(9)) == 9:
            after = at + 9 + int.from_bytes(head[1:], "little")
            if head[0] in (0, DATA_END) or after > size:
                break
            at = file.seek(after)
    return at


@dataclass(frozen=True)
class _TruncatedFile:
    """A path, as rosbags takes it, to what is whole of an MCAP file, closed by a footer."""

    path: Path
    end: int

    @property
    def suffix(self) -> str:
        return self.path.suffix

    def exists(self) -> bool:
        return self.path.exists()

    def is_dir(self) -> bool:
        return False

    def open(self, _mode: str) -> BinaryIO:
        return io.BufferedReader(_RepairedStream(open_regular(self.path), self.end))


class _RepairedStream(io.RawIOBase):
    """The first bytes of a file, then a footer."""

    def __init__(self, file: BinaryIO, end: int) -> None:
        self._file, self._end, self._at = file, end, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._end + len(FOOTER)}[whence]
        self._at = base + offset
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: Any) -> int:
        if self._at < self._end:
            self._file.seek(self._at)
            data = self._file.read(min(len(buffer), self._end - self._at))
        else:
            data = FOOTER[self._at - self._end :][: len(buffer)]
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)

    def close(self) -> None:
        self._file.close()
        super().close()
