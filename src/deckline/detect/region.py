"""Where the runway is: a box around the visible parts of both lines, encoded and decoded once.

A softmax over the cells of a coarse grid and "no runway"; every cell also says where the box lies from its own centre.
Boxes are (x0, y0, x1, y1) in the network's image, pixel centres.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

STRIDE = 16  # px of the network's image per region cell
SIZE_PX = 64.0  # px; a box of that size has log size 0
SPREAD_CELLS = 0.6  # Gaussian width of the target over neighbouring cells: they see nearly the same


@dataclass(frozen=True, eq=False)
class Region:
    """A box and how sure the network is of it."""

    box: NDArray[np.float64]  # (4,) x0, y0, x1, y1 in the network's image
    probability: float  # that there is a runway in the view


def encode_region(
    box: ArrayLike | None, grid_size: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """A box, or None for no runway, to targets on a grid of (width, height) cells.

    Returns:
        classes (width * height + 1,), sum 1, the last one "no runway"; box offsets (4, height, width): centre from the
        cell's own in cells, log of width and height over 64 px; weight (height, width) of every cell's box.
    """
    width, height = grid_size
    classes = np.zeros(width * height + 1, dtype=np.float32)
    offsets = np.zeros((4, height, width), dtype=np.float32)
    if box is None:
        classes[-1] = 1.0
        return classes, offsets, np.zeros((height, width), dtype=np.float32)
    x0, y0, x1, y1 = (float(value) for value in np.asarray(box, dtype=np.float64))
    if not (x1 > x0 and y1 > y0):
        raise ValueError(f"box needs x0 < x1 and y0 < y1, got {(x0, y0, x1, y1)}")
    row, column = np.mgrid[0:height, 0:width]
    centre_x = ((x0 + x1) / 2 + 0.5) / STRIDE - 0.5
    centre_y = ((y0 + y1) / 2 + 0.5) / STRIDE - 0.5
    offsets[0], offsets[1] = centre_x - column, centre_y - row
    offsets[2], offsets[3] = np.log((x1 - x0) / SIZE_PX), np.log((y1 - y0) / SIZE_PX)
    near = (np.abs(offsets[0]) <= 1.5) & (np.abs(offsets[1]) <= 1.5)
    weight = near * np.exp(-(offsets[0] ** 2 + offsets[1] ** 2) / (2 * SPREAD_CELLS**2))
    weight = (weight / max(weight.sum(), 1e-9)).astype(np.float32)
    classes[:-1] = weight.ravel()
    return classes, offsets, weight


def decode_region(logits: NDArray[np.float32], offsets: NDArray[np.float32]) -> Region:
    """Class logits (height * width + 1,) and box offsets (4, height, width) -> the most likely box.

    The 3x3 cells around the best one vote, by their share. The probability is that of any place: the middle of a large
    box is uncertain by more than those cells.
    """
    _, height, width = offsets.shape
    if logits.shape != (height * width + 1,):
        raise ValueError(f"expected logits of shape {(height * width + 1,)}, got {logits.shape}")
    values = logits.astype(np.float64)
    none = np.exp(values[-1] - np.logaddexp.reduce(values))
    shares = np.exp(values[:-1] - values[:-1].max()).reshape(height, width)
    best_row, best_column = np.unravel_index(int(shares.argmax()), shares.shape)
    row, column = np.mgrid[0:height, 0:width]
    votes = shares * ((np.abs(row - best_row) <= 1) & (np.abs(column - best_column) <= 1))
    votes /= votes.sum()
    mean = [(votes * offsets[k]).sum() for k in range(4)]
    centre_x = ((votes * column).sum() + mean[0] + 0.5) * STRIDE - 0.5
    centre_y = ((votes * row).sum() + mean[1] + 0.5) * STRIDE - 0.5
    half_width, half_height = SIZE_PX * np.exp(np.clip(mean[2:], -5.0, 3.0)) / 2
    box = [centre_x - half_width, centre_y - half_height, centre_x + half_width, centre_y + half_height]
    return Region(np.array(box), float(1.0 - none))
