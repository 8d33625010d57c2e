"""Between an image and a dehazing network's tensors: the same in training, evaluation and flight."""

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_image

Image = NDArray[np.uint8]
Tensor = NDArray[np.float32]

GUIDE_RADIUS, GUIDE_RIDGE = 4, 1e-4  # of the guided filter: window, px of the small image; on the variance, range 0..1
MIN_SIDE_PX = 32  # smaller images are padded first: reflection inside the network needs more pixels than it adds


def image_to_tensor(image_rgb: Image) -> Tensor:
    """(H, W, 3) uint8 -> (1, 3, H, W) float32 in 0..1, contiguous."""
    check_image(image_rgb)
    return np.ascontiguousarray(image_rgb.transpose(2, 0, 1)[None], dtype=np.float32) / np.float32(255)


def tensor_to_image(tensor: Tensor) -> Image:
    """(1, 3, H, W) -> (H, W, 3) uint8; values outside 0..1 are clipped, never wrapped, and NaN becomes 0."""
    scaled = np.nan_to_num(tensor[0] * np.float32(255), nan=0.0)
    return np.ascontiguousarray(np.clip(np.rint(scaled), 0, 255).astype(np.uint8).transpose(1, 2, 0))


def reduction_factor(height: int, width: int, working_long_side_px: int) -> int:
    """Whole factor by which an image is averaged down so that its long side comes near the working size."""
    if working_long_side_px < MIN_SIDE_PX:
        raise ValueError(f"working_long_side_px must be at least {MIN_SIDE_PX}, got {working_long_side_px}")
    return max(1, round(max(height, width) / working_long_side_px))


def pad(image_rgb: Image, multiple: int, min_side_px: int = MIN_SIDE_PX) -> Image:
    """The image continued below and right by its edge pixels, to sides that are a multiple and not too short, px."""
    height, width = image_rgb.shape[:2]
    least = -(-min_side_px // multiple) * multiple
    bottom, right = (max(-side % multiple, least - side) for side in (height, width))
    return np.pad(image_rgb, ((0, bottom), (0, right), (0, 0)), mode="edge") if bottom or right else image_rgb


def average_down(tensor: Tensor, factor: int) -> Tensor:
    """(1, 3, H, W) -> (1, 3, H / factor, W / factor), the mean of every block.

    Raises:
        ValueError: a size that is no multiple of the factor.
    """
    height, width = tensor.shape[2:]
    if height % factor or width % factor:
        raise ValueError(f"size {width}x{height} px is no multiple of {factor}")
    total = sum(tensor[:, :, i::factor, j::factor] for i in range(factor) for j in range(factor))
    return np.ascontiguousarray(total / np.float32(factor * factor), dtype=np.float32)


def upsample_guided(image: Tensor, small: Tensor, result: Tensor, factor: int) -> Tensor:
    """A small image's result at full size, with the edges of the full image.

    In every window and channel the result is taken as linear in the image; slope and offset are upsampled.
    Source: fast guided filter (He and Sun 2015).

    Args:
        image: (1, C, H, W) in 0..1.
        small: (1, C, H / factor, W / factor), the image averaged down.
        result: of its shape.
        factor: 1 gives the result as it is.
    """
    if factor == 1:
        return result
    import cv2

    side = (2 * GUIDE_RADIUS + 1,) * 2
    size = (image.shape[3], image.shape[2])
    full = np.empty_like(image)
    for k in range(image.shape[1]):
        guide, wanted = small[0, k], np.ascontiguousarray(result[0, k], dtype=np.float32)
        mean_guide, mean_wanted = cv2.blur(guide, side), cv2.blur(wanted, side)
        variance = np.maximum(cv2.blur(guide * guide, side) - mean_guide * mean_guide, 0)
        slope = (cv2.blur(guide * wanted, side) - mean_guide * mean_wanted) / (variance + GUIDE_RIDGE)
        offset = cv2.blur(mean_wanted - slope * mean_guide, side)
        full[0, k] = cv2.resize(cv2.blur(slope, side), size) * image[0, k] + cv2.resize(offset, size)
    return full
