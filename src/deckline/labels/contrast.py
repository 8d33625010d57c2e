"""How much a runway line stands out from the deck beside it in a picture."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates, uniform_filter1d

OFFSETS = np.linspace(-0.2, 0.2, 41)  # across a line, in parts of the way to the other one: to 5 m of 24
ALONG = 0.125  # of a line: averaged over, dashes and gaps alike
STRIPES = (0.01, 0.02, 0.04, 0.07)  # half the width of a marking
STEPS = np.arange(-0.1, 0.101, 0.02)  # where a marking that has run together may begin
FLANK = 0.05  # on both sides of a step


def _kernels(at: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, N) over places `at` (N,): a stripe against what is beside it, one side of a step against the other."""
    parts = []
    for half in STRIPES:
        away = np.abs(at)
        parts.append((away <= half, (away > half) & (away <= half + max(half, 0.02))))
    for step in STEPS:
        parts.append(((at > step) & (at <= step + FLANK), (at < step) & (at >= step - FLANK)))
    return np.stack([one / one.sum() - other / other.sum() for one, other in parts])


KERNELS = _kernels(OFFSETS)


def line_contrast(image: NDArray, line_px: ArrayLike, other_px: ArrayLike) -> NDArray[np.float64]:
    """What sets a marking apart, (N,) grey levels: its stripe from both sides, or one side of its edge from the other.

    The greatest over widths and places of a marking, the mean along an eighth of the line. What haze, blur and distance
    leave of it counts, and so do stains and shadows: bare decks have one or two grey levels in a clear view.

    Args:
        image: (H, W, 3) grey levels.
        line_px: (N, 2) points along the line, in order.
        other_px: (M, 2) points along the runway's other line: how wide it is there.
    """
    line, other = np.asarray(line_px, dtype=np.float64), np.asarray(other_px, dtype=np.float64)
    nearest = np.square(line[:, None] - other[None]).sum(axis=2).argmin(axis=1)
    across = other[nearest] - line
    u, v = np.moveaxis(line[:, None] + OFFSETS[:, None] * across[:, None], 2, 0)
    profile = [map_coordinates(image[..., k], (v, u), output=np.float64, order=1, mode="nearest") for k in range(3)]
    size = max(round(ALONG * len(line)), 1)
    smooth = uniform_filter1d(np.stack(profile), size, axis=1, mode="nearest")  # (3, N, OFFSETS)
    differences = np.sqrt(np.square(smooth @ KERNELS.T).mean(axis=0))
    return np.asarray(differences.max(axis=1))
