"""Padding, convolutions that continue by reflection, and first weights."""

import math

import pytest
import torch
from torch import nn

from deckline.train.rivals.common import padded, reflected, residual_gain, set_first_weights


@pytest.mark.parametrize(
    ("size", "multiple", "expected"),
    [((64, 48), 8, (64, 48)), ((65, 47), 8, (72, 48)), ((1, 50), 4, (32, 52)), ((7, 33), 5, (35, 35))],
)
def test_sides_become_multiples_and_not_too_short(
    size: tuple[int, int], multiple: int, expected: tuple[int, int]
) -> None:
    image = torch.rand(2, 3, *size)
    whole = padded(image, multiple)
    assert whole.shape == (2, 3, *expected)
    torch.testing.assert_close(whole[:, :, : size[0], : size[1]], image)
    torch.testing.assert_close(whole[:, :, -1, -1], image[:, :, -1, -1])


def test_reflected_convolution_sees_the_mirrored_border() -> None:
    layer = reflected(1, 1, 3)
    layer.weight.data.zero_()
    layer.bias.data.zero_()
    layer.weight.data[0, 0, 1, 0] = 1  # the left neighbour
    row = torch.tensor([[1.0, 2.0, 3.0]]).expand(3, 3)[None, None]
    with torch.no_grad():
        torch.testing.assert_close(layer(row)[0, 0, 0], torch.tensor([2.0, 1.0, 2.0]))


def test_first_weights_have_the_papers_spread() -> None:
    torch.manual_seed(0)
    layer = nn.Sequential(nn.Conv2d(64, 64, 3))
    set_first_weights(layer, residual_gain(16))
    spread = (8 * 16) ** -0.25 * math.sqrt(2 / (64 * 9 + 64 * 9))
    assert layer[0].weight.std().item() == pytest.approx(spread, rel=0.02)
    assert layer[0].bias.abs().max() == 0
