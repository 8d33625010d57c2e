"""RESA: what the shifts pass on, and how far."""

import torch

from deckline.train.detectors.resa import GAIN, ROUNDS, FeatureShift


def one_tap(module: FeatureShift) -> None:
    """Every convolution hands on the middle pixel of its own channel."""
    for convs in module.rounds:
        for conv in convs:
            conv.weight.data.zero_()
            conv.weight.data[:, :, conv.kernel_size[0] // 2, conv.kernel_size[1] // 2] = torch.eye(conv.in_channels)


def test_a_pass_is_its_formula() -> None:
    """Written out with index arithmetic: row i gets row (i + H / 2^(K - k)) mod H, then the other directions."""
    torch.manual_seed(0)
    module, x = FeatureShift(2), torch.randn(1, 2, 16, 32)
    one_tap(module)
    expected = x.clone()
    for dim, sign in ((2, 1), (2, -1), (3, 1), (3, -1)):
        side = x.shape[dim]
        for k in range(ROUNDS):
            index = (torch.arange(side) + sign * (side // 2 ** (ROUNDS - k))) % side
            expected = expected + GAIN * expected.index_select(dim, index).clamp(min=0)
    with torch.no_grad():
        torch.testing.assert_close(module(x), expected)


def test_one_pixel_reaches_every_other() -> None:
    module = FeatureShift(1)
    one_tap(module)
    x = torch.zeros(1, 1, 16, 16)
    x[0, 0, 3, 5] = 1.0
    with torch.no_grad():
        assert (module(x) > 0).all()
