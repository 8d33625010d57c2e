"""Losses and targets: perfect answers cost nothing, wrong ones their part, and what is taught is what is decoded."""

import numpy as np
import pytest
import torch

from deckline.detect.anchors import RowGrid, decode
from deckline_lab.train import detect_losses as losses
from deckline_lab.train.detect_losses import (
    LossWeights,
    anchor_loss,
    line_anchors,
    position_loss,
    row_loss,
    row_targets,
)
from deckline_lab.train.line_networks import Hybrid, PyramidConfig, join_classes

CELLS = 128
GRID = RowGrid()
DECODE = Hybrid(PyramidConfig(pretrained=False)).kind.search.decode


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
    assert shares[0, 3:5].tolist() == pytest.approx([0.75, 0.25])
    assert shares[[1, 2, 3, 4], [0, 127, 127, 128]].tolist() == [1.0] * 4


def test_perfect_rows_lose_nothing(cell):
    logits = perfect(cell)
    assert row_loss(logits, cell, 2.0).item() == pytest.approx(0.0, abs=1e-4)
    assert position_loss(logits, cell).item() == pytest.approx(0.0, abs=1e-4)
    assert losses.shape_loss(logits, cell).item() == pytest.approx(0.0, abs=1e-4)


def test_row_loss_weighs_rows_with_and_without_a_line_the_same():
    """Three rows with a line and one without: the loss is the sum of both means, not the mean of all four."""
    cell = torch.tensor([[[5.0, 9.0, 30.0, torch.nan]]])
    logits = torch.randn(1, 1, 4, CELLS + 1, generator=torch.Generator().manual_seed(2))
    p = logits.softmax(-1)[0, 0, range(4), [5, 9, 30, CELLS]]
    focal = (1 - p) ** 2 * -p.log()
    assert row_loss(logits, cell, 2.0).item() == pytest.approx((focal[:3].mean() + focal[3]).item(), rel=1e-5)


def test_shifted_rows_lose_position_by_their_shift(cell):
    assert position_loss(perfect(cell + 1), cell).item() == pytest.approx(1 - 0.25, abs=0.02)


def test_bent_lines_lose_shape():
    rows = torch.arange(72.0)
    bent = (40 + 0.02 * (rows - 36) ** 2)[None, None]
    assert losses.shape_loss(perfect(bent), bent).item() == pytest.approx(0.5 * 0.04**2, rel=0.05)


def test_box_loss_counts_only_images_with_a_runway():
    box, target = torch.ones(2, 4, 3, 3), torch.zeros(2, 4, 3, 3)
    weight = torch.zeros(2, 3, 3)
    assert losses.box_loss(box, target, weight).item() == 0.0
    weight[0, 1, 1] = 1.0
    assert losses.box_loss(box, target, weight).item() == pytest.approx(4 * (1 - 0.05))


def test_segmentation_knows_left_from_right():
    cell = torch.full((1, 2, 72), torch.nan)
    cell[0, 0], cell[0, 1] = 20.0, 90.0
    right_answer = torch.zeros(1, 3, 36, 64)
    right_answer[0, 0] = 5.0
    for line, column in ((1, 10), (2, 45)):
        right_answer[0, :, :, column - 1 : column + 2] = 0.0
        right_answer[0, line, :, column - 1 : column + 2] = 5.0
    swapped = right_answer[:, [0, 2, 1]]
    assert losses.segmentation_loss(right_answer, cell, CELLS) < 0.5 * losses.segmentation_loss(swapped, cell, CELLS)


def test_total_is_the_weighted_sum(cell):
    output = losses.UfldOutput(torch.randn(1, 2, 72, 129), torch.randn(1, 577), torch.randn(1, 4, 18, 32), None)
    region = torch.zeros(1, 577)
    region[0, 40] = 1.0
    targets = losses.DetectTargets(
        cell, torch.ones(1, 2, dtype=torch.bool), region, torch.zeros(1, 4, 18, 32), torch.ones(1, 18, 32) / 576,
        torch.tensor([-1]),
    )  # fmt: skip
    weights = LossWeights()
    total, parts = losses.ufld_loss(output, targets, weights)
    assert float(total) == pytest.approx(sum(getattr(weights, k) * v for k, v in parts.items()), rel=1e-5)
    assert np.isfinite(list(parts.values())).all()


def test_the_edge_counts_where_its_kind_is_known():
    logits = torch.tensor([[2.0, 0.0, 0.0], [0.0, 0.0, 9.0]])
    expected = float(torch.log(torch.exp(torch.tensor(2.0)) + 2) - 2)
    assert float(losses.edge_loss(logits, torch.tensor([0, -1]))) == pytest.approx(expected, rel=1e-5)
    assert float(losses.edge_loss(logits, torch.tensor([-1, -1]))) == 0.0


def pixel_rows(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    """x on every pixel row of a straight line."""
    y = np.arange(GRID.height, dtype=np.float64)
    x = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    return np.where((y >= min(y0, y1)) & (y <= max(y0, y1)), x, np.nan)


lines = pytest.mark.parametrize(
    ("ends", "kinds"),
    [
        ((100.0, 280.0, 140.0, 80.0), "rows"),
        ((50.0, 100.0, 450.0, 110.0), "columns"),
        ((100.0, 250.0, 300.0, 50.0), "rows columns"),
    ],
)


@lines
def test_a_steep_line_crosses_rows_a_flat_one_columns_and_its_ends_are_left_open(ends, kinds) -> None:
    x0, y0, x1, y1 = ends
    rows, columns, unknown = line_anchors(pixel_rows(*ends), GRID)
    y, x, slope = GRID.row_y, GRID.transposed.row_y, (x1 - x0) / (y1 - y0)
    on_rows, on_columns = (y >= min(y0, y1)) & (y <= max(y0, y1)), (x >= x0) & (x <= x1)
    expected = np.where(on_rows & ("rows" in kinds), x0 + (y - y0) * slope, np.nan)
    np.testing.assert_allclose(GRID.x_from_cell(rows), expected, atol=1e-3)
    expected = np.where(on_columns & ("columns" in kinds), y0 + (x - x0) / slope, np.nan)
    np.testing.assert_allclose(GRID.transposed.x_from_cell(columns), expected, atol=1e-3)
    near = (x > x0 - abs(slope)) & (x < x1 + abs(slope))
    np.testing.assert_array_equal(unknown, ~on_columns & near & ("columns" in kinds))


@lines
def test_what_is_taught_is_what_is_decoded(ends: tuple[float, float, float, float], kinds: str) -> None:
    """Shares as the targets have them give the same points, sure and sharp."""
    rows, columns, _ = line_anchors(pixel_rows(*ends), GRID)
    for position, grid in ((rows, GRID), (columns, GRID.transposed)):
        shares = row_targets(torch.from_numpy(position), grid.cells).numpy()
        found = decode(np.log(shares + 1e-9), grid, DECODE)
        np.testing.assert_allclose(found.x_px, grid.x_from_cell(position), atol=0.02)
        assert (found.confidence[np.isfinite(position)] > 0.999).all()


def test_a_batch_is_its_lines() -> None:
    lines = np.stack([pixel_rows(100, 280, 140, 80), pixel_rows(50, 100, 450, 110)]).astype(np.float32)
    parts = losses.anchor_targets(torch.from_numpy(lines)[None], GRID)
    assert [tuple(part.shape) for part in parts] == [(1, 2, 72), (1, 2, 128), (1, 2, 128)]
    for index, line in enumerate(lines):
        for whole, single in zip(parts, line_anchors(line.astype(np.float64), GRID), strict=True):
            np.testing.assert_array_equal(whole[0, index].numpy(), single)


def test_the_last_class_is_the_probability_of_no_crossing() -> None:
    torch.manual_seed(0)
    cells, crossed = torch.randn(2, 3, 7), torch.randn(2, 3)
    shares = join_classes(cells, crossed).softmax(-1)
    torch.testing.assert_close(1 - shares[..., -1], crossed.sigmoid())
    torch.testing.assert_close(shares[..., :-1] / shares[..., :-1].sum(-1, keepdim=True), cells.softmax(-1))


def test_loss_is_the_two_cross_entropies() -> None:
    """Against torch's own: existence as a binary one, cells as a soft one over the crossed anchors."""
    torch.manual_seed(0)
    cells, crossed = torch.randn(1, 2, 3, 9), torch.randn(1, 2, 3)
    position = torch.tensor([[[2.25, float("nan"), 7.0], [float("nan")] * 3]])
    ignored = torch.zeros(1, 2, 3, dtype=torch.bool)
    ignored[0, 1, 0] = True
    loss, _ = anchor_loss(join_classes(cells, crossed), position, ignored)
    there = ~torch.isnan(position)
    binary = torch.nn.functional.binary_cross_entropy_with_logits(crossed[~ignored], there[~ignored].float())
    log_p = cells.log_softmax(-1)
    soft = -(0.75 * log_p[0, 0, 0, 2] + 0.25 * log_p[0, 0, 0, 3] + log_p[0, 0, 2, 7]) / 2
    assert loss.item() == pytest.approx((binary + soft).item(), rel=1e-5)
