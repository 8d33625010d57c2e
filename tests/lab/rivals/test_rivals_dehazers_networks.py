"""The compared dehazers one by one: their blocks against formulas, what they start from, what they add."""

import math
from collections.abc import Callable

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline_lab.rivals.dehazers import dehaze_former, grid_dehaze_net
from deckline_lab.rivals.dehazers.aod_net import AodNet
from deckline_lab.rivals.dehazers.common import residual_gain, set_first_weights
from deckline_lab.rivals.dehazers.g_unet import GatedBlock, GUNet
from deckline_lab.rivals.dehazers.gca_net import SharedSmoothing, edges


def test_first_weights_have_the_papers_spread() -> None:
    torch.manual_seed(0)
    layer = nn.Sequential(nn.Conv2d(64, 64, 3))
    set_first_weights(layer, residual_gain(16))
    spread = (8 * 16) ** -0.25 * math.sqrt(2 / (64 * 9 + 64 * 9))
    assert layer[0].weight.std().item() == pytest.approx(spread, rel=0.02)
    assert layer[0].bias.abs().max() == 0


def test_norm_takes_scale_and_offset_out_and_hands_them_back() -> None:
    norm, x = dehaze_former.RescaleNorm(4), 3 + 5 * torch.randn(2, 4, 6, 7)
    for layer in (norm.rescale, norm.rebias):  # let both be the identity of the statistics
        layer.weight.data.fill_(1.0)
        layer.bias.data.zero_()
    with torch.no_grad():
        normed, rescale, rebias = norm(x)
    torch.testing.assert_close(normed.mean((1, 2, 3)), torch.zeros(2), atol=1e-5, rtol=0)
    torch.testing.assert_close(normed.std((1, 2, 3), correction=0), torch.ones(2), atol=1e-4, rtol=0)
    torch.testing.assert_close(normed * rescale + rebias, x, atol=1e-4, rtol=1e-4)


def test_log_offsets() -> None:
    offsets = dehaze_former.log_offsets(3).reshape(9, 9, 2)
    torch.testing.assert_close(offsets[0, 8], torch.tensor([-math.log(3), -math.log(3)]))  # two px up and left
    torch.testing.assert_close(offsets[5, 3], torch.tensor([0.0, math.log(3)]))
    torch.testing.assert_close(offsets, -offsets.transpose(0, 1))


def test_attention_is_torchs_own_in_every_window() -> None:
    torch.manual_seed(0)
    attention, qkv = dehaze_former.WindowAttention(2, 4), torch.randn(2, 18, 8, 12)
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
    layer, x = dehaze_former.Aggregation(4, 3, 2, 4, shift), torch.randn(1, 12, 16, 12)
    touched = x.clone()
    touched[:, :, 5, 5] += 1
    with torch.no_grad():
        changed = (layer._windows(touched) - layer._windows(x)).abs().sum((0, 1)) > 1e-6
    expected = torch.zeros(16, 12, dtype=torch.bool)
    first = 2 if shift else 4
    expected[first : first + 4, first : first + 4] = True
    torch.testing.assert_close(changed, expected)


def test_second_blocks_shift_and_last_ones_attend() -> None:
    assert [block.aggregation.shift for block in dehaze_former.stage(1)] == [0, 4, 0, 4]
    attentive = [[block.norm is not None for block in dehaze_former.stage(index)] for index in range(5)]
    assert attentive == [[False] * 4, [False, False, True, True], [True] * 4, [False] * 2, [False] * 2]


def test_gated_block_is_its_formula() -> None:
    torch.manual_seed(0)
    block, x = GatedBlock(4).eval(), torch.rand(1, 4, 8, 9)
    block.norm.running_mean.fill_(0.5)
    block.norm.running_var.fill_(4.0)
    with torch.no_grad():
        normed = (x - 0.5) / 2
        gate = 1 / (1 + torch.exp(-block.gate(normed)))
        torch.testing.assert_close(block(x), x + block.mix(block.value(normed) * gate), atol=1e-4, rtol=1e-4)


def test_edges_are_a_quarter_of_the_neighbours_differences() -> None:
    image = torch.zeros(1, 3, 5, 6)
    image[..., 3:] = 0.6
    expected = torch.zeros(1, 1, 5, 6)
    expected[..., 2:4] = 0.15
    torch.testing.assert_close(edges(image), expected)
    torch.testing.assert_close(edges(image.transpose(2, 3)), expected.transpose(2, 3))
    image[:, 1:] = 0  # an edge of one colour counts a third
    torch.testing.assert_close(edges(image), expected / 3)


def test_smoothing_starts_as_the_identity_and_is_shared() -> None:
    layer, x = SharedSmoothing(4, 3), torch.rand(2, 4, 9, 8)
    with torch.no_grad():
        torch.testing.assert_close(layer(x), x)
        layer.weight.copy_(torch.full((1, 1, 3, 3), 1 / 9))
        torch.testing.assert_close(layer(x), F.avg_pool2d(x, 3, 1, 1))  # zeros outside count, too


@pytest.mark.parametrize("downwards", [True, False])
def test_column_joins_rows_with_its_weights(downwards: bool) -> None:
    torch.manual_seed(0)
    column = grid_dehaze_net.GridColumn(4, downwards)
    nodes = [torch.rand(1, 4 * 2**row, 16 // 2**row, 24 // 2**row) for row in range(3)]
    for joint in column.joints:
        joint.data = torch.rand_like(joint)
    with torch.no_grad():
        after = column(nodes)
        order = (0, 1, 2) if downwards else (2, 1, 0)
        torch.testing.assert_close(after[order[0]], column.dense[0](nodes[order[0]]))
        for k in (1, 2):
            along, across = column.dense[k](nodes[order[k]]), column.links[k - 1](after[order[k - 1]])
            joint = column.joints[k - 1]
            torch.testing.assert_close(after[order[k]], joint[0] * along + joint[1] * across)


def constant_k(image: Tensor) -> Tensor:
    """J = K I - K + 1 of K 0.5, 0.1 and 0."""
    k = torch.tensor([0.5, 0.1, 0.0]).reshape(1, 3, 1, 1)
    return k * (image - 1) + 1


def constant_k_and_b(image: Tensor) -> Tensor:
    """K I - B + I of K 0.5 on a range of -1 to 1."""
    signed = 1.5 * (2 * image - 1) - torch.tensor([0.1, -0.2, 0.3]).reshape(1, 3, 1, 1)
    return (signed + 1) / 2


def constant_addition(image: Tensor) -> Tensor:
    return image + torch.tensor([0.25, 0.05, -0.1]).reshape(1, 3, 1, 1)


@pytest.mark.parametrize(
    ("model", "bias", "expected"),
    [
        (AodNet(), [0.5, 0.1, -0.2], constant_k),
        (dehaze_former.DehazeFormer(), [0.5, 0.1, -0.2, 0.3], constant_k_and_b),
        (GUNet().eval(), [0.5, 0.1, -0.2], constant_addition),
    ],
)
def test_the_published_formula_makes_the_picture(model: nn.Module, bias: list[float], expected: Callable) -> None:
    """With what the last convolution gives held constant by its bias."""
    last = [layer for layer in model.modules() if isinstance(layer, nn.Conv2d)][-1]
    image = torch.rand(1, 3, 37, 45)
    with torch.no_grad():
        last.weight.zero_()
        last.bias.copy_(torch.tensor(bias))
        torch.testing.assert_close(model(image), expected(image), atol=1e-5, rtol=0)
