"""UFLD as published: everything flattened into two fully connected layers, 100 cells on 56 row anchors.

Source: Qin, Wang and Li, "Ultra Fast Structure-aware Deep Lane Detection", 2020, and its configuration for TuSimple.
Ours are the region branch (`parts`), the size of the view, and the backbone: EfficientNet-Lite0 from ImageNet weights,
or the published ResNet-18 from random ones.
"""

from functools import partial
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline.detect.anchors import RowGrid
from deckline.detect.coarse_to_fine import DetectConfig
from deckline_lab.rivals.detectors.parts import PUBLISHED_SEARCH, WIDTHS, RegionBranch, ResNet
from deckline_lab.train.backbone import BLOCKS, CHANNELS, Lite0Backbone, conv_norm
from deckline_lab.train.detect_losses import (
    DetectTargets,
    Losses,
    LossWeights,
    UfldOutput,
    box_loss,
    region_loss,
    segmentation_loss,
)
from deckline_lab.train.line_networks import LINES, LineNetwork, NetworkKind, PyramidConfig

PUBLISHED_CELLS, PUBLISHED_ROWS = 100, 56  # on TuSimple
SQUEEZE = 8  # channels before flattening; published
HIDDEN = 2048  # published
FOCAL_GAMMA = 2.0  # published


class PublishedUfld(LineNetwork):
    """The published network.

    `resnet` takes ResNet-18 in place of EfficientNet-Lite0. Without anything of the backbone to train there is no
    auxiliary branch: it serves the backbone alone.
    """

    def __init__(
        self,
        shape: PyramidConfig,
        anchors: tuple[int, int] = (PUBLISHED_CELLS, PUBLISHED_ROWS),
        lines: int = LINES,
        resnet: bool = False,
    ) -> None:
        super().__init__()
        grid = RowGrid(*shape.grid.size, *anchors)
        self.kind = NetworkKind(DetectConfig(grid, **PUBLISHED_SEARCH), grid)
        self.shape = (lines, grid.rows, grid.cells + 1)
        channels = WIDTHS[1:] if resnet else CHANNELS[1:]
        if resnet:
            self.body = ResNet(18)
        else:
            self.backbone = Lite0Backbone(shape.pretrained, shape.frozen_blocks)
        self.resnet = resnet
        self.squeeze = nn.Conv2d(channels[2], SQUEEZE, 1)
        flat = SQUEEZE * (grid.width // 32) * (grid.height // 32)
        outputs = lines * grid.rows * (grid.cells + 1)
        self.fc = nn.Sequential(nn.Linear(flat, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, outputs))
        for layer in self.fc:
            if isinstance(layer, nn.Linear):
                nn.init.normal_(layer.weight, std=0.01)
        self.region = RegionBranch(channels[0], channels[1])
        learns = resnet or shape.frozen_blocks < BLOCKS
        self.segmentation = AuxiliaryBranch(channels, lines + 1) if learns else None

    def forward(self, image: Tensor) -> UfldOutput:
        taps = self.body(image) if self.resnet else self.backbone(image)[1:]
        rows = self.fc(self.squeeze(taps[2]).flatten(1)).unflatten(1, self.shape)
        region, box = self.region(taps[0], taps[1])
        segmentation = None if self.segmentation is None or not self.training else self.segmentation(taps)
        return UfldOutput(rows, region, box, segmentation)

    def loss(self, output: Any, targets: DetectTargets, weights: LossWeights, fraction: float) -> Losses:
        logits = output.rows.float()
        parts = {
            "rows": focal_loss(logits, targets.cell),
            "similarity": F.smooth_l1_loss(logits[:, :, :-1], logits[:, :, 1:]),
            "region": region_loss(output.region.float(), targets.region),
            "box": box_loss(output.box.float(), targets.box, targets.box_weight),
        }
        total = parts["rows"] + parts["similarity"] + weights.region * parts["region"] + weights.box * parts["box"]
        if output.segmentation is not None:
            parts["segmentation"] = segmentation_loss(output.segmentation.float(), targets.cell, logits.shape[-1] - 1)
            total = total + parts["segmentation"]
        return total, {name: float(value.detach()) for name, value in parts.items()}


def focal_loss(logits: Tensor, cell: Tensor) -> Tensor:
    """Focal cross-entropy of the nearest cell, or of "no line here", mean over all anchors.

    Args:
        logits: (B, lines, rows, cells + 1).
        cell: (B, lines, rows) position in cells, NaN for "no line here".
    """
    cells = logits.shape[-1] - 1
    label = torch.where(torch.isnan(cell), cells, cell.nan_to_num(0.0).round().clamp(0, cells - 1)).long()
    log_p = logits.log_softmax(-1).gather(-1, label[..., None])
    return -((1 - log_p.exp()) ** FOCAL_GAMMA * log_p).mean()


class AuxiliaryBranch(nn.Module):
    """The training-only branch: features of three stages, brought to stride 8 and together."""

    WIDTH = 128  # published

    def __init__(self, channels: tuple[int, ...], classes: int) -> None:
        super().__init__()
        conv = partial(conv_norm, kernel=3, relu=True)
        self.stages = nn.ModuleList(
            nn.Sequential(*(conv(width if k == 0 else self.WIDTH, self.WIDTH) for k in range(count + 1)))
            for width, count in zip(channels, (1, 2, 3), strict=True)
        )
        together = ((3 * self.WIDTH, 256, 2), (256, 128, 2), (128, 128, 2), (128, 128, 4))
        self.together = nn.Sequential(*(conv(before, after, dilation=by) for before, after, by in together))
        self.classes = nn.Conv2d(128, classes, 1)

    def forward(self, taps: list[Tensor]) -> Tensor:
        size = taps[0].shape[2:]
        maps = [stage(tap) for stage, tap in zip(self.stages, taps, strict=True)]
        maps = [F.interpolate(x, size=size, mode="bilinear", align_corners=False) for x in maps]
        return self.classes(self.together(torch.cat(maps, dim=1)))
