"""What the painting networks are taught: the stripe, its overlap, and that a perfect answer costs nothing."""

import numpy as np
import pytest
import torch
from painted_batch import painted_batch

from deckline.detect.anchors import decode, rows_from_map
from deckline.train.detect_losses import LossWeights
from deckline.train.detectors.map_losses import MAP_KIND, STRIPE_PX, MapOutput, map_loss, overlap_loss, painted


def test_the_stripe_has_its_width_on_every_row() -> None:
    cell = torch.full((1, 2, 5), float("nan"))
    cell[0, 0, 1:4] = torch.tensor([20.0, 20.5, 21.0])
    cell[0, 1, 2] = 40.0
    label = painted(cell, 64)
    assert (label[0] == 1).sum(1).tolist() == [0, STRIPE_PX + 1, STRIPE_PX, STRIPE_PX + 1, 0]
    assert (label[0, 2] == 2).nonzero().flatten().tolist() == list(range(34, 47))
    assert label[0, 0].max() == label[0, 4].max() == 0


def test_overlap_is_one_minus_intersection_over_union() -> None:
    label = torch.zeros(1, 2, 4, dtype=torch.long)
    label[0, :, 0] = 1
    logits = torch.full((1, 3, 2, 4), -20.0)
    logits[0, 0], logits[0, 1, :, :2] = 0.0, 20.0  # twice as wide as the stripe; the second line is not there
    assert overlap_loss(logits, label).item() == pytest.approx(0.5, abs=1e-6)


def test_a_perfect_answer_costs_nothing_and_a_wrong_one_does() -> None:
    _, targets = painted_batch(128, 32)
    label = painted(targets.cell, 128)
    logits = 40.0 * torch.nn.functional.one_hot(label, 3).permute(0, 3, 1, 2).float()
    lines = torch.tensor([[40.0, 40.0], [-40.0, -40.0]])
    region = torch.log(targets.region + 1e-12)
    right, parts = map_loss(MapOutput(logits, lines, region, targets.box), targets, LossWeights())
    assert parts["map"].item() == pytest.approx(0, abs=1e-6)
    assert parts["existence"].item() == pytest.approx(0, abs=1e-6)
    assert parts["box"].item() == 0
    swapped = MapOutput(logits[:, [0, 2, 1]], lines, region, targets.box)  # left for right
    assert map_loss(swapped, targets, LossWeights())[0].item() > right.item() + 1


def test_what_is_taught_is_what_is_decoded() -> None:
    """A network that paints exactly as taught gives the line back to a tenth of a pixel, and says how sure it is."""
    grid = MAP_KIND.grid
    y = np.arange(grid.height)
    x = np.stack([100.3 + 0.21 * y, 400.8 - 0.37 * y])
    label = painted(torch.from_numpy(x[None]).float(), grid.width)[0].numpy()
    logits = 12.0 * (label[None] == np.arange(3)[:, None, None])
    rows = rows_from_map(logits.astype(np.float32), np.array([9.0, -9.0], np.float32), grid)
    found = decode(rows[0], grid, MAP_KIND.decode)
    expected = np.interp(grid.row_y, y, x[0])
    assert np.abs(found.x_px - expected).max() < 0.35  # a painted edge falls on whole pixels
    assert np.abs(found.x_px - expected).mean() < 0.1
    assert found.confidence.min() > 0.99
    assert found.sigma_px.max() < 2.0
    assert np.isnan(decode(rows[1], grid, MAP_KIND.decode).x_px).all()  # painted, but said not to be there
