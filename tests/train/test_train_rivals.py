"""Every comparison network: its published size, any image size, learning, and torch against ONNX."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
from torch import nn

from deckline.dehaze import OnnxDehazer
from deckline.dehaze.network import image_to_tensor, pad
from deckline.haze import add_haze, beta_from_visibility
from deckline.train.dehaze import DehazeTrainConfig, Network, dehaze_loss
from deckline.train.dehaze_finish import export_dehaze
from deckline.train.network_cost import network_cost
from deckline.train.rivals import RIVALS, build

# Parameters and MACs at 256x256 that were published: AOD-Net, GCANet and GridDehazeNet as tabulated by Song et al. 2023
# (DehazeFormer), gUNet-T by Song et al. 2022.
PUBLISHED = {
    "aod-net": (0.00176e6, 0.115e9),
    "gca-net": (0.702e6, 18.41e9),
    "grid-dehaze-net": (0.956e6, 21.49e9),
    "g-unet-t": (0.805e6, 2.60e9),
    "dehaze-former-t": (0.686e6, 6.658e9),
}


def perturbed(name: str) -> nn.Module:
    """A network that does something: two of the fresh ones return their input, or nearly."""
    torch.manual_seed(0)
    model = build(name).eval()
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for value in model.parameters():
            value += 0.02 * torch.randn(value.shape, generator=generator)
    return model


def hazy_and_clear(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Dark sea and a striped deck, under haze and without it, uint8."""
    rng = np.random.default_rng(0)
    clear = rng.normal(60, 15, (height, width, 3)).clip(0, 255).astype(np.uint8)
    clear[height // 2 :, width // 3 : width // 2] = 90
    clear[height // 2 :, width // 3 : width // 3 + 4] = 230
    ranges = np.linspace(2000, 50, height)[:, None] + np.zeros((1, width))
    return add_haze(clear, ranges, beta_from_visibility(800.0), (180, 190, 200)), clear


def macs_of_transposed(model: nn.Module) -> int:
    """MACs at 256x256 when every weight of a transposed convolution is charged at every pixel of its output."""
    macs = []

    def count(layer: nn.ConvTranspose2d, inputs: tuple[torch.Tensor, ...], output: torch.Tensor) -> None:
        macs.append(layer.weight.numel() * output.shape[2] * output.shape[3])

    for layer in model.modules():
        if isinstance(layer, nn.ConvTranspose2d):
            layer.register_forward_hook(count)
    with torch.no_grad():
        model.to("meta")(torch.empty(1, 3, 256, 256, device="meta"))
    return sum(macs)


@pytest.mark.parametrize("name", list(RIVALS))
def test_size_is_the_published_one(name: str) -> None:
    cost = network_cost(build(name))
    parameters, macs = PUBLISHED[name]
    assert cost.parameters == pytest.approx(parameters, rel=0.05)
    by_output = macs_of_transposed(build(name))
    # The published counts charge transposed convolutions, all with stride 2, four times what they compute.
    assert cost.macs + by_output * 3 / 4 == pytest.approx(macs, rel=0.03 if by_output else 0.07)


@pytest.mark.parametrize("name", list(RIVALS))
@pytest.mark.parametrize("size", [(1, 1), (33, 50), (64, 97)])
def test_any_size_on_any_batch(name: str, size: tuple[int, int]) -> None:
    model = perturbed(name)
    image = torch.rand(2, 3, *size)
    before = image.clone()
    with torch.no_grad():
        clear = model(image)
        assert clear.shape == (2, 3, *size)
        assert torch.isfinite(clear).all()
        torch.testing.assert_close(clear, model(image), rtol=0, atol=0)
        torch.testing.assert_close(clear[1:], model(image[1:]), rtol=1e-4, atol=1e-4)  # images of a batch do not meet
    torch.testing.assert_close(image, before, rtol=0, atol=0)


@pytest.mark.parametrize("name", list(RIVALS))
def test_one_step_lowers_the_loss(name: str) -> None:
    torch.manual_seed(0)
    hazy, clear = (torch.from_numpy(image_to_tensor(image)) for image in hazy_and_clear(40, 48))
    model = build(name).train()
    optimizer = torch.optim.AdamW(model.parameters(), DehazeTrainConfig().lr)

    def loss() -> torch.Tensor:
        return dehaze_loss(model(hazy), clear, torch.ones(1, 1, 40, 48), 0.5)

    before = loss()
    before.backward()
    optimizer.step()
    with torch.no_grad():
        assert loss().item() < before.item() - 1e-3


@pytest.mark.parametrize("name", list(RIVALS))
def test_every_weight_learns(name: str) -> None:
    model = perturbed(name).train()
    (model(torch.rand(2, 3, 40, 48)) ** 2).mean().backward()
    idle = [key for key, value in model.named_parameters() if value.grad is None or not value.grad.abs().max() > 0]
    assert idle == []


@pytest.mark.parametrize("name", list(RIVALS))
def test_torch_and_onnx_agree(name: str, tmp_path: Path) -> None:
    """At most one grey level apart, at sizes the export never saw."""
    model = perturbed(name)
    network = {"name": name, "unshuffle": 1}
    dehazer = OnnxDehazer(export_dehaze(model, tmp_path / "net.onnx", network, 640, {"lr": 1.0}, 7), threads=1)
    assert not dehazer.coarse
    assert dehazer.session.config["network"] == network
    for height, width in [(5, 40), (75, 131)]:
        image, _ = hazy_and_clear(height, width)
        with torch.no_grad():
            expected = model(torch.from_numpy(image_to_tensor(pad(image, 1))))[0, :, :height, :width]
        expected = (255 * expected.permute(1, 2, 0).numpy()).clip(0, 255)
        assert np.abs(expected - image).max() > 3, "the network must do something for the comparison to mean anything"
        assert np.abs(dehazer(image) - expected).max() <= 1.0


def test_the_recipe_offers_them_all() -> None:
    assert set(get_args(Network)) == {"deckline", *RIVALS}


def test_builders_make_new_networks() -> None:
    assert build("aod-net") is not build("aod-net")
    with pytest.raises(ValueError, match="unknown network 'ffa-net': use one of aod-net, gca-net"):
        build("ffa-net")
