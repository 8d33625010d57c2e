"""gUNet-T: a U-net of gated depthwise convolutions.

Source: Song, Zhou, Qian and Du, "Rethinking Performance Gains in Image Dehazing Networks", arXiv 2209.11448, 2022, and
the shape that its authors published with it (width 24, 2-2-2-4-2-2-2 blocks, 5x5 kernels).
Published: 0.805 M parameters, 2.60 GMACs at 256x256. Counted here: 0.845 M and 2.76 G, 5 and 6 % more: the
printed figures are not those of the published shape with all its convolutions counted.
The paper freezes BatchNorm's statistics towards the end of training; here they are averaged like the weights.
"""

import torch
from torch import Tensor, nn

from deckline_lab.rivals.dehazers.common import pad_to_multiple, reflect_conv, residual_gain, set_first_weights
from deckline_lab.train.dehaze_blocks import SKFusion, down, up

CHANNELS = 24  # at full size; doubled at every halving
DEPTHS = (2, 2, 2, 4, 2, 2, 2)  # blocks a stage: down, bottom, up; the paper's T
HALVINGS = len(DEPTHS) // 2
MULTIPLE = 2**HALVINGS  # images are padded to a multiple of this, px
KERNEL = 5  # depthwise, px; published


class GatedBlock(nn.Module):
    """BatchNorm, then a depthwise convolution gated by a sigmoid and mixed by a 1x1 convolution; residual."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = nn.BatchNorm2d(channels)
        self.value = nn.Sequential(
            nn.Conv2d(channels, channels, 1), reflect_conv(channels, channels, KERNEL, groups=channels)
        )
        self.gate = nn.Conv2d(channels, channels, 1)
        self.mix = nn.Conv2d(channels, channels, 1)
        set_first_weights(self, residual_gain(sum(DEPTHS)))

    def forward(self, x: Tensor) -> Tensor:
        normed = self.norm(x)
        return x + self.mix(self.value(normed) * torch.sigmoid(self.gate(normed)))


class GUNet(nn.Module):
    """U-net whose skips are fused by selective kernels; what comes out is added to the image."""

    def __init__(self, inputs: int = 3, outputs: int = 3) -> None:
        super().__init__()
        widths = [CHANNELS * 2 ** min(k, 2 * HALVINGS - k) for k in range(len(DEPTHS))]
        falling, rising = widths[:HALVINGS], widths[HALVINGS + 1 :]
        stages = [
            nn.Sequential(*(GatedBlock(width) for _ in range(depth)))
            for width, depth in zip(widths, DEPTHS, strict=True)
        ]
        self.intro = reflect_conv(inputs, CHANNELS, 3)
        self.encoders = nn.ModuleList(stages[:HALVINGS])
        self.downs = nn.ModuleList(down(width) for width in falling)
        self.skips = nn.ModuleList(nn.Conv2d(width, width, 1) for width in falling)
        self.bottom = stages[HALVINGS]
        self.ups = nn.ModuleList(up(2 * width) for width in rising)
        self.fusions = nn.ModuleList(SKFusion(width, 8, bias=False) for width in rising)
        self.decoders = nn.ModuleList(stages[HALVINGS + 1 :])
        self.outro = reflect_conv(CHANNELS, outputs, 3)

    def forward(self, image: Tensor) -> Tensor:
        """(N, 3, H, W) RGB in 0..1 to the same shape, not clipped."""
        return image + self.estimate(image) / 2  # the network works on -1..1

    def estimate(self, image: Tensor) -> Tensor:
        """What the last convolution gives, (N, outputs, H, W)."""
        x = self.intro(2 * pad_to_multiple(image, MULTIPLE) - 1)
        skipped = []
        for encoder, to_half, skip in zip(self.encoders, self.downs, self.skips, strict=True):
            x = encoder(x)
            skipped.append(skip(x))
            x = to_half(x)
        x = self.bottom(x)
        for to_double, fusion, decoder, skip in zip(self.ups, self.fusions, self.decoders, skipped[::-1], strict=True):
            x = decoder(fusion(to_double(x), skip))
        return self.outro(x)[:, :, : image.shape[2], : image.shape[3]]
