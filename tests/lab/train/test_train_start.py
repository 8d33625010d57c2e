"""First weights from an earlier training's folder or file."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from deckline.config import Engine
from deckline.runtime import load_session, shipped_weights
from deckline_lab.rivals.detectors import DETECTORS
from deckline_lab.train.checkpoint import save_checkpoint
from deckline_lab.train.dehaze import export_dehaze
from deckline_lab.train.dehaze_network import DehazeNetwork, DehazeNetworkConfig
from deckline_lab.train.detect import DetectTrainConfig, export_detect
from deckline_lab.train.line_networks import Hybrid, PyramidConfig, PyramidNetwork, Ufld
from deckline_lab.train.start import recalibrate_batch_norm, start_detector, start_with

TINY = DehazeNetworkConfig(channels=8, depths=(1, 1, 1, 1, 1), vit_layers=(1, 1, 1))


@pytest.fixture(scope="module")
def trained() -> DehazeNetwork:
    torch.manual_seed(1)
    model = DehazeNetwork(TINY)
    for value in model.parameters():  # equal ones, as fresh biases are, would be stored once
        torch.nn.init.normal_(value, std=0.05)
    return model.eval()


@pytest.fixture(scope="module")
def exported(trained: DehazeNetwork, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("start") / "dehaze.onnx"
    return export_dehaze(trained, path, asdict(TINY), 640, {}, 0)


def test_an_exported_file_gives_its_weights_back(trained: DehazeNetwork, exported: Path) -> None:
    model = DehazeNetwork(TINY)
    start_with(model, exported)
    torch.testing.assert_close(model.state_dict(), trained.state_dict(), rtol=0, atol=0)


def test_a_prior_is_ignored_at_first(trained: DehazeNetwork, exported: Path) -> None:
    model = DehazeNetwork(replace(TINY, prior=True)).eval()
    start_with(model, exported)
    image, prior = torch.rand(2, 1, 3, 48, 64)
    with torch.no_grad():
        torch.testing.assert_close(model(image, torch.cat([image, image], 1)), trained(image))
        moved = model(image, torch.cat([image, prior], 1)) - trained(image)
    assert moved.abs().max() > 1e-4, "the prior also guides the filter"


def test_a_folder_without_a_checkpoint_and_another_network_are_refused(exported: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=str(tmp_path)):
        start_with(DehazeNetwork(TINY), tmp_path)
    with pytest.raises(ValueError, match=r"ufld\.onnx"):
        start_with(DehazeNetwork(TINY), shipped_weights("ufld"))
    with pytest.raises(ValueError, match=r"dehaze\.onnx.*\(.*\).*\("):
        start_with(DehazeNetwork(replace(TINY, channels=16)), exported)


SMALL = PyramidConfig(channels=16, pretrained=False)
VIEW = torch.from_numpy(np.random.default_rng(1).standard_normal((1, 3, 288, 512), dtype=np.float32))


@pytest.mark.parametrize(("name", "build"), [("ufld", Ufld), ("hybrid", Hybrid)])
def test_a_detector_goes_on_from_its_shipped_file(name: str, build: type[PyramidNetwork]) -> None:
    path = shipped_weights(name)
    model = build(PyramidConfig(pretrained=False)).eval()
    before = model.segmentation.weight.detach().clone()
    start_detector(model, path)
    session = load_session(path, Engine(threads=1))
    theirs = dict(zip(session.output_names, session(image=VIEW.numpy()), strict=True))
    with torch.no_grad():
        ours = model(VIEW)
    for output, value in zip(model.kind.output_names, ours, strict=False):
        if output in theirs:  # an earlier file lacks the kind of edge
            np.testing.assert_allclose(value.numpy(), theirs[output], atol=2e-2 if name == "hybrid" else 5e-3)
    torch.testing.assert_close(model.segmentation.weight, before)
    assert all(torch.all(n.running_var + n.eps == 1.0) for n in model.modules() if isinstance(n, torch.nn.BatchNorm2d))


def test_settled_norms_change_nothing_but_how_training_begins():
    model = Ufld(SMALL)
    images = torch.from_numpy(np.random.default_rng(2).standard_normal((2, 3, 288, 512), dtype=np.float32))
    with torch.no_grad():
        before = model.eval()(images)
        recalibrate_batch_norm(model, images)
        after, training = model(images), model.train()(images)
    torch.testing.assert_close(after.rows, before.rows, atol=1e-3, rtol=1e-3)
    torch.testing.assert_close(training.rows, before.rows, atol=5e-2, rtol=5e-2)


def test_a_training_folder_is_a_start_too(tmp_path):
    first, averaged, second = Ufld(SMALL), Ufld(SMALL), Ufld(SMALL)
    save_checkpoint(tmp_path, first, torch.optim.SGD(first.parameters(), 0.1), dict(averaged.state_dict()), {})
    start_detector(second, tmp_path)
    torch.testing.assert_close(second.state_dict(), averaged.state_dict())


def test_files_of_other_networks_are_refused(tmp_path):
    path = export_detect(Ufld(SMALL).eval(), tmp_path / "small.onnx", {}, 0)
    (tmp_path / "text.onnx").write_text("no network")
    with pytest.raises(ValueError, match=r"small\.onnx: .*hybrid and ufld"):
        start_detector(DETECTORS["enet-sad"](DetectTrainConfig()), path)
    for source in (shipped_weights("ufld"), shipped_weights("coarse-t"), tmp_path, tmp_path / "text.onnx"):
        with pytest.raises(ValueError, match=str(source)):
            start_detector(Ufld(SMALL), source)
