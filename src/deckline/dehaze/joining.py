"""Whom to believe: the network, what geometry made of the same frame, or the frame itself.

A network takes an overcast sea for a hazy one. Where pose and picture tell how clear the air is, that counts: in clear
air geometry's picture is taken, whatever the network says. In haze both are estimates with errors of their own, so
that their mean is better than either where they agree; where they do not, geometry is more often far off.
Without such knowledge a change that is no larger than what the network does to clear pictures is not made.
"""

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.geometry import Solved
from deckline.dehaze.haze_fit import HazeFit

# Chosen on 40 views of preset paper and 60 of train, 300 to 3000 m, and on 60 in 4 to 20 km; docs/dehazing.md.
CLEAR_M = (4000.0, 8000.0)  # visibility: from here on geometry is believed more, and from here on alone
HORIZON_SEA = (0.9, 1.0)  # of the airlight: water that far away mirrors the sky; a fit that has it brighter is wrong
SKY_CLEAR = 2.0  # times that in the sky, which geometry leaves as it is
MEAN_SHARE = 0.6  # of geometry where both agree
AGREE_LEVELS = 10.0  # apart: geometry counts half of that
AGREE_PX = 31  # side of the window in which they are compared, for pictures REFERENCE_PX wide
REFERENCE_PX = 640
CHANGE_LEVELS = (6.0, 9.0)  # rms: so little is not done; so much is done in full. Clear views change by 7, hazy by 28
SEEN_STEP = 4  # every so many-th pixel, along rows and columns, is looked at for the change

Image = NDArray[np.uint8]


def joined(network_rgb: Image, solved: Solved) -> Image:
    """One picture (H, W, 3) of the network's (H, W, 3) and geometry's."""
    import cv2

    red, green, blue = cv2.split(cv2.absdiff(network_rgb, solved.image_rgb))
    apart = cv2.max(cv2.max(red, green), blue).astype(np.float32)
    side = max(1, round(AGREE_PX * apart.shape[1] / REFERENCE_PX)) // 2 * 2 + 1
    share = MEAN_SHARE / (1 + np.square(cv2.blur(apart, (side, side)) / np.float32(AGREE_LEVELS)))
    below, sky = (clear_air(solved.haze, times) for times in (1.0, SKY_CLEAR))
    share = solved.known * (below + (1 - below) * share) + (1 - solved.known) * np.float32(sky)
    return mixed(network_rgb, solved.image_rgb, share.astype(np.float32))


def clear_air(haze: HazeFit, times: float) -> float:
    """How surely the air is `times` as clear as CLEAR_M, 0 to 1."""
    clear = ramp(float(np.log(haze.visibility_m / times)), *np.log(CLEAR_M))
    horizon = float((haze.airlight + haze.sea.sum(axis=0)).mean() / haze.airlight.mean())
    return clear * (1 - ramp(horizon, *HORIZON_SEA))


def ramp(value: float, low: float, high: float) -> float:
    """0 up to `low`, 1 from `high` on."""
    return float(np.clip((value - low) / (high - low), 0, 1))


def kept(image_rgb: Image, network_rgb: Image) -> Image:
    """The network's picture (H, W, 3), or as much of the image it was made from as it hardly differs."""
    step = np.s_[::SEEN_STEP, ::SEEN_STEP]
    change = np.sqrt(np.mean(np.square(network_rgb[step].astype(np.float32) - image_rgb[step])))
    share = 1 - ramp(float(change), *CHANGE_LEVELS)
    return mixed(network_rgb, image_rgb, np.full(image_rgb.shape[:2], share, np.float32)) if share else network_rgb


def mixed(first_rgb: Image, second_rgb: Image, share: NDArray[np.float32]) -> Image:
    """Two pictures (H, W, 3); `share` (H, W), 0 to 1, of the second."""
    import cv2

    return np.asarray(cv2.blendLinear(first_rgb, second_rgb, 1 - share, share), dtype=np.uint8)
