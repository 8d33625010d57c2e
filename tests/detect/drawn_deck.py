"""A dark deck with bright markings, drawn exactly to the sub-pixel."""

import numpy as np

TOP, BOTTOM = 150, 420  # rows of the markings


def at(v: np.ndarray | float, share: float) -> np.ndarray | float:
    """u of a line on the deck: share 0 is the runway's left edge, 1 its right one; all meet at (400, 60)."""
    return 400 + (v - 60) * (-0.55 + 1.1 * share)


def deck(stripes: list[float], width: float = 0.02, size: tuple[int, int] = (480, 800)) -> np.ndarray:
    """(H, W, 3) uint8 with a stripe at every share of the runway's width, as wide as that share of it."""
    height, columns = size
    v, u = np.mgrid[0:height, 0:columns].astype(float)
    level = np.full(size, 70.0)
    for share in stripes:
        half = width * (v - 60) * 1.1 / 2
        cover = np.clip(half + 0.5 - np.abs(u - at(v, share)), 0, 1) * ((v >= TOP) & (v <= BOTTOM))
        level += cover * (210 - level)
    noise = np.random.default_rng(0).normal(0, 1.0, size)
    return np.repeat((level + noise).clip(0, 255)[..., None], 3, axis=2).astype(np.uint8)
