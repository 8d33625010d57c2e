"""Views of recordings kept in memory, and batches made from them ahead of time; the same for every network."""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from deckline.recording import FrameError

MAX_BAD_DRAWS = 20  # frames in a row that cannot be used
PREFETCH = 4  # batches made ahead

View = TypeVar("View")
Batch = TypeVar("Batch")


class Views(Generic[View]):
    """Views of several recordings, read when first asked for and kept in memory. Safe to share between threads.

    Args:
        counts: frames of each recording, by path.
        recordings: paths; one given twice is drawn twice as often.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part; False gives the held-out part, of every recording once.
        load: view `index` of a recording. It raises FrameError where it cannot be read and others can, ValueError
            where it lacks what training needs, as all of its recording will.

    Attributes:
        skipped: what was wrong with frames that could not be used, by file.

    Raises:
        ValueError: no views.
    """

    def __init__(
        self,
        counts: Mapping[Path, int],
        recordings: list[Path],
        held_out: float,
        train: bool,
        load: Callable[[Path, int], View],
    ) -> None:
        self._load = load
        self._items: list[tuple[Path, int]] = []
        for path in recordings if train else counts:
            first_held_out = counts[path] - round(held_out * counts[path])
            part = range(first_held_out) if train else range(first_held_out, counts[path])
            self._items += [(path, index) for index in part]
        if not self._items:
            raise ValueError(f"no {'training' if train else 'held-out'} views in {[str(path) for path in recordings]}")
        self._cache: dict[tuple[Path, int], View] = {}
        self.skipped: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: int) -> View:
        item = self._items[index]
        view = self._cache.get(item)
        if view is None:  # two threads may both load a view; either result serves
            view = self._cache[item] = self._load(*item)
        return view

    def draw(self, rng: np.random.Generator) -> View:
        """A random view; a frame that cannot be used is noted in `skipped` and another one drawn.

        Raises:
            ValueError: MAX_BAD_DRAWS frames in a row cannot be used.
        """
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
