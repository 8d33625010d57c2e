"""ResNet-18 and -34, tapped at strides 8, 16 and 32, from random weights.

Source: He, Zhang, Ren and Sun, "Deep Residual Learning for Image Recognition", 2016.
"""

import torch.nn.functional as F
from torch import Tensor, nn

WIDTHS = (64, 128, 256, 512)  # channels of the four stages
BLOCKS = {18: (2, 2, 2, 2), 34: (3, 4, 6, 3)}  # residual blocks of the four stages, by layers


class ResNet(nn.Module):
    """(B, 3, H, W) -> features of stages two to four: 128, 256, 512 channels at strides 8, 16, 32.

    Args:
        layers: 18 or 34.
        stages: how many of the four are built.
        dilated: the third and fourth stage keep stride 8 and dilate their kernels instead.
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
