"""Line networks that ours are compared with, each written from its paper: same views, augmentation and budget."""

from collections.abc import Callable
from typing import Any

from deckline_lab.rivals.detectors.enet_sad import EnetSad
from deckline_lab.rivals.detectors.resa import Resa
from deckline_lab.rivals.detectors.sad import Sad
from deckline_lab.rivals.detectors.ufld_published import PublishedUfld
from deckline_lab.train.line_networks import LineNetwork

DETECTORS: dict[str, Callable[[Any], LineNetwork]] = {  # from a recipe, of which they need nothing
    "ufld-lite0": lambda _: PublishedUfld(),  # EfficientNet-Lite0 from ImageNet weights, as ours
    "sad-lite0": lambda _: Sad(),
    "resa-lite0": lambda _: Resa(),
    "ufld-r18": lambda _: PublishedUfld(resnet=True),  # the published backbones, from random weights
    "enet-sad": lambda _: EnetSad(),
    "resa-r18": lambda _: Resa(18),
}

__all__ = ["DETECTORS"]
