"""Truth on row and column anchors, from anchors one pixel apart."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deckline.detect.anchors import RowGrid

FLATTEST, STEEPEST = 4.0, 4.0  # |dx/dy| and |dy/dx| beyond which rows, or columns, are not asked: cells per anchor


def anchor_targets(x_px: Tensor, grid: RowGrid) -> tuple[Tensor, Tensor, Tensor]:
    """Positions on a grid's rows and columns, for a batch of lines.

    Args:
        x_px: (B, lines, height) on every pixel row, NaN where there is no line.
        grid: the network's.

    Returns:
        rows (B, lines, rows) in cells and columns (B, lines, cells) in rows, NaN for "does not cross here"; and which
        columns (B, lines, cells) lie within the last pixel row of a line's ends, where it is not known.
    """
    lines = x_px.detach().cpu().numpy()
    parts = [line_anchors(line.astype(np.float64), grid) for line in lines.reshape(-1, lines.shape[-1])]
    rows, columns, unknown = (
        torch.from_numpy(np.stack(part)).reshape(*lines.shape[:2], -1).to(x_px.device)
        for part in zip(*parts, strict=True)
    )
    return rows, columns, unknown


def line_anchors(
    x_px: NDArray[np.float64], grid: RowGrid
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """One line's x on every pixel row (height,) -> rows (rows,), columns (cells,), unknown columns (cells,)."""
    rows = np.full(grid.rows, np.nan, dtype=np.float32)
    columns = np.full(grid.cells, np.nan, dtype=np.float32)
    unknown = np.zeros(grid.cells, dtype=bool)
    y = np.flatnonzero(np.isfinite(x_px))
    if len(y) < 2:
        return rows, columns, unknown
    x = x_px[y]
    slope = (x[-1] - x[0]) / (y[-1] - y[0])  # dx / dy; lines are straight, but for the lens
    if abs(slope) <= FLATTEST:
        on_rows = np.interp(grid.row_y, y, x, left=np.nan, right=np.nan)
        rows = grid.cell_from_x(on_rows).astype(np.float32)
    if abs(slope) * STEEPEST >= 1:
        order = np.argsort(x, kind="stable")
        column_x = grid.transposed.row_y
        on_columns = np.interp(column_x, x[order], y[order], left=np.nan, right=np.nan)
        columns = grid.transposed.cell_from_x(on_columns).astype(np.float32)
        unknown = np.isnan(on_columns) & (column_x > x.min() - abs(slope)) & (column_x < x.max() + abs(slope))
    return rows, columns, unknown
