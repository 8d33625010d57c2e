"""What a network costs: parameters, and multiply-accumulates at an image size."""

import copy
from dataclasses import dataclass

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

REFERENCE_PX = (256, 256)  # height and width at which dehazing papers publish MACs


@dataclass(frozen=True)
class NetworkCost:
    """Cost of one image."""

    parameters: int
    macs: int  # multiply-accumulates of convolutions, linear layers and matrix products


def count_parameters(model: nn.Module) -> int:
    return sum(value.numel() for value in model.parameters())


def network_cost(
    model: nn.Module, size_px: tuple[int, int] = REFERENCE_PX, channels: tuple[int, ...] = (3,)
) -> NetworkCost:
    """Parameters and MACs of a network that takes images (1, C, H, W) of one size.

    A multiplication with its addition is one MAC. Biases, norms, activations, pooling, softmax and interpolation are
    not counted, as in the papers; attention's two products are. A transposed convolution is charged its weights once an
    input pixel, which is what it computes; some published counts charge them once an output pixel, stride^2 times as
    much. Nothing is computed: the shapes alone go through a copy without data.

    Args:
        model: left as it is.
        size_px: height and width of the images.
        channels: C of each of them.
    """
    shapes = copy.deepcopy(model).to("meta").eval()
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        shapes(*(torch.empty(1, count, *size_px, device="meta") for count in channels))
    return NetworkCost(count_parameters(model), counter.get_total_flops() // 2)
