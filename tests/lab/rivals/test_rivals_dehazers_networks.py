"""The compared dehazers one by one: their blocks against formulas, what they start from, what they add."""

import math

import pytest
import torch
import torch.nn.functional as F
from torch import nn

from deckline_lab.rivals.dehazers import dehaze_former, grid_dehaze_net
from deckline_lab.rivals.dehazers.aod_net import AodNet
from deckline_lab.rivals.dehazers.common import pad_to_multiple, residual_gain, set_first_weights
from deckline_lab.rivals.dehazers.g_unet import GatedBlock, GUNet
from deckline_lab.rivals.dehazers.gca_net import GcaNet, SharedSmoothing, edges


@pytest.mark.parametrize(
    ("size", "multiple", "expected"),
    [((64, 48), 8, (64, 48)), ((65, 47), 8, (72, 48)), ((1, 50), 4, (32, 52)), ((7, 33), 5, (35, 35))],
)
def test_sides_become_multiples_and_not_too_short(
    size: tuple[int, int], multiple: int, expected: tuple[int, int]
) -> None:
    image = torch.rand(2, 3, *size)
    whole = pad_to_multiple(image, multiple)
    assert whole.shape == (2, 3, *expected)
    torch.testing.assert_close(whole[:, :, : size[0], : size[1]], image)
    torch.testing.assert_close(whole[:, :, -1, -1], image[:, :, -1, -1])


def test_first_weights_have_the_papers_spread() -> None:
    torch.manual_seed(0)
    layer = nn.Sequential(nn.Conv2d(64, 64, 3))
    set_first_weights(layer, residual_gain(16))
    spread = (8 * 16) ** -0.25 * math.sqrt(2 / (64 * 9 + 64 * 9))
    assert layer[0].weight.std().item() == pytest.approx(spread, rel=0.02)
    assert layer[0].bias.abs().max() == 0


def test_aod_net_with_constant_k_is_the_papers_equation() -> None:
    """Untrained: the input. With K held by the last bias: J = K I - K + 1, K never negative."""
    model, image = AodNet(), torch.rand(2, 3, 20, 30)
    k = torch.tensor([1.5, 0.5, 0.0]).reshape(1, 3, 1, 1)
    with torch.no_grad():
        torch.testing.assert_close(model(image), image)
        model.fifth.bias.data = torch.tensor([1.5, 0.5, -2.0])
        torch.testing.assert_close(model(image), k * (image - 1) + 1)


SMALL = dehaze_former.DehazeFormerConfig(
    channels=(4, 8, 16, 8, 4), depths=(1, 1, 1, 1, 1), attentive=(0, 1, 1, 0, 0), heads=(1, 2, 2, 1, 1), window=4
)


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
    config = dehaze_former.DehazeFormerConfig()
    assert [block.aggregation.shift for block in dehaze_former.stage(config, 1)] == [0, 4, 0, 4]
    attentive = [[block.norm is not None for block in dehaze_former.stage(config, index)] for index in range(5)]
    assert attentive == [[False] * 4, [False, False, True, True], [True] * 4, [False] * 2, [False] * 2]


def test_dehaze_former_reconstructs_on_minus_one_to_one() -> None:
    """With K and B held by the last bias: on -1..1 the output is K I - B + I."""
    model = dehaze_former.DehazeFormer(SMALL)
    model.outro.weight.data.zero_()
    model.outro.bias.data = torch.tensor([0.5, 0.1, 0.2, 0.3])
    image = torch.rand(1, 3, 37, 45)
    with torch.no_grad():
        expected = 1.5 * (2 * image - 1) - torch.tensor([0.1, 0.2, 0.3]).reshape(1, 3, 1, 1)
        torch.testing.assert_close(2 * model(image) - 1, expected, atol=1e-5, rtol=0)


def test_gated_block_is_its_formula() -> None:
    torch.manual_seed(0)
    block, x = GatedBlock(4, 3, 7).eval(), torch.rand(1, 4, 8, 9)
    block.norm.running_mean.fill_(0.5)
    block.norm.running_var.fill_(4.0)
    with torch.no_grad():
        normed = (x - 0.5) / 2
        gate = 1 / (1 + torch.exp(-block.gate(normed)))
        torch.testing.assert_close(block(x), x + block.mix(block.value(normed) * gate), atol=1e-4, rtol=1e-4)


def test_g_unet_adds_to_the_image() -> None:
    model = GUNet(4, (1, 1, 1)).eval()
    model.outro.weight.data.zero_()
    model.outro.bias.data = torch.tensor([0.2, -0.4, 0.0])
    image = torch.rand(1, 3, 35, 33)
    with torch.no_grad():
        torch.testing.assert_close(model(image), image + torch.tensor([0.1, -0.2, 0.0]).reshape(1, 3, 1, 1))


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


def test_gate_weighs_three_depths() -> None:
    """With the gate held by its bias at (0, 0, 0) only the decoder's constant is added, the same everywhere."""
    torch.manual_seed(0)
    model = GcaNet(8)
    model.gate.weight.data.zero_()
    image = torch.rand(1, 3, 32, 40)
    added = []
    for weights in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        model.gate.bias.data = torch.tensor(weights)
        with torch.no_grad():
            added.append(model(image) - image)
    assert added[0][:, :, 4:-4, 4:-4].std((2, 3)).max() < 1e-5
    assert added[1].std() > 1e-2
    assert (added[1] - added[2]).abs().max() > 1e-2


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
