"""Edges that a dehazed picture shows and its scene, or its hazy picture, does not.

An edge is a step of the blurred grey picture, in levels, of at least 5 % of the level around it: the CIE's threshold of
visibility. The step is read from the gradient: a step of height h, blurred by sigma, has the gradient h / (sigma
sqrt(2 pi)).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.filters import estimate_noise

SIGMA_PX = 1.5
STEP = SIGMA_PX * np.sqrt(2 * np.pi)  # of a gradient
STEP_NOISE = STEP / (np.sqrt(8 * np.pi) * SIGMA_PX**2)  # 1-sigma of a step along one axis, of a pixel's white noise
REACH_PX = 5  # side of the window in which the other picture may have the edge
VISIBLE_SHARE, VISIBLE_LEVELS = 0.05, 3.0  # of the level around it, and levels: what an edge has at least
EXCESS = 2.0  # times the clear picture's step: false
NOISE_SIGMA = 3.0  # below it a step of the hazy picture is noise
QUANTISATION = 1.0  # levels: a smooth slope has steps of these
BLOCK_PX = 8  # of JPEG, H.264 and H.265

Grey = NDArray[np.float32]


def false_edges(image_rgb: NDArray[np.uint8], clear_rgb: NDArray[np.uint8]) -> float:
    """Share of a dehazed picture's pixels, 0..1, on edges of more than twice the clear picture's steps within 2 px.

    Args:
        image_rgb, clear_rgb: (H, W, 3) of one shape.
    """
    steps, visible = _visible_steps(image_rgb)
    return float(np.mean(visible & (steps > EXCESS * _largest_steps(clear_rgb))))


def raised_noise(image_rgb: NDArray[np.uint8], hazy_rgb: NDArray[np.uint8]) -> float:
    """Share of a dehazed picture's pixels, 0..1, on edges where the hazy picture has no step above its own noise.

    What is drawn there cannot be told from noise, from a compression's blocks or from one grey level, though a part of
    it may exist.

    Args:
        image_rgb, hazy_rgb: (H, W, 3) of one shape.
    """
    return float(np.mean(_visible_steps(image_rgb)[1] & (_largest_steps(hazy_rgb) < noise_step(hazy_rgb))))


def noise_step(image_rgb: NDArray[np.uint8]) -> float:
    """The largest step, levels, that noise, compression or quantisation draws into a plain part of a picture."""
    grey = _grey(image_rgb)
    noise = estimate_noise(np.diff(grey, axis=1))
    return max(QUANTISATION, NOISE_SIGMA * STEP_NOISE * noise, block_step(grey))


def block_step(grey: Grey) -> float:
    """How much more neighbours differ across the edges of a compression's blocks than elsewhere, levels; 0: not more.

    Args:
        grey: (H, W), its corner that of a block.
    """
    excess = 0.0
    for differences in (np.abs(np.diff(grey, axis=1)).T, np.abs(np.diff(grey, axis=0))):
        at_edge = np.arange(len(differences)) % BLOCK_PX == BLOCK_PX - 1
        if at_edge.any():
            plain = np.median(differences[~at_edge], axis=0)  # of a row or column: content has no grid
            excess = max(excess, float(np.median(np.median(differences[at_edge], axis=0) - plain)))
    return excess


def _grey(image_rgb: NDArray[np.uint8]) -> Grey:
    return np.asarray(cv2.cvtColor(image_rgb, cv2.COLOR_RGB2GRAY), dtype=np.float32)


def _visible_steps(image_rgb: NDArray[np.uint8]) -> tuple[Grey, NDArray[np.bool_]]:
    """Steps (H, W), levels, and where they are visible."""
    steps, level = _steps(_grey(image_rgb))
    return steps, steps >= np.maximum(VISIBLE_SHARE * level, VISIBLE_LEVELS)


def _largest_steps(image_rgb: NDArray[np.uint8]) -> Grey:
    """The largest step (H, W), levels, within a window around each pixel."""
    window = np.ones((REACH_PX, REACH_PX), np.uint8)
    return np.asarray(cv2.dilate(_steps(_grey(image_rgb))[0], window), dtype=np.float32)


def _steps(grey: Grey) -> tuple[Grey, Grey]:
    """Steps and the level around them, (H, W) both, in levels."""
    smooth = cv2.GaussianBlur(grey, (0, 0), SIGMA_PX)
    down, right = (np.asarray(part, np.float32) for part in np.gradient(smooth))
    return np.asarray(STEP * np.hypot(down, right), dtype=np.float32), np.asarray(smooth, dtype=np.float32)
