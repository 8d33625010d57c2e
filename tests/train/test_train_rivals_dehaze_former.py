"""DehazeFormer: rescaled normalisation, attention in windows against torch's own, shifts, soft reconstruction."""

import math

import pytest
import torch
import torch.nn.functional as F

from deckline.train.rivals import DehazeFormer
from deckline.train.rivals.dehaze_former import (
    Aggregation,
    DehazeFormerConfig,
    RescaleNorm,
    WindowAttention,
    log_offsets,
    stage,
)

SMALL = DehazeFormerConfig(
    channels=(4, 8, 16, 8, 4), depths=(1, 1, 1, 1, 1), attentive=(0, 1, 1, 0, 0), heads=(1, 2, 2, 1, 1), window=4
)


def test_norm_takes_scale_and_offset_out_and_hands_them_back() -> None:
    norm, x = RescaleNorm(4), 3 + 5 * torch.randn(2, 4, 6, 7)
    for layer in (norm.rescale, norm.rebias):  # let both be the identity of the statistics
        layer.weight.data.fill_(1.0)
        layer.bias.data.zero_()
    with torch.no_grad():
        normed, rescale, rebias = norm(x)
    torch.testing.assert_close(normed.mean((1, 2, 3)), torch.zeros(2), atol=1e-5, rtol=0)
    torch.testing.assert_close(normed.std((1, 2, 3), correction=0), torch.ones(2), atol=1e-4, rtol=0)
    torch.testing.assert_close(normed * rescale + rebias, x, atol=1e-4, rtol=1e-4)


def test_log_offsets() -> None:
    offsets = log_offsets(3).reshape(9, 9, 2)
    torch.testing.assert_close(offsets[0, 8], torch.tensor([-math.log(3), -math.log(3)]))  # two px up and left
    torch.testing.assert_close(offsets[5, 3], torch.tensor([0.0, math.log(3)]))
    torch.testing.assert_close(offsets, -offsets.transpose(0, 1))


def test_attention_is_torchs_own_in_every_window() -> None:
    torch.manual_seed(0)
    attention, qkv = WindowAttention(2, 4), torch.randn(2, 18, 8, 12)
    with torch.no_grad():
        out = attention(qkv)
        bias = attention.position(attention.offsets).T.reshape(2, 16, 16)
        for top, left in [(0, 0), (4, 8)]:
            tile = qkv[:, :, top : top + 4, left : left + 4].reshape(2, 3, 2, 3, 16).permute(1, 0, 2, 4, 3)
            expected = F.scaled_dot_product_attention(tile[0], tile[1], tile[2], attn_mask=bias)
            expected = expected.transpose(2, 3).reshape(2, 6, 4, 4)
            torch.testing.assert_close(out[:, :, top : top + 4, left : left + 4], expected, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("shift", [0, 2])
def test_windows_see_themselves_alone(shift: int) -> None:
    """A change in pixel (5, 5) reaches the window around it: rows and columns 4..7, or 2..5 when shifted by 2."""
    torch.manual_seed(0)
    layer, x = Aggregation(4, 3, 2, 4, shift), torch.randn(1, 12, 16, 12)
    touched = x.clone()
    touched[:, :, 5, 5] += 1
    with torch.no_grad():
        changed = (layer._windows(touched) - layer._windows(x)).abs().sum((0, 1)) > 1e-6
    expected = torch.zeros(16, 12, dtype=torch.bool)
    first = 2 if shift else 4
    expected[first : first + 4, first : first + 4] = True
    torch.testing.assert_close(changed, expected)


def test_second_blocks_shift_and_last_ones_attend() -> None:
    config = DehazeFormerConfig()
    assert [block.aggregation.shift for block in stage(config, 1)] == [0, 4, 0, 4]
    attentive = [[block.norm is not None for block in stage(config, index)] for index in range(5)]
    assert attentive == [[False] * 4, [False, False, True, True], [True] * 4, [False] * 2, [False] * 2]


def test_soft_reconstruction_on_minus_one_to_one() -> None:
    """With K and B held by the last bias: on -1..1 the output is K I - B + I."""
    model = DehazeFormer(SMALL)
    model.outro.weight.data.zero_()
    model.outro.bias.data = torch.tensor([0.5, 0.1, 0.2, 0.3])
    image = torch.rand(1, 3, 37, 45)
    with torch.no_grad():
        expected = 1.5 * (2 * image - 1) - torch.tensor([0.1, 0.2, 0.3]).reshape(1, 3, 1, 1)
        torch.testing.assert_close(2 * model(image) - 1, expected, atol=1e-5, rtol=0)
