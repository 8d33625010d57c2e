"""Views of recordings with their lines, and training batches made from them."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from deckline.detect.anchors import RowGrid
from deckline.recording import Source, open_recording
from deckline.train.detect_augment import DetectAugmentation
from deckline.train.detect_labels import LabelledFolder, LabelledView, is_labelled_folder
from deckline.train.detect_losses import DetectTargets
from deckline.train.detect_samples import make_sample
from deckline.train.detect_views import LineView, line_view
from deckline.train.views import Views, made_ahead


class LineViews(Views[LineView | LabelledView, Source | LabelledFolder]):
    """Views of recordings and labelled folders; see `Views`.

    Args:
        recordings: clear recordings with full depth and true lines, or images with labels.json.
        held_out: share of every recording, at its end, that training does not see.
        train: the training part.

    Raises:
        ValueError: no recordings, or no views.
    """

    def __init__(self, recordings: list[Path], held_out: float, train: bool = True) -> None:
        sources = {
            path: LabelledFolder(path) if is_labelled_folder(path) else open_recording(path) for path in recordings
        }
        super().__init__(sources, recordings, held_out, train)

    def load(self, source: Source | LabelledFolder, index: int) -> LineView | LabelledView:
        """View `index` of a recording.

        Raises:
            FrameError: it cannot be read; others can.
            ValueError: it lacks what training needs, as all of its recording will.
        """
        return source.view(index) if isinstance(source, LabelledFolder) else line_view(source.load(index))


def make_batch(
    views: LineViews, batch: int, grid: RowGrid, augment: DetectAugmentation, seed: list[int]
) -> tuple[Tensor, DetectTargets]:
    """Views (batch, 3, height, width) and targets; the same for the same seed, so that resuming changes nothing."""
    rng = np.random.default_rng(seed)
    samples = [make_sample(views.draw(rng), grid, augment, rng) for _ in range(batch)]
    columns = [torch.from_numpy(np.stack(column)) for column in zip(*samples, strict=True)]
    return columns[0], DetectTargets(*columns[1:])


def batches(
    views: LineViews, batch: int, grid: RowGrid, augment: DetectAugmentation, seed: int, start: int, steps: int
) -> Iterator[tuple[Tensor, DetectTargets]]:
    """Batches of the steps from `start` on, made ahead by threads."""
    return made_ahead(lambda step: make_batch(views, batch, grid, augment, [seed, step]), start, steps)
