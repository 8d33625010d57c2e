"""Runway line detection: an image in, points of the left and right line out."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from deckline.config import CPU
from deckline.detect.coarse_to_fine import DetectConfig
from deckline.detect.crop import Box
from deckline.detect.onnx_detector import OnnxDetector
from deckline.detect.scheduler import SearchingDetector, SearchScheduler
from deckline.runtime.weights import shipped_weights
from deckline.types import Detection

__all__ = [
    "DETECTORS",
    "Box",
    "DetectConfig",
    "Detector",
    "OnnxDetector",
    "SearchScheduler",
    "SearchingDetector",
]


class Detector(Protocol):
    """What every detector is: a callable with a name.

    Takes an image (H, W, 3) uint8 RGB of any size and leaves it untouched; gives the points of both lines in that
    image's pixels. A line that is not seen has no points; a line is never returned with fewer than three.
    `prior_box` is a box (u0, v0, u1, v1), px, in which the runway should be. It is searched only where a search of the
    whole image misses a line. A detector that can search one view at a time inherits from `SearchingDetector`.
    """

    @property
    def name(self) -> str: ...

    def __call__(self, image_rgb: NDArray[np.uint8], prior_box: Box | None = None) -> Detection: ...


DETECTORS: dict[str, Callable[..., Detector]] = {  # from the `Engine` that computes a network
    "hybrid": lambda engine=CPU: OnnxDetector(shipped_weights("hybrid"), engine=engine),
    "hybrid-int8": lambda engine=CPU: OnnxDetector(shipped_weights("hybrid-int8"), engine=engine),
    "ufld": lambda engine=CPU: OnnxDetector(shipped_weights("ufld"), engine=engine),
}
