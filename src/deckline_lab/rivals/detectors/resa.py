"""RESA: a line painted from features that pass on what they see across the whole image, by rows and by columns.

Source: Zheng, Fang, Zhang et al., "RESA: Recurrent Feature-Shift Aggregator for Lane Detection", 2021: our reading of
the paper's "LaneDet". Ours are the region branch (`parts`), the size of the view and the backbone: EfficientNet-Lite0
from ImageNet weights, or the published ResNet from random ones.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline_lab.rivals.detectors.parts import (
    WIDTHS,
    LineExistence,
    MapOutput,
    Merge,
    RegionBranch,
    ResNet,
    dice_loss,
    lines_and_stripes,
    map_kind,
    shared_losses,
)
from deckline_lab.train.backbone import Lite0Backbone
from deckline_lab.train.detect_losses import DetectTargets, Losses, LossWeights
from deckline_lab.train.line_networks import LINES, LineNetwork, PyramidConfig

WIDTH = 128  # channels that are passed on; published
ROUNDS = 4  # a shift by 1/16, 1/8, 1/4 and 1/2 of the side; published
KERNEL = 9  # across the direction of the shift; published
GAIN = 2.0  # of what is passed on; published
DICE_WEIGHT = 2.0  # published
SHIFT_RATE = 0.03  # learning rate of the shifts, relative to the recipe's; our choice


class Resa(LineNetwork):
    """The network of the published CULane configuration, at stride 8: plain decoder and dice loss.

    The sixteen shifts feed each other. Where Adam moves their small first weights as fast as the rest, features grow a
    billionfold in 200 steps and neither map nor existence learns; the published optimizer, plain gradient descent, does
    not.

    A ResNet in place of EfficientNet-Lite0 (`layers`: 18 or 34) ends after its third stage, which fits the published
    cost.
    """

    rates: ClassVar[Mapping[str, float]] = {"shifts.": SHIFT_RATE}

    def __init__(self, shape: PyramidConfig, layers: int | None = None, lines: int = LINES) -> None:
        super().__init__()
        self.kind = map_kind(shape.grid.size)
        if layers is None:
            self.backbone, self.merge = Lite0Backbone(shape.pretrained, shape.frozen_blocks), Merge(WIDTH)
        else:
            self.body = ResNet(layers, stages=3)
            self.reduce = nn.Conv2d(WIDTHS[2], WIDTH, 1, bias=False)
        self.layers = layers
        self.shifts = FeatureShift(WIDTH)
        self.decoder = nn.Sequential(nn.Dropout2d(0.1), nn.Conv2d(WIDTH, lines + 1, 1))
        self.existence = LineExistence(WIDTH, None, lines, shape.grid.size)
        self.region = RegionBranch(WIDTH)

    def forward(self, image: Tensor) -> MapOutput:
        reduced = self.merge(self.backbone(image)) if self.layers is None else self.reduce(self.body(image)[1])
        features = self.shifts(reduced)
        painted = F.interpolate(self.decoder(features), scale_factor=8.0, mode="bilinear", align_corners=False)
        region, box = self.region(features)
        return MapOutput(painted, self.existence(features), region, box)

    def loss(self, output: Any, targets: DetectTargets, weights: LossWeights, fraction: float) -> Losses:
        total, parts = shared_losses(output, targets, weights)
        parts["dice"] = dice_loss(*lines_and_stripes(output.map, targets.cell))
        return total + DICE_WEIGHT * parts["dice"], {name: float(value.detach()) for name, value in parts.items()}


class FeatureShift(nn.Module):
    """Every place gets, cyclically, what lies ever farther down, up, right and left of it, through a convolution."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        across, along = (1, KERNEL), (KERNEL, 1)
        self.rounds = nn.ModuleList(
            nn.ModuleList(
                nn.Conv2d(channels, channels, kernel, padding=(kernel[0] // 2, kernel[1] // 2), bias=False)
                for kernel in (across, across, along, along)
            )
            for _ in range(ROUNDS)
        )
        spread = (2.0 / (channels * channels * KERNEL)) ** 0.5 / 5.0  # small, as many passes are added up
        for conv in self.rounds.modules():
            if isinstance(conv, nn.Conv2d):
                nn.init.uniform_(conv.weight, -spread, spread)

    def forward(self, x: Tensor) -> Tensor:
        for direction, (dim, sign) in enumerate(((2, 1), (2, -1), (3, 1), (3, -1))):
            for index, convs in enumerate(self.rounds):
                shift = x.shape[dim] // 2 ** (ROUNDS - index)
                shifted = torch.roll(x, -sign * shift, dim)
                x = x + GAIN * F.relu(convs[direction](shifted))  # type: ignore[index]  # a ModuleList
        return x
