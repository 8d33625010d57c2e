"""What every dehazer is, and the one that does nothing."""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_image
from deckline.types import Frame, Value


class Dehazer(Protocol):
    """A hazy image (H, W, 3) uint8 RGB in, a clear one of the same shape and type out; its input stays untouched.

    Raises:
        ValueError: an array that is no such image.
    """

    name: str  # for people and reports

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]: ...


@dataclass(frozen=True, eq=False)
class DehazeResult:
    """A dehazed frame."""

    image_rgb: NDArray[np.uint8]  # (H, W, 3), no view of the input
    note: str = ""  # why the frame was left as it is, for people
    visibility_m: Value | None = None  # that picture and height tell
    visibility_heights: Value | None = None  # in heights of the camera above the water, where that is not known


@runtime_checkable
class FrameDehazer(Dehazer, Protocol):
    """A dehazer that uses the frame's camera, pose and depth too."""

    def restore(self, frame: Frame) -> DehazeResult: ...


class IdentityDehazer:
    """Returns a copy of its input: what the chain does when haze is left in."""

    name = "none"

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        return image_rgb.copy()


def restore(dehazer: Dehazer, frame: Frame, strength: float = 1.0) -> DehazeResult:
    """A frame through any dehazer; `strength`, 0 to 1, is how much of the removal is kept."""
    if not isinstance(dehazer, FrameDehazer):
        return DehazeResult(mix(frame.image_rgb, dehazer(frame.image_rgb), strength))
    restored = dehazer.restore(frame)
    if not restored.note and np.array_equal(restored.image_rgb, frame.image_rgb):
        return replace(restored, note="not dehazed: no haze is seen")
    return replace(restored, image_rgb=mix(frame.image_rgb, restored.image_rgb, strength))


def mix(first_rgb: NDArray[np.uint8], second_rgb: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    """Two images (H, W, 3); `share`, 0 to 1, of the second. No view of the first."""
    import cv2

    if share == 1:
        return second_rgb
    return np.asarray(cv2.addWeighted(first_rgb, 1 - share, second_rgb, share, 0), dtype=np.uint8)


def linear_step(value: float, low: float, high: float) -> float:
    """0 up to `low`, 1 from `high` on."""
    return float(np.clip((value - low) / (high - low), 0, 1))
