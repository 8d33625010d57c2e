"""Parameters and MACs against sums done by hand."""

import pytest
import torch
from torch import nn

from deckline.train.network_cost import NetworkCost, count_parameters, network_cost


def test_convolutions_are_counted_by_output_pixel() -> None:
    model = nn.Sequential(nn.Conv2d(3, 8, 3, padding=1, stride=2), nn.ReLU(), nn.Conv2d(8, 8, 5, padding=2, groups=8))
    macs = 32 * 24 * (8 * 3 * 9 + 8 * 25)
    assert network_cost(model, (64, 48)) == NetworkCost(8 * 27 + 8 + 8 * 25 + 8, macs)


def test_transposed_convolution_is_counted_by_input_pixel() -> None:
    """Every input pixel is multiplied with every weight once."""
    model = nn.ConvTranspose2d(3, 5, 4, stride=2, padding=1, bias=False)
    assert network_cost(model, (10, 12)) == NetworkCost(3 * 5 * 16, 10 * 12 * 3 * 5 * 16)


def test_matrix_products_are_counted() -> None:
    class Gram(nn.Module):
        def forward(self, image: torch.Tensor) -> torch.Tensor:
            tokens = image.flatten(2)
            return tokens @ tokens.transpose(1, 2)

    assert network_cost(Gram(), (10, 12)) == NetworkCost(0, 3 * 3 * 120)


def test_model_stays_where_and_how_it_was() -> None:
    model = nn.Sequential(nn.Conv2d(3, 4, 1), nn.BatchNorm2d(4))
    before = [value.clone() for value in model.state_dict().values()]
    network_cost(model)
    assert model.training
    for old, new in zip(before, model.state_dict().values(), strict=True):
        torch.testing.assert_close(old, new, rtol=0, atol=0)


def test_default_size_is_the_papers() -> None:
    assert network_cost(nn.Conv2d(3, 1, 1)).macs == 3 * 256 * 256


def test_tied_weights_count_once() -> None:
    layer = nn.Conv2d(3, 3, 1, bias=False)
    model = nn.Sequential(layer, layer)
    assert count_parameters(model) == 9
    assert network_cost(model, (2, 2)).macs == pytest.approx(2 * 4 * 9)
