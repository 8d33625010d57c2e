"""What several of the comparison networks share: padding, convolutions that continue by reflection, first weights."""

import math

import torch.nn.functional as F
from torch import Tensor, nn

MIN_SIDE_PX = 32  # smaller images are continued first: reflection inside the networks needs more pixels than it adds


def pad_to_multiple(image: Tensor, multiple: int) -> Tensor:
    """(N, C, H, W) continued below and right by its edge pixels, to sides that are a multiple and not too short, px."""
    height, width = image.shape[2:]
    least = -(-MIN_SIDE_PX // multiple) * multiple
    bottom = -height % multiple if height >= least else least - height
    right = -width % multiple if width >= least else least - width
    return F.pad(image, (0, right, 0, bottom), mode="replicate")


def reflect_conv(channels_in: int, channels_out: int, kernel: int, groups: int = 1) -> nn.Conv2d:
    """Convolution with an output of the input's size; the border is continued by reflection."""
    return nn.Conv2d(channels_in, channels_out, kernel, padding=kernel // 2, groups=groups, padding_mode="reflect")


def residual_gain(blocks: int) -> float:
    """(8 blocks)^(-1/4): how much smaller first weights are in a network of so many residual blocks.

    Source: Song et al. 2022 and 2023, their way to start a deep residual network.
    """
    return (8 * blocks) ** -0.25


def set_first_weights(module: nn.Module, gain: float) -> None:
    """Xavier's normal weights times `gain`, drawn within -2..2, and zero biases in every convolution of a module."""
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d):
            per_tap = layer.weight.shape[2] * layer.weight.shape[3]
            fans = (layer.weight.shape[0] + layer.weight.shape[1]) * per_tap
            nn.init.trunc_normal_(layer.weight, std=gain * math.sqrt(2 / fans))
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)
