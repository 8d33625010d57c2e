"""What several of the compared networks share: the region branch, and ResNet from random weights."""

import torch.nn.functional as F
from torch import Tensor, nn

from deckline.train.backbone import conv_norm, separable
from deckline.train.line_networks import RegionHead

REGION_WIDTH = 64  # channels, as in our own networks
WIDTHS = (64, 128, 256, 512)  # channels of the four stages
BLOCKS = {18: (2, 2, 2, 2), 34: (3, 4, 6, 3)}  # residual blocks of the four stages, by layers


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


class ResNet(nn.Module):
    """ResNet-18 or -34: (B, 3, H, W) -> features of stages two to four, 128, 256, 512 channels at strides 8, 16, 32.

    Args:
        layers: 18 or 34.
        stages: how many of the four are built.
        dilated: the third and fourth stage keep stride 8 and dilate their kernels instead.

    Source: He, Zhang, Ren and Sun, "Deep Residual Learning for Image Recognition", 2016.
    """

    def __init__(self, layers: int = 18, stages: int = 4, dilated: bool = False) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            nn.Conv2d(3, 64, 7, 2, 3, bias=False), nn.BatchNorm2d(64), nn.ReLU(), nn.MaxPool2d(3, 2, 1)
        )
        self.stages = nn.ModuleList()
        channels = WIDTHS[0]
        for index in range(stages):
            stride = 1 if index == 0 or (dilated and index >= 2) else 2
            dilation = 2 ** (index - 1) if dilated and index >= 2 else 1
            blocks = [_Block(channels, WIDTHS[index], stride, dilation)]
            blocks += [_Block(WIDTHS[index], WIDTHS[index], 1, dilation) for _ in range(BLOCKS[layers][index] - 1)]
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


class _Block(nn.Module):
    """Two 3x3 convolutions added to their input, which a 1x1 convolution brings to the same shape where it differs."""

    def __init__(self, channels_in: int, channels_out: int, stride: int, dilation: int) -> None:
        super().__init__()
        self.first = nn.Sequential(
            nn.Conv2d(channels_in, channels_out, 3, stride, dilation, dilation, bias=False),
            nn.BatchNorm2d(channels_out),
            nn.ReLU(),
        )
        self.second = nn.Sequential(
            nn.Conv2d(channels_out, channels_out, 3, 1, dilation, dilation, bias=False), nn.BatchNorm2d(channels_out)
        )
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or channels_in != channels_out:
            self.shortcut = nn.Sequential(
                nn.Conv2d(channels_in, channels_out, 1, stride, bias=False), nn.BatchNorm2d(channels_out)
            )

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(self.second(self.first(x)) + self.shortcut(x))
