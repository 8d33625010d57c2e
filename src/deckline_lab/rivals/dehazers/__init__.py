"""Networks that ours is compared with, each written from its paper and trained like ours: same data, loss and budget.

Each takes (N, 3, H, W) RGB in 0..1 of any size and returns the same shape, not clipped: at full resolution as in print,
and on our coarse grid.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from torch import nn

from deckline_lab.rivals.dehazers.aod_net import AodNet
from deckline_lab.rivals.dehazers.coarse import CoarseGrid
from deckline_lab.rivals.dehazers.dehaze_former import DehazeFormer
from deckline_lab.rivals.dehazers.g_unet import GUNet
from deckline_lab.rivals.dehazers.gca_net import GcaNet
from deckline_lab.rivals.dehazers.grid_dehaze_net import GridDehazeNet

RIVALS: dict[str, Callable[..., nn.Module]] = {  # each takes `inputs` and `outputs`, channels
    "aod-net": AodNet,
    "gca-net": GcaNet,
    "grid-dehaze-net": GridDehazeNet,
    "g-unet-t": GUNet,
    "dehaze-former-t": DehazeFormer,
}


def without_recipe(build: Callable[[], nn.Module]) -> Callable[[Any], nn.Module]:
    """A builder from a recipe, of which it needs nothing."""
    return lambda _: build()


DEHAZERS: dict[str, Callable[[Any], nn.Module]] = {
    **{name: without_recipe(build) for name, build in RIVALS.items()},
    **{f"{name}-coarse": without_recipe(partial(CoarseGrid, build)) for name, build in RIVALS.items()},
}

__all__ = ["DEHAZERS", "RIVALS"]
