"""Row and column anchors by one network: steep lines cross many rows, flat ones many columns.

Idea: Qin, Zhang and Li, "Ultra Fast Deep Lane Detection with Hybrid Anchor Driven Ordinal Classification", 2022: every
anchor says whether the line crosses it and orders the cells it may lie in; the position is their expectation. Theirs
are fully connected heads on the whole frame; ours read the anchors from a feature pyramid on EfficientNet-Lite0, in two
looks.
"""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline.detect.anchors import HYBRID_OUTPUTS, DecodeConfig, RowGrid
from deckline.train.backbone import CHANNELS, Lite0Backbone
from deckline.train.detect_losses import (
    DetectTargets,
    LossWeights,
    box_loss,
    position_loss,
    region_loss,
    row_targets,
    segmentation_loss,
)
from deckline.train.detectors.hybrid_targets import anchor_targets
from deckline.train.line_network import LINES, LineNetwork, NetworkKind
from deckline.train.ufld import RegionHead, conv_norm, separable

WIDTH = 64  # channels of the feature pyramid
ALL_LINES = LINES + 1  # the centre line too
_GRID = RowGrid()
KIND = NetworkKind(
    grid=_GRID,
    target_grid=RowGrid(_GRID.width, _GRID.height, _GRID.width, _GRID.height),  # anchors one pixel apart
    output_names=HYBRID_OUTPUTS,
    decode=DecodeConfig(min_line_share=0.5),
    lines=ALL_LINES,
)


class HybridOutput(NamedTuple):
    """What the network says of a batch; the last class of an anchor is "the line does not cross here"."""

    rows: Tensor  # (B, 3, rows, cells + 1) class logits of left, right and centre
    columns: Tensor  # (B, 3, cells, rows + 1) class logits
    region: Tensor  # (B, region cells + 1) class logits
    box: Tensor  # (B, 4, region rows, region columns)
    segmentation: Tensor | None  # (B, 4, H/8, W/8) logits of background and every line; in training only


class Hybrid(LineNetwork):
    """Our network with both kinds of anchors.

    Args:
        pretrained: start from the ImageNet weights.
        frozen_blocks: of the backbone, not trained.
    """

    def __init__(self, pretrained: bool = True, frozen_blocks: int = 2) -> None:
        super().__init__()
        self.kind = KIND
        self.backbone = Lite0Backbone(pretrained, frozen_blocks)
        self.lateral = nn.ModuleList(conv_norm(channels, WIDTH, 1) for channels in CHANNELS)
        self.smooth = nn.ModuleList(separable(WIDTH, WIDTH) for _ in CHANNELS)
        self.anchors = nn.Sequential(separable(WIDTH, WIDTH, 5), separable(WIDTH, WIDTH, 5))
        self.row_cells = nn.Conv2d(WIDTH, ALL_LINES, 1)
        self.column_cells = nn.Conv2d(WIDTH, ALL_LINES, 1)
        self.row_crossed = _Crossed()
        self.column_crossed = _Crossed()
        self.region = RegionHead(WIDTH)
        self.segmentation = nn.Conv2d(WIDTH, ALL_LINES + 1, 1)

    def forward(self, image: Tensor) -> HybridOutput:
        taps = self.backbone(image)
        level = self.smooth[3](self.lateral[3](taps[3]))
        pyramid = [level]
        for index in (2, 1, 0):
            level = F.interpolate(level, scale_factor=2.0, mode="nearest") + self.lateral[index](taps[index])
            level = self.smooth[index](level)
            pyramid.insert(0, level)
        features = self.anchors(pyramid[0])
        rows = _classes(self.row_cells(features), self.row_crossed(features, 3))
        columns = _classes(self.column_cells(features).transpose(2, 3), self.column_crossed(features, 2))
        region, box = self.region(pyramid[1], pyramid[2])
        return HybridOutput(rows, columns, region, box, self.segmentation(pyramid[1]) if self.training else None)

    def loss(  # type: ignore[override]  # the output is its own
        self, output: HybridOutput, targets: DetectTargets, weights: LossWeights, fraction: float
    ) -> tuple[Tensor, dict[str, float]]:
        rows, columns, between = anchor_targets(targets.cell, self.kind.grid)
        hidden = ~targets.known[..., None]
        parts = {
            "region": region_loss(output.region.float(), targets.region),
            "box": box_loss(output.box.float(), targets.box, targets.box_weight),
        }
        for name, logits, position, ignored in (
            ("rows", output.rows.float(), rows, hidden.expand_as(rows)),
            ("columns", output.columns.float(), columns, between | hidden),
        ):
            parts[name], parts[f"{name}_position"] = anchor_loss(logits, position, ignored)
        total = weights.region * parts["region"] + weights.box * parts["box"]
        total = total + weights.rows * (parts["rows"] + parts["columns"])
        total = total + weights.position * (parts["rows_position"] + parts["columns_position"])
        if output.segmentation is not None:
            parts["segmentation"] = segmentation_loss(output.segmentation.float(), rows, self.kind.grid.cells)
            total = total + weights.segmentation * parts["segmentation"]
        return total, {name: float(value.detach()) for name, value in parts.items()}


def anchor_loss(logits: Tensor, position: Tensor, ignored: Tensor) -> tuple[Tensor, Tensor]:
    """Cross-entropy of "crossed here or not" plus that of the cells, and smooth L1 of the expected cell.

    Neither is focal nor weighted by class: what the network then says of an anchor is a probability.

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


class _Crossed(nn.Module):
    """Whether the lines cross each row (or column): from the mean and maximum along it."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv1d(2 * WIDTH, WIDTH, 5, padding=2), nn.ReLU(), nn.Conv1d(WIDTH, ALL_LINES, 5, padding=2)
        )

    def forward(self, features: Tensor, along: int) -> Tensor:
        """(B, C, h, w) -> (B, 3, anchors) logits; `along` is the axis that is pooled."""
        return self.layers(torch.cat([features.mean(along), features.amax(along)], dim=1))


def _classes(cells: Tensor, crossed: Tensor) -> Tensor:
    """Cell logits (..., cells) and "crossed" logits (...) as one softmax of cells + 1 classes.

    Its last class gets the probability that the anchor is not crossed, exactly: 1 - sigmoid(crossed).
    """
    shares = cells.float().log_softmax(-1) + crossed.float()[..., None]
    return torch.cat([shares, torch.zeros_like(shares[..., :1])], dim=-1)
