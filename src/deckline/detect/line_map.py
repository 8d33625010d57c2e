"""Networks that paint the lines: from a map of every pixel's line to row anchors, once for training and runtime.

A row's shares are the map's, averaged over the cells of the row grid, so that the same decoding gives position,
confidence and sigma as for networks that classify row anchors.
"""

import numpy as np
from numpy.typing import NDArray

from deckline.detect.row_anchors import RowGrid

SMALLEST_SHARE = 1e-9  # of a row; keeps logarithms finite


def rows_from_map(
    map_logits: NDArray[np.float32], line_logits: NDArray[np.float32], grid: RowGrid
) -> NDArray[np.float32]:
    """Class logits (lines, rows, cells + 1) of row anchors; the last class is "no line here".

    A row has the line with the probability of its most certain cell times that of the whole line; it lies among the
    cells in proportion to their probabilities.

    Args:
        map_logits: (lines + 1, H, W) of background and every line, at each pixel.
        line_logits: (lines,) of the line being in the view at all.
        grid: the row anchors; its rows and cells divide H and W.

    Raises:
        ValueError: shapes that do not agree.
    """
    classes, height, width = map_logits.shape
    if line_logits.shape != (classes - 1,) or height % grid.rows or width % grid.cells:
        raise ValueError(
            f"expected logits (lines + 1, H, W) whose sides {grid.rows} rows and {grid.cells} cells divide, "
            f"and (lines,), got {map_logits.shape} and {line_logits.shape}"
        )
    values = map_logits.astype(np.float64)
    pixels = np.exp(values - values.max(axis=0))
    pixels = (pixels / pixels.sum(axis=0))[1:]
    cells = pixels.reshape(-1, grid.rows, height // grid.rows, grid.cells, width // grid.cells).mean(axis=(2, 4))
    there = cells.max(axis=2) / (1 + np.exp(-line_logits.astype(np.float64)))[:, None]
    shares = there[..., None] * cells / np.maximum(cells.sum(axis=2, keepdims=True), SMALLEST_SHARE)
    everything = np.concatenate([shares, 1 - there[..., None]], axis=2)
    return np.log(np.maximum(everything, SMALLEST_SHARE)).astype(np.float32)
