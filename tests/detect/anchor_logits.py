"""Logits of a network that is sure of a line."""

import numpy as np

from deckline.detect.anchors import RowGrid

GRID = RowGrid()


def logits_of(cell: np.ndarray, grid: RowGrid = GRID) -> np.ndarray:
    """Logits (rows, cells + 1) whose softmax is the two-cell target of every row; NaN is no line."""
    shares = np.full((grid.rows, grid.cells + 1), 1e-9)
    for row, position in enumerate(cell):
        if np.isnan(position):
            shares[row, -1] = 1.0
        else:
            low = min(int(np.floor(np.clip(position, 0, grid.cells - 1))), grid.cells - 2)
            shares[row, low] += max(1 - (position - low), 0.0)
            shares[row, low + 1] += max(position - low, 0.0)
    return np.log(shares).astype(np.float32)
