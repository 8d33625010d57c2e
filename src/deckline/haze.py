"""Atmospheric scattering: I = J t + A (1 - t), t = exp(-beta d), d the ray length in metres.

Source: Koschmieder's law; SPEC section 6. Visibility is quoted at 2 % contrast: V = 3.912 / beta.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

CONTRAST_THRESHOLD = 0.02  # Koschmieder's 2 %; the meteorological optical range uses 5 %


def beta_from_visibility(visibility_m: float, contrast: float = CONTRAST_THRESHOLD) -> float:
    """Extinction coefficient, 1/m. Infinite visibility gives 0."""
    if not visibility_m > 0:
        raise ValueError(f"visibility must be positive metres, got {visibility_m}")
    return float(-np.log(contrast) / visibility_m)


def visibility_from_beta(beta_per_m: float, contrast: float = CONTRAST_THRESHOLD) -> float:
    """Visibility, m, of an extinction coefficient. Zero extinction gives infinity."""
    if beta_per_m < 0:
        raise ValueError(f"extinction must not be negative, got {beta_per_m} 1/m")
    return float("inf") if beta_per_m == 0 else float(-np.log(contrast) / beta_per_m)


def transmission(range_m: ArrayLike, beta_per_m: float) -> NDArray[np.float32]:
    """exp(-beta range) for ray lengths in metres; unknown (NaN) and infinite ranges transmit nothing."""
    ranges = np.nan_to_num(np.asarray(range_m, dtype=np.float32), nan=np.inf)
    if beta_per_m == 0:
        return np.ones_like(ranges)
    return np.exp(-np.float32(beta_per_m) * ranges)


def add_haze(
    clear_rgb: NDArray[np.uint8], range_m: ArrayLike, beta_per_m: float, airlight_rgb: ArrayLike
) -> NDArray[np.uint8]:
    """Hazy image (H, W, 3) uint8 from a clear one, ray lengths (H, W) in metres and airlight (3,) in 0..255."""
    t = transmission(range_m, beta_per_m)[..., None]
    if t.shape[:2] != clear_rgb.shape[:2]:
        raise ValueError(f"image is {clear_rgb.shape[:2]} but range is {t.shape[:2]}")
    airlight = np.asarray(airlight_rgb, dtype=np.float32)
    hazy = clear_rgb.astype(np.float32) * t + airlight * (1 - t)
    return np.clip(np.rint(hazy), 0, 255).astype(np.uint8)
