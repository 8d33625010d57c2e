"""What a camera, the weather and an encoder do to a clear view: pure functions on grey levels (H, W, 3) float32."""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from scipy.fft import dctn, idctn
from scipy.ndimage import gaussian_filter1d

JPEG_BLOCK = 8  # px
LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)  # of red, green, blue
JPEG_SLOPE = 0.35  # a quantisation step grows by so much of the base step per frequency; about JPEG's own tables


@dataclass(frozen=True)
class DetectAugmentation:
    """How training views are made. Shares are probabilities."""

    haze_share: float = 0.75
    optical_depth_max: float = 3.2  # of the haze up to the ramp; uniform from 0
    horizon_share: float = 0.4  # of the airlights are near the sky's colour, the others random
    fade_share: float = 0.25  # contrast taken off without haze
    close_share: float = 0.55  # of close looks, around the runway; the others see most of the image
    empty_share: float = 0.06  # of close looks beside the runway
    thing_share: float = 0.8  # of those, and of close looks without a runway, at something: a ship, a coast
    flip_share: float = 0.5
    rotate_share: float = 0.35
    rotate_max_deg: float = 5.0
    centre_jitter: float = 0.25  # of a close look, relative to the box
    fill: tuple[float, float] = (0.36, 0.86)  # of a close look; the runtime aims at 0.6
    min_width_px: tuple[float, float] = (30.0, 64.0)  # of a close look in 640-px frames
    wide_scale: tuple[float, float] = (0.55, 1.3)  # of a wide look's window, relative to the whole image
    colour_share: float = 0.7
    grey_share: float = 0.1
    blur_share: float = 0.25
    vertical_blur_share: float = 0.25
    noise_share: float = 0.6
    noise_max: float = 8.0  # grey levels, 1-sigma; most views get much less
    jpeg_share: float = 0.3
    jpeg_step: tuple[float, float] = (1.5, 32.0)  # grey levels, evenly in its logarithm; from quality 95 to 25
    patch_share: float = 0.2

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name.endswith("_share") and not 0 <= value <= 1:
                raise ValueError(f"{name} must lie in 0..1, got {value}")


def rotated(
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
    # grid_sample wants old from new, in units of half the size.
    half = np.array([width / 2, height / 2])
    theta = np.zeros((1, 2, 3), dtype=np.float32)
    theta[0, :, :2] = matrix.T * half[None, :] / half[:, None]
    tensor = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None]
    grid = F.affine_grid(torch.from_numpy(theta), list(tensor.shape), align_corners=False)
    turned = F.grid_sample(tensor, grid, mode="bilinear", padding_mode="reflection", align_corners=False)
    return turned[0].numpy().transpose(1, 2, 0), matrix, middle - matrix @ middle


def recoloured(image: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Exposure, gamma, white balance and saturation of another camera."""
    levels = np.clip(image / 255.0, 0.0, 1.0) ** np.float32(np.exp(rng.uniform(-0.5, 0.5)))
    levels *= rng.uniform(0.6, 1.25) * (1 + rng.normal(0, 0.07, 3)).astype(np.float32)
    grey = levels.mean(axis=2, keepdims=True)
    levels = grey + (levels - grey) * np.float32(rng.uniform(0.2, 1.7))
    return np.clip(levels * 255.0, 0.0, 255.0).astype(np.float32)


def blurred(image: NDArray[np.float32], sigma_v_px: float, sigma_u_px: float) -> NDArray[np.float32]:
    """Gaussian blur, its widths apart: a renderer's mip-maps and far flat decks blur along v only."""
    for axis, sigma in ((0, sigma_v_px), (1, sigma_u_px)):
        if sigma > 0.1:
            image = gaussian_filter1d(image, sigma, axis=axis, truncate=3.0, mode="nearest")
    return image


def block_compressed(image: NDArray[np.float32], step: float) -> NDArray[np.float32]:
    """What JPEG leaves: colour at half the resolution, 8x8 DCT coefficients rounded to steps that grow with frequency.

    A step of 32 grey levels is about quality 25, 16 quality 50, 3 quality 90.
    """
    height, width = image.shape[:2]
    padded = np.pad(image, ((0, -height % (2 * JPEG_BLOCK)), (0, -width % (2 * JPEG_BLOCK)), (0, 0)), mode="edge")
    grey = padded @ LUMA
    colour = padded[..., [0, 2]] - grey[..., None]  # red and blue
    colour = colour.reshape(grey.shape[0] // 2, 2, grey.shape[1] // 2, 2, 2).mean(axis=(1, 3))
    colour = np.stack([_rounded_blocks(part, step) for part in (colour[..., 0], colour[..., 1])], axis=-1)
    red_blue = colour.repeat(2, axis=0).repeat(2, axis=1)
    grey = _rounded_blocks(grey, step)
    green = grey - red_blue @ LUMA[[0, 2]] / LUMA[1]
    decoded = np.stack([grey + red_blue[..., 0], green, grey + red_blue[..., 1]], axis=-1)
    return decoded[:height, :width].astype(np.float32)


def _rounded_blocks(plane: NDArray[np.float32], step: float) -> NDArray[np.float32]:
    """A plane (H, W), whole blocks on both sides."""
    blocks = plane.reshape(plane.shape[0] // JPEG_BLOCK, JPEG_BLOCK, plane.shape[1] // JPEG_BLOCK, JPEG_BLOCK)
    frequency = np.add.outer(np.arange(JPEG_BLOCK), np.arange(JPEG_BLOCK))[None, :, None, :]
    steps = np.float32(step) * (1 + JPEG_SLOPE * frequency).astype(np.float32)
    coefficients = dctn(blocks, axes=(1, 3), norm="ortho")
    decoded: NDArray[np.float32] = idctn(np.rint(coefficients / steps) * steps, axes=(1, 3), norm="ortho")
    return decoded.reshape(plane.shape)


def degraded(
    image: NDArray[np.float32], box_size_px: tuple[float, float], augment: DetectAugmentation, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Colour, blur, noise, compression and patches; blur stays small against the runway's (width, height)."""
    if rng.random() < augment.colour_share:
        image = recoloured(image, rng)
    if rng.random() < augment.grey_share:
        image = np.repeat(image.mean(axis=2, keepdims=True), 3, axis=2)
    if rng.random() < augment.patch_share:
        image = _patched(image, rng)
    if rng.random() < augment.blur_share:
        sigma = rng.uniform(0.3, min(2.0, 0.3 + 0.04 * box_size_px[0]))
        image = blurred(image, sigma, sigma)
    if rng.random() < augment.vertical_blur_share:
        image = blurred(image, rng.uniform(0.3, min(5.0, 0.5 + 0.1 * box_size_px[1])), 0.0)
    if rng.random() < augment.noise_share:
        noise = rng.standard_normal(image.shape, dtype=np.float32)
        image = image + noise * np.float32(augment.noise_max * rng.random() ** 2)
    if rng.random() < augment.jpeg_share:
        image = block_compressed(image, float(np.exp(rng.uniform(*np.log(augment.jpeg_step)))))
    return np.clip(np.rint(image), 0, 255)


def _patched(image: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Up to three rectangles of one colour: what is parked, or flies, before the runway."""
    image = image.copy()
    height, width = image.shape[:2]
    for _ in range(rng.integers(1, 4)):
        tall, wide = max(1, int(height * rng.uniform(0.02, 0.2))), max(1, int(width * rng.uniform(0.02, 0.2)))
        top, left = rng.integers(0, height - tall + 1), rng.integers(0, width - wide + 1)
        image[top : top + tall, left : left + wide] = rng.uniform(10, 240) + rng.normal(0, 15, 3)
    return image
