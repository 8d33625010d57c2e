"""What every dehazer is."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Dehazer(Protocol):
    """A hazy image (H, W, 3) uint8 RGB in, a clear one of the same shape and type out; its input stays untouched.

    Raises:
        ValueError: an array that is no such image.
    """

    name: str  # for people and reports

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]: ...


def check_image(image_rgb: NDArray[np.uint8]) -> None:
    """Raise ValueError unless this is a (H, W, 3) uint8 image of at least one pixel."""
    if image_rgb.dtype != np.uint8:
        raise ValueError(f"image must be uint8, got {image_rgb.dtype}")
    if image_rgb.ndim != 3 or image_rgb.shape[2] != 3 or image_rgb.size == 0:
        raise ValueError(f"image must have shape (H, W, 3) with H, W >= 1, got {image_rgb.shape}")
