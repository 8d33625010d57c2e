"""The dehazing network: hazy image in, K and B of the soft reconstruction, clear image out.

`unshuffle` 1 is the paper's network at full resolution. With 4 the network sees the image through a pixel-unshuffle,
estimates K and B on that coarse grid, and a fast guided filter brings them up along the image's own edges.

Source: Li et al. 2024, section 3.1.
"""

from dataclasses import dataclass, replace
from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline.checks import check_choice, check_numbers
from deckline_lab.train import dehaze_blocks as blocks
from deckline_lab.train.dehaze_blocks import SKFusion, down, up

STAGE_MULTIPLE = 8  # two halvings, then patches of 2x2
# Image px between the keys of the plain transformer: attention of all pixels to all would be quadratic in their number.
KEY_STRIDE_PX = 16
LUMA = (0.299, 0.587, 0.114)  # ITU-R BT.601
Attention = Literal["mix", "depthwise"]
Transformer = Literal["mobilevit", "plain"]


@dataclass(frozen=True)
class DehazeNetworkConfig:
    """Shape of the network; stages are full, half and quarter size, then half and full again."""

    channels: int = 24  # C; doubled at every halving
    depths: tuple[int, int, int, int, int] = (2, 2, 1, 2, 1)  # MixAttention blocks a stage
    vit_layers: tuple[int, int, int] = (1, 2, 2)  # linear transformers in each encoder stage and the bottleneck
    spatial_kernel: int = 5  # depthwise kernel of the spatial attention, px
    expansion: int = 2  # of the feed-forward parts
    unshuffle: int = 4  # image px per pixel of the coarse grid; 1 is the paper's full resolution
    guide_radius: int = 1  # of the guided filter's window, coarse px
    prior: bool = False  # starts from a second picture, where geometry has removed haze already; coarse grids only
    attention: Attention = "mix"  # or depthwise-separable convolutions in its place: the paper's Table 5
    transformer: Transformer = "mobilevit"  # or conventional transformers in its place: the paper's Table 5

    def __post_init__(self) -> None:
        check_numbers(self, "", "channels", "unshuffle", "guide_radius", least=1)
        if self.prior and self.unshuffle == 1:
            raise ValueError("prior needs a coarse grid: unshuffle above 1")
        if len(self.depths) != 5 or len(self.vit_layers) != 3:
            raise ValueError(f"need 5 depths and 3 vit_layers, got {self.depths} and {self.vit_layers}")
        if self.spatial_kernel % 2 == 0:
            raise ValueError(f"spatial_kernel must be odd, got {self.spatial_kernel}")
        check_choice("attention", self.attention, Attention)
        check_choice("transformer", self.transformer, Transformer)

    @property
    def multiple(self) -> int:
        """The image is padded to a multiple of this, px."""
        least = 4 * self.key_pool if self.transformer == "plain" else 1
        return max(STAGE_MULTIPLE, least) * self.unshuffle

    @property
    def key_pool(self) -> int:
        """Pixels of the quarter-size stage, along each side, whose mean is one key of the plain transformer."""
        return max(1, KEY_STRIDE_PX // (4 * self.unshuffle))


_T = DehazeNetworkConfig()
_S, _B = replace(_T, channels=32, depths=(2, 2, 1, 2, 2)), replace(_T, channels=44, depths=(2, 2, 1, 2, 2))
SHAPES = {
    "coarse-t": _T,
    "coarse-s": _S,
    "coarse-b": _B,
    "full-t": replace(_T, unshuffle=1),
    "full-s": replace(_S, unshuffle=1),
    "full-b": replace(_B, unshuffle=1),
}


class DehazeNetwork(nn.Module):
    """Soft reconstruction of a clear image from a hazy one."""

    def __init__(self, config: DehazeNetworkConfig) -> None:
        super().__init__()
        self.config = config
        c = config.channels
        mix, vit = _attention_stages(config), _transformer_stages(config)
        self.intro = nn.Conv2d(3 * config.unshuffle**2 + 3 * config.prior, c, 3, padding=1)
        self.encoder_full = nn.Sequential(mix[0], vit[0])
        self.down_half = down(c)
        self.encoder_half = nn.Sequential(mix[1], vit[1])
        self.down_quarter = down(2 * c)
        self.bottleneck = nn.Sequential(mix[2], vit[2])
        self.up_half, self.fuse_half, self.decoder_half = up(4 * c), SKFusion(2 * c), mix[3]
        self.up_full, self.fuse_full, self.decoder_full = up(2 * c), SKFusion(c), mix[4]
        last = nn.Conv2d(c, 4, 3, padding=1)
        nn.init.zeros_(last.weight)  # an untrained network returns its input
        last.bias = nn.Parameter(torch.zeros(4))
        self.head = nn.Sequential(blocks.ChannelNorm(c), last)
        self.log_guide_eps = nn.Parameter(torch.tensor(-7.0))  # of the guided filter, image range 0..1; learned

    def forward(self, image: Tensor, working: Tensor | None = None) -> Tensor:
        """Remove haze: (B, 3, H, W), not clipped to 0..1.

        Args:
            image: (B, 3, H, W) RGB in 0..1: what K and B are applied to. The hazy picture, or with `prior` what
                geometry made of it.
            working: (B, 3, h, w) the same picture averaged down by a whole factor H / h = W / w, on which K and B
                are estimated (coarse networks only); None estimates them on `image` itself. With `prior` it is
                needed, (B, 6, h, w): the hazy picture, then the other one.
        """
        if self.config.prior and working is None:
            raise ValueError("a network with a prior needs the working pictures: the hazy one, then the prior")
        source = image if working is None else working
        if self.config.unshuffle == 1:
            if working is not None:
                raise ValueError("a network with unshuffle = 1 estimates at full resolution: give no working image")
            soft = self._estimate(source)[:, :, : image.shape[2], : image.shape[3]]
        else:
            soft = self._coarse(image, source)
        return soft[:, :1] * image - soft[:, 1:] + image

    def _estimate(self, image: Tensor) -> Tensor:
        """K and B (B, 4, h, w) on the grid of the padded image's unshuffled pixels."""
        whole, unshuffle = self._pad(image), self.config.unshuffle
        x = F.pixel_unshuffle(whole[:, :3], unshuffle) - 0.5
        if self.config.prior:
            x = torch.cat([x, F.avg_pool2d(whole[:, 3:], unshuffle) - 0.5], 1)
        full = self.encoder_full(self.intro(x))
        half = self.encoder_half(self.down_half(full))
        x = self.bottleneck(self.down_quarter(half))
        x = self.decoder_half(self.fuse_half(self.up_half(x), half))
        x = self.decoder_full(self.fuse_full(self.up_full(x), full))
        return self.head(x)

    def _pad(self, image: Tensor) -> Tensor:
        multiple = self.config.multiple
        bottom, right = -image.shape[2] % multiple, -image.shape[3] % multiple
        return F.pad(image, (0, right, 0, bottom), mode="reflect")

    def _coarse(self, image: Tensor, working: Tensor) -> Tensor:
        """K and B (B, 4, H, W), brought up from the coarse grid along the edges of `image`'s luma."""
        unshuffle, eps = self.config.unshuffle, torch.exp(self.log_guide_eps)
        guide = F.avg_pool2d(luma(self._pad(working[:, -3:])), unshuffle)
        return upsample_soft(self._estimate(working), guide, image, working, unshuffle, eps, self.config.guide_radius)


def _attention_stages(config: DehazeNetworkConfig) -> list[nn.Module]:
    block = blocks.MixAttention if config.attention == "mix" else blocks.DepthwiseSeparable
    return [
        nn.Sequential(*(block(config.channels * wider, config.spatial_kernel, config.expansion) for _ in range(depth)))
        for wider, depth in zip((1, 2, 4, 2, 1), config.depths, strict=True)
    ]


def _transformer_stages(config: DehazeNetworkConfig) -> list[nn.Module]:
    """Of the encoder's two stages and the bottleneck; a head of the plain transformer is `channels` wide."""
    stages: list[nn.Module] = []
    for wider, layers in zip((1, 2, 4), config.vit_layers, strict=True):
        width = config.channels * wider
        if config.transformer == "mobilevit":
            stages.append(blocks.MobileViTv3(width, layers, config.expansion))
        else:
            pool = config.key_pool * 4 // wider
            plain = (blocks.plain_transformer(width, wider, pool, config.expansion) for _ in range(layers))
            stages.append(nn.Sequential(*plain))
    return stages


def luma(image: Tensor) -> Tensor:
    """(B, 1, H, W) of RGB."""
    r, g, b = LUMA
    return r * image[:, 0:1] + g * image[:, 1:2] + b * image[:, 2:3]


def upsample_soft(
    soft: Tensor, guide: Tensor, image: Tensor, working: Tensor, unshuffle: int, eps: Tensor, radius: int
) -> Tensor:
    """K and B (B, 4, H, W) from the coarse grid along the edges of the image's luma.

    Source: fast guided filter (He and Sun 2015): K and B are linear in the guide within a window.

    Args:
        soft: (B, 4, h', w') K and B on the coarse grid, which may reach beyond the picture at the right and below.
        guide: (B, 1, h', w') luma's mean in every cell.
        image: (B, 3, H, W) the picture at full size.
        working: (B, C, h, w) the picture averaged down by H / h, whose blocks of `unshuffle` px are the cells.
        eps, radius: see linear_in_guide.
    """
    slope, offset = linear_in_guide(soft, guide, eps, radius)
    rows, columns = -(-working.shape[2] // unshuffle), -(-working.shape[3] // unshuffle)
    factor = image.shape[2] // working.shape[2] * unshuffle
    models = torch.cat([slope, offset], 1)[:, :, :rows, :columns]
    models = F.interpolate(models, (rows * factor, columns * factor), mode="bilinear", align_corners=False)
    # A copy at full size is slow; exported networks get images that need none (see export_dehaze).
    if models.shape[2] != image.shape[2] or models.shape[3] != image.shape[3]:
        models = models[:, :, : image.shape[2], : image.shape[3]]
    return models[:, :4] * luma(image) + models[:, 4:]


def linear_in_guide(values: Tensor, guide: Tensor, eps: Tensor, radius: int) -> tuple[Tensor, Tensor]:
    """Slope and offset (B, C, h, w each) of the local least-squares fit values = slope * guide + offset.

    Args:
        values: (B, C, h, w).
        guide: (B, 1, h, w).
        eps: ridge on the guide's variance.
        radius: of the square window, px.
    """

    def box(x: Tensor) -> Tensor:
        # Windows are cut at the border: the mean is over the pixels that exist.
        return F.avg_pool2d(x, 2 * radius + 1, stride=1, padding=radius, count_include_pad=False)

    mean_guide, mean_values = box(guide), box(values)
    variance = box(guide * guide) - mean_guide * mean_guide
    slope = (box(guide * values) - mean_guide * mean_values) / (variance.clamp(min=0) + eps)
    return box(slope), box(mean_values - slope * mean_guide)
