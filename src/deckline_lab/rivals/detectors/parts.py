"""Building blocks of the compared networks: backbones, region branch, segmentation on anchors one pixel high."""

from typing import Any, NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline.detect.anchors import MAP_OUTPUTS, DecodeConfig, RowGrid
from deckline.detect.coarse_to_fine import DetectConfig
from deckline_lab.train.backbone import CHANNELS, conv_norm, separable
from deckline_lab.train.detect_losses import DetectTargets, LossWeights, box_loss, region_loss
from deckline_lab.train.line_networks import CELL_PX, NetworkKind, RegionHead

REGION_WIDTH = 64  # channels, as in our own networks
WIDTHS = (64, 128, 256, 512)  # channels of the four stages
BLOCKS = {18: (2, 2, 2, 2), 34: (3, 4, 6, 3)}  # residual blocks of the four stages, by layers
STRIPE_SHARE = 12 / 512  # of the view's width: the stripe that is painted along a row, about the 30 px of CULane's 1640
EXISTENCE_WEIGHT = 0.1  # published
# The published networks accept a line by their own rule (`rows_from_map`; UFLD: a row whose best class is a cell) and
# keep all of its points. The region branch says where to look closer, once, and refuses nothing.
PUBLISHED_SEARCH: dict[str, Any] = {
    "min_confidence": 0.0,
    "min_rows": 2,
    "straight_cells": 1e9,
    "min_straight_share": 0.0,
    "min_probability": 0.0,
    "min_lone_probability": 0.0,
    "min_close_probability": 0.0,
    "min_prior_probability": 0.0,
    "sure_probability": 0.0,
    "sure_clear_probability": 0.0,
    "agreeing_probability": 0.0,
    "min_view_probability": 0.0,
    "min_place_probability": 0.0,
    "places": 1,
    "tilings": (),
}


def map_kind(size_px: tuple[int, int]) -> NetworkKind:
    """A network that paints lines: taught on every pixel row, read on anchors and cells of 4 px."""
    width, height = size_px
    grid = RowGrid(width, height, width // CELL_PX, height // CELL_PX)
    decode = DecodeConfig(stripe_cells=STRIPE_SHARE * grid.cells)
    return NetworkKind(
        DetectConfig(grid, decode, **PUBLISHED_SEARCH), RowGrid(width, height, width, height), MAP_OUTPUTS
    )


class RegionBranch(nn.Module):
    """Where the runway is. No part of the published networks: with it all of them search coarse to fine, as ours.

    Args:
        eighth: channels of the features at stride 8.
        sixteenth: channels of those at stride 16; None where a network has none.
    """

    def __init__(self, eighth: int, sixteenth: int | None = None) -> None:
        super().__init__()
        self.eighth = conv_norm(eighth, REGION_WIDTH, 1)
        self.sixteenth = (
            separable(REGION_WIDTH, REGION_WIDTH) if sixteenth is None else conv_norm(sixteenth, REGION_WIDTH, 1)
        )
        self.head = RegionHead(REGION_WIDTH)

    def forward(self, eighth: Tensor, sixteenth: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Class logits (B, cells + 1) and box offsets (B, 4, rows, columns) on the stride-16 grid."""
        near = self.eighth(eighth)
        return self.head(near, self.sixteenth(F.max_pool2d(near, 2) if sixteenth is None else sixteenth))


class Merge(nn.Module):
    """Features of EfficientNet-Lite0 at strides 8, 16 and 32, each by a 1x1 convolution, added up at stride 8.

    It replaces the dilated last stages of a ResNet: dilating these costs four and sixteen times as much.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.lateral = nn.ModuleList(conv_norm(channels, width, 1) for channels in CHANNELS[1:])

    def forward(self, taps: list[Tensor]) -> Tensor:
        """The backbone's taps -> (B, width, H/8, W/8), not negative."""
        eighth, sixteenth, deepest = (layer(tap) for layer, tap in zip(self.lateral, taps[1:], strict=True))
        x = F.interpolate(deepest, scale_factor=2.0, mode="bilinear", align_corners=False) + sixteenth
        return F.relu(F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False) + eighth)


class ResNet(nn.Module):
    """ResNet-18 or -34: (B, 3, H, W) -> features of stages two to four, 128, 256, 512 channels at strides 8, 16, 32.

    Args:
        layers: 18 or 34.
        stages: how many of the four are built; the third of three has stride 8 and dilates its kernels instead.

    Source: He, Zhang, Ren and Sun, "Deep Residual Learning for Image Recognition", 2016.
    """

    def __init__(self, layers: int, stages: int = 4) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            nn.Conv2d(3, 64, 7, 2, 3, bias=False), nn.BatchNorm2d(64), nn.ReLU(), nn.MaxPool2d(3, 2, 1)
        )
        self.stages = nn.ModuleList()
        channels = WIDTHS[0]
        for index in range(stages):
            dilation = 2 if (index, stages) == (2, 3) else 1
            stride = 1 if index == 0 or dilation == 2 else 2
            blocks = [ResidualBlock(channels, WIDTHS[index], stride, dilation)]
            blocks += [
                ResidualBlock(WIDTHS[index], WIDTHS[index], 1, dilation) for _ in range(BLOCKS[layers][index] - 1)
            ]
            self.stages.append(nn.Sequential(*blocks))
            channels = WIDTHS[index]
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d):
                nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, image: Tensor) -> list[Tensor]:
        x, taps = self.stem(image), []
        for index, stage in enumerate(self.stages):
            x = stage(x)
            if index > 0:
                taps.append(x)
        return taps


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions added to their input, which a 1x1 convolution brings to the same shape where it differs."""

    def __init__(self, channels_in: int, channels_out: int, stride: int, dilation: int) -> None:
        super().__init__()
        self.first = conv_norm(channels_in, channels_out, 3, stride, dilation, relu=True)
        self.second = conv_norm(channels_out, channels_out, 3, 1, dilation)
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or channels_in != channels_out:
            self.shortcut = conv_norm(channels_in, channels_out, 1, stride)

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(self.second(self.first(x)) + self.shortcut(x))


class MapOutput(NamedTuple):
    """The outputs of a segmentation network for a batch."""

    map: Tensor  # (B, lines + 1, H, W) class logits of background and every line
    lines: Tensor  # (B, lines) logits
    region: Tensor  # (B, region cells + 1) class logits
    box: Tensor  # (B, 4, region rows, region columns)
    encoded: tuple[Tensor, ...] = ()  # features of the encoder's blocks, shallow to deep; in training only


class LineExistence(nn.Module):
    """Which lines are in the view, from features at stride 8: the branch that SCNN introduced.

    Args:
        hidden: channels of a first 3x3 convolution; None goes straight to the class maps.
        size_px: width and height of the view; the fully connected layer fixes them.

    Source: Pan et al., "Spatial As Deep: Spatial CNN for Traffic Scene Understanding", 2018.
    """

    FC_WIDTH = 128  # published

    def __init__(self, channels: int, hidden: int | None, lines: int, size_px: tuple[int, int]) -> None:
        super().__init__()
        self.hidden = nn.Identity() if hidden is None else conv_norm(channels, hidden, 3, dilation=4, relu=True)
        self.classes = nn.Sequential(nn.Dropout2d(0.1), nn.Conv2d(hidden or channels, lines + 1, 1))
        flat = (lines + 1) * (size_px[0] // 16) * (size_px[1] // 16)
        self.fc = nn.Sequential(nn.Linear(flat, self.FC_WIDTH), nn.ReLU(), nn.Linear(self.FC_WIDTH, lines))

    def forward(self, features: Tensor) -> Tensor:
        """(B, lines) logits."""
        shares = self.classes(self.hidden(features)).softmax(1)
        return self.fc(F.avg_pool2d(shares, 2).flatten(1))


def paint_stripes(cell: Tensor, width: int) -> Tensor:
    """Class (B, H, width) of every pixel: 0, or k + 1 within the stripe of line k.

    Args:
        cell: (B, lines, H) position on every pixel row, px, NaN for "no line here".
        width: px.
    """
    x = torch.arange(width, device=cell.device)
    label = torch.zeros(cell.shape[0], cell.shape[2], width, dtype=torch.long, device=cell.device)
    for line in range(cell.shape[1]):
        label[(x - cell[:, line, :, None]).abs() <= STRIPE_SHARE * width / 2] = line + 1  # never true beside NaN
    return label


def shared_losses(output: MapOutput, targets: DetectTargets, weights: LossWeights) -> tuple[Tensor, dict[str, Tensor]]:
    """Existence, region and box, which all networks that paint lines have: weighted sum, and every part by name."""
    there = (~torch.isnan(targets.cell)).any(2).float()
    parts = {
        "existence": F.binary_cross_entropy_with_logits(output.lines.float(), there),
        "region": region_loss(output.region.float(), targets.region),
        "box": box_loss(output.box.float(), targets.box, targets.box_weight),
    }
    total = EXISTENCE_WEIGHT * parts["existence"] + weights.region * parts["region"] + weights.box * parts["box"]
    return total, parts


def lines_and_stripes(logits: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
    """Probabilities of the lines (B, lines, H, W) from class logits, and their stripes, 0 or 1."""
    label = paint_stripes(cell, logits.shape[3])
    shares = logits.float().softmax(1)[:, 1:]
    return shares, torch.stack([(label == line + 1).float() for line in range(shares.shape[1])], dim=1)


def overlap_loss(shares: Tensor, stripes: Tensor) -> Tensor:
    """1 - intersection over union of every line with its stripe (B, lines, H, W), mean over the lines that are there.

    Source: Hou et al. 2019 (SAD), after Zhang et al. 2017.
    """
    both = (shares * stripes).sum((2, 3))
    union = (shares + stripes).sum((2, 3)) - both
    there = stripes.sum((2, 3)) > 0
    return ((1 - both / union.clamp(min=1e-6)) * there).sum() / there.sum().clamp(min=1)


def dice_loss(shares: Tensor, stripes: Tensor) -> Tensor:
    """1 - dice coefficient of all lines with their stripes (B, lines, H, W) together, mean over the views.

    Source: Zheng et al. 2021 (RESA), its configuration for CULane.
    """
    both = (shares * stripes).sum((1, 2, 3))
    squares = (shares**2).sum((1, 2, 3)) + (stripes**2).sum((1, 2, 3))
    return (1 - 2 * both / (squares + 2e-3)).mean()
