"""Lines and the runway's box as targets of the line networks, in the terms that `deckline.detect.anchors` decodes."""

import numpy as np
from numpy.typing import ArrayLike

from deckline.detect.anchors import SIZE_PX, STRIDE, Float32, RowGrid
from deckline.detect.crop import check_box

SPREAD_CELLS = 0.6  # Gaussian width of the target over neighbouring cells: they see nearly the same


def encode(points_px: ArrayLike, seen: ArrayLike, grid: RowGrid) -> Float32:
    """A line's points in the network's image -> its cell on every row anchor.

    Args:
        points_px: (N, 2) x, y along the line in order, y monotone; N may be 0.
        seen: (N,) bool; a row between two points has a position only when both are seen.
        grid: the row anchors.

    Returns:
        (rows,) position in cells, NaN where the row has no line (beyond its ends, outside the image, not seen).

    Raises:
        ValueError: shapes that do not agree.
    """
    points = np.asarray(points_px, dtype=np.float64)
    visible = np.asarray(seen, dtype=bool)
    if points.ndim != 2 or points.shape[1] != 2 or visible.shape != (len(points),):
        raise ValueError(f"expected points (N, 2) and seen (N,), got {points.shape} and {visible.shape}")
    finite = np.all(np.isfinite(points), axis=1)
    points, visible = points[finite], visible[finite]
    if len(points) < 2:
        return np.full(grid.rows, np.nan, dtype=np.float32)
    order = np.argsort(points[:, 1], kind="stable")
    x, y, flags = points[order, 0], points[order, 1], visible[order].astype(np.float64)
    cell = grid.cell_from_x(np.interp(grid.row_y, y, x, left=np.nan, right=np.nan))
    both_seen = np.interp(grid.row_y, y, flags, left=0.0, right=0.0) > 0.999
    inside = (cell > -0.5) & (cell < grid.cells - 0.5)
    return np.where(both_seen & inside, cell, np.nan).astype(np.float32)


def encode_region(box: ArrayLike | None, grid_size: tuple[int, int]) -> tuple[Float32, Float32, Float32]:
    """A box, or None for no runway, to targets on a grid of (width, height) cells.

    Returns:
        classes (width * height + 1,), sum 1, the last one "no runway"; box offsets (4, height, width): centre from the
        cell's own in cells, log of width and height over 64 px; weight (height, width) of every cell's box.

    Raises:
        ValueError: a box without width or height.
    """
    width, height = grid_size
    classes = np.zeros(width * height + 1, dtype=np.float32)
    offsets = np.zeros((4, height, width), dtype=np.float32)
    if box is None:
        classes[-1] = 1.0
        return classes, offsets, np.zeros((height, width), dtype=np.float32)
    x0, y0, x1, y1 = check_box(box)
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
