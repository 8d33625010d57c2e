"""ResNet: its published size, strides, and what dilation keeps."""

import pytest
import torch

from deckline.train.detectors.resnet import ResNet
from deckline.train.network_cost import count_parameters, network_cost


def test_size_is_the_published_one() -> None:
    """ResNet-18 has 11.69 M parameters and 1.8 GMACs at 224x224 with its classifier (512 x 1000 + 1000)."""
    assert count_parameters(ResNet(18)) + 513_000 == 11_689_512
    assert network_cost(ResNet(18), (224, 224)).macs == pytest.approx(1.8e9, rel=0.02)
    assert count_parameters(ResNet(34)) + 513_000 == 21_797_672


def test_taps_have_their_strides() -> None:
    image = torch.empty(1, 3, 64, 96, device="meta")
    taps = ResNet(18).to("meta")(image)
    assert [tuple(tap.shape[1:]) for tap in taps] == [(128, 8, 12), (256, 4, 6), (512, 2, 3)]
    dilated = ResNet(18, dilated=True).to("meta")(image)
    assert [tuple(tap.shape[1:]) for tap in dilated] == [(128, 8, 12), (256, 8, 12), (512, 8, 12)]
    assert len(ResNet(18, stages=3).stages) == 3


def test_dilation_changes_no_weight_s_shape() -> None:
    plain, dilated = (ResNet(18, dilated=flag).state_dict() for flag in (False, True))
    assert {name: value.shape for name, value in plain.items()} == {n: value.shape for n, value in dilated.items()}
