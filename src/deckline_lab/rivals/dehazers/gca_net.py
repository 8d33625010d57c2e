"""GCANet: smoothed dilated convolutions at half size, and a gate that weighs what three depths have seen.

Source: Chen, He, Fan, Liao, Zhang, Hou, Yuan and Hua, "Gated Context Aggregation Network for Image Dehazing and
Deraining", WACV 2019; smoothing from Wang and Ji, "Smoothed Dilated Convolutions", KDD 2018.
Published: 0.702 M parameters, 18.4 GMACs at 256x256. Counted here: 0.703 M and 15.6 G. The published count charges the
transposed convolution's 65,536 weights at every pixel of its output; each output pixel uses a quarter of them. Counted
that way this network has 18.8 GMACs.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline_lab.rivals.dehazers.common import pad_to_multiple

MULTIPLE = 2  # one halving
CHANNELS = 64  # published
DILATIONS = (2, 2, 2, 4, 4, 4, 1)  # of the residual blocks at half size, px; published
MIDDLE = 4  # blocks after which the gate reads the features, besides before the first and after the last; published


class SharedSmoothing(nn.Module):
    """One k x k filter, the same for every channel, before a dilated convolution: neighbours then meet again.

    It starts as the identity. Source: Wang and Ji 2018, separable and shared convolution.
    """

    def __init__(self, channels: int, kernel: int) -> None:
        super().__init__()
        self.channels, self.kernel = channels, kernel
        weight = torch.zeros(1, 1, kernel, kernel)
        weight[0, 0, kernel // 2, kernel // 2] = 1
        self.weight = nn.Parameter(weight)

    def forward(self, x: Tensor) -> Tensor:
        weight = self.weight.repeat(self.channels, 1, 1, 1)
        return F.conv2d(x, weight, padding=self.kernel // 2, groups=self.channels)


class SmoothDilatedBlock(nn.Module):
    """Two dilated convolutions, each smoothed before and normalised after; residual."""

    def __init__(self, channels: int, dilation: int) -> None:
        super().__init__()

        def half() -> list[nn.Module]:
            smoothing = [SharedSmoothing(channels, 2 * dilation - 1)] if dilation > 1 else []
            dilated = nn.Conv2d(channels, channels, 3, padding=dilation, dilation=dilation, bias=False)
            return [*smoothing, dilated, nn.InstanceNorm2d(channels, affine=True)]

        self.body = nn.Sequential(*half(), nn.ReLU(), *half())

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.body(x))


def edges(image: Tensor) -> Tensor:
    """(N, 1, H, W): absolute differences to the four neighbours, averaged over them and colours; 0 to the outside."""
    across = (image[:, :, :, 1:] - image[:, :, :, :-1]).abs().mean(1, keepdim=True)
    down = (image[:, :, 1:] - image[:, :, :-1]).abs().mean(1, keepdim=True)
    total = F.pad(across, (1, 0)) + F.pad(across, (0, 1)) + F.pad(down, (0, 0, 1, 0)) + F.pad(down, (0, 0, 0, 1))
    return total / 4


class GcaNet(nn.Module):
    """Encoder to half size, residual blocks, gated sum, decoder to what is added to the image."""

    def __init__(self, inputs: int = 3, outputs: int = 3) -> None:
        super().__init__()
        c = CHANNELS

        def normed(conv: nn.Module) -> nn.Sequential:
            return nn.Sequential(conv, nn.InstanceNorm2d(c, affine=True), nn.ReLU())

        shapes = ((inputs + 1, 1), (c, 1), (c, 2))  # channels and stride
        self.encoder = nn.Sequential(*(normed(nn.Conv2d(n, c, 3, stride, 1, bias=False)) for n, stride in shapes))
        blocks = [SmoothDilatedBlock(c, dilation) for dilation in DILATIONS]
        self.first_blocks, self.last_blocks = nn.Sequential(*blocks[:MIDDLE]), nn.Sequential(*blocks[MIDDLE:])
        self.gate = nn.Conv2d(3 * c, 3, 3, padding=1)
        self.decoder = nn.Sequential(
            normed(nn.ConvTranspose2d(c, c, 4, stride=2, padding=1)),
            normed(nn.Conv2d(c, c, 3, padding=1)),
            nn.Conv2d(c, outputs, 1),
        )

    def forward(self, image: Tensor) -> Tensor:
        """(N, 3, H, W) RGB in 0..1 to the same shape, not clipped."""
        return image + self.estimate(image)

    def estimate(self, image: Tensor) -> Tensor:
        """What the last convolution gives, (N, outputs, H, W)."""
        whole = pad_to_multiple(image, MULTIPLE)
        shallow = self.encoder(torch.cat([whole - 0.5, edges(whole)], 1))
        middle = self.first_blocks(shallow)
        deep = self.last_blocks(middle)
        weights = self.gate(torch.cat([shallow, middle, deep], 1))
        gated = weights[:, 0:1] * shallow + weights[:, 1:2] * middle + weights[:, 2:3] * deep
        return self.decoder(gated)[:, :, : image.shape[2], : image.shape[3]]
