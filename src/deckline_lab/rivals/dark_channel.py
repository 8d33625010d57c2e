"""The dark channel prior, a dehazer without weights.

Source: He, Sun and Tang, "Single image haze removal using dark channel prior", 2011, with the guided filter of
the same authors (2013) in place of matting.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_image, check_numbers
from deckline.dehaze.filters import dark_channel, guided_coefficients
from deckline.dehaze.pixel_map import LUMA

Image = NDArray[np.floating]  # float32; (H, W, 3) in 0..1 or (H, W)


@dataclass(frozen=True)
class DarkChannelConfig:
    """Values of the papers, in pixels, as published for images of about 600x400 px."""

    patch_px: int = 15  # side of the dark channel's window
    omega: float = 0.95  # how much of the haze is removed
    airlight_fraction: float = 0.001  # brightest part of the dark channel that airlight is taken from
    guide_radius_px: int = 50
    guide_eps: float = 1e-3  # on the variance of a guide in 0..1
    min_transmission: float = 0.1

    def __post_init__(self) -> None:
        if self.patch_px < 1 or self.patch_px % 2 == 0:
            raise ValueError(f"patch_px must be odd and positive, got {self.patch_px}")
        check_numbers(self, "", "omega", "airlight_fraction", "min_transmission", above=0, most=1)


class DarkChannelDehazer:
    """He et al.'s method on one image."""

    name = "dark-channel"

    def __init__(self, config: DarkChannelConfig | None = None) -> None:
        self.config = config or DarkChannelConfig()

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        config = self.config
        image = image_rgb.astype(np.float32) / 255
        airlight = estimate_airlight(image, dark_channel(image, config.patch_px), config.airlight_fraction)
        rough = 1 - config.omega * dark_channel(image / airlight, config.patch_px)
        guide = image @ LUMA
        refined = guided_filter(guide, rough, config.guide_radius_px, config.guide_eps)
        t = np.clip(refined, config.min_transmission, 1)[..., None]
        clear = (image - airlight) / t + airlight
        return np.clip(np.rint(255 * clear), 0, 255).astype(np.uint8)


def estimate_airlight(image: Image, dark: Image, fraction: float) -> Image:
    """Airlight (3,): the brightest pixel among those with the `fraction` largest dark channel (He et al., 4.4)."""
    count = max(1, round(fraction * dark.size))
    haziest = np.argpartition(dark.ravel(), -count)[-count:]
    candidates = image.reshape(-1, 3)[haziest]
    return np.maximum(candidates[candidates.sum(axis=1).argmax()], np.float32(1 / 255))  # a divisor, never zero


def guided_filter(guide: Image, values: Image, radius_px: int, eps: float) -> Image:
    """Smooth `values` along the edges of a grey `guide`, both (H, W). Source: He, Sun and Tang 2013, equation 5-8."""
    slope, offset = guided_coefficients(guide, values, radius_px, eps)
    return slope * guide + offset
