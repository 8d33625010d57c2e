"""Views of recordings kept in memory, and training batches made from them ahead of time."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from deckline.detect.row_anchors import RowGrid
from deckline.recording import Source, open_source
from deckline.train.detect_augment import DetectAugmentation
from deckline.train.detect_labels import LabelledFolder, LabelledView, is_labelled_folder
from deckline.train.detect_losses import DetectTargets
from deckline.train.detect_samples import make_sample
from deckline.train.detect_views import LineView, line_view
from deckline.train.split import split_views

PREFETCH = 4  # batches made ahead


class LineViews:
    """Views of recordings and labelled folders, read when first asked for and kept in memory. Threads may share it.

    Args:
        recordings: clear recordings with full depth and true lines, or images with labels.json; one given twice is
            drawn twice as often.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part; False gives the held-out part, of every recording once.

    Raises:
        ValueError: no recordings, or no views.
    """

    def __init__(self, recordings: list[Path], held_out: float, train: bool = True) -> None:
        self._sources: dict[Path, Source | LabelledFolder] = {
            path: LabelledFolder(path) if is_labelled_folder(path) else open_source(path) for path in recordings
        }
        self._items = split_views(recordings, self._sources, held_out, train)
        self._cache: dict[tuple[Path, int], LineView | LabelledView] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: int) -> LineView | LabelledView:
        path, frame_index = item = self._items[index]
        view = self._cache.get(item)
        if view is None:
            source = self._sources[path]
            if isinstance(source, LabelledFolder):
                view = source.view(frame_index)
            else:
                view = line_view(source.load(frame_index))
            with self._lock:
                self._cache[item] = view
        return view


def make_batch(
    views: LineViews, batch: int, grid: RowGrid, augment: DetectAugmentation, seed: list[int]
) -> tuple[Tensor, DetectTargets]:
    """Views (batch, 3, height, width) and targets; the same for the same seed, so that resuming changes nothing."""
    rng = np.random.default_rng(seed)
    samples = [make_sample(views[int(index)], grid, augment, rng) for index in rng.integers(0, len(views), batch)]
    columns = [torch.from_numpy(np.stack(column)) for column in zip(*samples, strict=True)]
    return columns[0], DetectTargets(*columns[1:])


def batches(
    views: LineViews, batch: int, grid: RowGrid, augment: DetectAugmentation, seed: int, start: int, steps: int
) -> Iterator[tuple[Tensor, DetectTargets]]:
    """Batches of the steps from `start` on, made ahead by threads."""

    def make(step: int) -> tuple[Tensor, DetectTargets]:
        return make_batch(views, batch, grid, augment, [seed, step])

    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(make, start + k) for k in range(PREFETCH)]
        try:
            for step in range(start, steps):
                waiting.append(pool.submit(make, step + PREFETCH))
                yield waiting.pop(0).result()
        finally:
            pool.shutdown(cancel_futures=True)
