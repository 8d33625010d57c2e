"""What every source of frames has in common: its errors, how to iterate, and checks of what its files hold."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.files import MOST_TEXT_BYTES, parse_plain, print_line, read_regular
from deckline.types import Frame

if TYPE_CHECKING:
    from deckline.recording.pose_track import PoseTrack


class RecordingError(ValueError):
    """A source that cannot be opened, or a recording that cannot be written."""


class FrameError(ValueError):
    """One frame that cannot be used; the others can.

    Args:
        file: name of the frame's file.
        reason: what is wrong with it, for people.
    """

    def __init__(self, file: str, reason: str) -> None:
        super().__init__(file, reason)
        self.file = file
        self.reason = reason

    def __str__(self) -> str:
        return f"{self.file}: {self.reason}"


@dataclass(frozen=True)
class BadFrame:
    """A damaged frame, and why it is skipped."""

    file: str
    reason: str


def print_skipped(bad: BadFrame) -> None:
    """Print on stderr which frame is skipped, and why."""
    print_line(f"skipped {bad.file}: {bad.reason}")


class Source(ABC):
    """Frames of a folder, a video, a bag, a simulator, a camera or a stream, in their order.

    A `Recording` can be asked for any of its frames; a `deckline.live.source.LiveSource` has them as they are taken.
    Iterating yields the usable frames and calls `on_skip` for each damaged one.
    """

    name: str
    """What a report calls it."""
    notes: tuple[str, ...] = ()
    """What is odd about it but does not stop it, one line each, for people."""
    base_config: RunConfig | None = None
    """What is known of its deck, as the configuration that runs start from; None: nothing."""
    on_skip: Callable[[BadFrame], None] | None = None
    """Takes a damaged frame; None prints its file and the reason on stderr."""

    @property
    def length(self) -> int | None:
        """Number of frames, damaged ones included; None where they come until `stop`."""
        return None

    @abstractmethod
    def items(self) -> Iterator[Frame | BadFrame]:
        """All frames in their order, damaged ones too, once through."""

    def __iter__(self) -> Iterator[Frame]:
        for item in self.items():
            if isinstance(item, BadFrame):
                (self.on_skip or print_skipped)(item)
            else:
                yield item

    def stop(self) -> None:  # noqa: B027 (files need no stopping)
        """End a wait for the next frame; for a signal handler or any thread."""

    def close(self) -> None:  # noqa: B027 (few hold anything)
        """Release what it holds, once nobody iterates."""


class Recording(Source):
    """A source of files, any of whose frames can be asked for."""

    pose_track: "PoseTrack | None" = None
    """The poses that are placed on its pictures by time; None: there are none, or each picture has its own."""

    @property
    def length(self) -> int | None:
        return len(self)

    @abstractmethod
    def __len__(self) -> int:
        """Number of frames, damaged ones included."""

    @abstractmethod
    def times(self) -> NDArray[np.float64]:
        """Time of every frame, s, on the source's own clock, without loading it; NaN where it has none."""

    @abstractmethod
    def load(self, index: int) -> Frame:
        """Frame `index`, counted from 0.

        Raises:
            FrameError: this frame cannot be used.
            IndexError: there is no such frame.
        """

    def item(self, index: int) -> Frame | BadFrame:
        """Frame `index`, or that it is damaged; an IndexError as `load`."""
        try:
            return self.load(index)
        except FrameError as error:
            return BadFrame(error.file, error.reason)

    def items(self) -> Iterator[Frame | BadFrame]:
        return map(self.item, range(len(self)))


def read_data(path: Path, most_bytes: int = MOST_TEXT_BYTES) -> bytes:
    """All of a file; a RecordingError for a missing, unreadable or too large one."""
    try:
        return read_regular(path, most_bytes)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise RecordingError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None


def read_text(path: Path, most_bytes: int = MOST_TEXT_BYTES) -> str:
    """UTF-8 text without byte-order mark; a RecordingError as `read_data`, and for what is no text."""
    try:
        return read_data(path, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not a text file ({error.reason} at byte {error.start})") from None


def parse_json(text: str, where: str) -> Any:
    """Values of a JSON text, or a RecordingError that begins with `where`."""
    try:
        return parse_plain(json.loads, text)
    except ValueError as error:
        raise RecordingError(f"{where}: not valid JSON: {error}") from None


def check_index(index: int, count: int, name: str) -> None:
    if not 0 <= index < count:
        raise IndexError(f"{name} has frames 0 to {count - 1}, asked for {index}")


def is_inside(name: str) -> bool:
    """Whether a relative path stays inside its folder (a recording may come from anywhere)."""
    path = PurePosixPath(name.replace("\\", "/"))
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts and ":" not in path.parts[0]


def check_number(value: Any, name: str) -> float:
    """A finite number; anything else is a ValueError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number, got {value!r}")
    return float(value)


def check_numbers(values: Any, count: int, name: str) -> tuple[float, ...]:
    """So many finite numbers of a list; anything else is a ValueError."""
    if not isinstance(values, list) or len(values) != count:
        raise ValueError(f"{name} must be {count} finite numbers, got {values!r}")
    return tuple(check_number(value, name) for value in values)
