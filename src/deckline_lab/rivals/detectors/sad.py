"""SAD: lines painted by a network whose blocks learn to attend to what the next deeper one attends to.

Source: Hou, Ma, Liu and Loy, "Learning Lightweight Lane Detection CNNs by Self Attention Distillation", 2019, whose
network on a plain backbone interpolates class maps of stride 8 to the view. Ours are the region branch (`parts`), the
size of the view and EfficientNet-Lite0 from ImageNet weights; the published ENet is `enet_sad`.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline_lab.rivals.detectors import parts
from deckline_lab.rivals.detectors.parts import MapOutput, map_kind
from deckline_lab.train.backbone import Lite0Backbone, conv_norm
from deckline_lab.train.detect_losses import DetectTargets, Losses, LossWeights, class_weights
from deckline_lab.train.line_networks import LINES, LineNetwork, PyramidConfig

WIDTH = 128  # channels at stride 8, as of ENet
DISTIL_WEIGHT, OVERLAP_WEIGHT = 0.1, 0.1  # published
BACKGROUND_WEIGHT = 0.4  # of the cross-entropy; published
DISTIL_FROM = 2 / 3  # of the training; published as 40 k of 60 k iterations: the maps must mean something first


class SadNetwork(LineNetwork):
    """A network whose output in training holds the features of its blocks E1 to E4."""

    def loss(self, output: Any, targets: DetectTargets, weights: LossWeights, fraction: float) -> Losses:
        total, losses = parts.shared_losses(output, targets, weights)
        label = parts.paint_stripes(targets.cell, output.map.shape[3])
        losses["map"] = F.cross_entropy(
            output.map.float(), label, weight=class_weights(output.map.float(), BACKGROUND_WEIGHT)
        )
        losses["overlap"] = parts.overlap_loss(*parts.lines_and_stripes(output.map, targets.cell))
        total = total + losses["map"] + OVERLAP_WEIGHT * losses["overlap"]
        if fraction >= DISTIL_FROM and output.encoded:
            losses["distil"] = distillation_loss(output.encoded[1:])
            total = total + DISTIL_WEIGHT * losses["distil"]
        return total, {name: float(value.detach()) for name, value in losses.items()}


class Sad(SadNetwork):
    """EfficientNet-Lite0, whose taps at strides 4 to 32 end the blocks E1 to E4; E2 to E4 distil, as published.

    Blocks whose backbone is not trained distil nothing.
    """

    def __init__(self, shape: PyramidConfig) -> None:
        super().__init__()
        self.kind = map_kind(shape.grid.size)
        self.backbone = Lite0Backbone(shape.pretrained, shape.frozen_blocks)
        self.merge = parts.Merge(WIDTH)
        self.map = nn.Sequential(
            conv_norm(WIDTH, WIDTH, 3), nn.ReLU(), nn.Dropout2d(0.1), nn.Conv2d(WIDTH, LINES + 1, 1)
        )
        self.existence = parts.LineExistence(WIDTH, 32, LINES, shape.grid.size)
        self.region = parts.RegionBranch(WIDTH)

    def forward(self, image: Tensor) -> MapOutput:
        taps = self.backbone(image)
        merged = self.merge(taps)
        painted = F.interpolate(self.map(merged), scale_factor=8.0, mode="bilinear", align_corners=False)
        region, box = self.region(merged)
        return MapOutput(painted, self.existence(merged), region, box, tuple(taps) if self.training else ())


def attention(features: Tensor, size: Sequence[int]) -> Tensor:
    """A block's attention map (B, h * w), sum 1: squares summed over channels, resized, softmax over places.

    The squares are relative to their mean over places: the softmax of plain sums puts all on one place, so that the
    loss stays near its largest value (3.7 of 4 measured on EfficientNet-Lite0) and has no gradient.
    Source: Hou et al. 2019, equation of G^2_sum with bilinear resizing and spatial softmax.
    """
    squares = (features.float() ** 2).sum(1, keepdim=True)
    squares = squares / squares.mean((2, 3), keepdim=True).clamp(min=1e-6)
    return F.interpolate(squares, size=size, mode="bilinear", align_corners=False).flatten(1).softmax(1)


def distillation_loss(blocks: tuple[Tensor, ...]) -> Tensor:
    """Squared distance of every block's attention from that of the next deeper one, which gets no gradient."""
    losses = [
        ((attention(shallow, shallow.shape[2:]) - attention(deep, shallow.shape[2:]).detach()) ** 2).sum(1).mean()
        for shallow, deep in pairwise(blocks)
    ]
    return torch.stack(losses).sum()
