"""Filters of images that several dehazers share: over channels, over windows, along edges.

cv2 is imported where it is used: training imports this package on machines without OpenCV.
"""

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.floating]  # float32

NOISE_PART = 0.9  # of the differences that count
NOISE_MEAN = 0.9297  # of a normal difference of sigma sqrt(2), in size, of that smallest part


def min_channel(image: Image) -> Image:
    """Minimum over colours, (H, W, 3) -> (H, W); numpy's over the last axis takes several times as long."""
    import cv2

    red, green, blue = cv2.split(image)
    return np.asarray(cv2.min(cv2.min(red, green), blue))


def mean_channel(image: Image) -> Image:
    """Mean over colours, (H, W, 3) -> (H, W); numpy's over the last axis takes ten times as long."""
    import cv2

    return np.asarray(cv2.transform(image, np.full((1, 3), 1 / 3, np.float32)), dtype=np.float32)


def max_channel(levels: Image) -> Image:
    """Largest of three channels, (3, ...) -> (...)."""
    return np.maximum(np.maximum(levels[0], levels[1]), levels[2])


def dark_channel(image: Image, patch_px: int) -> Image:
    """Minimum over colours and a square window, (H, W, 3) -> (H, W). Source: He, Sun and Tang 2011."""
    import cv2

    return np.asarray(cv2.erode(min_channel(image), np.ones((patch_px, patch_px), np.uint8)), dtype=np.float32)


def guided_coefficients(guide: Image, values: Image, radius_px: int, eps: float) -> tuple[Image, Image]:
    """Slope and offset (H, W) of `values` as a function of a guide, linear in every window, mean over windows.

    Args:
        guide: (H, W), grey.
        values: (H, W).
        radius_px: of the square window.
        eps: ridge on the guide's variance.

    Source: He, Sun and Tang 2013, equations 5 to 8.
    """
    import cv2

    def box(x: Image) -> Image:
        side = 2 * radius_px + 1
        smooth = cv2.boxFilter(x, cv2.CV_32F, (side, side), borderType=cv2.BORDER_REPLICATE)
        return np.asarray(smooth, dtype=np.float32)

    mean_guide, mean_values = box(guide), box(values)
    variance = np.maximum(box(guide * guide) - mean_guide * mean_guide, 0)
    slope = (box(guide * values) - mean_guide * mean_values) / (variance + np.float32(eps))
    return box(slope), box(mean_values - slope * mean_guide)


def estimate_noise(differences: Image) -> float:
    """1-sigma of a pixel's noise from differences (N, 3) of two pixels; the largest are clouds and edges."""
    sizes = np.abs(differences).ravel()
    count = int(NOISE_PART * sizes.size)
    return float(np.sort(sizes)[:count].mean() / NOISE_MEAN) if count else 0.0
