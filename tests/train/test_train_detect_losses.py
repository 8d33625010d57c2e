import numpy as np
import pytest
import torch

from deckline.train.detect_losses import (
    DetectTargets,
    LossWeights,
    box_loss,
    detect_loss,
    position_loss,
    row_loss,
    row_targets,
    segmentation_loss,
    shape_loss,
)
from deckline.train.ufld import UfldOutput

CELLS = 128


def perfect(cell: torch.Tensor) -> torch.Tensor:
    return torch.log(row_targets(cell, CELLS) + 1e-9)


@pytest.fixture
def cell() -> torch.Tensor:
    line = torch.linspace(20, 100, 72)
    both = torch.stack([line, line + 5.3])[None]
    both[:, :, :30] = torch.nan
    return both


def test_row_targets_are_two_cells_by_nearness():
    shares = row_targets(torch.tensor([3.25, 0.0, 127.0, 127.4, torch.nan]), CELLS)
    assert shares.sum(-1).tolist() == pytest.approx([1.0] * 5)
    assert shares[0, 3].item() == pytest.approx(0.75)
    assert shares[0, 4].item() == pytest.approx(0.25)
    assert shares[1, 0] == 1.0
    assert shares[2, 127] == 1.0
    assert shares[3, 127] == 1.0
    assert shares[4, 128] == 1.0


def test_perfect_rows_lose_nothing(cell):
    logits = perfect(cell)
    assert row_loss(logits, cell, 2.0).item() == pytest.approx(0.0, abs=1e-4)
    assert position_loss(logits, cell).item() == pytest.approx(0.0, abs=1e-4)
    assert shape_loss(logits, cell).item() == pytest.approx(0.0, abs=1e-4)


def test_row_loss_is_the_focal_loss_of_one_hot_targets():
    cell = torch.tensor([[[5.0, 9.0]]])
    logits = torch.randn(1, 1, 2, CELLS + 1, generator=torch.Generator().manual_seed(1))
    p = logits.softmax(-1)[0, 0, [0, 1], [5, 9]]
    expected = ((1 - p) ** 2 * -p.log()).mean()
    assert row_loss(logits, cell, 2.0).item() == pytest.approx(expected.item(), rel=1e-5)


def test_shifted_rows_lose_position_by_their_shift(cell):
    assert position_loss(perfect(cell + 1), cell).item() == pytest.approx(1 - 0.25, abs=0.02)


def test_bent_lines_lose_shape():
    rows = torch.arange(72.0)
    bent = (40 + 0.02 * (rows - 36) ** 2)[None, None]
    assert shape_loss(perfect(bent), bent).item() == pytest.approx(0.5 * 0.04**2, rel=0.05)


def test_box_loss_counts_only_images_with_a_runway():
    box, target = torch.ones(2, 4, 3, 3), torch.zeros(2, 4, 3, 3)
    weight = torch.zeros(2, 3, 3)
    assert box_loss(box, target, weight).item() == 0.0
    weight[0, 1, 1] = 1.0
    assert box_loss(box, target, weight).item() == pytest.approx(4 * (1 - 0.05))


def test_segmentation_knows_left_from_right():
    cell = torch.full((1, 2, 72), torch.nan)
    cell[0, 0], cell[0, 1] = 20.0, 90.0
    right_answer = torch.zeros(1, 3, 36, 64)
    right_answer[0, 0] = 5.0
    for line, column in ((1, 10), (2, 45)):
        right_answer[0, :, :, column - 1 : column + 2] = 0.0
        right_answer[0, line, :, column - 1 : column + 2] = 5.0
    swapped = right_answer[:, [0, 2, 1]]
    assert segmentation_loss(right_answer, cell, CELLS) < 0.5 * segmentation_loss(swapped, cell, CELLS)


def test_total_is_the_weighted_sum(cell):
    output = UfldOutput(torch.randn(1, 2, 72, 129), torch.randn(1, 577), torch.randn(1, 4, 18, 32), None)
    region = torch.zeros(1, 577)
    region[0, 40] = 1.0
    targets = DetectTargets(
        cell, torch.ones(1, 2, dtype=torch.bool), region, torch.zeros(1, 4, 18, 32), torch.ones(1, 18, 32) / 576
    )
    weights = LossWeights()
    total, parts = detect_loss(output, targets, weights)
    assert float(total) == pytest.approx(sum(getattr(weights, k) * v for k, v in parts.items()), rel=1e-5)
    assert np.isfinite(list(parts.values())).all()
