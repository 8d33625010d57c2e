"""Views that dehazers are trained on: recordings with depth, and pairs of a hazy and a clear picture."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline_lab.evaluation.dehazing_pairs import Pair, open_pairs
from deckline_lab.labels.lines import LABELS_FILE
from deckline_lab.train.clear_views import ClearView, make_clear_view, shrink
from deckline_lab.train.view_sets import Part, Views, open_views


@dataclass(frozen=True, eq=False)
class PairView:
    """A view in haze and without it, of which no depth is known."""

    clear_rgb: NDArray[np.uint8]  # (H, W, 3)
    hazy_rgb: NDArray[np.uint8]  # (H, W, 3)


def make_pair_view(pair: Pair, long_side_px: int) -> PairView:
    """A pair averaged down by a whole factor to about `long_side_px`."""
    if pair.clear_rgb is None:
        raise ValueError(f'{pair.frame.file}: no clear picture; name it in {LABELS_FILE} as "pair_of" of the hazy one')
    return PairView(*(shrink(image, long_side_px)[0] for image in (pair.clear_rgb, pair.frame.image_rgb)))


def open_clear_views(
    recordings: list[Path], long_side_px: int, held_out: float, train: bool = True
) -> Views[ClearView | PairView]:
    """Clear views of recordings and pairs of labelled folders; see `Views`.

    Args:
        long_side_px: larger pictures are averaged down to about this.
    """

    def open_labelled(folder: Path) -> Part[PairView]:
        pairs = open_pairs(folder)
        return len(pairs.keys), lambda index: make_pair_view(pairs.load(pairs.keys[index]), long_side_px)

    return open_views(recordings, open_labelled, lambda frame: make_clear_view(frame, long_side_px), held_out, train)
