"""Losses of the row-anchor network, on the targets that `deckline.detect` encodes."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

NEAR_CELLS = 4  # around the target: where the expected position is taken for its loss


class UfldOutput(NamedTuple):
    """What the network says of a batch."""

    rows: Tensor  # (B, 2, rows, cells + 1) class logits
    region: Tensor  # (B, region cells + 1) class logits
    box: Tensor  # (B, 4, region rows, region columns)
    segmentation: Tensor | None  # (B, 3, H/8, W/8) logits of background, left, right; in training only


class DetectTargets(NamedTuple):
    """Encoded truth of a batch."""

    cell: Tensor  # (B, lines, rows) position in cells, NaN for "no line here"
    known: Tensor  # (B, lines) bool: whether the truth of the line is known
    region: Tensor  # (B, region cells + 1) shares
    box: Tensor  # (B, 4, region rows, region columns)
    box_weight: Tensor  # (B, region rows, region columns)

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
    similarity: float = 0.0  # of neighbouring rows' logits: pulls slanted lines upright, and ours are slanted
    shape: float = 0.05  # second differences: runway edges are straight in a pinhole image


def detect_loss(output: UfldOutput, targets: DetectTargets, weights: LossWeights) -> tuple[Tensor, dict[str, float]]:
    """Weighted sum, and every part by name."""
    logits = output.rows.float()
    parts = {
        "rows": row_loss(logits, targets.cell, weights.focal_gamma),
        "position": position_loss(logits, targets.cell),
        "region": region_loss(output.region.float(), targets.region),
        "box": box_loss(output.box.float(), targets.box, targets.box_weight),
        "shape": shape_loss(logits, targets.cell),
        "similarity": F.smooth_l1_loss(logits[:, :, 1:], logits[:, :, :-1]),
    }
    if output.segmentation is not None:
        parts["segmentation"] = segmentation_loss(output.segmentation.float(), targets.cell, logits.shape[-1] - 1)
    total = torch.stack([getattr(weights, name) * value for name, value in parts.items()]).sum()
    return total, {name: float(value.detach()) for name, value in parts.items()}


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
    with two-cell targets a perfect row would otherwise keep a loss.
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
    weight = torch.ones(logits.shape[1], device=logits.device)
    weight[0] = 0.2
    return F.cross_entropy(logits, label, weight=weight)


def _expected(logits: Tensor) -> Tensor:
    return (logits.softmax(-1) * torch.arange(logits.shape[-1], device=logits.device)).sum(-1)


def _mean_where(values: Tensor, mask: Tensor) -> Tensor:
    return (values * mask).sum() / mask.sum().clamp(min=1)
