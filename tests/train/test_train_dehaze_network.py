"""The dehazing network: its size, its blocks against their formulas, and torch against ONNX."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from deckline.dehaze import OnnxDehazer
from deckline.dehaze.network_io import averaged_down, image_to_tensor, padded
from deckline.haze import add_haze, beta_from_visibility
from deckline.train.dehaze_blocks import SeparableSelfAttention, SKFusion, fold, unfold
from deckline.train.dehaze_finish import export_dehaze
from deckline.train.dehaze_network import (
    SIZES,
    DehazeNetwork,
    DehazeNetworkConfig,
    linear_in_guide,
    luma,
    network_metadata,
)
from deckline.train.network_cost import count_parameters, network_cost
from deckline.train.rivals import build

PAPER_LIMITS = {"t": 484_000, "s": 905_000, "b": 1_774_000}  # SPEC section 1
TINY = DehazeNetworkConfig(channels=8, depths=(1, 1, 1, 1, 1), vit_layers=(1, 1, 1))


def network(config: DehazeNetworkConfig, seed: int = 0) -> DehazeNetwork:
    """A network whose head says something: freshly built ones return their input."""
    torch.manual_seed(seed)
    model = DehazeNetwork(config).eval()
    torch.nn.init.normal_(model.head[1].weight, std=0.05)
    return model


@pytest.mark.parametrize("unshuffle", [1, 4])
@pytest.mark.parametrize("size", list(SIZES))
def test_parameters_stay_under_the_papers(size: str, unshuffle: int) -> None:
    count = count_parameters(DehazeNetwork(replace(SIZES[size], unshuffle=unshuffle)))
    assert 0.8 * PAPER_LIMITS[size] < count <= PAPER_LIMITS[size]


def test_coarse_grid_costs_a_sixteenth() -> None:
    macs = [network_cost(DehazeNetwork(replace(SIZES["t"], unshuffle=unshuffle))).macs for unshuffle in (1, 4)]
    assert macs[0] < network_cost(build("dehaze-former-t")).macs
    assert macs[1] < macs[0] / 12


@pytest.mark.parametrize("unshuffle", [1, 4])
def test_untrained_network_returns_its_input(unshuffle: int) -> None:
    torch.manual_seed(0)
    image = torch.rand(2, 3, 45, 70)
    with torch.no_grad():
        torch.testing.assert_close(DehazeNetwork(replace(TINY, unshuffle=unshuffle))(image), image)


def test_soft_reconstruction() -> None:
    """With K and B held constant by the head's bias the output is K I - B + I, whatever the way up."""
    image = torch.rand(1, 3, 33, 50)
    bias = torch.tensor([0.5, 0.1, 0.2, 0.3])
    for unshuffle in (1, 4):
        model = DehazeNetwork(replace(TINY, unshuffle=unshuffle))
        model.head[1].bias.data = bias
        with torch.no_grad():
            torch.testing.assert_close(model(image), 1.5 * image - bias[1:].reshape(1, 3, 1, 1), atol=1e-4, rtol=0)


@pytest.mark.parametrize("unshuffle", [1, 4])
@pytest.mark.parametrize("size", [(32, 32), (33, 50), (64, 97), (101, 39)])
def test_any_size(unshuffle: int, size: tuple[int, int]) -> None:
    with torch.no_grad():
        assert network(replace(TINY, unshuffle=unshuffle))(torch.rand(1, 3, *size)).shape == (1, 3, *size)


def test_unfold_and_fold() -> None:
    x = torch.arange(2 * 3 * 4 * 6, dtype=torch.float32).reshape(2, 3, 4, 6)
    tokens = unfold(x)
    assert tokens.shape == (2, 3, 4, 6)
    torch.testing.assert_close(tokens[0, 0, :, 0], torch.tensor([0.0, 1.0, 6.0, 7.0]))  # the top-left 2x2 patch
    torch.testing.assert_close(fold(tokens, 4, 6), x)


def test_separable_attention_is_its_formula() -> None:
    torch.manual_seed(1)
    layer = SeparableSelfAttention(5).eval()
    x = torch.randn(1, 5, 4, 7)
    tokens = x[0, :, 2].T  # (7, 5): the tokens of pixel 2
    scores, key, value = (tokens @ layer.maps.weight[:, :, 0, 0].T + layer.maps.bias).split([1, 5, 5], 1)
    context = (torch.softmax(scores, 0) * key).sum(0)
    expected = (context * torch.relu(value)) @ layer.out.weight[:, :, 0, 0].T + layer.out.bias
    with torch.no_grad():
        torch.testing.assert_close(layer(x)[0, :, 2].T, expected)


def test_attention_ignores_the_order_of_tokens() -> None:
    layer = SeparableSelfAttention(5).eval()
    x, order = torch.randn(1, 5, 4, 9), torch.randperm(9)
    with torch.no_grad():
        torch.testing.assert_close(layer(x)[..., order], layer(x[..., order]))


def test_selective_kernel_fusion_weighs_two_branches() -> None:
    layer, a = SKFusion(6).eval(), torch.randn(1, 6, 5, 5)
    with torch.no_grad():
        torch.testing.assert_close(layer(a, a), a)
        logits = layer.weights((a + 2 * a).mean((2, 3), keepdim=True)).reshape(2, 6)
        share = torch.softmax(logits, 0)
        expected = a * share[0].reshape(1, 6, 1, 1) + 2 * a * share[1].reshape(1, 6, 1, 1)
        torch.testing.assert_close(layer(a, 2 * a), expected)


def test_linear_in_guide_finds_a_line() -> None:
    guide = torch.rand(1, 1, 12, 17)
    slope, offset = linear_in_guide(2.5 * guide - 0.5, guide, torch.tensor(1e-9), 1)
    torch.testing.assert_close(slope, torch.full_like(slope, 2.5), atol=1e-2, rtol=0)
    torch.testing.assert_close(offset, torch.full_like(offset, -0.5), atol=1e-2, rtol=0)


def test_working_image_of_a_smooth_view_changes_little() -> None:
    """Estimating on the image averaged down by two gives what a smooth view's own estimate would, magnified."""
    model = network(TINY)
    coarse = torch.rand(1, 3, 6, 8)
    full = torch.nn.functional.interpolate(coarse, (192, 256), mode="bicubic")
    half = torch.nn.functional.avg_pool2d(full, 2)
    with torch.no_grad():
        by_working, of_half = model(full, half), model(half)
    difference = torch.nn.functional.avg_pool2d(by_working, 2) - of_half
    assert difference.abs().mean() < 0.01 * (of_half - half).abs().mean()


def frame_like(height: int, width: int) -> np.ndarray:
    """Dark sea and a striped deck under haze, uint8."""
    rng = np.random.default_rng(0)
    clear = rng.normal(60, 15, (height, width, 3)).clip(0, 255).astype(np.uint8)
    clear[height // 2 :, width // 3 : width // 2] = 90
    clear[height // 2 :, width // 3 : width // 3 + 4] = 230
    ranges = np.linspace(2000, 50, height)[:, None] + np.zeros((1, width))
    return add_haze(clear, ranges, beta_from_visibility(800.0), (180, 190, 200))


@pytest.mark.parametrize("config", [SIZES["t"], replace(TINY, unshuffle=1)], ids=["coarse", "full resolution"])
def test_torch_and_onnx_agree(config: DehazeNetworkConfig, tmp_path: Path) -> None:
    """At most one grey level apart, at sizes the export never saw, odd ones too."""
    model = network(config)
    dehazer = OnnxDehazer(
        export_dehaze(model, tmp_path / "net.onnx", network_metadata(config), 128, {"lr": 1.0}, 7), threads=1
    )
    assert dehazer.session.config["network"]["channels"] == config.channels
    assert (dehazer.session.config["recipe"], dehazer.session.config["step"]) == ({"lr": 1.0}, 7)
    for height, width, factor in [(72, 128, 1), (75, 131, 1), (144, 257, 2), (201, 380, 3)]:
        image = frame_like(height, width)
        full = image_to_tensor(padded(image, 4 * factor if dehazer.coarse else 1))
        inputs = (full, averaged_down(full, factor)) if dehazer.coarse else (full,)
        with torch.no_grad():
            expected = model(*map(torch.from_numpy, inputs))[0, :, :height, :width].permute(1, 2, 0).numpy()
        expected = (255 * expected).clip(0, 255)
        assert np.abs(expected - image).max() > 20, "the network must do something for the comparison to mean anything"
        assert np.abs(dehazer(image) - expected).max() <= 1.0


def test_luma_weights_sum_to_one() -> None:
    torch.testing.assert_close(luma(torch.full((1, 3, 2, 2), 0.7)), torch.full((1, 1, 2, 2), 0.7))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"channels": 0}, "channels, unshuffle and guide_radius must be at least 1, got 0"),
        ({"depths": (1, 1)}, r"need 5 depths and 3 vit_layers, got \(1, 1\)"),
        ({"spatial_kernel": 4}, "spatial_kernel must be odd, got 4"),
    ],
)
def test_config_errors(keys: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DehazeNetworkConfig(**keys)


def test_full_resolution_network_takes_no_working_image() -> None:
    with pytest.raises(ValueError, match="give no working image"):
        DehazeNetwork(replace(TINY, unshuffle=1))(torch.rand(1, 3, 32, 32), torch.rand(1, 3, 32, 32))
