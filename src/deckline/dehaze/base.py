"""What every dehazer is, and the one that does nothing."""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_image
from deckline.types import Frame, Value


class Dehazer(Protocol):
    """What every dehazer is: a callable with a name."""

    name: str
    """For people and reports."""

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """An image without its haze.

        Args:
            image_rgb: (H, W, 3) uint8 RGB, of any size; it stays unchanged.

        Returns:
            (H, W, 3) uint8 RGB, no view of the input.

        Raises:
            ValueError: an array that is no such image.
        """
        ...


@dataclass(frozen=True, eq=False)
class DehazeResult:
    """A dehazed frame, and the visibility where the dehazer measures it."""

    image_rgb: NDArray[np.uint8]
    """(H, W, 3) uint8 RGB, no view of the input."""
    note: str = ""
    """Why the image is the input's, for people; empty for a dehazed one."""
    visibility_m: Value | None = None
    """Range at which 2 % of a contrast are left, m, with 1-sigma; None: not measured in metres."""
    visibility_heights: Value | None = None
    """The same in heights of the camera above the water, where that height is not known; None: not measured so."""


@runtime_checkable
class FrameDehazer(Dehazer, Protocol):
    """A dehazer that also uses the frame's camera, pose and depth."""

    def restore(self, frame: Frame) -> DehazeResult:
        """A frame without its haze. The frame stays unchanged.

        Raises:
            ValueError: a frame whose image is none.
        """
        ...


class IdentityDehazer:
    """Returns a copy of its input."""

    name = "none"

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        return image_rgb.copy()


def restore(dehazer: Dehazer, frame: Frame, strength: float = 1.0) -> DehazeResult:
    """A frame through any dehazer.

    Args:
        dehazer: any; a `FrameDehazer` gets the whole frame, another one its image.
        frame: it stays unchanged.
        strength: share of the haze's removal, 0 (the image as it is) to 1.
    """
    if not isinstance(dehazer, FrameDehazer):
        return DehazeResult(mix(frame.image_rgb, dehazer(frame.image_rgb), strength))
    restored = dehazer.restore(frame)
    if not restored.note and np.array_equal(restored.image_rgb, frame.image_rgb):
        return replace(restored, note="not dehazed: no haze is seen")
    return replace(restored, image_rgb=mix(frame.image_rgb, restored.image_rgb, strength))


def mix(first_rgb: NDArray[np.uint8], second_rgb: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    """Weighted mean of two images (H, W, 3), no view of the first; `share` is the second one's weight, 0 to 1."""
    import cv2

    if share == 1:
        return second_rgb
    return np.asarray(cv2.addWeighted(first_rgb, 1 - share, second_rgb, share, 0), dtype=np.uint8)


def linear_step(value: float, low: float, high: float) -> float:
    """0 up to `low`, 1 from `high` on, linear between."""
    return float(np.clip((value - low) / (high - low), 0, 1))
