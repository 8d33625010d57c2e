"""Line networks that ours are compared with, each written from its paper, with its own loss and rule of acceptance."""

from collections.abc import Callable
from typing import Any

from deckline_lab.rivals.detectors.enet_sad import EnetSad
from deckline_lab.rivals.detectors.parts import Trunk
from deckline_lab.rivals.detectors.resa import Resa
from deckline_lab.rivals.detectors.sad import Sad
from deckline_lab.rivals.detectors.ufld_published import PublishedUfld
from deckline_lab.train.line_networks import LineNetwork


def trunk_of(recipe: Any) -> Trunk:
    """What a recipe says about the view and the backbone."""
    return Trunk(recipe.shape.grid.size, recipe.shape.pretrained, recipe.shape.frozen_blocks)


DETECTORS: dict[str, Callable[[Any], LineNetwork]] = {  # from a recipe
    "ufld-lite0": lambda recipe: PublishedUfld(trunk_of(recipe)),  # EfficientNet-Lite0 from ImageNet weights, as ours
    "sad-lite0": lambda recipe: Sad(trunk_of(recipe)),
    "resa-lite0": lambda recipe: Resa(trunk_of(recipe)),
    "ufld-r18": lambda recipe: PublishedUfld(trunk_of(recipe), resnet=True),  # published backbones, from random weights
    "enet-sad": lambda recipe: EnetSad(recipe.shape.grid.size),
    "resa-r18": lambda recipe: Resa(trunk_of(recipe), 18),
}

__all__ = ["DETECTORS"]
