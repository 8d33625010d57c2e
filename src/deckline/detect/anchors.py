"""Row and column anchors, line maps and the runway's box: the networks' outputs, decoded once.

A row anchor gives a line as one horizontal position per image row, a column anchor as one vertical position per image
column (the same code on the transposed grid). The box is a softmax over the cells of a coarse grid and "no runway",
with the box's offset from every cell. Training, evaluation and runtime decode; training encodes.
Everything lives in the network's own image: (0, 0) is the centre of its top-left pixel; boxes are (x0, y0, x1, y1).
Source: row anchors after UFLD (Qin, Wang and Li, 2020).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.types import EdgeKind

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

ROW_OUTPUTS = ("row_logits", "region_logits", "region_box")  # row anchors
HYBRID_OUTPUTS = ("row_logits", "column_logits", "region_logits", "region_box")  # row and column anchors
EDGE_OUTPUTS = (*HYBRID_OUTPUTS, "edge_logits")  # and what the edge lines are
MAP_OUTPUTS = ("map_logits", "line_logits", "region_logits", "region_box")  # a class for every pixel
KNOWN_OUTPUTS = (ROW_OUTPUTS, HYBRID_OUTPUTS, EDGE_OUTPUTS, MAP_OUTPUTS)
EDGES = tuple(EdgeKind)  # classes of the edge, in their order
MAP_PEAK = 0.3  # that the best cell of a map's row must exceed; published (CULane)
MAP_EXISTENCE = 0.5  # that the probability of a map's line must exceed; published
MOST_LOG_ODDS = 100.0  # of no line over the best cell, so that they are finite
SMALLEST_SHARE = 1e-9  # of a row, so that logarithms are finite
STRIDE = 16  # px of the network's image per region cell
SIZE_PX = 64.0  # px; a box of that size has log size 0
PLACE_CELLS = 2  # from the best cell of a place, within which no other place begins
TAKEN = -1e9  # log of a cell's share in a place that is taken


@dataclass(frozen=True)
class RowGrid:
    """The network's image and its row anchors.

    Cell j of a row is centred on x = (j + 0.5) width / cells - 0.5, row i on y = (i + 0.5) height / rows - 0.5.
    Class `cells` of a row means "no line here".
    """

    width: int = 512
    """Of the network's image, px."""
    height: int = 288
    """Of the network's image, px."""
    cells: int = 128
    """Positions on a row."""
    rows: int = 72
    """Row anchors."""

    def __post_init__(self) -> None:
        for what, pixels, parts in (("cells", self.width, self.cells), ("rows", self.height, self.rows)):
            if parts < 2 or pixels < parts:
                raise ValueError(f"RowGrid needs 2 <= {what} <= pixels, got {parts} {what} over {pixels} px")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        return self.width, self.height

    @property
    def cell_px(self) -> float:
        return self.width / self.cells

    @cached_property
    def row_y(self) -> Float64:
        """y of every row anchor, px, (rows,)."""
        return (np.arange(self.rows) + 0.5) * self.height / self.rows - 0.5

    @cached_property
    def transposed(self) -> "RowGrid":
        """Column anchors: the same image with x and y swapped, one anchor a cell and one cell a row of this grid."""
        return RowGrid(self.height, self.width, self.rows, self.cells)

    def cell_from_x(self, x_px: ArrayLike) -> Float64:
        return (np.asarray(x_px, dtype=np.float64) + 0.5) / self.cell_px - 0.5

    def x_from_cell(self, cell: ArrayLike) -> Float64:
        return (np.asarray(cell, dtype=np.float64) + 0.5) * self.cell_px - 0.5


@dataclass(frozen=True)
class DecodeConfig:
    """How a row's classes become a position.

    The position is the mean cell in a window around the best one. Over the whole row, a far tail of a few percent
    would shift the mean by several cells (one percent 60 cells away: 0.6 cells).
    """

    window_cells: int = 3  # on either side of the best cell
    # With it 95 % of errors on hazy held-out simulator frames lie within 1.94 sigma, 68 % within 0.65 (heavy tails).
    sigma_floor_cells: float = 0.12
    # A row has a line if this much of its shares lies in cells; None: if its best class is a cell, as published.
    min_line_share: float | None = None
    # Width of the stripe whose cells the training target marks; 0: the target marks the two nearest cells.
    stripe_cells: float = 0.0


@dataclass(frozen=True, eq=False)
class RowPoints:
    """Positions on every row anchor, of one line or, with a first axis, of several."""

    x_px: Float64
    """(..., rows) in the network's image; NaN where there is no line."""
    confidence: Float64
    """(..., rows) probability that the line lies in the window whose mean x is."""
    sigma_px: Float64
    """(..., rows) 1-sigma of x, in the network's image; NaN where there is no line."""

    def __iter__(self) -> Iterator["RowPoints"]:
        """Every line's, where there are several."""
        return map(RowPoints, self.x_px, self.confidence, self.sigma_px)


@dataclass(frozen=True, eq=False)
class Region:
    """A box around the visible parts of both lines, and how sure the network is of it."""

    box: Float64
    """(4,) x0, y0, x1, y1 in the network's image, px."""
    probability: float
    """That there is a runway in the view."""


class NetworkOutput(NamedTuple):
    """A network's outputs for one view."""

    rows: Float32
    """(lines, rows, cells + 1) class logits of left, right and, with three lines, centre."""
    region: Float32
    """(region cells + 1,) class logits."""
    box: Float32
    """(4, region rows, region columns) box offsets."""
    columns: Float32 | None = None
    """(lines, cells, rows + 1) class logits of column anchors; None: the network has none."""
    edge: Float32 | None = None
    """(len(EDGES),) class logits of what the edge lines are; None: the network has none."""


def network_output(outputs: Mapping[str, Float32], grid: RowGrid) -> NetworkOutput:
    """A network's outputs for one view, by name and without the batch axis, as anchors and box."""
    if "map_logits" in outputs:
        rows = rows_from_map(outputs["map_logits"], outputs["line_logits"], grid)
    else:
        rows = outputs["row_logits"]
    others = outputs.get("column_logits"), outputs.get("edge_logits")
    return NetworkOutput(rows, outputs["region_logits"], outputs["region_box"], *others)


def decode(logits: Float32, grid: RowGrid, config: DecodeConfig | None = None) -> RowPoints:
    """Class logits (..., rows, cells + 1) of one or several lines -> a position per row.

    The confidence is the share of the window alone: a row that does not distinguish the runway's edge from a catapult
    track gives each a half, and neither is reliable. The training target itself has a spread: f (1 - f) cells^2 for the
    two nearest cells (f: the line's place between them), w^2 / 12 for a stripe w cells wide. The variance excludes it.

    Raises:
        ValueError: logits of another shape than the grid's.
    """
    config = config or DecodeConfig()
    if logits.shape[-2:] != (grid.rows, grid.cells + 1):
        raise ValueError(f"expected logits ending in shape {(grid.rows, grid.cells + 1)}, got {logits.shape}")
    values = logits.astype(np.float64)
    best = values[..., :-1].argmax(axis=-1)[..., None]
    odds = np.exp(np.minimum(values - np.take_along_axis(values, best, axis=-1), MOST_LOG_ODDS))  # over the best cell's
    window = best + np.arange(-config.window_cells, config.window_cells + 1)
    is_cell = (window >= 0) & (window < grid.cells)
    weights = np.where(is_cell, np.take_along_axis(odds, np.clip(window, 0, grid.cells - 1), axis=-1), 0.0)
    inside, total = weights.sum(axis=-1), odds.sum(axis=-1)
    mean = (weights * window).sum(axis=-1) / inside
    spread = (weights * (window - mean[..., None]) ** 2).sum(axis=-1) / inside
    fraction = mean - np.floor(mean)
    target = config.stripe_cells**2 / 12 if config.stripe_cells > 0 else fraction * (1 - fraction)
    variance = np.maximum(spread - target, 0.0) + config.sigma_floor_cells**2
    if config.min_line_share is None:
        line = odds[..., -1] <= 1.0
    else:
        line = 1.0 - odds[..., -1] / total >= config.min_line_share
    return RowPoints(
        np.where(line, grid.x_from_cell(mean), np.nan),
        inside / total,
        np.where(line, np.sqrt(variance) * grid.cell_px, np.nan),
    )


def rows_from_map(map_logits: Float32, line_logits: Float32, grid: RowGrid) -> Float32:
    """Class logits (lines, rows, cells + 1) of row anchors from a map of every pixel's line.

    A row has the line where its most certain cell and the whole line exceed the published thresholds; it lies among the
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
    there = 1 / (1 + np.exp(-line_logits.astype(np.float64))) > MAP_EXISTENCE
    present = (cells.max(axis=2) > MAP_PEAK) & there[:, None]
    shares = present[..., None] * cells / np.maximum(cells.sum(axis=2, keepdims=True), SMALLEST_SHARE)
    classes_of_rows = np.concatenate([shares, 1 - present[..., None]], axis=2)
    return np.log(np.maximum(classes_of_rows, SMALLEST_SHARE)).astype(np.float32)


def decode_region(logits: Float32, offsets: Float32) -> Region:
    """Class logits (height * width + 1,) and box offsets (4, height, width) -> the most likely box.

    The 3x3 cells around the best one vote, by their share. The probability is that of any place: the middle of a large
    box is uncertain by more than those cells.

    Raises:
        ValueError: shapes that do not agree.
    """
    _, height, width = offsets.shape
    if logits.shape != (height * width + 1,):
        raise ValueError(f"expected logits of shape {(height * width + 1,)}, got {logits.shape}")
    values = logits.astype(np.float64)
    none = np.exp(values[-1] - np.logaddexp.reduce(values))
    shares = np.exp(values[:-1] - values[:-1].max()).reshape(height, width)
    best_row, best_column = divmod(int(shares.argmax()), width)
    rows, columns = slice(max(best_row - 1, 0), best_row + 2), slice(max(best_column - 1, 0), best_column + 2)
    votes = shares[rows, columns] / shares[rows, columns].sum()
    mean = (votes * offsets[:, rows, columns]).sum(axis=(1, 2))
    at = np.array([votes.sum(axis=0) @ np.arange(width)[columns], votes.sum(axis=1) @ np.arange(height)[rows]])
    centre = (at + mean[:2] + 0.5) * STRIDE - 0.5
    half = SIZE_PX * np.exp(np.clip(mean[2:], -5.0, 3.0)) / 2
    return Region(np.concatenate([centre - half, centre + half]), float(1.0 - none))


def decode_places(logits: Float32, offsets: Float32, count: int) -> list[Region]:
    """The `count` most likely boxes, none with a best cell beside another's; each with its own cells' probability.

    Args:
        logits, offsets: as in `decode_region`.
        count: of boxes; fewer where the grid has no more cells apart.
    """
    _, height, width = offsets.shape
    row, column = np.mgrid[0:height, 0:width]
    left = logits.astype(np.float64)
    total, places = np.logaddexp.reduce(left), []
    for _ in range(count):
        cells = left[:-1].reshape(height, width)
        best_row, best_column = np.unravel_index(int(cells.argmax()), cells.shape)
        apart = np.maximum(np.abs(row - best_row), np.abs(column - best_column))
        share = float(np.exp(np.logaddexp.reduce(cells[apart <= 1]) - total))
        places.append(Region(decode_region(left.astype(np.float32), offsets).box, share))
        cells[apart <= PLACE_CELLS] = TAKEN
        if (cells <= TAKEN).all():
            break
    return places
