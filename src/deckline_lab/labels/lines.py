"""The labelled lines of one image, what all label formats share, and deckline's own labels.json.

labels.json beside images: {"frames": [{"file": "a.png", "left_px": [[u, v], ...], "right_px": [[u, v], ...]}]}.
At least two points a line, or null for a line that is not there; other keys are left alone.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.atomic import write_atomic
from deckline.recording.images import IMAGE_SUFFIXES, read_image
from deckline.recording.source import parse_json, read_text
from deckline.types import SIDES

LABELS_FILE = "labels.json"
FARTHEST_PX = 1e6  # of a labelled point from the image's corner
VISIBLE = 2  # flag of a keypoint that is labelled and seen; 0 is not labelled
DECIMALS = 3  # of u and v that are written, px
Line = NDArray[np.float64]  # (N, 2) u, v in order along the line, N >= 2, px
Labels = dict[str, Line | None]  # side -> labelled line, None: no such line


@dataclass(frozen=True, eq=False)
class LabelledImage:
    """Where the two runway lines are in one image; each is two or more points, else a ValueError."""

    file: str  # of the image, relative to its data set's folder
    left_px: Line | None  # None: there is no such line in the image
    right_px: Line | None
    size_px: tuple[int, int] | None = None  # width, height, where the labels' file holds it
    ignored: tuple[str, ...] = ()  # labels in the file that name no side; their shapes are left out

    def __post_init__(self) -> None:
        for side, line in self.lines.items():
            if line is not None:
                parse_points(line, f"{self.file}: {side}_px")

    @property
    def lines(self) -> Labels:
        """Both lines by the name of their side."""
        return dict(zip(SIDES, (self.left_px, self.right_px), strict=True))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px, or a ValueError where they are not known."""
        if self.size_px is None:
            raise ValueError(f"{self.file}: this format needs the image's size")
        return self.size_px


LabelSet = tuple[Path, list[LabelledImage]]  # the folder that the images' names are relative to


def read_labels(path: Path) -> dict[str, Labels]:
    """Labelled lines by image file; a ValueError names the file and the entry that is none."""
    values = parse_object(read_text(path), str(path), "frames")
    labels = {}
    for where, entry in iterate_objects(values["frames"], f"{path}: frames"):
        file = get_text(entry, "file", where)
        named = {side: (entry.get(f"{side}_px"), f"{path}: {file} {side}_px (or null)") for side in SIDES}
        labels[file] = {side: None if x is None else parse_points(x, name) for side, (x, name) in named.items()}
    if not labels:
        raise ValueError(f"{path}: frames must hold at least one frame")
    return labels


def write_labels(path: Path, images: Sequence[LabelledImage]) -> None:
    """Write labels.json, one frame a line."""
    rows = []
    for image in images:
        lines = {f"{side}_px": None if x is None else x.round(DECIMALS).tolist() for side, x in image.lines.items()}
        rows.append(json.dumps({"file": image.file, **lines}, allow_nan=False))
    write_atomic(path, ('{"frames": [\n' + ",\n".join(rows) + "\n]}\n").encode())


def interpolate_rows(line: Line, rows: ArrayLike) -> NDArray[np.float64]:
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


def sample_rows(image: LabelledImage, rows: NDArray[np.int64]) -> list[NDArray[np.float64] | None]:
    """u (rows,) of the left and the right line, NaN where a row has none; None for fewer than two rows in the image."""
    samples: list[NDArray[np.float64] | None] = []
    for line in image.lines.values():
        u = np.full(len(rows), np.nan) if line is None else interpolate_rows(line, rows)
        u[~((u >= 0) & (u <= image.size[0] - 1))] = np.nan
        samples.append(u if np.isfinite(u).sum() >= 2 else None)
    return samples


def resample(line: Line, count: int) -> Line:
    """`count` points evenly spaced along a line, its ends among them."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(wanted, along, line[:, axis]) for axis in (0, 1)], axis=1)


def assign_sides(lines: Sequence[Line], where: str) -> tuple[Line | None, Line | None]:
    """Which of the lines of a file that does not name them is which: on the rows that they share, left is left.

    One line alone, or more than two, are a ValueError that begins with `where`.
    """
    if not lines:
        return None, None
    if len(lines) == 1:
        raise ValueError(f"{where}: one line alone has no side; expected 0 or 2 lines")
    if len(lines) > 2:
        raise ValueError(f"{where}: {len(lines)} lines; a runway has two, left and right: remove the others")
    first, second = lines
    low, high = (max(first[:, 1].min(), second[:, 1].min()), min(first[:, 1].max(), second[:, 1].max()))
    apart = second[:, 0].mean() - first[:, 0].mean()
    if high > low:
        rows = np.linspace(low, high, 9)
        apart = interpolate_rows(second, rows) - interpolate_rows(first, rows)
    return (first, second) if np.nanmean(apart) >= 0 else (second, first)


def parse_points(values: Any, where: str) -> Line:
    """Points (N, 2) from parsed JSON, text or an array, or a ValueError that begins with `where`."""
    try:
        points = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        points = np.zeros(0)
    if points.ndim != 2 or points.shape[1:] != (2,) or len(points) < 2 or not np.all(np.abs(points) <= FARTHEST_PX):
        raise ValueError(f"{where} must be two or more [u, v] in px, at most {FARTHEST_PX:g}")
    return points


def find_side(name: str, where: str) -> str | None:
    """The side that a label or a keypoint's name holds: a word that begins with left or right, such as "Runway right".

    Capitals, spaces, hyphens, underscores and digits part words. None: no side. Both are a ValueError
    that begins with `where`.
    """
    words = [word.lower() for word in re.findall(r"[A-Z]*[a-z]+|[A-Z]+", name)]
    found = [side for side in SIDES if any(word.startswith(side) for word in words)]
    if len(found) > 1:
        raise ValueError(f"{where}: {name!r} names both sides; expected {' or '.join(SIDES)}")
    return found[0] if found else None


def name_keypoints(line_points: int) -> list[str]:
    """left_1, left_2, ..., right_1, ...: `line_points` along each line."""
    return [f"{side}_{k}" for side in SIDES for k in range(1, line_points + 1)]


def make_keypoints(lines: Sequence[Line | None], line_points: int) -> NDArray[np.float64]:
    """Keypoints (2, line_points, 3) u, v, px, and VISIBLE, evenly spaced along each line; zeros without one."""
    keypoints = np.zeros((len(SIDES), line_points, 3))
    for side, line in enumerate(lines):
        if line is not None:
            keypoints[side, :, :2] = resample(line, line_points)
            keypoints[side, :, 2] = VISIBLE
    return keypoints


def split_keypoints(points: Sequence[Any], names: Sequence[str], where: str) -> Labels:
    """Lines from the labelled keypoints, each with its name; names without a side are left out."""
    sides = [find_side(name, where) for name in names]
    lines: Labels = {}
    for side in SIDES:
        chosen = [point for point, named in zip(points, sides, strict=True) if named == side]
        lines[side] = parse_points(chosen, f"{where}: {side}, labelled keypoints,") if chosen else None
    return lines


def is_in_picture(line: Line, size_px: tuple[int, int]) -> NDArray[np.bool_]:
    """Which points (N,) of a line lie in a picture (width, height)."""
    return np.all((line >= -0.5) & (line <= np.subtract(size_px, 0.5)), axis=1)


def read_size(path: Path) -> tuple[int, int]:
    """Width and height of an image file, px; a ValueError names it."""
    try:
        height, width = read_image(path).shape[:2]
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return width, height


def read_rows(path: Path) -> list[tuple[int, str]]:
    """The lines of a text file that are not blank, with their numbers."""
    return [(number, text) for number, text in enumerate(read_text(path).splitlines(), 1) if text.strip()]


def parse_object(text: str, where: str, *keys: str) -> dict[str, Any]:
    """A JSON object that holds these keys, or a ValueError that begins with `where`."""
    values = parse_json(text, where)
    if not isinstance(values, dict) or any(key not in values for key in keys):
        raise ValueError(f"{where} must be a JSON object with {', '.join(keys)}")
    return values


def find_image(folder: Path, stem: str) -> Path | None:
    """The image file of that name without suffix in a folder."""
    names = (stem + suffix for lower in IMAGE_SUFFIXES for suffix in (lower, lower.upper()))
    return next((folder / name for name in names if (folder / name).is_file()), None)


def iterate_objects(values: Any, where: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Name and entry of each object in a JSON list, or a ValueError that begins with `where`."""
    if not isinstance(values, list):
        raise ValueError(f"{where} must be a list of objects")
    for index, entry in enumerate(values):
        if not isinstance(entry, dict):
            raise ValueError(f"{where}[{index}] must be an object")
        yield f"{where}[{index}]", entry


def get_text(entry: dict[str, Any], key: str, where: str) -> str:
    """The text under a key of a JSON object, or a ValueError that begins with `where`."""
    if not isinstance(entry.get(key), str):
        raise ValueError(f"{where}: {key} must be a text")
    return str(entry[key])
