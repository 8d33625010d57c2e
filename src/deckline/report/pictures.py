"""Small pictures for the report's frame slider: few, evenly spread, on disk while the run goes on."""

from dataclasses import dataclass
from pathlib import Path

import cv2

from deckline.report.draw import Image
from deckline.report.panels import Panels

MOST = 60  # pictures kept
JPEG_QUALITY = 78


@dataclass(frozen=True)
class Picture:
    """The files of one sampled frame."""

    index: int  # of the frame's record
    hazy: Path
    marked: Path


class PictureSample:
    """Keeps every n-th frame's pictures; n doubles whenever there are too many, so any run length is spread evenly.

    Args:
        folder: where the pictures lie; those of an interrupted run are taken over.
        most: pictures kept, at least 2.
    """

    def __init__(self, folder: Path, most: int = MOST) -> None:
        if most < 2:
            raise ValueError(f"at least 2 pictures must be kept, got {most}")
        folder.mkdir(exist_ok=True)
        self._folder = folder
        self._most = most
        self._every = 1
        self._kept = [int(path.stem) for path in sorted(folder.glob("*.marked")) if path.stem.isdigit()]
        while len(self._kept) > 1 and all(index % (2 * self._every) == 0 for index in self._kept):
            self._every *= 2

    def add(self, index: int, pictures: Panels) -> None:
        """Offer the pictures of record `index`; a record offered before is written again."""
        if index % self._every:
            return
        _write_jpeg(self._picture(index).hazy, pictures.hazy)
        _write_jpeg(self._picture(index).marked, pictures.marked)
        if index not in self._kept:
            self._kept.append(index)
        while len(self._kept) > self._most:
            self._every *= 2
            for dropped in [kept for kept in self._kept if kept % self._every]:
                self._kept.remove(dropped)
                self._picture(dropped).hazy.unlink(missing_ok=True)
                self._picture(dropped).marked.unlink(missing_ok=True)

    def kept(self) -> list[Picture]:
        """The pictures there are, in the order of their frames."""
        return [self._picture(index) for index in sorted(self._kept)]

    def _picture(self, index: int) -> Picture:
        stem = f"{index:09d}"
        return Picture(index, self._folder / f"{stem}.hazy", self._folder / f"{stem}.marked")


def _write_jpeg(path: Path, image: Image) -> None:
    done, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise ValueError(f"{path.name}: a picture of shape {image.shape} could not be encoded")
    path.write_bytes(data.tobytes())
