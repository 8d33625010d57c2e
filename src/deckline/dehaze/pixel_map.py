"""A dehazed picture as a linear map of the hazy one: found at a small resolution, applied at any."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
RIPPLE_PX = 17  # side of the window that ripples are measured in; compression makes blocks of 8 and 16
RIPPLE_NOISES = 1.5  # times the noise: of ripples with this 1-sigma one half is taken for noise


@dataclass(frozen=True, eq=False)
class PixelMap:
    """J = gain Y + chroma (I - Y) + offset, in levels 0..255, where Y is a pixel's `luma`."""

    gain: Image
    """(h, w)."""
    chroma: Image
    """(h, w), less than `gain` where what differs from grey is more likely noise."""
    offset: Image
    """(3, h, w), levels."""
    noise: float = 0.0
    """1-sigma of a pixel's noise, levels; it is not amplified. 0: all detail is."""

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The map of an image (H, W, 3) of any resolution."""
        import cv2

        size = image_rgb.shape[1], image_rgb.shape[0]
        chroma, shared = (cv2.resize(part, size) for part in (self.chroma, self.gain - self.chroma))
        scene, added = np.empty_like(chroma), np.empty_like(chroma)  # used again: fresh memory costs more than the sums
        grey = np.asarray(cv2.cvtColor(image_rgb, cv2.COLOR_RGB2GRAY), np.uint8)
        cv2.multiply(shared, grey, dst=shared, dtype=cv2.CV_32F)
        if self.noise > 0:
            cv2.subtract(shared, self._amplified_noise(grey), dst=shared)
        channels = list(cv2.split(image_rgb))
        for channel, offset in zip(channels, self.offset, strict=True):
            cv2.multiply(channel, chroma, dst=scene, dtype=cv2.CV_32F)
            cv2.resize(offset, size, dst=added)
            cv2.add(scene, shared, dst=scene)
            cv2.add(scene, added, dst=channel, dtype=cv2.CV_8U)
        return np.asarray(cv2.merge(channels), dtype=np.uint8)

    def _amplified_noise(self, grey: NDArray[np.uint8]) -> Image:
        """What the map adds (H, W) to ripples of a grey image (H, W) that are no larger than noise.

        Source: He, Sun and Tang 2013, the guided filter with the image as its own guide; its weights are smooth, and
        taken at the map's resolution.
        """
        import cv2

        size, small = grey.shape[::-1], self.gain.shape[::-1]
        ripple = np.asarray(grey, np.float32)
        cv2.subtract(ripple, cv2.blur(ripple, (RIPPLE_PX, RIPPLE_PX)), dst=ripple)
        window = (max(1, round(RIPPLE_PX * small[0] / size[0])) // 2 * 2 + 1,) * 2
        variance = cv2.blur(cv2.resize(ripple * ripple, small, interpolation=cv2.INTER_AREA), window)
        of_noise = np.float32((RIPPLE_NOISES * self.noise) ** 2)
        weight = cv2.blur(of_noise / (of_noise + variance), window) * np.maximum(self.gain - 1, 0)
        return np.asarray(cv2.multiply(ripple, cv2.resize(weight, size), dst=ripple), dtype=np.float32)

    def add(self, levels: Image) -> "PixelMap":
        """The same map with `levels` (..., ..., 3) added to its result."""
        import cv2

        added = np.moveaxis(np.asarray(cv2.resize(levels, self.gain.shape[::-1])), 2, 0)
        return replace(self, offset=np.ascontiguousarray(self.offset + added, np.float32))

    def mix(self, other: "PixelMap", share: Image) -> "PixelMap":
        """The map whose result is a weighted mean; `share` (h, w), 0 to 1, is the other's weight, the noise is ours."""
        gain, chroma, offset = (
            mine + share * (its - mine)
            for mine, its in ((self.gain, other.gain), (self.chroma, other.chroma), (self.offset, other.offset))
        )
        return replace(self, gain=gain, chroma=chroma, offset=offset)

    def fade(self, share: float) -> "PixelMap":
        """The same map with a `share`, 0 to 1, of the image as it is."""
        done = np.float32(1 - share)
        gain, chroma = (np.float32(share) + done * part for part in (self.gain, self.chroma))
        return replace(self, gain=gain, chroma=chroma, offset=done * self.offset)


def luma(levels: Image) -> Image:
    """Grey (H, W) of levels (3, H, W). Source of the weights: ITU-R BT.601."""
    return np.asarray(np.tensordot(LUMA, levels, axes=1), np.float32)


def linear_levels(display: NDArray) -> Image:
    """Light, 0..255, of display levels 0..255. Source: IEC 61966-2-1 (sRGB)."""
    x = np.asarray(display, dtype=np.float32) / 255
    return np.asarray(255 * np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4), dtype=np.float32)


def display_levels(light: Image) -> Image:
    """The inverse of `linear_levels`; light beyond 0..255 is clipped."""
    y = np.clip(light, 0, 255) / 255
    return np.asarray(255 * np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1 / 2.4) - 0.055), dtype=np.float32)
