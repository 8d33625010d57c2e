"""Every compared dehazer: its published size, any image size, learning, torch against ONNX, and training as ours."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import nn

from clear_scene import QUICK, clear_frame, clear_recording, striped_deck
from deckline.config import Engine
from deckline.dehaze import OnnxDehazer
from deckline.dehaze.tensors import image_to_tensor, pad
from deckline_lab.rivals.dehazers import DEHAZERS, RIVALS
from deckline_lab.train.checkpoint import read_tensors
from deckline_lab.train.dehaze import NETWORKS, DehazeTrainConfig, dehaze_loss, export_dehaze, train_dehaze
from deckline_lab.train.export import network_cost

# Parameters and MACs at 256x256 that were published: AOD-Net, GCANet and GridDehazeNet as tabulated by Song et al. 2023
# (DehazeFormer), gUNet-T by Song et al. 2022.
PUBLISHED = {
    "aod-net": (0.00176e6, 0.115e9),
    "gca-net": (0.702e6, 18.41e9),
    "grid-dehaze-net": (0.956e6, 21.49e9),
    "g-unet-t": (0.805e6, 2.60e9),
    "dehaze-former-t": (0.686e6, 6.658e9),
}


def perturb(name: str) -> nn.Module:
    """A network that does something: two of the fresh ones return their input, or nearly."""
    torch.manual_seed(0)
    model = DEHAZERS[name](None).eval()
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for value in model.parameters():
            value += 0.02 * torch.randn(value.shape, generator=generator)
    return model


def macs_of_transposed(model: nn.Module) -> int:
    """MACs at 256x256 when every weight of a transposed convolution is charged at every pixel of its output."""
    macs = []
    for layer in model.modules():
        if isinstance(layer, nn.ConvTranspose2d):
            layer.register_forward_hook(lambda one, _, out: macs.append(one.weight.numel() * out[0, 0].numel()))
    with torch.no_grad():
        model.to("meta")(torch.empty(1, 3, 256, 256, device="meta"))
    return sum(macs)


@pytest.mark.parametrize("name", list(PUBLISHED))
def test_size_is_the_published_one(name: str) -> None:
    cost = network_cost(DEHAZERS[name](None))
    parameters, macs = PUBLISHED[name]
    assert cost.parameters == pytest.approx(parameters, rel=0.05)
    by_output = macs_of_transposed(DEHAZERS[name](None))
    # The published counts charge transposed convolutions, all with stride 2, four times what they compute.
    assert cost.macs + by_output * 3 / 4 == pytest.approx(macs, rel=0.03 if by_output else 0.07)


@pytest.mark.parametrize("name", list(DEHAZERS))
@pytest.mark.parametrize("size", [(1, 1), (33, 50)])
def test_any_size_on_any_batch(name: str, size: tuple[int, int]) -> None:
    model = perturb(name)
    image = torch.rand(2, 3, *size)
    before = image.clone()
    with torch.no_grad():
        clear = model(image)
        assert clear.shape == (2, 3, *size)
        assert torch.isfinite(clear).all()
        torch.testing.assert_close(clear, model(image), rtol=0, atol=0)
        torch.testing.assert_close(clear[1:], model(image[1:]), rtol=1e-4, atol=1e-4)  # images of a batch do not meet
    torch.testing.assert_close(image, before, rtol=0, atol=0)


@pytest.mark.parametrize("name", list(DEHAZERS))
def test_one_step_lowers_the_loss_and_every_weight_learns(name: str) -> None:
    torch.manual_seed(0)
    hazy, clear = (torch.from_numpy(image_to_tensor(image)) for image in striped_deck(40, 48))
    model = DEHAZERS[name](None).train()
    optimizer = torch.optim.AdamW(model.parameters(), DehazeTrainConfig().lr)
    losses = []
    for _ in range(2):
        losses.append(dehaze_loss(model(hazy), clear, torch.ones(1, 1, 40, 48), 0.5))
        losses[-1].backward()
        optimizer.step()
    assert losses[1].item() < losses[0].item() - 1e-3
    model = perturb(name).train()
    (model(torch.rand(2, 3, 40, 48)) ** 2).mean().backward()
    idle = [key for key, value in model.named_parameters() if value.grad is None or not value.grad.abs().max() > 0]
    assert idle == []


@pytest.mark.parametrize("name", list(DEHAZERS))
def test_torch_and_onnx_agree(name: str, tmp_path: Path) -> None:
    """At most one grey level apart, at sizes the export never saw."""
    model = perturb(name)
    network = {"name": name, "unshuffle": 1} | getattr(model, "grid", {})
    dehazer = OnnxDehazer(
        export_dehaze(model, tmp_path / "net.onnx", network, 640, {"lr": 1.0}, 7), engine=Engine(threads=1)
    )
    assert dehazer.coarse == name.endswith("-coarse")
    assert dehazer.session.config["network"] == network
    for height, width in [(5, 40), (75, 131)]:
        image, _ = striped_deck(height, width)
        with torch.no_grad():
            whole = pad(image, dehazer.grid_px, dehazer.min_side_px)
            expected = model(torch.from_numpy(image_to_tensor(whole)))[0, :, :height, :width]
        expected = (255 * expected.permute(1, 2, 0).numpy()).clip(0, 255)
        assert np.abs(expected - image).max() > 3, "the network must do something for the comparison to mean anything"
        assert np.abs(dehazer(image) - expected).max() <= 1.0


@pytest.mark.parametrize("name", RIVALS)
def test_a_coarse_grid_holds_k_and_b(name: str) -> None:
    """Untrained: the input. With K and B held by the last bias: K I - B + I, from a picture averaged down, too."""
    model, image = DEHAZERS[f"{name}-coarse"](None).eval(), torch.rand(1, 3, 72, 104)
    last = [layer for layer in model.modules() if isinstance(layer, nn.Conv2d)][-1]
    with torch.no_grad():
        torch.testing.assert_close(model(image), image)
        last.bias.copy_(torch.tensor([0.5, 0.1, 0.2, 0.3]))
        expected = 1.5 * image - torch.tensor([0.1, 0.2, 0.3]).reshape(1, 3, 1, 1)
        for working in (None, F.avg_pool2d(image, 2)):
            torch.testing.assert_close(model(image, working), expected, atol=1e-4, rtol=0)


AOD = replace(QUICK, network="aod-net", steps=6)
train_rival = partial(train_dehaze, networks=NETWORKS | DEHAZERS)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clear_recording(tmp_path_factory.mktemp("clear"), frames=8)


def test_a_trained_network_is_exported_with_its_averaged_weights(recording: Path, tmp_path: Path) -> None:
    figures = train_rival(replace(AOD, steps=60, lr=3e-2), [recording], tmp_path)
    assert all(np.isfinite(value) for value in figures.values())
    assert figures["psnr_db_surface.mean"] > figures["psnr_db_surface_hazy.mean"] + 0.5
    model, image = DEHAZERS["aod-net"](None), clear_frame(3).image_rgb
    model.load_state_dict(read_tensors(tmp_path, "ema"))
    with torch.no_grad():
        expected = 255 * model(torch.from_numpy(image_to_tensor(image)))[0].permute(1, 2, 0).numpy()
    assert np.abs(expected.clip(0, 255) - image).max() > 20, "training must have changed what it does"
    assert np.abs(OnnxDehazer(tmp_path / "dehaze.onnx")(image) - expected.clip(0, 255)).max() <= 1.0
