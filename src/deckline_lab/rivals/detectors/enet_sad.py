"""ENet that paints the lines and distils its own attention (`sad`).

Sources: Paszke, Chaurasia, Kim and Culurciello, "ENet", 2016; Hou, Ma, Liu and Loy, "Learning Lightweight Lane
Detection CNNs by Self Attention Distillation", 2019. Ours are the region branch (`parts`) and the size of the view.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline_lab.rivals.detectors import parts
from deckline_lab.rivals.detectors.parts import MapOutput, map_kind
from deckline_lab.rivals.detectors.sad import SadNetwork
from deckline_lab.train.backbone import conv_norm
from deckline_lab.train.line_networks import LINES

CONTEXT: tuple[tuple[str, int], ...] = (  # kernels and dilations of the second and of the third stage; published
    ("square", 1), ("square", 2), ("asymmetric", 1), ("square", 4),
    ("square", 1), ("square", 8), ("asymmetric", 1), ("square", 16),
)  # fmt: skip


class EnetSad(SadNetwork):
    """The published network; encoder blocks E1 to E4 are ENet's initial block and stages one to three.

    `size_px` are width and height of the view, which 16 divides.
    """

    def __init__(self, size_px: tuple[int, int], lines: int = LINES) -> None:
        super().__init__()
        self.kind = map_kind(size_px)
        self.initial = InitialBlock()
        self.down1 = Bottleneck(16, 64, "down", dropout=0.01)
        self.stage1 = nn.Sequential(*(Bottleneck(64, 64, "square", dropout=0.01) for _ in range(4)))
        self.down2 = Bottleneck(64, 128, "down")
        self.stage2, self.stage3 = (
            nn.Sequential(*(Bottleneck(128, 128, shape, dilation) for shape, dilation in CONTEXT)) for _ in range(2)
        )
        self.up4 = Unpooling(128, 64)
        self.stage4 = nn.Sequential(*(Bottleneck(64, 64, "square", act=nn.ReLU) for _ in range(2)))
        self.up5 = Unpooling(64, 16)
        self.stage5 = Bottleneck(16, 16, "square", act=nn.ReLU)
        self.map = nn.ConvTranspose2d(16, lines + 1, 3, 2, 1, output_padding=1, bias=False)
        self.existence = parts.LineExistence(128, 32, lines, size_px)
        self.region = parts.RegionBranch(128)

    def forward(self, image: Tensor) -> MapOutput:
        half = self.initial(image)
        quarter = self.stage1(self.down1(half))
        eighth = self.stage2(self.down2(quarter))
        deepest = self.stage3(eighth)
        x = self.stage4(self.up4(deepest, quarter))
        x = self.stage5(self.up5(x, half))
        region, box = self.region(deepest)
        encoded = (half, quarter, eighth, deepest) if self.training else ()
        return MapOutput(self.map(x), self.existence(deepest), region, box, encoded)


class InitialBlock(nn.Module):
    """Stride 2: thirteen convolved channels beside the three pooled ones."""

    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.Conv2d(3, 13, 3, 2, 1, bias=False)
        self.norm = nn.Sequential(nn.BatchNorm2d(16), nn.PReLU(16))

    def forward(self, image: Tensor) -> Tensor:
        return self.norm(torch.cat([self.conv(image), F.max_pool2d(image, 2)], dim=1))


class Bottleneck(nn.Module):
    """A quarter of the channels, one larger convolution, back; added to the input, or to it pooled and padded.

    The decoder's activations (`act`) are ReLU, the encoder's PReLU.
    """

    def __init__(
        self,
        channels_in: int,
        channels_out: int,
        shape: str,  # "square", "asymmetric" or "down"
        dilation: int = 1,
        dropout: float = 0.1,
        act: type[nn.Module] = nn.PReLU,
    ) -> None:
        super().__init__()
        inner = channels_out // 4
        step = 2 if shape == "down" else 1
        self.padded_channels = channels_out - channels_in
        self.step = step
        main = [nn.Conv2d(inner, inner, 3, padding=dilation, dilation=dilation, bias=False)]
        if shape == "asymmetric":
            main = [nn.Conv2d(inner, inner, size, padding="same", bias=False) for size in ((5, 1), (1, 5))]
        self.branch = nn.Sequential(
            nn.Conv2d(channels_in, inner, step, step, bias=False),
            nn.BatchNorm2d(inner),
            _activation(act, inner),
            *main,
            nn.BatchNorm2d(inner),
            _activation(act, inner),
            *conv_norm(inner, channels_out, 1),
            nn.Dropout2d(dropout),
        )
        self.act = _activation(act, channels_out)

    def forward(self, x: Tensor) -> Tensor:
        straight = x
        if self.step == 2:
            straight = F.pad(F.max_pool2d(x, 2), (0, 0, 0, 0, 0, self.padded_channels))
        return self.act(straight + self.branch(x))


class Unpooling(nn.Module):
    """Twice the size: values go back to where the encoder pooled its maxima from; a transposed convolution is added."""

    def __init__(self, channels_in: int, channels_out: int) -> None:
        super().__init__()
        inner = channels_out // 4
        self.straight = conv_norm(channels_in, channels_out, 1)
        self.branch = nn.Sequential(
            *conv_norm(channels_in, inner, 1, relu=True),
            nn.ConvTranspose2d(inner, inner, 3, 2, 1, output_padding=1, bias=False),
            nn.BatchNorm2d(inner),
            nn.ReLU(),
            *conv_norm(inner, channels_out, 1),
            nn.Dropout2d(0.1),
        )

    def forward(self, x: Tensor, pooled_from: Tensor) -> Tensor:
        return F.relu(unpool(self.straight(x), pooled_from) + self.branch(x))


def unpool(x: Tensor, pooled_from: Tensor) -> Tensor:
    """(B, C, h, w) at the places of (B, C, 2h, 2w) whose values are the maxima of their 2x2 blocks, 0 elsewhere.

    Comparing values in place of remembering indices runs in every ONNX runtime; equal maxima all get the value.
    """
    maxima = F.interpolate(F.max_pool2d(pooled_from, 2), scale_factor=2.0, mode="nearest")
    return F.interpolate(x, scale_factor=2.0, mode="nearest") * (pooled_from == maxima)


def _activation(act: type[nn.Module], channels: int) -> nn.Module:
    return nn.PReLU(channels) if act is nn.PReLU else act()
