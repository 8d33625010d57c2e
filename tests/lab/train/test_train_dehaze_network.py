"""The dehazing network: its size, its blocks against their formulas, and torch against ONNX."""

import json
import re
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from clear_scene import striped_deck
from deckline.config import Engine
from deckline.dehaze import GeometryDehazer, OnnxDehazer
from deckline.dehaze.by_pose import GeometrySolution
from deckline.dehaze.haze_fit import HazeFit, NotFitted
from deckline.dehaze.pixel_map import PixelMap
from deckline.dehaze.tensors import average_down, image_to_tensor, pad
from deckline.geometry import Camera
from deckline.types import Frame
from deckline_lab.train.dehaze import export_dehaze
from deckline_lab.train.dehaze_blocks import (
    PooledSelfAttention,
    SeparableSelfAttention,
    SKFusion,
    fold,
    unfold,
)
from deckline_lab.train.dehaze_network import (
    SHAPES,
    DehazeNetwork,
    DehazeNetworkConfig,
    linear_in_guide,
)
from deckline_lab.train.export import count_parameters, network_cost

PAPER_LIMITS = {"t": 484_000, "s": 905_000, "b": 1_774_000}  # Li et al. 2024, section 4.1.2
DEHAZE_FORMER_MACS = 6.66e9  # published (Song et al. 2023); the compared network has 6.64e9
TINY = DehazeNetworkConfig(channels=8, depths=(1, 1, 1, 1, 1), vit_layers=(1, 1, 1))
variants = pytest.mark.parametrize(
    ("attention", "transformer"), list(product(("mix", "depthwise"), ("mobilevit", "plain")))
)


def network(config: DehazeNetworkConfig, seed: int = 0) -> DehazeNetwork:
    """A network with a random head: a freshly built one returns its input."""
    torch.manual_seed(seed)
    model = DehazeNetwork(config).eval()
    torch.nn.init.normal_(model.head[1].weight, std=0.05)
    return model


def test_costs_stay_under_the_papers_and_the_coarse_grid_costs_a_sixteenth() -> None:
    for name, shape in SHAPES.items():
        limit = PAPER_LIMITS[name[-1]]
        assert 0.8 * limit < count_parameters(DehazeNetwork(shape)) <= limit
    full, coarse = (network_cost(DehazeNetwork(SHAPES[name])).macs for name in ("full-t", "coarse-t"))
    assert full < DEHAZE_FORMER_MACS
    assert coarse < full / 12


@pytest.mark.parametrize("unshuffle", [1, 4])
@variants
def test_ablated_networks_are_about_as_large(attention, transformer, unshuffle: int) -> None:
    """So that Table 5 compares kinds of blocks, not sizes."""
    whole = replace(SHAPES["coarse-t"], unshuffle=unshuffle)
    ablated = replace(whole, attention=attention, transformer=transformer)
    count, full = (count_parameters(DehazeNetwork(config)) for config in (ablated, whole))
    assert count == pytest.approx(full, rel=0.05)


@pytest.mark.parametrize("unshuffle", [1, 4])
@variants
@pytest.mark.parametrize("size", [(33, 50), (64, 97), (101, 39)])
def test_ablated_networks_take_any_size_and_learn_in_every_weight(attention, transformer, unshuffle, size) -> None:
    config = replace(TINY, unshuffle=unshuffle, attention=attention, transformer=transformer)
    unreached = {name for name, _ in network(config).named_parameters()}
    for seed in (0, 1):  # the few ReLUs of one small SKFusion may all be shut at the start, by chance
        model = network(config, seed)
        out = model(torch.rand(2, 3, *size))
        assert out.shape == (2, 3, *size)
        out.square().mean().backward()
        unreached -= {name for name, p in model.named_parameters() if p.grad is not None and p.grad.abs().max() > 0}
    assert unreached == ({"log_guide_eps"} if unshuffle == 1 else set())  # no guided filter at full resolution


@pytest.mark.parametrize("unshuffle", [1, 4])
def test_soft_reconstruction(unshuffle: int) -> None:
    """Untrained: the input. With K and B held constant by the head's bias: K I - B + I."""
    image, bias = torch.rand(2, 3, 33, 50), torch.tensor([0.5, 0.1, 0.2, 0.3])
    model = DehazeNetwork(replace(TINY, unshuffle=unshuffle))
    with torch.no_grad():
        torch.testing.assert_close(model(image), image)
        model.head[1].bias.data = bias
        torch.testing.assert_close(model(image), 1.5 * image - bias[1:].reshape(1, 3, 1, 1), atol=1e-4, rtol=0)


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


@pytest.mark.parametrize("pool", [1, 2])
def test_pooled_attention_is_its_formula(pool: int) -> None:
    torch.manual_seed(1)
    layer, x = PooledSelfAttention(6, heads=2, pool=pool).eval(), torch.randn(1, 6, 4, 8)
    means = x.reshape(1, 6, 4 // pool, pool, 8 // pool, pool).mean((3, 5))
    queries, sources = x[0].flatten(1).T, means[0].flatten(1).T
    with torch.no_grad():
        query = queries @ layer.query.weight[:, :, 0, 0].T + layer.query.bias
        key, value = (sources @ layer.key_value.weight[:, :, 0, 0].T).split(6, 1)
        heads = []
        for part in (slice(0, 3), slice(3, 6)):
            share = torch.softmax(query[:, part] @ key[:, part].T / 3**0.5, 1)
            heads.append(share @ value[:, part])
        expected = torch.cat(heads, 1) @ layer.out.weight[:, :, 0, 0].T + layer.out.bias
        torch.testing.assert_close(layer(x)[0].flatten(1).T, expected)


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


class Halved(GeometryDehazer):
    """Stands for a geometry that knows the air of every frame: half as bright without it."""

    def solve(self, frame: Frame) -> GeometrySolution | NotFitted:
        haze = HazeFit(np.full(3, 200.0), 1e-3, 0.0, 0.0, np.zeros((2, 3)))
        size = frame.image_rgb.shape[:2]
        half, zero = np.full(size, 0.5, np.float32), np.zeros((3, *size), np.float32)
        return GeometrySolution(haze, PixelMap(half, half, zero), np.zeros(size, np.float32))


BASELINE = {"attention": "depthwise", "transformer": "plain"}


@pytest.mark.parametrize(
    "config",
    [
        SHAPES["coarse-t"],
        replace(SHAPES["coarse-t"], **BASELINE),
        replace(TINY, unshuffle=1),
        replace(TINY, unshuffle=1, **BASELINE),
        replace(TINY, prior=True),
    ],
    ids=["coarse", "coarse baseline", "full", "full baseline", "prior"],
)
def test_torch_and_onnx_agree(config: DehazeNetworkConfig, tmp_path: Path) -> None:
    """At most one grey level apart, at sizes the export never saw, odd ones too."""
    model, coarse = network(config), config.unshuffle > 1
    working_px = 128 if coarse else 1024  # full resolution: nothing here is averaged down first
    path = export_dehaze(model, tmp_path / "net.onnx", asdict(config), working_px, {"lr": 1.0}, 7)
    dehazer = OnnxDehazer(path, engine=Engine(threads=1), network_only=config.prior)
    if config.prior:
        dehazer.geometry = Halved()
    stored = dehazer.session.config
    assert (stored["network"], stored["step"]) == (json.loads(json.dumps(asdict(config))), 7)
    assert (dehazer.coarse, stored["recipe"]) == (coarse, {"lr": 1.0})
    for height, width, factor in [(72, 128, 1), (75, 131, 1), (144, 257, 2), (201, 380, 3)]:
        image = striped_deck(height, width)[0]
        pictures = [image, np.rint(image / 2).astype(np.uint8)] if config.prior else [image]  # the prior
        full = [image_to_tensor(pad(picture, 4 * factor if coarse else 1)) for picture in pictures]
        working = [np.concatenate([average_down(each, factor) for each in full], axis=1)] if coarse else []
        with torch.no_grad():
            restored = model(*map(torch.from_numpy, [full[-1], *working]))[0, :, :height, :width]
        expected = (255 * restored.permute(1, 2, 0).numpy()).clip(0, 255)
        assert np.abs(expected - pictures[-1]).max() > 20, "the network must change the picture"
        frame = Frame("a.png", 0.0, image, Camera.from_fov(width, height, 1.0))
        found = dehazer.restore(frame).image_rgb if config.prior else dehazer(image)
        assert np.abs(found - expected).max() <= 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [("channels", 0), ("depths", (1, 1)), ("spatial_kernel", 4), ("attention", "none"), ("transformer", "swin")],
)
def test_shapes_that_cannot_be_built_are_refused(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"{name}.*{re.escape(repr(value))}"):
        DehazeNetworkConfig(**{name: value})


def test_full_resolution_network_takes_no_working_image() -> None:
    with pytest.raises(ValueError, match=r"unshuffle.*1"):
        DehazeNetwork(replace(TINY, unshuffle=1))(torch.rand(1, 3, 32, 32), torch.rand(1, 3, 32, 32))
