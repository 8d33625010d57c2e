"""What a camera, the weather and an encoder do to a clear view: pure functions on grey levels (H, W, 3) float32."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class DetectAugmentation:
    """How training views are made. Shares are probabilities."""

    haze_share: float = 0.75
    optical_depth_max: float = 3.2  # of the haze up to the ramp; uniform from 0
    horizon_share: float = 0.4  # of the airlights are near the sky's colour, the others random
    fade_share: float = 0.25  # contrast taken off without haze
    close_share: float = 0.55  # of close crops, around the runway; the others show most of the image
    empty_share: float = 0.06  # of close crops beside the runway
    object_share: float = 0.8  # of those, and of close crops without a runway, at an object: a ship, a coast
    flip_share: float = 0.5
    rotate_share: float = 0.35
    rotate_max_deg: float = 5.0
    centre_jitter: float = 0.25  # of a close crop, relative to the box
    fill: tuple[float, float] = (0.36, 0.86)  # of a close crop by the runway; the runtime aims at 0.6
    min_width_px: tuple[float, float] = (30.0, 64.0)  # of a close crop in 640-px frames
    wide_scale: tuple[float, float] = (0.55, 1.3)  # of a wide crop, relative to the whole image
    colour_share: float = 0.7
    grey_share: float = 0.1
    blur_share: float = 0.25
    vertical_blur_share: float = 0.25
    noise_share: float = 0.6
    noise_max: float = 8.0  # grey levels, 1-sigma; most views get much less
    jpeg_share: float = 0.3
    jpeg_scale: tuple[float, float] = (0.1, 2.0)  # of the standard's tables, log-uniform; from quality 95 to 25
    patch_share: float = 0.2

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name.endswith("_share") and not 0 <= value <= 1:
                raise ValueError(f"{name} must lie in 0..1, got {value}")


def rotate(
    image: NDArray[np.float32], angle_rad: float
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """An image (H, W, C) turned about its middle, its edges mirrored.

    Returns:
        image; (2, 2) and (2,) of the map of its points: new = matrix @ old + offset, px.
    """
    height, width = image.shape[:2]
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    matrix = np.array([[cosine, -sine], [sine, cosine]])
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    offset = middle - matrix @ middle
    new_from_old = np.column_stack([matrix, offset])
    rotated = cv2.warpAffine(np.ascontiguousarray(image), new_from_old, (width, height), borderMode=cv2.BORDER_REFLECT)
    return np.asarray(rotated, np.float32).reshape(image.shape), matrix, offset


def recolour(image: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Exposure, gamma, white balance and saturation of another camera."""
    levels = np.clip(image / 255.0, 0.0, 1.0) ** np.float32(np.exp(rng.uniform(-0.5, 0.5)))
    levels *= rng.uniform(0.6, 1.25) * (1 + rng.normal(0, 0.07, 3)).astype(np.float32)
    grey = levels.mean(axis=2, keepdims=True)
    levels = grey + (levels - grey) * np.float32(rng.uniform(0.2, 1.7))
    return np.clip(levels * 255.0, 0.0, 255.0).astype(np.float32)


def blur(image: NDArray[np.float32], sigma_v_px: float, sigma_u_px: float) -> NDArray[np.float32]:
    """Gaussian blur, its widths apart: a renderer's mip-maps and far flat decks blur along v only."""
    width, height = (2 * round(3 * sigma) + 1 for sigma in (sigma_u_px, sigma_v_px))  # 1 px: no blur
    blurred = cv2.GaussianBlur(image, (width, height), sigma_u_px, sigmaY=sigma_v_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.float32)


def compress(image: NDArray[np.float32], scale: float) -> NDArray[np.float32]:
    """The image after JPEG with `scale` times the standard's quantisation tables: 1 is libjpeg's quality 50."""
    quality = round(100 - 50 * scale if scale < 1 else 50 / scale)
    levels = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    _, coded = cv2.imencode(".jpg", levels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.float32)[..., ::-1]


def degrade(
    image: NDArray[np.float32], box_size_px: tuple[float, float], augment: DetectAugmentation, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Colour, blur, noise, compression and patches; blur stays small against the runway's (width, height)."""
    if rng.random() < augment.colour_share:
        image = recolour(image, rng)
    if rng.random() < augment.grey_share:
        image = np.repeat(image.mean(axis=2, keepdims=True), 3, axis=2)
    if rng.random() < augment.patch_share:
        image = _add_patches(image, rng)
    if rng.random() < augment.blur_share:
        sigma = rng.uniform(0.3, min(2.0, 0.3 + 0.04 * box_size_px[0]))
        image = blur(image, sigma, sigma)
    if rng.random() < augment.vertical_blur_share:
        image = blur(image, rng.uniform(0.3, min(5.0, 0.5 + 0.1 * box_size_px[1])), 0.0)
    if rng.random() < augment.noise_share:
        noise = rng.standard_normal(image.shape, dtype=np.float32)
        image = image + noise * np.float32(augment.noise_max * rng.random() ** 2)
    if rng.random() < augment.jpeg_share:
        image = compress(image, float(np.exp(rng.uniform(*np.log(augment.jpeg_scale)))))
    return np.clip(np.rint(image), 0, 255)


def _add_patches(image: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Up to three rectangles of one colour: parked or flying objects before the runway."""
    image = image.copy()
    height, width = image.shape[:2]
    for _ in range(rng.integers(1, 4)):
        tall, wide = max(1, int(height * rng.uniform(0.02, 0.2))), max(1, int(width * rng.uniform(0.02, 0.2)))
        top, left = rng.integers(0, height - tall + 1), rng.integers(0, width - wide + 1)
        image[top : top + tall, left : left + wide] = rng.uniform(10, 240) + rng.normal(0, 15, 3)
    return image
