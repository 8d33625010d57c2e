"""First weights from an earlier training, whatever it was kept in."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from deckline.runtime import shipped_weights
from deckline.train.checkpoint import save_checkpoint
from deckline.train.dehaze_finish import export_dehaze
from deckline.train.dehaze_network import DehazeNetwork, DehazeNetworkConfig, network_metadata
from deckline.train.start import start_with

TINY = DehazeNetworkConfig(channels=8, depths=(1, 1, 1, 1, 1), vit_layers=(1, 1, 1))


@pytest.fixture(scope="module")
def trained() -> DehazeNetwork:
    torch.manual_seed(1)
    model = DehazeNetwork(TINY)
    for value in model.parameters():  # equal ones, as fresh biases are, would be kept once in the file
        torch.nn.init.normal_(value, std=0.05)
    return model.eval()


@pytest.fixture(scope="module")
def exported(trained: DehazeNetwork, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("start") / "dehaze.onnx"
    return export_dehaze(trained, path, network_metadata(TINY), 640, {}, 0)


def test_an_exported_file_gives_its_weights_back(trained: DehazeNetwork, exported: Path) -> None:
    model = DehazeNetwork(TINY)
    start_with(model, exported)
    for name, value in trained.state_dict().items():
        torch.testing.assert_close(model.state_dict()[name], value, rtol=0, atol=0)


def test_a_prior_is_ignored_at_first(trained: DehazeNetwork, exported: Path) -> None:
    model = DehazeNetwork(replace(TINY, prior=True)).eval()
    start_with(model, exported)
    image, prior = torch.rand(2, 1, 3, 48, 64)
    with torch.no_grad():
        torch.testing.assert_close(model(image, torch.cat([image, image], 1)), trained(image))
        moved = model(image, torch.cat([image, prior], 1)) - trained(image)
    assert moved.abs().max() > 1e-4, "the prior also guides the filter"


def test_averaged_weights_of_a_checkpoint_come_first(trained: DehazeNetwork, tmp_path: Path) -> None:
    other = DehazeNetwork(TINY)
    save_checkpoint(tmp_path, other, torch.optim.AdamW(other.parameters()), dict(trained.state_dict()), {})
    model = DehazeNetwork(TINY)
    start_with(model, tmp_path)
    torch.testing.assert_close(model.head[1].weight, trained.head[1].weight)


def test_errors(exported: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds no checkpoint to start from"):
        start_with(DehazeNetwork(TINY), tmp_path)
    with pytest.raises(ValueError, match="holds the weights of another network: it has no "):
        start_with(DehazeNetwork(TINY), shipped_weights("detect"))
    with pytest.raises(ValueError, match=r"has shape \(.*\), expected \("):
        start_with(DehazeNetwork(replace(TINY, channels=16)), exported)
    (tmp_path / "checkpoint.safetensors").write_bytes(b"nonsense")
    with pytest.raises(ValueError, match="is not a deckline checkpoint"):
        start_with(DehazeNetwork(TINY), tmp_path)
