"""No dehazing: what the chain does when haze is left in."""

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.base import check_image


class IdentityDehazer:
    """Returns a copy of its input."""

    name = "none"

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        return image_rgb.copy()
