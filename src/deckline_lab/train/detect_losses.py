"""Losses of our line networks, on the targets that `deckline.detect` encodes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from deckline.detect.anchors import RowGrid

NEAR_CELLS = 4  # around the target: where the expected position is taken for its loss
FLATTEST, STEEPEST = 4.0, 4.0  # |dx/dy| and |dy/dx| beyond which rows, or columns, are not asked: cells per anchor

Losses = tuple[Tensor, dict[str, float]]  # weighted sum, and its parts by name


class UfldOutput(NamedTuple):
    """The outputs of a row-anchor network for a batch."""

    rows: Tensor  # (B, 2, rows, cells + 1) class logits
    region: Tensor  # (B, region cells + 1) class logits
    box: Tensor  # (B, 4, region rows, region columns)
    segmentation: Tensor | None  # (B, 3, H/8, W/8) logits of background, left, right; in training only


class HybridOutput(NamedTuple):
    """The outputs of the hybrid network for a batch; the last class of an anchor is "the line does not cross here"."""

    rows: Tensor  # (B, 3, rows, cells + 1) class logits of left, right and centre
    columns: Tensor  # (B, 3, cells, rows + 1) class logits
    region: Tensor  # (B, region cells + 1) class logits
    box: Tensor  # (B, 4, region rows, region columns)
    edge: Tensor  # (B, kinds) class logits of what the edge lines are
    segmentation: Tensor | None  # (B, 4, H/8, W/8) logits of background and every line; in training only


class DetectTargets(NamedTuple):
    """Encoded truth of a batch."""

    cell: Tensor  # (B, lines, rows) position in cells, NaN for "no line here"
    known: Tensor  # (B, lines) bool: whether the truth of the line is known
    region: Tensor  # (B, region cells + 1) shares
    box: Tensor  # (B, 4, region rows, region columns)
    box_weight: Tensor  # (B, region rows, region columns)
    edge: Tensor  # (B,) number of the edge's kind in `EDGES`; -1 where there is no line or nobody knows

    def first(self, lines: int) -> "DetectTargets":
        """What a network of so many lines is taught: the left, the right, then the centre line."""
        return self._replace(cell=self.cell[:, :lines], known=self.known[:, :lines])


@dataclass(frozen=True)
class LossWeights:
    """How much every part counts."""

    rows: float = 1.0
    focal_gamma: float = 2.0  # published
    position: float = 0.5  # smooth L1 of the expected cell: what classes alone leave unsharp
    region: float = 0.5
    box: float = 0.5
    segmentation: float = 0.2
    edge: float = 0.1
    shape: float = 0.05  # second differences: runway edges are straight in a pinhole image


def ufld_loss(output: UfldOutput, targets: DetectTargets, weights: LossWeights) -> Losses:
    """Weighted sum of the row-anchor network's losses, and every part by name."""
    logits = output.rows.float()
    parts = {
        "rows": row_loss(logits, targets.cell, weights.focal_gamma),
        "position": position_loss(logits, targets.cell),
        "region": region_loss(output.region.float(), targets.region),
        "box": box_loss(output.box.float(), targets.box, targets.box_weight),
        "shape": shape_loss(logits, targets.cell),
    }
    if output.segmentation is not None:
        parts["segmentation"] = segmentation_loss(output.segmentation.float(), targets.cell, logits.shape[-1] - 1)
    total = torch.stack([getattr(weights, name) * value for name, value in parts.items()]).sum()
    return total, {name: float(value.detach()) for name, value in parts.items()}


def hybrid_loss(
    output: HybridOutput, targets: DetectTargets, anchors: tuple[Tensor, Tensor, Tensor], weights: LossWeights
) -> Losses:
    """Weighted sum of the hybrid network's losses, and every part by name; `anchors` are `anchor_targets`."""
    rows, columns, between = anchors
    hidden = ~targets.known[..., None]
    parts = {
        "region": region_loss(output.region.float(), targets.region),
        "box": box_loss(output.box.float(), targets.box, targets.box_weight),
    }
    losses = anchor_loss(output.rows.float(), rows, hidden.expand_as(rows))
    parts["rows"], parts["rows_position"] = losses
    losses = anchor_loss(output.columns.float(), columns, between | hidden)
    parts["columns"], parts["columns_position"] = losses
    parts["edge"] = edge_loss(output.edge.float(), targets.edge)
    total = weights.region * parts["region"] + weights.box * parts["box"] + weights.edge * parts["edge"]
    total = total + weights.rows * (parts["rows"] + parts["columns"])
    total = total + weights.position * (parts["rows_position"] + parts["columns_position"])
    if output.segmentation is not None:
        parts["segmentation"] = segmentation_loss(output.segmentation.float(), rows, output.rows.shape[-1] - 1)
        total = total + weights.segmentation * parts["segmentation"]
    return total, {name: float(value.detach()) for name, value in parts.items()}


def edge_loss(logits: Tensor, kind: Tensor) -> Tensor:
    """Cross-entropy of the edge's kind (B,), over the views in which it is known."""
    losses = F.cross_entropy(logits, kind.clamp(min=0), reduction="none")
    return _mean_where(losses, kind >= 0)


def anchor_loss(logits: Tensor, position: Tensor, ignored: Tensor) -> tuple[Tensor, Tensor]:
    """Cross-entropy of "crossed here or not" plus that of the cells, and smooth L1 of the expected cell.

    Neither is focal nor weighted by class: the network's output for an anchor is then a probability.

    Args:
        logits: (B, lines, anchors, cells + 1).
        position: (B, lines, anchors) in cells, NaN for "not crossed here".
        ignored: (B, lines, anchors) where it is not known which.
    """
    shares = row_targets(position, logits.shape[-1] - 1)
    log_p = logits.log_softmax(-1)
    crossed, known = ~torch.isnan(position), ~ignored
    log_not, log_crossed = log_p[..., -1], log_p[..., :-1].logsumexp(-1)
    existence = -torch.where(crossed, log_crossed, log_not)
    where = -(shares[..., :-1] * (log_p[..., :-1] - log_crossed[..., None])).sum(-1)
    loss = (existence * known).sum() / known.sum().clamp(min=1) + (where * crossed).sum() / crossed.sum().clamp(min=1)
    return loss, position_loss(logits, position)


def anchor_targets(x_px: Tensor, grid: RowGrid) -> tuple[Tensor, Tensor, Tensor]:
    """Positions on a grid's rows and columns, for a batch of lines.

    Args:
        x_px: (B, lines, height) on every pixel row, NaN where there is no line.

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


def row_targets(cell: Tensor, cells: int) -> Tensor:
    """Shares (..., cells + 1) of a position (...) in cells: its two neighbours by nearness; the last one for NaN."""
    none = torch.isnan(cell)
    position = cell.nan_to_num(0.0).clamp(0, cells - 1)
    low = position.floor().clamp(max=cells - 2)
    share = position - low
    shares = torch.zeros(*cell.shape, cells + 1, device=cell.device)
    shares.scatter_(-1, low.long()[..., None], (1 - share)[..., None])
    shares.scatter_add_(-1, low.long()[..., None] + 1, share[..., None])
    shares[none] = 0.0
    shares[..., -1] = none.float()
    return shares


def row_loss(logits: Tensor, cell: Tensor, gamma: float) -> Tensor:
    """Focal cross-entropy; for a one-hot target the published one. Rows with and without a line weigh the same.

    The focus (1 - overlap)^gamma takes the overlap of predicted and target shares in place of the true class' share:
    with two-cell targets a perfect row would otherwise have a loss.
    """
    shares = row_targets(cell, logits.shape[-1] - 1)
    log_p = logits.log_softmax(-1)
    overlap = torch.minimum(log_p.exp(), shares).sum(-1)
    loss = (1 - overlap).clamp(min=0) ** gamma * -(shares * log_p).sum(-1)
    none = torch.isnan(cell)
    return _mean_where(loss, ~none) + _mean_where(loss, none)


def position_loss(logits: Tensor, cell: Tensor) -> Tensor:
    """Smooth L1 of the expected cell near the target; far cells are the classes' business."""
    cells = logits.shape[-1] - 1
    target = cell.nan_to_num(0.0)
    near = (torch.arange(cells, device=cell.device) - target[..., None]).abs() <= NEAR_CELLS
    expected = _expected(logits[..., :-1].masked_fill(~near, -1e4))
    error = F.smooth_l1_loss(expected, target, reduction="none", beta=0.5)
    return _mean_where(error, ~torch.isnan(cell))


def shape_loss(logits: Tensor, cell: Tensor) -> Tensor:
    """Smooth L1 of second differences of expected cells over three rows with a line.

    Source: UFLD's shape loss; its weight sum over all rows is taken per row here.
    """
    expected = _expected(logits[..., :-1])
    second = expected[..., :-2] - 2 * expected[..., 1:-1] + expected[..., 2:]
    seen = ~torch.isnan(cell)
    triple = seen[..., :-2] & seen[..., 1:-1] & seen[..., 2:]
    return _mean_where(F.smooth_l1_loss(second, torch.zeros_like(second), reduction="none"), triple)


def region_loss(logits: Tensor, shares: Tensor) -> Tensor:
    """Cross-entropy of the region's cells, both (B, cells + 1)."""
    return -(shares * logits.log_softmax(1)).sum(1).mean()


def box_loss(box: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Smooth L1 of the box offsets at the cells around the box' centre, over the images that have one."""
    error = F.smooth_l1_loss(box, target, reduction="none", beta=0.1).sum(1)
    images = (weight.flatten(1).sum(1) > 0).sum().clamp(min=1)
    return (error * weight).sum() / images


def segmentation_loss(logits: Tensor, cell: Tensor, cells: int) -> Tensor:
    """Cross-entropy of background and every line, on the rows and columns of the logits (B, lines + 1, h, w)."""
    batch, _, height, width = logits.shape
    rows = cell.shape[-1]
    cells_per_column = cells / width
    nearest = (torch.arange(height, device=cell.device) * rows + rows // 2) // height
    line_cell = cell[..., nearest].nan_to_num(-1e4)  # (B, lines, height); far outside where there is no line
    column_cell = (torch.arange(width, device=cell.device) + 0.5) * cells_per_column - 0.5
    distance = (column_cell - line_cell[..., None]).abs()
    label = torch.zeros(batch, height, width, dtype=torch.long, device=cell.device)
    for line in range(cell.shape[1]):
        label[distance[:, line] <= cells_per_column] = line + 1
    return F.cross_entropy(logits, label, weight=class_weights(logits, 0.2))


def class_weights(logits: Tensor, background: float) -> Tensor:
    """Weights of the classes (B, classes, h, w): the background's, and 1 of every line."""
    return torch.tensor([background, *[1.0] * (logits.shape[1] - 1)], device=logits.device)


def _expected(logits: Tensor) -> Tensor:
    return (logits.softmax(-1) * torch.arange(logits.shape[-1], device=logits.device)).sum(-1)


def _mean_where(values: Tensor, mask: Tensor) -> Tensor:
    return (values * mask).sum() / mask.sum().clamp(min=1)
