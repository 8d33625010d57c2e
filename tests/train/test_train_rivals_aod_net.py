"""AOD-Net: where it starts, and its formula."""

import torch

from deckline.train.rivals import AodNet


def test_untrained_network_returns_its_input() -> None:
    image = torch.rand(2, 3, 20, 30)
    with torch.no_grad():
        torch.testing.assert_close(AodNet()(image), image)


def test_constant_k_is_the_papers_equation() -> None:
    """With K held by the last bias: J = K I - K + 1, K never negative."""
    model = AodNet()
    model.fifth.bias.data = torch.tensor([1.5, 0.5, -2.0])
    image = torch.rand(1, 3, 20, 30)
    with torch.no_grad():
        clear = model(image)
    k = torch.tensor([1.5, 0.5, 0.0]).reshape(1, 3, 1, 1)
    torch.testing.assert_close(clear, k * (image - 1) + 1)


def test_k_sees_seven_pixels_around() -> None:
    """1x1, 3x3, 5x5, 7x7 and 3x3 in a row reach 0 + 1 + 2 + 3 + 1 = 7 px; the deepest path decides."""
    torch.manual_seed(0)
    model = AodNet()
    for layer in (model.first, model.second, model.third, model.fourth, model.fifth):
        layer.weight.data = layer.weight.data.abs() + 0.1  # nothing rectified away
    image = torch.rand(1, 3, 31, 31)
    touched = image.clone()
    touched[:, :, 15, 15] += 0.5
    with torch.no_grad():
        rows, columns = torch.nonzero((model(touched) - model(image)).abs().sum((0, 1)) > 0, as_tuple=True)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (8, 22, 8, 22)
