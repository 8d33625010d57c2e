"""The colour of the haze that training views get."""

import numpy as np
from numpy.typing import NDArray

GREY_LEVELS = (70.0, 245.0)  # airlight of a random colour, 0..255
# Tints of random airlight, multiplied onto grey: bluish (fog in daylight) to warm (dust, low sun).
BLUISH, WARM = np.array([0.86, 0.95, 1.05]), np.array([1.06, 0.97, 0.85])


def random_airlight(
    horizon_rgb: NDArray[np.float32] | None, horizon_share: float, rng: np.random.Generator, exact_share: float = 0.0
) -> NDArray[np.float64]:
    """Colour of thick haze (3,), 0..255: the horizon's; near it, greyer, at times darker; or grey, bluish or warm."""
    if horizon_rgb is not None and rng.random() < horizon_share:
        if rng.random() < exact_share:
            return np.clip(horizon_rgb * (1 + rng.normal(0, 0.02, 3)), 0, 255)
        grey = horizon_rgb.mean()
        colour = grey + (horizon_rgb - grey) * rng.uniform(0.0, 1.2)
        colour = colour * (rng.uniform(0.55, 0.85) if rng.random() < 0.25 else rng.uniform(0.85, 1.1))
    else:
        tint = BLUISH if rng.random() < 0.5 else WARM
        colour = rng.uniform(*GREY_LEVELS) * (1 + (tint - 1) * rng.uniform(0.0, 1.0))
    return np.clip(colour * (1 + rng.normal(0, 0.03, 3)), 40, 250)
