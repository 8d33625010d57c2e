"""RESA: a line painted from features that pass on what they see across the whole image, by rows and by columns.

Source: Zheng, Fang, Zhang et al., "RESA: Recurrent Feature-Shift Aggregator for Lane Detection", 2021: our reading of
the paper's "LaneDet". Ours are the region branch (`parts`), the size of the view and the backbone: EfficientNet-Lite0
from ImageNet weights, or the published ResNet from random ones.
"""

from typing import Any

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
    Trunk,
    dice_loss,
    lines_and_stripes,
    map_kind,
    shared_losses,
)
from deckline_lab.train.backbone import conv_norm
from deckline_lab.train.detect_losses import DetectTargets, Losses, LossWeights
from deckline_lab.train.line_networks import LINES, LineNetwork

WIDTH = 128  # channels that are passed on; published
ROUNDS = 4  # a shift by 1/16, 1/8, 1/4 and 1/2 of the side; published
KERNEL = 9  # across the direction of the shift; published
GAIN = 2.0  # of what is passed on; published
DICE_WEIGHT = 2.0  # published


class Resa(LineNetwork):
    """The published network at stride 8, with its paper's bilateral decoder and the dice loss of its code for CULane.

    With that code's plain decoder, one 1x1 convolution, dice learned nothing in 120 steps of 8 (0.98 to 0.997). A ResNet in place of EfficientNet-Lite0 (`layers`: 18 or 34) ends after its third stage, which fits the published
    cost.
    """

    def __init__(self, trunk: Trunk, layers: int | None = None, lines: int = LINES) -> None:
        super().__init__()
        self.kind = map_kind(trunk.size_px)
        if layers is None:
            self.backbone, self.merge = trunk.build(), Merge(WIDTH)
        else:
            self.body = ResNet(layers, stages=3)
            self.reduce = nn.Conv2d(WIDTHS[2], WIDTH, 1, bias=False)
        self.layers = layers
        self.shifts = FeatureShift(WIDTH)
        self.decoder = nn.Sequential(
            BilateralUpsampling(WIDTH, 64),
            BilateralUpsampling(64, 32),
            BilateralUpsampling(32, 16),
            nn.Conv2d(16, lines + 1, 1),
        )
        self.existence = LineExistence(WIDTH, None, lines, trunk.size_px)
        self.region = RegionBranch(WIDTH)

    def forward(self, image: Tensor) -> MapOutput:
        reduced = self.merge(self.backbone(image)) if self.layers is None else self.reduce(self.body(image)[1])
        features = self.shifts(reduced)
        region, box = self.region(features)
        return MapOutput(self.decoder(features), self.existence(features), region, box)

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


class BilateralUpsampling(nn.Module):
    """Bilateral up-sampling: a coarse branch that interpolates and a fine one that is learned, added."""

    def __init__(self, channels_in: int, channels_out: int) -> None:
        super().__init__()
        self.coarse = conv_norm(channels_in, channels_out, 1)
        self.fine = nn.Sequential(
            nn.ConvTranspose2d(channels_in, channels_out, 3, 2, 1, output_padding=1, bias=True),
            nn.BatchNorm2d(channels_out),
            nn.ReLU(),
            FactoredConvolutions(channels_out),
            FactoredConvolutions(channels_out),
        )

    def forward(self, x: Tensor) -> Tensor:
        coarse = F.interpolate(self.coarse(x), scale_factor=2.0, mode="bilinear", align_corners=False)
        return F.relu(coarse) + self.fine(x)


class FactoredConvolutions(nn.Module):
    """Two 3x3 convolutions, each as 3x1 and 1x3, added to their input."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for _ in range(2):
            layers += [nn.Conv2d(channels, channels, (3, 1), padding=(1, 0)), nn.ReLU()]
            layers += [nn.Conv2d(channels, channels, (1, 3), padding=(0, 1)), nn.BatchNorm2d(channels), nn.ReLU()]
        self.branch = nn.Sequential(*layers[:-1])

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.branch(x))
