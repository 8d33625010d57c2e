"""Networks that ours is compared with, each written from its paper and trained like ours: same data, loss and budget.

Each takes (N, 3, H, W) RGB in 0..1 of any size and returns the same shape, not clipped.
"""

from collections.abc import Callable

from torch import nn

from deckline.train.rivals.aod_net import AodNet
from deckline.train.rivals.dehaze_former import DehazeFormer
from deckline.train.rivals.g_unet import GUNet
from deckline.train.rivals.gca_net import GcaNet
from deckline.train.rivals.grid_dehaze_net import GridDehazeNet

RIVALS: dict[str, Callable[[], nn.Module]] = {
    "aod-net": AodNet,
    "gca-net": GcaNet,
    "grid-dehaze-net": GridDehazeNet,
    "g-unet-t": GUNet,
    "dehaze-former-t": DehazeFormer,
}


def build(name: str) -> nn.Module:
    """A fresh network.

    Raises:
        ValueError: a name that is not in RIVALS.
    """
    if name not in RIVALS:
        raise ValueError(f"unknown network {name!r}: use one of {', '.join(RIVALS)}")
    return RIVALS[name]()


__all__ = ["RIVALS", "AodNet", "DehazeFormer", "GUNet", "GcaNet", "GridDehazeNet", "build"]
