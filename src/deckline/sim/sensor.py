"""What a camera does to a clean picture: exposure, white balance, gamma, blur, noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

DISPLAY_GAMMA = 2.2  # an image's level is light to the power of one over this
SKY_TARGET = 0.8  # what automatic exposure makes of the sky near the horizon


@dataclass(frozen=True)
class Sensor:
    """One camera's settings."""

    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)  # exposure and white balance, red green blue
    gamma: float = 1.0
    blur_px: float = 0.0  # 1-sigma
    noise: float = 0.0  # 1-sigma, 8-bit steps


def random_sensor(strength: float, sky_level: float, rng: np.random.Generator) -> Sensor:
    """Settings that stray by `strength` (0: none, 1: as far as training wants), exposed for a sky of level 0..1."""
    automatic = (SKY_TARGET / max(sky_level, 0.1)) ** rng.uniform(0.4, 1.0)
    exposure = automatic * np.exp(rng.normal(0.0, 0.15 * strength))
    gain = exposure * np.exp(rng.normal(0.0, 0.04 * strength, 3))
    blur = rng.uniform(0.3, 1.1) if rng.random() < 0.4 * strength else 0.0
    return Sensor(
        (float(gain[0]), float(gain[1]), float(gain[2])),
        float(np.exp(rng.normal(0.0, 0.15 * strength))),
        float(blur),
        float(strength * rng.gamma(1.5, 1.5)),
    )


def develop(radiance: NDArray[np.float32], sensor: Sensor) -> NDArray[np.uint8]:
    """Image of linear light (H, W, 3): exposure, white balance, gamma and blur."""
    level = np.maximum(radiance, 0.0) ** np.float32(1.0 / DISPLAY_GAMMA)
    level = np.clip(level * np.asarray(sensor.gain, np.float32), 0.0, 1.0) ** np.float32(sensor.gamma)
    out = np.rint(255.0 * level).astype(np.uint8)
    if sensor.blur_px > 0:
        out = np.stack([gaussian_filter(out[..., c], sensor.blur_px, truncate=3.0) for c in range(3)], axis=-1)
    return out


def add_noise(rgb: NDArray[np.uint8], sensor: Sensor, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Gaussian read-out noise on an image (H, W, 3)."""
    if sensor.noise == 0:
        return rgb
    noisy = rgb + np.float32(sensor.noise) * rng.standard_normal(rgb.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
