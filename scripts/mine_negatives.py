"""Cut out of pictures without a runway what a detector takes for one: hard negatives to train with.

    python scripts/mine_negatives.py photographs/train --out photographs/hard

Every picture and its mirror image are searched with all tiles. Each place whose closest view shows both lines with a
probability of LEAST or more is written, with its surroundings, and labels.json says that it has no lines.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from deckline.detect.search import CropView
from deckline.flight import open_detector
from deckline.recording.images import read_image
from deckline_lab.labels import LABELS_FILE, LabelledImage, read_labels, write_labels
from deckline_sim.progress import progress

LEAST = 0.2  # probability of both lines; a search accepts from 0.5 to 0.87
AROUND = 1.3  # the written part, in sizes of the view
JPEG_QUALITY = 97


def main() -> int:
    parser = argparse.ArgumentParser(description="Cut what a detector takes for a runway out of pictures without one.")
    parser.add_argument("pictures", type=Path, help="folder with labels.json, none with a line")
    parser.add_argument("--detector", default="hybrid", help="name or .onnx file")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    given = parser.parse_args()
    labels = read_labels(given.pictures / LABELS_FILE)
    given.out.mkdir(parents=True, exist_ok=True)
    detector = open_detector(given.detector)
    written = []
    with progress("pictures", len(labels)) as advance:
        for file in labels:
            picture = read_image(given.pictures / file)
            for side, image in (("", picture), ("m", np.ascontiguousarray(picture[:, ::-1]))):
                search = detector.start_search(image)
                for _ in search.steps():
                    pass
                views = [view for view in (*search.candidates, *search.tile_candidates) if view.count == 2]
                for number, view in enumerate(view for view in views if view.probability >= LEAST):
                    name = f"{Path(file).stem}-{side}{number}.jpg"
                    Image.fromarray(cut_out(image, view)).save(given.out / name, quality=JPEG_QUALITY)
                    written.append(LabelledImage(name, None, None))
            advance()
    write_labels(given.out / LABELS_FILE, written)
    print(f"{given.out}: {len(written)} pictures")
    return 0


def cut_out(image_rgb: NDArray[np.uint8], view: CropView) -> NDArray[np.uint8]:
    """The part of an image (H, W, 3) that a view shows, with a margin, as far as it lies in the image."""
    u0, v0, u1, v1 = view.crop.bounds(*view.config.grid.size)
    wide, tall = (AROUND - 1) / 2 * (u1 - u0), (AROUND - 1) / 2 * (v1 - v0)
    left, top = max(int(u0 - wide), 0), max(int(v0 - tall), 0)
    return image_rgb[top : int(v1 + tall) + 1, left : int(u1 + wide) + 1]


if __name__ == "__main__":
    sys.exit(main())
