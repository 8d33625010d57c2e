"""gUNet: the gated block's formula, and what its statistics do."""

import torch

from deckline.train.rivals import GUNet
from deckline.train.rivals.g_unet import GatedBlock, GUNetConfig

SMALL = GUNetConfig(channels=4, depths=(1, 1, 1))


def test_gated_block_is_its_formula() -> None:
    torch.manual_seed(0)
    block, x = GatedBlock(4, 3, 7).eval(), torch.rand(1, 4, 8, 9)
    block.norm.running_mean.fill_(0.5)
    block.norm.running_var.fill_(4.0)
    with torch.no_grad():
        normed = (x - 0.5) / 2
        gate = 1 / (1 + torch.exp(-block.gate(normed)))
        torch.testing.assert_close(block(x), x + block.mix(block.value(normed) * gate), atol=1e-4, rtol=1e-4)


def test_what_comes_out_is_added_to_the_image() -> None:
    model = GUNet(SMALL).eval()
    model.outro.weight.data.zero_()
    model.outro.bias.data = torch.tensor([0.2, -0.4, 0.0])
    image = torch.rand(1, 3, 35, 33)
    with torch.no_grad():
        torch.testing.assert_close(model(image), image + torch.tensor([0.1, -0.2, 0.0]).reshape(1, 3, 1, 1))


def test_widths_double_down_and_halve_up() -> None:
    model = GUNet()
    assert [stage[0].mix.in_channels for stage in [*model.encoders, model.bottom, *model.decoders]] == [
        24, 48, 96, 192, 96, 48, 24,
    ]  # fmt: skip
    assert model.config.multiple == 8


def test_statistics_are_learned_while_training_only() -> None:
    model, image = GUNet(SMALL), torch.rand(2, 3, 32, 32)
    before = model.bottom[0].norm.running_mean.clone()
    with torch.no_grad():
        model.eval()(image)
        torch.testing.assert_close(model.bottom[0].norm.running_mean, before)
        model.train()(image)
    assert (model.bottom[0].norm.running_mean - before).abs().max() > 0
