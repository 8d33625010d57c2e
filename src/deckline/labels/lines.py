"""The labelled lines of one image, whatever file they stand in."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.types import SIDES

Line = NDArray[np.float64]  # (N, 2) u, v in order along the line, N >= 2, px


@dataclass(frozen=True, eq=False)
class LabelledImage:
    """Where the two runway lines are in one image.

    Raises:
        ValueError: a line that is not two or more finite points.
    """

    file: str  # of the image, relative to its data set's folder
    left_px: Line | None  # None: there is no such line in the image
    right_px: Line | None
    size_px: tuple[int, int] | None = None  # width, height, where the labels' file says it

    def __post_init__(self) -> None:
        for side, line in self.lines.items():
            if line is not None and (line.ndim != 2 or len(line) < 2 or line.shape[1] != 2 or not finite(line)):
                raise ValueError(f"{self.file}: {side}_px must be two or more [u, v] in px, or None")

    @property
    def lines(self) -> dict[str, Line | None]:
        """Both lines by the name of their side."""
        return dict(zip(SIDES, (self.left_px, self.right_px), strict=True))


@dataclass(frozen=True, eq=False)
class LabelSet:
    """What a reader found."""

    root: Path  # folder that the images' names are relative to
    images: tuple[LabelledImage, ...]


def finite(values: ArrayLike) -> bool:
    return bool(np.all(np.isfinite(values)))


def at_rows(line: Line, rows: ArrayLike) -> NDArray[np.float64]:
    """Where a line crosses image rows: u (rows,), NaN beyond its ends; of several crossings the first one."""
    v = np.asarray(rows, dtype=np.float64)[:, None]
    start, end = line[:-1], line[1:]
    rise = end[:, 1] - start[:, 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        share = (v - start[:, 1]) / rise
    crossed = (share >= 0) & (share <= 1)
    first = crossed.argmax(axis=1)
    part = np.arange(len(v))
    with np.errstate(invalid="ignore"):
        u = start[first, 0] + share[part, first] * (end[first, 0] - start[first, 0])
    return np.where(crossed[part, first], u, np.nan)


def resampled(line: Line, count: int) -> Line:
    """`count` points evenly spaced along a line, its ends among them."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(wanted, along, line[:, axis]) for axis in (0, 1)], axis=1)


def left_and_right(lines: Sequence[Line], where: str) -> tuple[Line | None, Line | None]:
    """Which of the lines of a file that does not name them is which: on the rows that they share, left is left.

    Raises:
        ValueError: one line alone, or more than two; begins with `where`.
    """
    if not lines:
        return None, None
    if len(lines) == 1:
        raise ValueError(f"{where}: one line alone does not say whether it is the left or the right one")
    if len(lines) > 2:
        raise ValueError(f"{where}: {len(lines)} lines; a runway has two, left and right: remove the others")
    first, second = lines
    low, high = (max(first[:, 1].min(), second[:, 1].min()), min(first[:, 1].max(), second[:, 1].max()))
    rows = np.linspace(low, high, 9)
    apart = at_rows(second, rows) - at_rows(first, rows) if high > low else second[:, 0].mean() - first[:, 0].mean()
    return (first, second) if np.nanmean(apart) >= 0 else (second, first)


def sized(image: LabelledImage) -> tuple[int, int]:
    """Width and height of an image, px.

    Raises:
        ValueError: they are not known.
    """
    if image.size_px is None:
        raise ValueError(f"{image.file}: this format needs the image's size")
    return image.size_px


def points(values: Any, where: str) -> Line:
    """Points (N, 2) from parsed JSON or text.

    Raises:
        ValueError: no list of finite pairs; begins with `where`.
    """
    try:
        found = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.ndim != 2 or found.shape[1:] != (2,) or len(found) < 2 or not finite(found):
        raise ValueError(f"{where} must be two or more [u, v] in px")
    return found


def parsed(text: str, where: str) -> Any:
    """Values of a JSON text.

    Raises:
        ValueError: it is none; begins with `where`.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{where}: not valid JSON: {error}") from None


def read_text(path: Path) -> str:
    """Text of a label file.

    Raises:
        ValueError: missing or no text; names the file.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not a text file ({error.reason} at byte {error.start})") from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:  # a name that no file can have
        raise ValueError(f"{path}: cannot be read: {error}") from None
