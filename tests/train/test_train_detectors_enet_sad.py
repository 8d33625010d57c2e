"""ENet with self attention distillation: unpooling, attention, and who learns from whom."""

import pytest
import torch
import torch.nn.functional as F
from painted_batch import painted_batch

from deckline.train.detect_losses import LossWeights
from deckline.train.detectors.enet_sad import DISTIL_FROM, EnetSad, attention, distillation_loss, unpooled


def test_values_go_back_to_where_the_maxima_were() -> None:
    torch.manual_seed(0)
    before, x = torch.randn(2, 3, 8, 10), torch.randn(2, 3, 4, 5)
    _, places = F.max_pool2d(before, 2, return_indices=True)
    torch.testing.assert_close(unpooled(x, before), F.max_unpool2d(x, places, 2), rtol=0, atol=0)


def test_attention_is_a_distribution_over_places() -> None:
    features = torch.zeros(1, 2, 2, 2)
    features[0, :, 0, 1] = torch.tensor([1.0, -1.0])
    expected = torch.tensor([1.0, 2.718281828**2, 1.0, 1.0])
    torch.testing.assert_close(attention(features, (2, 2))[0], expected / expected.sum())
    assert attention(features, (4, 6)).sum().item() == pytest.approx(1.0)


def test_only_the_shallower_block_learns() -> None:
    torch.manual_seed(0)
    shallow, deep = (torch.randn(1, 4, 8, 8, requires_grad=True) for _ in range(2))
    loss = distillation_loss((shallow, deep))
    loss.backward()
    assert shallow.grad is not None and shallow.grad.abs().max() > 0
    assert deep.grad is None
    assert distillation_loss((shallow, shallow)).item() == 0
    assert 0 < loss.item() <= 2


def test_distillation_comes_in_late() -> None:
    torch.manual_seed(0)
    model = EnetSad(size_px=(64, 32)).train()
    image, targets = painted_batch(64, 32)
    output = model(image)
    assert [features.shape[2] for features in output.encoded] == [16, 8, 4, 4]
    early, late = (model.loss(output, targets, LossWeights(), share) for share in (DISTIL_FROM - 0.01, DISTIL_FROM))
    assert "distil" not in early[1]
    assert (late[0] - early[0]).item() == pytest.approx(0.1 * late[1]["distil"], rel=1e-3)
