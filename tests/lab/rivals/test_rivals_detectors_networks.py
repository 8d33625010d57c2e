"""The compared detectors one by one: backbone, shifts, attention, painted stripes and their losses."""

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from deckline.detect.anchors import RowGrid, decode, rows_from_map
from deckline_lab.rivals.detectors import parts
from deckline_lab.rivals.detectors.enet_sad import EnetSad, unpool
from deckline_lab.rivals.detectors.parts import MapOutput, map_kind
from deckline_lab.rivals.detectors.resa import GAIN, ROUNDS, FeatureShift, Resa
from deckline_lab.rivals.detectors.sad import DISTIL_FROM, Sad, attention, distillation_loss
from deckline_lab.rivals.detectors.ufld_published import focal_loss
from deckline_lab.train.detect_losses import DetectTargets, LossWeights
from deckline_lab.train.line_networks import PyramidConfig
from deckline_lab.train.line_targets import encode_region

SHAPE = PyramidConfig(RowGrid(128, 32, 32, 8), pretrained=False)


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


def test_values_go_back_to_where_the_maxima_were() -> None:
    torch.manual_seed(0)
    before, x = torch.randn(2, 3, 8, 10), torch.randn(2, 3, 4, 5)
    _, places = F.max_pool2d(before, 2, return_indices=True)
    torch.testing.assert_close(unpool(x, before), F.max_unpool2d(x, places, 2), rtol=0, atol=0)


def test_attention_is_a_distribution_over_places() -> None:
    features = torch.zeros(1, 2, 2, 2)
    features[0, :, 0, 1] = torch.tensor([1.0, -1.0])
    expected = torch.tensor([1.0, 2.718281828**4, 1.0, 1.0])  # 4 times the mean
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


def test_overlap_is_one_minus_intersection_over_union() -> None:
    stripes, shares = torch.zeros(1, 2, 2, 4), torch.zeros(1, 2, 2, 4)
    stripes[0, 0, :, 0], shares[0, 0, :, :2] = 1.0, 1.0  # twice as wide as the stripe; the second line is not there
    assert parts.overlap_loss(shares, stripes).item() == pytest.approx(0.5, abs=1e-6)


def test_dice_is_twice_the_overlap_over_both_squares() -> None:
    stripes, shares = torch.zeros(2, 2, 2, 4), torch.zeros(2, 2, 2, 4)
    stripes[0, 0, :, 0], shares[0, 0, :, :2] = 1.0, 1.0
    stripes[1, 1, :, 1], shares[1, 1, :, 1] = 1.0, 1.0
    assert parts.dice_loss(shares, stripes).item() == pytest.approx((1 - 4 / 6) / 2, abs=1e-3)


def test_focal_loss_is_its_formula_and_leaves_out_no_row() -> None:
    logits = torch.log(torch.tensor([[[[0.7, 0.2, 0.1], [0.1, 0.3, 0.6]]]]))
    cell = torch.tensor([[[0.2, float("nan")]]])  # the first cell; no line
    expected = -(0.3**2 * np.log(0.7) + 0.4**2 * np.log(0.6)) / 2
    assert focal_loss(logits, cell).item() == pytest.approx(expected, rel=1e-5)


def test_a_perfect_answer_costs_nothing_and_a_wrong_one_does() -> None:
    _, targets = painted_batch(128, 32)
    label = parts.paint_stripes(targets.cell, 128)
    logits = 40.0 * torch.nn.functional.one_hot(label, 3).permute(0, 3, 1, 2).float()
    lines = torch.tensor([[40.0, 40.0], [-40.0, -40.0]])
    region = torch.log(targets.region + 1e-12)
    for model, name in ((Sad(SHAPE), "map"), (Resa(SHAPE), "dice")):
        right, losses = model.loss(MapOutput(logits, lines, region, targets.box), targets, LossWeights(), 0.0)
        assert [losses["existence"], losses["box"]] == pytest.approx([0] * 2, abs=1e-6)
        assert losses[name] == pytest.approx(0.5 if name == "dice" else 0, abs=1e-3)  # of an empty view nothing is left
        swapped = MapOutput(logits[:, [0, 2, 1]], lines, region, targets.box)  # left for right
        assert model.loss(swapped, targets, LossWeights(), 0.0)[0].item() > right.item() + 0.5


def test_what_is_taught_is_what_is_decoded() -> None:
    """A network that paints exactly as taught gives the line to a tenth of a pixel, with high confidence."""
    search = map_kind((512, 288)).search
    grid = search.grid
    y = np.arange(grid.height)
    x = np.stack([100.3 + 0.21 * y, 400.8 - 0.37 * y])
    label = parts.paint_stripes(torch.from_numpy(x[None]).float(), grid.width)[0].numpy()
    logits = 12.0 * (label[None] == np.arange(3)[:, None, None])
    rows = rows_from_map(logits.astype(np.float32), np.array([9.0, -9.0], np.float32), grid)
    found = decode(rows[0], grid, search.decode)
    expected = np.interp(grid.row_y, y, x[0])
    assert np.abs(found.x_px - expected).max() < 0.35  # a painted edge falls on whole pixels
    assert np.abs(found.x_px - expected).mean() < 0.1
    assert found.confidence.min() > 0.99
    assert found.sigma_px.max() < 2.0
    assert np.isnan(decode(rows[1], grid, search.decode).x_px).all()  # painted, but absent by the existence branch


def painted_batch(width: int, height: int) -> tuple[torch.Tensor, DetectTargets]:
    """Views (2, 3, height, width) and targets; the lines stand upright at a third and at two thirds."""
    image, cell = torch.zeros(2, 3, height, width), torch.full((2, 2, height), float("nan"))
    for line, u in enumerate((width // 3, 2 * width // 3)):
        image[0, :, :, u - 1 : u + 2] = 3.0
        cell[0, line] = u
    cells = (width // 16, height // 16)
    box = [width / 3, 1.0, 2 * width / 3, height - 2.0]
    pairs = zip(encode_region(box, cells), encode_region(None, cells), strict=True)
    return image, DetectTargets(
        cell,
        torch.ones(2, 2, dtype=torch.bool),
        *(torch.from_numpy(np.stack(pair)) for pair in pairs),
        edge=torch.tensor([0, -1]),
    )
