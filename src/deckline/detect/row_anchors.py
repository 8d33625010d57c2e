"""Row anchors: a line as one horizontal position per image row, encoded and decoded once for training and runtime.

Everything here lives in the network's own image: (0, 0) is the centre of its top-left pixel.
Source: UFLD (Qin et al., 2020), SPEC section 3.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class RowGrid:
    """The network's image and its row anchors.

    Cell j of a row is centred on x = (j + 0.5) width / cells - 0.5, row i on y = (i + 0.5) height / rows - 0.5.
    Class `cells` of a row means "no line here".
    """

    width: int = 512  # px
    height: int = 288  # px
    cells: int = 128
    rows: int = 72

    def __post_init__(self) -> None:
        for what, pixels, parts in (("cells", self.width, self.cells), ("rows", self.height, self.rows)):
            if parts < 2 or pixels < parts:
                raise ValueError(f"RowGrid needs 2 <= {what} <= pixels, got {parts} {what} over {pixels} px")

    @property
    def cell_px(self) -> float:
        return self.width / self.cells

    @property
    def row_y(self) -> NDArray[np.float64]:
        """y of every row anchor, px, (rows,)."""
        return (np.arange(self.rows) + 0.5) * self.height / self.rows - 0.5

    @property
    def transposed(self) -> "RowGrid":
        """Column anchors: the same image with x and y swapped, one anchor a cell and one cell a row of this grid."""
        return RowGrid(self.height, self.width, self.rows, self.cells)

    def cell_from_x(self, x_px: ArrayLike) -> NDArray[np.float64]:
        return (np.asarray(x_px, dtype=np.float64) + 0.5) / self.cell_px - 0.5

    def x_from_cell(self, cell: ArrayLike) -> NDArray[np.float64]:
        return (np.asarray(cell, dtype=np.float64) + 0.5) * self.cell_px - 0.5


@dataclass(frozen=True)
class DecodeConfig:
    """How a row's classes become a position.

    The expected cell is taken in a window around the best one: over the whole row, a far tail of a few percent drags
    it by several cells (one percent 60 cells away is 0.6 cells).
    """

    window_cells: int = 3  # on either side of the best cell
    # With it 95 % of errors on hazy held-out simulator frames lie within 1.94 sigma, 68 % within 0.65 (heavy tails).
    sigma_floor_cells: float = 0.12
    # A row has a line if this much of its shares lies in cells; None: if its best class is a cell, as published.
    min_line_share: float | None = None
    # Width of the stripe whose cells the network was taught to mark; 0: it was taught the two nearest cells.
    stripe_cells: float = 0.0


@dataclass(frozen=True, eq=False)
class RowPoints:
    """What the rows of one line say."""

    x_px: NDArray[np.float64]  # (rows,) in the network's image; NaN where there is no line
    confidence: NDArray[np.float64]  # (rows,) P(the line lies in the window that x is the mean of)
    sigma_px: NDArray[np.float64]  # (rows,) 1-sigma of x, in the network's image; NaN where there is no line


def encode(points_px: ArrayLike, seen: ArrayLike, grid: RowGrid) -> NDArray[np.float32]:
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
    keep = np.all(np.isfinite(points), axis=1)
    points, visible = points[keep], visible[keep]
    if len(points) < 2:
        return np.full(grid.rows, np.nan, dtype=np.float32)
    order = np.argsort(points[:, 1], kind="stable")
    x, y, flags = points[order, 0], points[order, 1], visible[order].astype(np.float64)
    cell = grid.cell_from_x(np.interp(grid.row_y, y, x, left=np.nan, right=np.nan))
    whole = np.interp(grid.row_y, y, flags, left=0.0, right=0.0) > 0.999
    inside = (cell > -0.5) & (cell < grid.cells - 0.5)
    return np.where(whole & inside, cell, np.nan).astype(np.float32)


def decode(logits: NDArray[np.float32], grid: RowGrid, config: DecodeConfig | None = None) -> RowPoints:
    """Class logits (rows, cells + 1) of one line -> a position per row.

    Confidence is the share of the window, not all that is left by "no line": a row that cannot tell the runway's edge
    from a catapult track beside it gives each a half, and is not to be trusted.
    The two-cell targets of training spread by f (1 - f) cells^2 however sure the network is (f: where between the
    cells the line lies), a stripe w cells wide by w^2 / 12; that part of the spread is no uncertainty and is taken off.

    Raises:
        ValueError: logits of another shape than the grid's.
    """
    config = config or DecodeConfig()
    if logits.shape != (grid.rows, grid.cells + 1):
        raise ValueError(f"expected logits of shape {(grid.rows, grid.cells + 1)}, got {logits.shape}")
    values = logits.astype(np.float64)
    shares = np.exp(values - values.max(axis=1, keepdims=True))
    shares /= shares.sum(axis=1, keepdims=True)
    best = values[:, :-1].argmax(axis=1)
    cells = np.arange(grid.cells)
    near = np.abs(cells - best[:, None]) <= config.window_cells
    weights = np.exp(values[:, :-1] - values[:, :-1].max(axis=1, keepdims=True)) * near
    weights /= weights.sum(axis=1, keepdims=True)
    mean = (weights * cells).sum(axis=1)
    spread = (weights * (cells - mean[:, None]) ** 2).sum(axis=1)
    fraction = mean - np.floor(mean)
    taught = config.stripe_cells**2 / 12 if config.stripe_cells > 0 else fraction * (1 - fraction)
    variance = np.maximum(spread - taught, 0.0) + config.sigma_floor_cells**2
    if config.min_line_share is None:
        line = values.argmax(axis=1) < grid.cells
    else:
        line = shares[:, :-1].sum(axis=1) >= config.min_line_share
    return RowPoints(
        np.where(line, grid.x_from_cell(mean), np.nan),
        (shares[:, :-1] * near).sum(axis=1),
        np.where(line, np.sqrt(variance) * grid.cell_px, np.nan),
    )
