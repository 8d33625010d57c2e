"""Line networks beside our first one, trained on the same views, augmentation and budget.

`hybrid` is meant to succeed it; the others are compared with it, each written from its paper.
"""

from collections.abc import Callable

from deckline.train.detectors.enet_sad import EnetSad
from deckline.train.detectors.hybrid import Hybrid
from deckline.train.detectors.resa import Resa
from deckline.train.detectors.ufld_r18 import UfldR18
from deckline.train.line_network import LineNetwork

DETECTORS_TO_TRAIN: dict[str, Callable[[], LineNetwork]] = {
    "hybrid": Hybrid,
    "ufld-r18": UfldR18,
    "enet-sad": EnetSad,
    "resa-r18": Resa,
}

__all__ = ["DETECTORS_TO_TRAIN", "EnetSad", "Hybrid", "Resa", "UfldR18"]
