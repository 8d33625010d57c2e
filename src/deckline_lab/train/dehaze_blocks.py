"""Blocks of the dehazing network, Li et al. 2024, section 3.1. Features are (B, C, H, W).

`DepthwiseSeparable` and `plain_transformer` are the conventional blocks that the paper's ablation starts from.
"""

from collections.abc import Callable
from functools import partial

import torch
import torch.nn.functional as F
from torch import Tensor, nn

PATCH = 2  # MobileViTv3 unfolds into patches of 2x2 px


class ChannelNorm(nn.Module):
    """LayerNorm over the channels of every pixel."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(channels)

    def forward(self, x: Tensor) -> Tensor:
        # Channels-last memory makes both permutations free views.
        return self.norm(x.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)


def feed_forward(channels: int, expansion: int) -> nn.Sequential:
    """LayerNorm, 1x1 expand, GELU, 1x1 reduce; its input is added outside."""
    hidden = channels * expansion
    widen, narrow = nn.Conv2d(channels, hidden, 1), nn.Conv2d(hidden, channels, 1)
    return nn.Sequential(ChannelNorm(channels), widen, nn.GELU(), narrow)


def depthwise(channels: int, kernel: int) -> nn.Conv2d:
    return nn.Conv2d(channels, channels, kernel, padding=kernel // 2, groups=channels)


class SimpleSpatialAttention(nn.Module):
    """SPA: sigmoid(1x1 conv) gates a depthwise convolution; no reshape."""

    def __init__(self, channels: int, kernel: int) -> None:
        super().__init__()
        self.gate = nn.Conv2d(channels, channels, 1)
        self.value = depthwise(channels, kernel)

    def forward(self, x: Tensor) -> Tensor:
        return torch.sigmoid(self.gate(x)) * self.value(x)


class SimpleChannelAttention(nn.Module):
    """SCA: sigmoid(1x1 conv of the global mean) gates the channels."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.gate = nn.Conv2d(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        return torch.sigmoid(self.gate(x.mean((2, 3), keepdim=True))) * x


class MixAttention(nn.Module):
    """SPA and SCA in parallel, fused by a 1x1 convolution, then a feed-forward part; both residual."""

    def __init__(self, channels: int, kernel: int, expansion: int) -> None:
        super().__init__()
        self.project = nn.Sequential(
            ChannelNorm(channels), nn.Conv2d(channels, channels, 1), depthwise(channels, 3), nn.GELU()
        )
        self.spatial = SimpleSpatialAttention(channels, kernel)
        self.channel = SimpleChannelAttention(channels)
        self.fuse = nn.Conv2d(2 * channels, channels, 1)
        self.feed_forward = feed_forward(channels, expansion)

    def forward(self, x: Tensor) -> Tensor:
        projected = self.project(x)
        x = x + self.fuse(torch.cat([self.spatial(projected), self.channel(projected)], 1))
        return x + self.feed_forward(x)


class DepthwiseSeparable(nn.Module):
    """Two depthwise-separable convolutions, then a feed-forward part; both residual. In place of MixAttention.

    Its feed-forward part is wider by one, which makes up for the 1x1 maps that MixAttention has and this has not.
    """

    def __init__(self, channels: int, kernel: int, expansion: int) -> None:
        super().__init__()
        self.convolve = nn.Sequential(
            ChannelNorm(channels),
            depthwise(channels, 3),
            nn.Conv2d(channels, channels, 1),
            nn.GELU(),
            depthwise(channels, kernel),
            nn.Conv2d(channels, channels, 1),
        )
        self.feed_forward = feed_forward(channels, expansion + 1)

    def forward(self, x: Tensor) -> Tensor:
        x = x + self.convolve(x)
        return x + self.feed_forward(x)


class SeparableSelfAttention(nn.Module):
    """Self-attention of linear cost over the tokens of (B, C, P, N): N tokens for each of P pixels of a patch.

    Source: Mehta and Rastegari 2022 (MobileViTv2).
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channels = channels
        self.maps = nn.Conv2d(channels, 1 + 2 * channels, 1)
        self.out = nn.Conv2d(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        scores, key, value = self.maps(x).split([1, self.channels, self.channels], 1)
        context = (torch.softmax(scores, -1) * key).sum(-1, keepdim=True)
        return self.out(context * F.relu(value))


class TransformerLayer(nn.Module):
    """LayerNorm, self-attention, feed-forward; both residual."""

    def __init__(self, channels: int, build_attention: Callable[[], nn.Module], expansion: int) -> None:
        super().__init__()
        self.norm = ChannelNorm(channels)
        self.attention = build_attention()
        self.feed_forward = feed_forward(channels, expansion)

    def forward(self, x: Tensor) -> Tensor:
        x = x + self.attention(self.norm(x))
        return x + self.feed_forward(x)


def unfold(x: Tensor) -> Tensor:
    """(B, C, H, W) with even H, W -> (B, C, 4, H W / 4): which pixel of its 2x2 patch, which patch."""
    b, c, h, w = x.shape
    patches = x.reshape(b, c, h // PATCH, PATCH, w // PATCH, PATCH).permute(0, 1, 3, 5, 2, 4)
    return patches.reshape(b, c, PATCH * PATCH, (h // PATCH) * (w // PATCH))


def fold(tokens: Tensor, height: int, width: int) -> Tensor:
    """Inverse of `unfold`."""
    b, c = tokens.shape[:2]
    patches = tokens.reshape(b, c, PATCH, PATCH, height // PATCH, width // PATCH).permute(0, 1, 4, 2, 5, 3)
    return patches.reshape(b, c, height, width)


class MobileViTv3(nn.Module):
    """Local convolution and a global transformer over 2x2 patches, fused by a 1x1 convolution, plus the input.

    Source: Wadekar and Chaurasia 2022.
    """

    def __init__(self, channels: int, layers: int, expansion: int) -> None:
        super().__init__()
        self.local = nn.Sequential(depthwise(channels, 3), nn.Conv2d(channels, channels, 1))
        attention = partial(SeparableSelfAttention, channels)
        self.transformer = nn.Sequential(*(TransformerLayer(channels, attention, expansion) for _ in range(layers)))
        self.project = nn.Conv2d(channels, channels, 1)
        self.fuse = nn.Conv2d(2 * channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        local = self.local(x)
        tokens = self.transformer(unfold(local))
        spread = self.project(fold(tokens, x.shape[2], x.shape[3]))
        return self.fuse(torch.cat([local, spread], 1)) + x


class PooledSelfAttention(nn.Module):
    """Multi-head softmax attention of every pixel to the means of `pool` x `pool` px; 1 is full self-attention.

    Sides must be multiples of `pool`. Positions are not encoded: the convolutions before encode them (CvT).

    Source: Vaswani et al. 2017; pooled keys: Wang et al. 2022 (PVT v2); positions: Wu et al. 2021 (CvT).
    """

    def __init__(self, channels: int, heads: int, pool: int) -> None:
        super().__init__()
        self.heads, self.pool = heads, pool
        # A bias of the keys would move all scores of a query alike, one of the values only the output's own.
        self.query = nn.Conv2d(channels, channels, 1)
        self.key_value = nn.Conv2d(channels, 2 * channels, 1, bias=False)
        self.out = nn.Conv2d(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        b, c, h, w = x.shape
        pooled = F.avg_pool2d(x, self.pool) if self.pool > 1 else x
        key, value = self.key_value(pooled).split(c, 1)
        query, key, value = (
            tokens.reshape(b, self.heads, c // self.heads, -1).transpose(2, 3) for tokens in (self.query(x), key, value)
        )
        mixed = F.scaled_dot_product_attention(query, key, value)
        return self.out(mixed.transpose(2, 3).reshape(b, c, h, w))


def plain_transformer(channels: int, heads: int, pool: int, expansion: int) -> TransformerLayer:
    """A layer of conventional self-attention; the ablation uses it in place of MobileViTv3.

    Its feed-forward part is wider by one, which makes up for MobileViTv3's local and fusing convolutions.
    """
    return TransformerLayer(channels, partial(PooledSelfAttention, channels, heads, pool), expansion + 1)


class SKFusion(nn.Module):
    """Selective-kernel sum of two branches: softmax weights per channel from their pooled sum."""

    def __init__(self, channels: int, reduction: int = 4, bias: bool = True) -> None:
        super().__init__()
        self.channels = channels
        hidden = max(channels // reduction, 4)
        self.weights = nn.Sequential(
            nn.Conv2d(channels, hidden, 1, bias=bias), nn.ReLU(), nn.Conv2d(hidden, 2 * channels, 1, bias=bias)
        )

    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        logits = self.weights((a + b).mean((2, 3), keepdim=True))
        # The softmax over two branches is a sigmoid of the difference of their logits.
        share = torch.sigmoid(logits[:, : self.channels] - logits[:, self.channels :])
        return share * a + (1 - share) * b


def down(channels: int) -> nn.Conv2d:
    """Half the size, twice the channels."""
    return nn.Conv2d(channels, 2 * channels, 2, stride=2)


def up(channels: int) -> nn.Sequential:
    """Twice the size, half the channels."""
    return nn.Sequential(nn.Conv2d(channels, 2 * channels, 1), nn.PixelShuffle(2))
