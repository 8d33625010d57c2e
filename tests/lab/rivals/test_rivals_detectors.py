"""Every line network: its published size, learning, and torch against ONNX."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from deckline.config import Models, RunConfig
from deckline.detect import OnnxDetector
from deckline.detect.anchors import RowGrid
from deckline_lab.rivals.catalog import flight_from_config
from deckline_lab.rivals.detectors import DETECTORS
from deckline_lab.rivals.detectors.enet_sad import EnetSad
from deckline_lab.rivals.detectors.resa import Resa
from deckline_lab.rivals.detectors.ufld_published import PublishedUfld
from deckline_lab.train.detect import (
    NETWORKS,
    DetectTrainConfig,
    export_detect,
    make_optimizer,
    runtime_parameters,
    torch_infer,
)
from deckline_lab.train.detect_losses import DetectTargets, LossWeights
from deckline_lab.train.export import count_parameters, network_cost
from deckline_lab.train.line_networks import LineNetwork, PyramidConfig
from deckline_lab.train.line_targets import encode, encode_region
from deckline_lab.train.loop import RATE

CULANE = (800, 288)  # width and height at which the costs were published
CULANE_LINES = 4
BUILDERS = NETWORKS | DETECTORS
CONFIG = DetectTrainConfig()
SMALL = PyramidConfig(RowGrid(128, 64, 32, 16), pretrained=False)
LARGE = PyramidConfig(RowGrid(*CULANE, CULANE[0] // 4, CULANE[1] // 4))


def small(name: str) -> LineNetwork:
    """A network for a small view."""
    torch.manual_seed(0)
    if name in ("ufld-lite0", "ufld-r18"):
        return PublishedUfld(SMALL, (32, 16), resnet=name == "ufld-r18")
    return BUILDERS[name](replace(CONFIG, shape=SMALL if name in DETECTORS else replace(SMALL, frozen_blocks=0)))


def batch(model: LineNetwork, name: str) -> tuple[torch.Tensor, DetectTargets]:
    """Two bright lines on a grey view, twice, and the second time nothing; encoded as in training."""
    grid = model.kind.target_grid
    if "map_logits" in model.kind.output_names:
        grid = RowGrid(128, 64, 128, 64)
    lines = np.array([[[0.3, 0.95], [0.42, 0.2]], [[0.7, 0.95], [0.58, 0.2]]]) * [grid.width, grid.height]
    view = np.zeros((3, grid.height, grid.width), np.float32)
    for near, far in lines:
        for v in range(int(far[1]), int(near[1])):
            u = near[0] + (v - near[1]) * (far[0] - near[0]) / (far[1] - near[1])
            view[:, v, int(u) - 2 : int(u) + 3] = 3.0
    lines = np.concatenate([lines, lines.mean(axis=0, keepdims=True)])[: model.kind.lines]
    cell = np.stack([encode(line, [True, True], grid) for line in lines])
    known = np.ones(len(lines), bool)
    box = [*lines.min(axis=(0, 1)), *lines.max(axis=(0, 1))]
    cells = (grid.width // 16, grid.height // 16)
    full = (cell, known, *encode_region(box, cells))
    empty = (np.full_like(cell, np.nan), known, *encode_region(None, cells))
    columns = [torch.from_numpy(np.stack(pair)) for pair in zip(full, empty, strict=True)]
    return torch.from_numpy(np.stack([view, np.zeros_like(view)])), DetectTargets(*columns, torch.tensor([0, -1]))


def test_enet_sad_has_the_published_parameters() -> None:
    """0.98 M (Hou et al. 2019), four lines at 288x800, existence branch included: its size follows the input."""
    model = EnetSad(CULANE, CULANE_LINES)
    assert count_parameters(model) - count_parameters(model.region) == pytest.approx(0.98e6, rel=0.01)


def test_ufld_has_the_published_cost() -> None:
    """8.4 GMACs as tabulated by Tabelini et al. 2021 (LaneATT), CULane: 200 cells, 18 rows, four lines.

    Our region branch, counted here too, is less than half a percent of it.
    """
    model = PublishedUfld(LARGE, (200, 18), CULANE_LINES, resnet=True)
    assert network_cost(model, CULANE[::-1]).macs == pytest.approx(8.4e9, rel=0.01)
    flat, outputs = 8 * 9 * 25, 4 * 18 * 201
    layers = 11_176_512 + (512 * 8 + 8) + (flat + 1) * 2048 + 2049 * outputs
    assert runtime_parameters(model) - count_parameters(model.region) == layers


def test_resa_has_the_published_cost() -> None:
    """41.0 GMACs with ResNet-34 as tabulated by Zheng et al. 2022 (CLRNet); that fits no fourth stage."""
    model = Resa(LARGE, 34, CULANE_LINES)
    region = network_cost(model.region, (CULANE[1] // 8, CULANE[0] // 8), (128,)).macs
    assert network_cost(model, CULANE[::-1]).macs - region == pytest.approx(41.0e9, rel=0.01)


@pytest.mark.parametrize("name", list(BUILDERS))
def test_a_few_steps_lower_the_loss_and_every_weight_learns(name: str) -> None:
    model = small(name).train()
    image, targets = batch(model, name)
    optimizer = make_optimizer(CONFIG, model)
    for group in optimizer.param_groups:
        group["lr"] = 1e-3 * group[RATE]
    totals = []
    for _ in range(3):
        torch.manual_seed(0)  # the same channels are dropped every time
        loss, parts = model.loss(model(image), targets, LossWeights(), fraction=1.0)
        assert all(np.isfinite(value) for value in parts.values())
        totals.append(loss.item())
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert totals[-1] < totals[0] - 0.1
    trained = [(key, value.grad) for key, value in model.named_parameters() if value.requires_grad]
    assert [key for key, grad in trained if grad is None or not grad.abs().max() > 0] == []


@pytest.mark.parametrize("name", ["ufld-lite0", "sad-lite0", "resa-lite0"])
def test_compared_networks_start_from_the_features_that_ours_starts_from(name: str) -> None:
    ours, theirs = (BUILDERS[each](CONFIG).backbone.state_dict() for each in ("hybrid", name))
    assert all(torch.equal(value, theirs[key]) for key, value in ours.items())


@pytest.mark.parametrize("name", list(BUILDERS))
def test_torch_and_onnx_agree(name: str, tmp_path: Path) -> None:
    torch.manual_seed(0)
    model = (small(name) if name in DETECTORS else NETWORKS[name](CONFIG)).eval()
    path = export_detect(model, tmp_path / f"{name}.onnx", {"lr": 1.0}, 7)
    detector = OnnxDetector(path, compare=True)
    assert detector.name == name
    if name in DETECTORS:
        with pytest.raises(ValueError, match=path.name):  # no aircraft should follow a network that refuses nothing
            OnnxDetector(path)
        assert flight_from_config(RunConfig(models=Models("none", str(path)))).detector.config == detector.config
    else:
        assert OnnxDetector(path).config == detector.config
    assert detector.config == model.kind.search
    assert detector.session.config["parameters"] == runtime_parameters(model)
    grid = model.kind.grid
    view = np.random.default_rng(0).standard_normal((3, grid.height, grid.width), dtype=np.float32)
    ours, theirs = torch_infer(model)(view), detector.infer(view)
    assert (ours.columns is None) == (theirs.columns is None) == (name != "hybrid")
    for one, other in zip(ours, theirs, strict=True):
        if one is not None and other is not None:
            assert np.abs(one).max() > 1e-3, "the network must give more than zeros"
            np.testing.assert_allclose(one, other, atol=2e-3 * max(1.0, np.abs(one).max()))
