"""DehazeFormer-T: a U-net of shifted-window attention beside depthwise convolution, with rescaled normalisation.

Source: Song, He, Qian and Du, "Vision Transformers for Single Image Dehazing", IEEE TIP 32, 2023, and the T shape that
its authors published. Published: 0.686 M parameters, 6.7 GMACs at 256x256. Counted here: 0.687 M and 6.64 G.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline_lab.rivals.dehazers.common import pad_to_multiple, reflect_conv, residual_gain, set_first_weights
from deckline_lab.train.dehaze_blocks import SKFusion, down, up

MULTIPLE = 4  # two halvings
POSITION_HIDDEN = 256  # width of the network that gives attention its bias by position
NORM_EPS = 1e-5


# The T shape; stages are full, half and quarter size, then half and full again.
CHANNELS = (24, 48, 96, 48, 24)
DEPTHS = (4, 4, 4, 2, 2)  # blocks a stage
ATTENTIVE = (0, 2, 4, 0, 0)  # of them, at the stage's end, that have attention
HEADS = (2, 4, 6, 1, 1)
EXPANSION = (2, 4, 4, 2, 2)  # of the feed-forward parts
WINDOW, KERNEL = 8, 5  # of attention and of the depthwise convolution, px


class RescaleNorm(nn.Module):
    """Normalises over channels and pixels; returns also what brings scale and offset of the input back afterwards."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(1, channels, 1, 1))
        self.bias = nn.Parameter(torch.zeros(1, channels, 1, 1))
        self.rescale, self.rebias = nn.Conv2d(1, channels, 1), nn.Conv2d(1, channels, 1)
        for layer in (self.rescale, self.rebias):
            nn.init.trunc_normal_(layer.weight, std=0.02)
        self.rescale.bias = nn.Parameter(torch.ones(channels))
        self.rebias.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        mean = x.mean((1, 2, 3), keepdim=True)
        centred = x - mean
        std = torch.sqrt((centred * centred).mean((1, 2, 3), keepdim=True) + NORM_EPS)
        return centred / std * self.weight + self.bias, self.rescale(std), self.rebias(mean)


def log_offsets(window: int) -> Tensor:
    """(window^4, 2): sign(d) log(1 + |d|) of the offset in px between every two pixels of a window."""
    axis = torch.arange(window, dtype=torch.float32)
    places = torch.stack(torch.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2)
    offsets = places[:, None] - places[None]
    return (torch.sign(offsets) * torch.log1p(offsets.abs())).reshape(-1, 2)


class WindowAttention(nn.Module):
    """Multi-head attention inside windows; its bias by position comes from a small network of the log offsets."""

    def __init__(self, heads: int, window: int) -> None:
        super().__init__()
        self.heads, self.window = heads, window
        self.register_buffer("offsets", log_offsets(window), persistent=False)
        self.position = nn.Sequential(nn.Linear(2, POSITION_HIDDEN), nn.ReLU(), nn.Linear(POSITION_HIDDEN, heads))

    def forward(self, qkv: Tensor) -> Tensor:
        """(N, 3 C, H, W) with sides that are multiples of the window -> (N, C, H, W)."""
        n, channels, height, width = qkv.shape
        side, heads = self.window, self.heads
        each = channels // 3 // heads
        tiles = qkv.reshape(n, 3, heads, each, height // side, side, width // side, side)
        tokens = tiles.permute(1, 0, 4, 6, 2, 5, 7, 3).reshape(3, -1, heads, side * side, each)
        query, key, value = tokens[0], tokens[1], tokens[2]
        bias = self.position(self.offsets).reshape(side * side, side * side, heads).permute(2, 0, 1)
        weights = torch.softmax(each**-0.5 * query @ key.transpose(-2, -1) + bias, -1)
        out = (weights @ value).reshape(n, height // side, width // side, heads, side, side, each)
        return out.permute(0, 3, 6, 1, 4, 2, 5).reshape(n, channels // 3, height, width)


class Aggregation(nn.Module):
    """A depthwise convolution of the values, plus window attention where `heads` are given; mixed by a 1x1 convolution.

    `kernel`, `window` and the windows' `shift` are in px.
    """

    def __init__(self, channels: int, kernel: int, heads: int | None, window: int, shift: int) -> None:
        super().__init__()
        self.window, self.shift = window, shift
        self.value = nn.Conv2d(channels, channels, 1)
        self.local = reflect_conv(channels, channels, kernel, groups=channels)
        self.mix = nn.Conv2d(channels, channels, 1)
        self.query_key = None if heads is None else nn.Conv2d(channels, 2 * channels, 1)
        self.attention = None if heads is None else WindowAttention(heads, window)

    def forward(self, x: Tensor) -> Tensor:
        value = self.value(x)
        out = self.local(value)
        if self.query_key is not None and self.attention is not None:
            out = out + self._windows(torch.cat([self.query_key(x), value], 1))
        return self.mix(out)

    def _windows(self, qkv: Tensor) -> Tensor:
        """Windows start `shift` px before the image; what lies outside is its reflection, not its other side."""
        height, width = qkv.shape[2:]
        before, side = self.shift, self.window
        bottom, right = -(height + before) % side, -(width + before) % side
        whole = F.pad(qkv, (before, right, before, bottom), mode="reflect")
        return self.attention(whole)[:, :, before : before + height, before : before + width]  # type: ignore[misc]


class Block(nn.Module):
    """Aggregation, normalised and rescaled where it has attention, then a feed-forward part; both residual."""

    def __init__(self, channels: int, aggregation: Aggregation, expansion: int) -> None:
        super().__init__()
        self.norm = RescaleNorm(channels) if aggregation.attention is not None else None
        self.aggregation = aggregation
        hidden = channels * expansion
        self.feed_forward = nn.Sequential(nn.Conv2d(channels, hidden, 1), nn.ReLU(), nn.Conv2d(hidden, channels, 1))
        for part in (self.aggregation, self.feed_forward):
            set_first_weights(part, residual_gain(sum(DEPTHS)))
        if aggregation.query_key is not None:  # attention does not grow with depth: the published start
            set_first_weights(aggregation.query_key, 1.0)

    def forward(self, x: Tensor) -> Tensor:
        if self.norm is None:
            x = x + self.aggregation(x)
        else:
            normed, rescale, rebias = self.norm(x)
            x = x + self.aggregation(normed) * rescale + rebias
        return x + self.feed_forward(x)


def stage(index: int) -> nn.Sequential:
    """The blocks of one stage; every second one shifts its windows by half."""
    blocks = []
    for k in range(DEPTHS[index]):
        heads = HEADS[index] if k >= DEPTHS[index] - ATTENTIVE[index] else None
        aggregation = Aggregation(CHANNELS[index], KERNEL, heads, WINDOW, WINDOW // 2 if k % 2 else 0)
        blocks.append(Block(CHANNELS[index], aggregation, EXPANSION[index]))
    return nn.Sequential(*blocks)


class DehazeFormer(nn.Module):
    """U-net that estimates K and B of the soft reconstruction K I - B + I."""

    def __init__(self, inputs: int = 3, outputs: int = 4) -> None:
        super().__init__()
        full, half, quarter = CHANNELS[:3]
        self.intro = reflect_conv(inputs, full, 3)
        self.encoder_full, self.encoder_half, self.bottom, self.decoder_half, self.decoder_full = (
            stage(index) for index in range(5)
        )
        self.down_half, self.down_quarter = down(full), down(half)
        self.skip_full, self.skip_half = nn.Conv2d(full, full, 1), nn.Conv2d(half, half, 1)
        self.up_half, self.up_full = up(quarter), up(half)
        self.fuse_half, self.fuse_full = SKFusion(half, 8, bias=False), SKFusion(full, 8, bias=False)
        self.outro = reflect_conv(full, outputs, 3)

    def forward(self, image: Tensor) -> Tensor:
        """(N, 3, H, W) RGB in 0..1 to the same shape, not clipped."""
        signed, soft = 2 * image - 1, self.estimate(image)  # the network works on -1..1
        return (soft[:, :1] * signed - soft[:, 1:] + signed + 1) / 2

    def estimate(self, image: Tensor) -> Tensor:
        """What the last convolution gives, K and B (N, 4, H, W)."""
        full = self.encoder_full(self.intro(pad_to_multiple(2 * image - 1, MULTIPLE)))
        half = self.encoder_half(self.down_half(full))
        x = self.up_half(self.bottom(self.down_quarter(half)))
        x = self.up_full(self.decoder_half(self.fuse_half(x, self.skip_half(half)) + x))
        x = self.decoder_full(self.fuse_full(x, self.skip_full(full)) + x)
        return self.outro(x)[:, :, : image.shape[2], : image.shape[3]]
