"""Networks that ours is compared with, each written from its paper and trained like ours: same data, loss and budget.

Each takes (N, 3, H, W) RGB in 0..1 of any size and returns the same shape, not clipped.
"""

from collections.abc import Callable
from typing import Any

from torch import nn

from deckline.research.dehazers.aod_net import AodNet
from deckline.research.dehazers.dehaze_former import DehazeFormer
from deckline.research.dehazers.g_unet import GUNet
from deckline.research.dehazers.gca_net import GcaNet
from deckline.research.dehazers.grid_dehaze_net import GridDehazeNet

DEHAZERS: dict[str, Callable[[Any], nn.Module]] = {  # from a recipe, of which they need nothing
    "aod-net": lambda _: AodNet(),
    "gca-net": lambda _: GcaNet(),
    "grid-dehaze-net": lambda _: GridDehazeNet(),
    "g-unet-t": lambda _: GUNet(),
    "dehaze-former-t": lambda _: DehazeFormer(),
}

__all__ = ["DEHAZERS"]
