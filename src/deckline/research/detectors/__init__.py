"""Line networks that ours are compared with, each written from its paper: same views, augmentation and budget."""

from collections.abc import Callable
from typing import Any

from deckline.research.detectors.enet_sad import EnetSad
from deckline.research.detectors.resa import Resa
from deckline.research.detectors.ufld_r18 import UfldR18
from deckline.train.line_networks import LineNetwork

DETECTORS: dict[str, Callable[[Any], LineNetwork]] = {  # from a recipe, of which they need nothing
    "ufld-r18": lambda _: UfldR18(),
    "enet-sad": lambda _: EnetSad(),
    "resa-r18": lambda _: Resa(),
}

__all__ = ["DETECTORS"]
