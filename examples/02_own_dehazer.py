"""Put a dehazer of your own into the chain: any callable from an RGB image to an RGB image.

    python examples/02_own_dehazer.py RECORDING

Here: contrast-limited histogram equalisation from OpenCV, beside what deckline ships.
"""

import sys

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline import Flight, open_recording


class Clahe:
    """Equalise the lightness channel."""

    name = "clahe"

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        lab = cv2.cvtColor(image_rgb, cv2.COLOR_RGB2LAB)
        lab[..., 0] = cv2.createCLAHE(clipLimit=3.0, tileGridSize=(8, 8)).apply(lab[..., 0])
        return np.asarray(cv2.cvtColor(lab, cv2.COLOR_LAB2RGB), dtype=np.uint8)


def main(recording: str) -> None:
    shipped, own = Flight.from_config(), Flight.from_config(dehazer=Clahe())
    for frame in open_recording(recording):
        print(
            frame.file,
            *(f"{flight.dehazer.name}: {flight(frame).estimate.seen}" for flight in (shipped, own)),
            sep="  ",
        )


if __name__ == "__main__":
    main(sys.argv[1])
