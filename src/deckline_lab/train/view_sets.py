"""Sets of views that networks are trained on, and batches that threads make ahead of time."""

import math
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.recording import FrameError, open_recording
from deckline.recording.airsim import RECORD_FILE
from deckline.recording.image_folder import list_images
from deckline.recording.images import read_image
from deckline.types import Frame
from deckline_lab.labels.lines import LABELS_FILE

MAX_BAD_DRAWS = 20  # frames in a row that cannot be used
PREFETCH = 4  # batches made ahead

View = TypeVar("View")
Batch = TypeVar("Batch")
Part = tuple[int, Callable[[int], View]]  # of the views: a recording's number of frames, and what loads one


class Views(Generic[View]):
    """Views of several recordings, loaded on first use and cached. Safe to share between threads.

    `skipped` holds the reason why a frame cannot be used, by file.

    Args:
        parts: number of frames of each recording, and what loads one by its index. That raises FrameError for a frame
            that cannot be read, ValueError for a recording without what training needs.
        recordings: paths; one given twice is drawn twice as often.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part; False gives the held-out part, of every recording once.

    Raises:
        ValueError: no views.
    """

    def __init__(self, parts: Mapping[Path, Part[View]], recordings: list[Path], held_out: float, train: bool) -> None:
        self._load = {path: load for path, (_, load) in parts.items()}
        self._items: list[tuple[Path, int]] = []
        for path in recordings if train else parts:
            count = parts[path][0]
            first_held_out = count - round(held_out * count)
            indices = range(first_held_out) if train else range(first_held_out, count)
            self._items += [(path, index) for index in indices]
        if not self._items:
            counts = {path: count for path, (count, _) in parts.items()}
            raise ValueError(_explain_split(counts, held_out, train))
        self._cache: dict[tuple[Path, int], View] = {}
        self.skipped: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: int) -> View:
        item = self._items[index]
        view = self._cache.get(item)
        if view is None:  # two threads may both load a view; either result serves
            view = self._cache[item] = self._load[item[0]](item[1])
        return view

    def draw(self, rng: np.random.Generator) -> View:
        """A random view; a frame that cannot be used is noted in `skipped` and another one drawn."""
        for _ in range(MAX_BAD_DRAWS):
            view = self.get_usable(int(rng.integers(0, len(self))))
            if view is not None:
                return view
        file, reason = list(self.skipped.items())[-1]
        raise ValueError(f"{MAX_BAD_DRAWS} frames in a row cannot be used, {file} as {reason}")

    def get_usable(self, index: int) -> View | None:
        """View `index`; None, and a note in `skipped`, where it cannot be used."""
        try:
            return self[index]
        except FrameError as error:
            self.skipped[error.file] = error.reason
            return None

    def spread(self, count: int) -> list[int]:
        """Indices of at most `count` views, evenly spread over all."""
        return np.linspace(0, len(self) - 1, min(len(self), count)).round().astype(int).tolist()


def _explain_split(counts: Mapping[Path, int], held_out: float, train: bool) -> str:
    """Why a part is empty: expected and actual number of views, and the option to give."""
    most, part = max(counts.values(), default=0), "training" if train else "held-out"
    places = ", ".join(map(str, counts)) or "no recording"
    found = f"no {part} views: expected 1 or more, got 0 of {sum(counts.values())} in {places}"
    if most < 2:
        return f"{found}; give recordings of 2 or more"
    remedy = "less" if train else f"--held-out {math.ceil(10 / most) / 10:g}"  # one of the largest recording
    return f"{found} with --held-out {held_out:g}; give {remedy}"


def make_ahead(make: Callable[[int], Batch], start: int, steps: int) -> Iterator[Batch]:
    """`make(step)` of the steps from `start` to `steps`, both included, made ahead by threads."""
    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(make, start + k) for k in range(PREFETCH)]
        try:
            for step in range(start, steps + 1):
                waiting.append(pool.submit(make, step + PREFETCH))
                yield waiting.pop(0).result()
        finally:
            pool.shutdown(cancel_futures=True)


def is_labelled_folder(path: Path) -> bool:
    """Whether a folder holds pictures with labels.json, and no recording."""
    return (path / LABELS_FILE).is_file() and not (path / RECORD_FILE).exists()


def open_views(
    recordings: list[Path],
    open_labelled: Callable[[Path], Part[View]],
    make_view: Callable[[Frame], View],
    held_out: float,
    train: bool,
) -> Views[View]:
    """Views of recordings and of labelled folders.

    Args:
        open_labelled: number of views of a labelled folder, and what loads one.
        make_view: what training needs of a recording's frame.
        recordings, held_out, train: see `Views`.
    """

    def open_part(path: Path) -> Part[View]:
        if is_labelled_folder(path):
            return open_labelled(path)
        source = open_recording(path)
        return len(source), lambda index: make_view(source.load(index))

    return Views({path: open_part(path) for path in dict.fromkeys(recordings)}, recordings, held_out, train)


def open_pictures(folder: Path, long_side_px: int) -> Part[NDArray[np.uint8]]:
    """The photographs (H, W, 3) of a folder in the order of their names, long sides at most `long_side_px`.

    Raises:
        ValueError: no pictures in it.
    """
    files = sorted(list_images(folder))  # what is drawn must not depend on the file system
    if not files:
        raise ValueError(f"{folder} holds no pictures; give a folder of photographs")

    def load(index: int) -> NDArray[np.uint8]:
        picture = read_image(folder / files[index])
        factor = min(1.0, long_side_px / max(picture.shape[:2]))
        return np.asarray(cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), np.uint8)

    return len(files), load
