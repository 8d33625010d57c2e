"""UFLD as published: everything flattened into two fully connected layers, 100 cells on 56 row anchors.

Source: Qin, Wang and Li, "Ultra Fast Structure-aware Deep Lane Detection", 2020. Ours are the region branch (`parts`),
the view of 512x288 px, and the backbone: EfficientNet-Lite0 from ImageNet weights, or the published ResNet-18 from
random ones.
"""

from functools import partial
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline.detect.anchors import RowGrid
from deckline_lab.rivals.detectors.parts import WIDTHS, RegionBranch, ResNet
from deckline_lab.train.backbone import CHANNELS, Lite0Backbone, conv_norm
from deckline_lab.train.detect_losses import DetectTargets, Losses, LossWeights, UfldOutput, ufld_loss
from deckline_lab.train.line_networks import LINES, LineNetwork, NetworkKind

PUBLISHED_CELLS, PUBLISHED_ROWS = 100, 56  # on TuSimple
SQUEEZE = 8  # channels before flattening; published
HIDDEN = 2048  # published


class PublishedUfld(LineNetwork):
    """The published network; `grid` holds row anchors and input size, whose sides 32 divides.

    `resnet` takes ResNet-18 in place of EfficientNet-Lite0.
    """

    def __init__(
        self, grid: RowGrid | None = None, lines: int = LINES, resnet: bool = False, pretrained: bool = True
    ) -> None:
        super().__init__()
        grid = grid or RowGrid(cells=PUBLISHED_CELLS, rows=PUBLISHED_ROWS)
        self.kind = NetworkKind(grid, grid)
        self.shape = (lines, grid.rows, grid.cells + 1)
        channels = WIDTHS[1:] if resnet else CHANNELS[1:]
        if resnet:
            self.body = ResNet(18)
        else:
            self.backbone = Lite0Backbone(pretrained)
        self.resnet = resnet
        self.squeeze = nn.Conv2d(channels[2], SQUEEZE, 1)
        flat = SQUEEZE * (grid.width // 32) * (grid.height // 32)
        outputs = lines * grid.rows * (grid.cells + 1)
        self.fc = nn.Sequential(nn.Linear(flat, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, outputs))
        for layer in self.fc:
            if isinstance(layer, nn.Linear):
                nn.init.normal_(layer.weight, std=0.01)
        self.region = RegionBranch(channels[0], channels[1])
        self.segmentation = AuxiliaryBranch(channels, lines + 1)

    def forward(self, image: Tensor) -> UfldOutput:
        taps = self.body(image) if self.resnet else self.backbone(image)[1:]
        rows = self.fc(self.squeeze(taps[2]).flatten(1)).unflatten(1, self.shape)
        region, box = self.region(taps[0], taps[1])
        return UfldOutput(rows, region, box, self.segmentation(taps) if self.training else None)

    def loss(self, output: Any, targets: DetectTargets, weights: LossWeights, fraction: float) -> Losses:
        return ufld_loss(output, targets, weights)


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
