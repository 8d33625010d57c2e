"""How far the picture has moved between two frames of one flight: what an aircraft's turning does to far objects."""

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.detect.crop import Box

WIDTH_PX = 320  # of the pictures that are compared
MIN_RESPONSE = 0.1  # of the correlation's peak; a lower one is chance, as between two scenes

Float32 = NDArray[np.float32]


def small_grey(image_rgb: NDArray[np.uint8]) -> Float32:
    """An image (H, W, 3) as grey levels, `WIDTH_PX` wide."""
    height, width = image_rgb.shape[:2]
    size = WIDTH_PX, max(round(height * WIDTH_PX / width), 2)
    return cv2.cvtColor(cv2.resize(image_rgb, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY).astype(
        np.float32
    )


def picture_shift(before: Float32, after: Float32) -> NDArray[np.float64] | None:
    """How far `after` is moved against `before`, both of `small_grey`: (du, dv) in image widths.

    By phase correlation. None where the pictures have nothing in common, or another size.
    """
    if before.shape != after.shape:
        return None
    window = cv2.createHanningWindow(before.shape[::-1], cv2.CV_32F)
    shift, response = cv2.phaseCorrelate(before, after, window)
    return np.array(shift) / WIDTH_PX if response >= MIN_RESPONSE else None


def move_box(box: Box, shift: NDArray[np.float64], image_width: int) -> Box:
    """A box of an image so many px wide, moved by a shift (2,) in image widths."""
    du, dv = shift * image_width
    u0, v0, u1, v1 = box
    return u0 + du, v0 + dv, u1 + du, v1 + dv
