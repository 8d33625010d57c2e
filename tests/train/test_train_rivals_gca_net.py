"""GCANet: its edge channel, smoothing before dilation, and the gate."""

import torch
import torch.nn.functional as F

from deckline.train.rivals import GcaNet
from deckline.train.rivals.gca_net import GcaNetConfig, SharedSmoothing, SmoothDilatedBlock, edges


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


def test_dilated_block_reaches_its_neighbours_through_smoothing() -> None:
    """Without smoothing, dilation 2 sees every second pixel only; with it, all of them within reach.

    Norms over the whole image would show every pixel everywhere, so the bare convolutions are looked at.
    """
    block = SmoothDilatedBlock(1, 2)
    smoothing, dilated = block.body[0], block.body[1]
    assert (smoothing.kernel, dilated.dilation) == (3, (2, 2))
    dilated.weight.data.fill_(1.0)
    spot = torch.zeros(1, 1, 15, 15)
    spot[..., 7, 7] = 1
    with torch.no_grad():
        assert (dilated(smoothing(spot)) > 0).sum() == 9
        smoothing.weight.fill_(1.0)
        assert (dilated(smoothing(spot)) > 0).sum() == 49


def test_gate_weighs_three_depths() -> None:
    """With the gate held by its bias at (0, 0, 0) only the decoder's constant is added, the same everywhere."""
    torch.manual_seed(0)
    model = GcaNet(GcaNetConfig(channels=8))
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
