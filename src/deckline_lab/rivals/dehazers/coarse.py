"""The compared networks on our coarse grid: what their layers are worth behind the same input and the same upsampling.

All differ from print in the same three things. Their first convolution takes the picture as ours does, through a
pixel-unshuffle into 48 channels of a grid of 4 px. Their last one gives K and B of J = K I - B + I and starts at zero,
as ours: an untrained network returns its input. Their own ways to make a picture are left out: AOD-Net's rectified K of
every colour, DehazeFormer's range of -1..1, the image that GCANet and gUNet add, GridDehazeNet's direct one.
"""

from collections.abc import Callable
from typing import ClassVar

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deckline_lab.rivals.dehazers.common import MIN_SIDE_PX, pad_to_multiple
from deckline_lab.train.dehaze_network import SHAPES, luma, upsample_soft

OURS = SHAPES["coarse-t"]  # its grid and its guided filter
INPUTS, OUTPUTS = 3 * OURS.unshuffle**2, 4


class CoarseGrid(nn.Module):
    """A compared network's layers between our coarse grid and our soft reconstruction.

    `build` makes it for so many `inputs` and `outputs`; its `estimate` of (N, 48, h, w) is K and B (N, 4, h, w).
    """

    # For the exported file, which does not pad small pictures itself.
    grid: ClassVar = {"unshuffle": OURS.unshuffle, "min_side_px": MIN_SIDE_PX * OURS.unshuffle}

    def __init__(self, build: Callable[..., nn.Module]) -> None:
        super().__init__()
        self.network = build(inputs=INPUTS, outputs=OUTPUTS)
        last = [layer for layer in self.network.modules() if isinstance(layer, nn.Conv2d)][-1]
        nn.init.zeros_(last.weight)
        last.bias = nn.Parameter(torch.zeros(OUTPUTS))
        self.log_guide_eps = nn.Parameter(torch.tensor(-7.0))  # of the guided filter, image range 0..1; learned

    def forward(self, image: Tensor, working: Tensor | None = None) -> Tensor:
        """Remove haze: (N, 3, H, W) RGB in 0..1 to the same shape, not clipped.

        Args:
            image: what K and B are applied to.
            working: (N, 3, h, w) the same picture averaged down by a whole factor, on which they are estimated; None
                estimates them on `image` itself.
        """
        working = image if working is None else working
        whole = pad_to_multiple(working, OURS.unshuffle)
        estimate = self.network.estimate(F.pixel_unshuffle(whole, OURS.unshuffle))  # type: ignore[operator]
        guide, eps = F.avg_pool2d(luma(whole), OURS.unshuffle), torch.exp(self.log_guide_eps)
        soft = upsample_soft(estimate, guide, image, working, OURS.unshuffle, eps, OURS.guide_radius)
        return soft[:, :1] * image - soft[:, 1:] + image
