"""Tone curves: how linear light becomes an 8-bit level, and back, through tables."""

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Tone = Literal["gamma", "srgb", "filmic"]
DISPLAY_GAMMA = 2.2  # a plain display's level is light to the power of one over this
STEPS = 16384  # of a table, equally spaced in the square root of light, where levels lie nearly evenly
FILMIC = (2.51, 0.03, 2.43, 0.59, 0.14)  # Narkowicz 2015, "ACES filmic tone mapping curve": a, b, c, d, e
WHITE = {"gamma": 1.0, "srgb": 1.0, "filmic": 7.24}  # light from which on a curve shows full white

# A curve is (tone, gamma, contrast, black): gamma is an exponent on the level, contrast bends it about its middle,
# black is the level that no light has.
Curve = tuple[Tone, float, float, float]


def level_of(light: NDArray[np.float64], curve: Curve) -> NDArray[np.float64]:
    """Level 0..1 of exposed linear light, 1 being white of the plain curves."""
    tone, gamma, contrast, black = curve
    x = np.clip(light, 0.0, WHITE[tone])
    if tone == "srgb":  # IEC 61966-2-1
        level = np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)
    else:
        if tone == "filmic":
            a, b, c, d, e = FILMIC
            x = np.clip(x * (a * x + b) / (x * (c * x + d) + e), 0.0, 1.0)
        level = x ** (1.0 / DISPLAY_GAMMA)
    level = level**gamma
    level = level + contrast * level * (1 - level) * (2 * level - 1)
    return black + (1 - black) * level


@lru_cache(maxsize=64)
def table(curve: Curve) -> NDArray[np.uint8]:
    """8-bit level of `STEPS` amounts of light, 0 to WHITE, equally spaced in their square root."""
    return np.rint(255.0 * level_of(_light(curve), curve)).astype(np.uint8)


@lru_cache(maxsize=64)
def light_of_levels(curve: Curve) -> NDArray[np.float32]:
    """Light (256,) that a curve shows as each level; levels out of its reach get its darkest or brightest."""
    light = _light(curve)
    return np.interp(np.arange(256) / 255.0, level_of(light, curve), light).astype(np.float32)


def _light(curve: Curve) -> NDArray[np.float64]:
    return WHITE[curve[0]] * np.linspace(0.0, 1.0, STEPS) ** 2
