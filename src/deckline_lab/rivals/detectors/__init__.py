"""Line networks that ours are compared with, each written from its paper, with its own loss and rule of acceptance."""

from collections.abc import Callable
from typing import Any

from deckline_lab.rivals.detectors.enet_sad import EnetSad
from deckline_lab.rivals.detectors.resa import Resa
from deckline_lab.rivals.detectors.sad import Sad
from deckline_lab.rivals.detectors.ufld_published import PublishedUfld
from deckline_lab.train.line_networks import LineNetwork

DETECTORS: dict[str, Callable[[Any], LineNetwork]] = {  # from a recipe
    "ufld-lite0": lambda recipe: PublishedUfld(recipe.shape),  # EfficientNet-Lite0 from ImageNet weights, as ours
    "sad-lite0": lambda recipe: Sad(recipe.shape),
    "resa-lite0": lambda recipe: Resa(recipe.shape),
    "ufld-r18": lambda recipe: PublishedUfld(recipe.shape, resnet=True),  # published backbones, from random weights
    "enet-sad": lambda recipe: EnetSad(recipe.shape.grid.size),
    "resa-r18": lambda recipe: Resa(recipe.shape, 18),
}

__all__ = ["DETECTORS"]
