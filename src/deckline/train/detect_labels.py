"""Pictures that people labelled, as views to train on: no depth, so no haze is added to them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline.labels.lines import LABELS_FILE, Labels, read_labels, resampled
from deckline.labels.truth import LINE_POINTS
from deckline.recording.airsim import RECORD_FILE
from deckline.recording.images import read_image
from deckline.recording.source import FrameError, is_inside
from deckline.types import SIDES


@dataclass(frozen=True, eq=False)
class LabelledView:
    """A picture as it was taken and where its lines are in it."""

    file: str
    image_rgb: NDArray[np.uint8]  # (H, W, 3)
    lines_px: NDArray[np.float64] | None  # (3, N, 2) left, right, centre in order along each, NaN one that is not there


class LabelledFolder:
    """The labelled images of a folder with labels.json; images that it does not name are left out.

    Raises:
        ValueError: labels that cannot be read, or an image that is not there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._labels = read_labels(path / LABELS_FILE)
        self._files = list(self._labels)
        for file in self._files:
            if not is_inside(file) or not (path / file).is_file():
                raise ValueError(f"{path / LABELS_FILE}: there is no image {file} in {path}")

    def __len__(self) -> int:
        return len(self._files)

    def view(self, index: int) -> LabelledView:
        """View `index`, in the order of the labels.

        Raises:
            FrameError: an image that cannot be read.
        """
        file = self._files[index]
        try:
            image = read_image(self._path / file)
        except ValueError as error:
            raise FrameError(str(self._path / file), str(error)) from None
        return LabelledView(file, image, _lines(self._labels[file]))


def is_labelled_folder(path: Path) -> bool:
    """Whether a folder holds images with labels.json, and no recording."""
    return (path / LABELS_FILE).is_file() and not (path / RECORD_FILE).exists()


def _lines(labels: Labels) -> NDArray[np.float64] | None:
    if all(line is None for line in labels.values()):
        return None
    lines = np.full((len(SIDES) + 1, LINE_POINTS, 2), np.nan)  # nobody labels the centre line
    for k, side in enumerate(SIDES):
        line = labels[side]
        if line is not None:
            lines[k] = resampled(line, LINE_POINTS)
    return lines
