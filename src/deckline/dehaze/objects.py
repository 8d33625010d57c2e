"""What stands out of hazy sea and sky: how surely each pixel shows something nearer, and how near it must be.

All maps here are of the small picture that the dehazer looks at first; lengths are scaled to its width.
"""

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.geometry_config import GeometryConfig
from deckline.dehaze.sea_view import SeaView

Image = NDArray[np.float32]

REFERENCE_PX = 1280  # image width that lengths in pixels are meant for
OBJECT_SIGMAS = (1.0, 2.5)  # of noise off the airlight where haze hides the sea: as object_levels
SKY_BINS = 40  # of equal width in the sine of the elevation
SKY_STEPS = 16  # between the middles of two bins
MIN_SKY_BIN_PX = 60


def bounded_t(image: Image, airlight: Image, config: GeometryConfig) -> Image:
    """Least transmission (H, W) that the darkest or brightest detail about a pixel allows.

    J <= 255 gives t >= (I - A) / (255 - A). J >= 0 gives t >= (A - I) / A, and a little more, as ships are not black.
    Source: He et al. 2011 for the dark side.
    """
    import cv2

    off = image - airlight
    below: Image = np.maximum(np.float32(1 - config.darkest) * airlight, np.float32(1))
    above: Image = np.maximum(255 - airlight, np.float32(1))
    bound = np.maximum(strongest(-off / below), strongest(off / above))
    window = scaled_px(config.window_px, image.shape[2])
    spread = np.asarray(cv2.dilate(bound, np.ones((window, window), np.uint8)), dtype=np.float32)
    return np.asarray(np.clip(cv2.blur(spread, (window, window)), 0, 1), dtype=np.float32)


def raised_to_deck(bound: Image, sea_t: Image, deck_t: Image, config: GeometryConfig) -> Image:
    """The bound (H, W), raised to the deck plane's transmission where the picture shows that the sea is too far.

    What stands out of the sea and lies on the deck is exactly there; of what is lower, too little haze is taken away.
    """
    low, high = config.standing_out
    surely = np.clip((bound / np.maximum(sea_t, np.float32(1e-6)) - low) / (high - low), 0, 1)
    return bound + surely * np.maximum(deck_t - bound, 0)


def object_share(
    image: Image, hazy_sea: Image, sea_t: Image, bound: Image, view: SeaView, config: GeometryConfig
) -> Image:
    """How surely each pixel (H, W) shows something nearer than sea and sky, 0 to 1.

    On the sea: what differs from hazy water, where haze flattens waves with everything else. In the sky: what is
    darker than the sky at its height, reaches down to the sea, and shows through clearly enough. Gaps are closed:
    paint on a deck may be as bright as the haze.
    """
    import cv2

    is_sea = view.is_sea
    off = strongest(np.abs(image - hazy_sea))
    off[~is_sea] = darker_than_sky(image[:, ~is_sea], view.down[~is_sea])
    waves = np.where(is_sea, sea_t, np.float32(1))
    low, high = (
        config.level_sigma * sigmas * (1 - waves) + level * waves
        for sigmas, level in zip(OBJECT_SIGMAS, config.object_levels, strict=True)
    )
    share = np.clip((off - low) / (high - low), 0, 1)
    share *= np.where(is_sea, 1, np.clip(bound / config.min_object_t - 1, 0, 1))
    count, labels = cv2.connectedComponents((share > 0.5).astype(np.uint8))
    stands = np.zeros(count, dtype=bool)
    stands[labels[is_sea]] = True
    share *= is_sea | stands[labels]
    window = scaled_px(config.window_px, image.shape[2])
    closed = cv2.morphologyEx(share.astype(np.float32), cv2.MORPH_CLOSE, np.ones((window, window), np.uint8))
    edge = scaled_px(config.window_px // 3, image.shape[2])
    return np.asarray(cv2.blur(closed, (edge, edge)), dtype=np.float32)


def darker_than_sky(levels: Image, down: Image) -> Image:
    """How many levels pixels of the sky (3, N) are darker than the median of those as high (N,), in any channel.

    Zero where there is too little sky to tell.
    """
    nothing = np.zeros(len(down), dtype=np.float32)
    if len(down) < MIN_SKY_BIN_PX:
        return nothing
    low = down.min()
    bin_height = np.float32(max(float(down.max() - low), 1e-6) / SKY_BINS)
    place = (down - low) * (1 / bin_height)
    which = np.minimum(place.astype(np.uint8), SKY_BINS - 1)
    counts = np.bincount(which, minlength=SKY_BINS)
    filled = np.flatnonzero(counts >= MIN_SKY_BIN_PX)
    if not len(filled):
        return nothing
    bins = np.split(levels[:, np.argsort(which, kind="stable")], np.cumsum(counts)[:-1], axis=1)
    medians = np.stack([np.median(bins[k], axis=1) for k in filled], axis=1)
    steps = (np.arange(SKY_BINS * SKY_STEPS) + 0.5) / SKY_STEPS
    usual = np.stack([np.interp(steps, filled + 0.5, channel) for channel in medians]).astype(np.float32)
    return strongest(usual[:, np.minimum((place * SKY_STEPS).astype(np.int32), len(steps) - 1)] - levels)


def strongest(levels: Image) -> Image:
    """Largest of three channels, (3, ...) -> (...)."""
    return np.maximum(np.maximum(levels[0], levels[1]), levels[2])


def scaled_px(length_px: int, width_px: int) -> int:
    """An odd length for an image of this width."""
    return max(1, round(length_px * width_px / REFERENCE_PX)) // 2 * 2 + 1
