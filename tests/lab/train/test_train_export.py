"""ONNX export: metadata, dynamic axes, the manifest block that describes a file; costs against sums done by hand."""

import argparse
import json
import re
import runpy
import tomllib
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from torch import nn

from deckline.config import Engine
from deckline.dehaze import OnnxDehazer
from deckline.runtime import load_session, shipped_models, shipped_weights
from deckline_lab.train.export import NetworkCost, count_parameters, export_onnx, network_cost


def test_export_fixes_the_size_and_leaves_the_model_training_and_no_part_file(tmp_path: Path) -> None:
    model = torch.nn.ReLU()
    path = export_onnx(model, (torch.rand(1, 4),), tmp_path / "new" / "relu.onnx", ["x"], ["y"], None, {})
    assert model.training
    assert [item.name for item in path.parent.iterdir()] == ["relu.onnx"]
    with pytest.raises(ValueError, match=r"relu\.onnx.*5"):
        load_session(path, Engine(threads=1))(x=np.zeros((1, 5), dtype=np.float32))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_page_exports_a_network_that_dehazes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[3] / "docs" / "how" / "network.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(re.findall(r"```python\n(.*?)```", page, re.DOTALL)[1], {"__name__": "page"})
    dehazer = OnnxDehazer(tmp_path / "mine.onnx", engine=Engine(threads=1))
    image = np.random.default_rng(0).integers(0, 256, (37, 51, 3), dtype=np.uint8)
    wanted = np.rint(np.clip((image / 255 - 0.1) / 0.9, 0, 1) * 255)
    assert np.abs(dehazer(image) - wanted).max() <= 1


DAMAGED = (
    {"working_long_side_px": 640},
    {"network": {"unshuffle": 1}},
    {"working_long_side_px": 640, "network": {}},
    {"working_long_side_px": "wide", "network": {"unshuffle": 1}},
    {"working_long_side_px": 640, "network": 3},
)


@pytest.mark.parametrize("metadata", DAMAGED)
def test_a_dehazer_without_its_metadata_is_named(tmp_path: Path, metadata: dict[str, object]) -> None:
    args = (torch.rand(1, 3, 64, 64),)
    path = export_onnx(
        nn.ReLU(), args, tmp_path / "mine.onnx", ["image"], ["clear"], None, {"kind": "dehaze", **metadata}
    )
    with pytest.raises(ValueError, match=r"mine\.onnx.*(Key|Type|Value)Error\("):
        OnnxDehazer(path)


class PaddedConvolution(torch.nn.Conv2d):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(torch.nn.functional.pad(x, [0, 1, 0, 1]))


def test_no_node_ends_with_an_empty_input(tmp_path: Path) -> None:
    args = (torch.rand(1, 3, 8, 8),)
    path = export_onnx(PaddedConvolution(3, 4, 3), args, tmp_path / "pad.onnx", ["x"], ["y"], None, {})
    nodes = onnx.load(str(path)).graph.node
    assert [len(node.input) for node in nodes if node.op_type == "Pad"] == [2]
    assert all(node.input[-1] for node in nodes if node.input)


def test_shipping_replaces_one_entry_and_keeps_the_others(tmp_path: Path) -> None:
    ship = runpy.run_path(str(Path(__file__).parents[3] / "scripts" / "ship_weights.py"))["ship"]
    weights = tmp_path / "weights"
    weights.mkdir()
    (weights / "manifest.toml").write_text("# head\n")
    figures = tmp_path / "figures.json"
    for name, step in (("a", 1), ("b", 2), ("a", 3)):
        figures.write_text(json.dumps({"psnr_db.mean": 20.123456 + step}))
        metadata = {"kind": "test", "recipe": {"seed": 7}, "step": step}
        model = export_onnx(torch.nn.ReLU(), (torch.rand(1, 4),), tmp_path / "m.onnx", ["x"], ["y"], None, metadata)
        keys = {"name": name, "command": 'deckline train "a b"', "data": "d", "hardware": "h"}
        ship(argparse.Namespace(model=model, figures=figures, **keys), weights)
    models = shipped_models(weights)
    assert {name: (model.steps, model.seed) for name, model in models.items()} == {"b": (2, 7), "a": (3, 7)}
    assert models["a"].figures == {"psnr_db.mean": 23.1235}
    entries = tomllib.loads((weights / "manifest.toml").read_text())["model"]
    assert {entry["command"] for entry in entries} == {'deckline train "a b"'}
    assert shipped_weights("a", weights) == weights / "a.onnx"
    assert (weights / "manifest.toml").read_text().startswith("# head\n")


class Gram(nn.Module):
    """One matrix product."""

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        tokens = image.flatten(2)
        return tokens @ tokens.transpose(1, 2)


@pytest.mark.parametrize(
    ("model", "parameters", "macs"),
    [
        (nn.Conv2d(3, 8, 3, padding=1, stride=2), 8 * 27 + 8, 5 * 6 * 8 * 27),  # once an output pixel
        (nn.Conv2d(3, 3, 5, padding=2, groups=3), 3 * 25 + 3, 10 * 12 * 3 * 25),
        (nn.ConvTranspose2d(3, 5, 4, stride=2, padding=1, bias=False), 3 * 5 * 16, 10 * 12 * 3 * 5 * 16),  # input pixel
        (Gram(), 0, 3 * 3 * 120),
    ],
)
def test_costs_are_counted_by_hand(model: nn.Module, parameters: int, macs: int) -> None:
    assert network_cost(model, (10, 12)) == NetworkCost(parameters, macs)
    assert model.training and all(value.device.type == "cpu" for value in model.parameters())


def test_tied_weights_count_once() -> None:
    layer = nn.Conv2d(3, 3, 1, bias=False)
    model = nn.Sequential(layer, layer)
    assert count_parameters(model) == 9
    assert network_cost(model).macs == 2 * 256 * 256 * 9  # at the papers' size
