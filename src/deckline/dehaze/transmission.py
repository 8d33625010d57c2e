"""Transmission of every pixel of a hazy image, and the most likely scene behind the haze.

Two lower bounds of the transmission are at hand: of the sea's range, and of a dark or bright detail, since no light is
negative or beyond full scale. What rises out of the sea, as a ship does, is nearer than the sea behind it; there the
second bound applies, or the deck plane's transmission where it is larger.
"""

from dataclasses import dataclass

import numpy as np

from deckline.checks import check_numbers
from deckline.dehaze.filters import max_channel
from deckline.dehaze.haze_fit import HazeFit
from deckline.dehaze.pixel_map import Image
from deckline.dehaze.sea_view import SeaView
from deckline.haze import transmission

REFERENCE_PX = 1280  # image width that lengths in pixels are meant for
OBJECT_SIGMAS = (1.0, 2.5)  # of noise off the airlight where haze hides the sea: as object_levels
SKY_BINS = 40  # of equal width in the sine of the elevation
SKY_STEPS = 16  # between the middles of two bins
MIN_SKY_BIN_PX = 60
MAX_SKY_PX = 10_000  # that the medians are taken of, evenly chosen


@dataclass(frozen=True)
class GeometryConfig:
    """Settings of the geometry dehazer. Lengths in pixels are meant for images 1280 px wide and scaled for others."""

    sea_below_deck_m: float = 20.0  # where the frame does not know the sea's height; Nimitz class
    clear_beta_per_m: float = 1e-4  # what is left in the image: a clear day's air, visibility 39 km
    level_sigma: float = 2.0  # of a pixel's noise, levels 0..255, at least; a sky that shows more raises it
    airlight_sigma: float = 0.02  # of the airlight's share in a pixel, as a fraction of it
    scene_sigma: float = 40.0  # of ship and waves about the sea's mean colour, levels
    # The same of what differs from grey; 8 to 20 are alike: docs/experiments/2026-11-dehazing-blend.md
    airlight_chroma_sigma: float = 0.01
    chroma_sigma: float = 12.0
    object_levels: tuple[float, float] = (12.0, 30.0)  # off the hazy sea or sky: surely not an object, surely one
    nearer_ratio: tuple[float, float] = (1.1, 1.5)  # bound over the sea's transmission: surely sea, surely nearer
    window_px: int = 15  # over which one dark detail bounds its neighbours
    object_range_m: float = 1500.0  # ships farther away are taken to be here; clear images stay as they are
    darkest: float = 0.2  # of the airlight: what light a ship's darkest detail still sends
    min_object_t: float = 0.2  # above the horizon; fainter objects are left in the haze

    def __post_init__(self) -> None:
        check_numbers(self, "", "level_sigma", "scene_sigma", "chroma_sigma", "window_px", "min_object_t", above=0)


def find_objects(
    image: Image, view: SeaView, deck: SeaView, haze: HazeFit, config: GeometryConfig
) -> tuple[Image, Image]:
    """What is nearer than the sea: how surely (H, W), 0 to 1, and the least transmission (H, W) that it then has.

    Args:
        image: (3, H, W) levels 0..255, as `haze` was fitted.
        deck: the deck's plane, seen as if it were endless.
    """
    airlight = haze.airlight.astype(np.float32)[:, None, None]
    sea_t = np.exp(-haze.optical_depth(view.range_m))
    farthest = np.exp(-haze.optical_depth(np.float32(config.object_range_m)))
    bound = np.maximum(bound_transmission(image, airlight, config), farthest)
    bound = raise_to_deck(bound, sea_t, np.exp(-haze.optical_depth(deck.range_m)), config)
    hazy_sea = airlight + sea_t * (haze.clear_sea(view.down) - airlight)
    return _object_certainty(image, hazy_sea, sea_t, bound, view, config), bound


def bound_transmission(image: Image, airlight: Image, config: GeometryConfig) -> Image:
    """Least transmission (H, W) that the darkest or brightest detail about a pixel allows.

    J <= 255 gives t >= (I - A) / (255 - A). J >= 0 gives t >= (A - I) / A, and a little more, as ships are not black.
    Source: He, Sun and Tang 2011 for the dark side.
    """
    import cv2

    below: Image = np.maximum(np.float32(1 - config.darkest) * airlight, np.float32(1))
    above: Image = np.maximum(255 - airlight, np.float32(1))
    contrast = image - airlight
    bound = max_channel(np.maximum(contrast * (1 / above), contrast * (-1 / below)))
    window = scale_length(config.window_px, image.shape[2])
    spread = np.asarray(cv2.dilate(bound, np.ones((window, window), np.uint8)), dtype=np.float32)
    return np.asarray(np.clip(cv2.blur(spread, (window, window)), 0, 1), dtype=np.float32)


def raise_to_deck(bound: Image, sea_t: Image, deck_t: Image, config: GeometryConfig) -> Image:
    """The bound (H, W), raised to the deck plane's transmission where the image shows that the sea is too far.

    What rises out of the sea and lies on the deck is exactly there; of what is lower, too little haze is removed.
    """
    low, high = config.nearer_ratio
    certainty = np.clip((bound / np.maximum(sea_t, np.float32(1e-6)) - low) / (high - low), 0, 1)
    return bound + certainty * np.maximum(deck_t - bound, 0)


def _object_certainty(
    image: Image, hazy_sea: Image, sea_t: Image, bound: Image, view: SeaView, config: GeometryConfig
) -> Image:
    """How surely each pixel (H, W) shows something nearer than sea and sky, 0 to 1.

    On the sea: what differs from hazy water, where haze flattens waves with everything else. In the sky: what is
    darker than the sky at its height, reaches down to the sea, and shows through clearly enough. Gaps are closed:
    paint on a deck may be as bright as the haze. At its edge an object is as sure as it covers the pixel, by contrast:
    with the water beside it, it has a pale halo.
    """
    import cv2

    is_sea = view.is_sea
    contrast = max_channel(np.abs(image - hazy_sea))
    contrast[~is_sea] = sky_contrast(image[:, ~is_sea], view.down[~is_sea])
    waves = np.where(is_sea, sea_t, np.float32(1))
    low, high = (
        config.level_sigma * sigmas * (1 - waves) + level * waves
        for sigmas, level in zip(OBJECT_SIGMAS, config.object_levels, strict=True)
    )
    certainty = np.clip((contrast - low) / (high - low), 0, 1)
    certainty *= np.where(is_sea, 1, np.clip(bound / config.min_object_t - 1, 0, 1))
    count, labels = cv2.connectedComponents((certainty > 0.5).astype(np.uint8))
    reaches_sea = np.zeros(count, dtype=bool)
    reaches_sea[labels[is_sea]] = True
    certainty *= is_sea | reaches_sea[labels]
    window = scale_length(config.window_px, image.shape[2])
    closed = cv2.morphologyEx(certainty.astype(np.float32), cv2.MORPH_CLOSE, np.ones((window, window), np.uint8))
    edge = scale_length(config.window_px // 3, image.shape[2])
    square = np.ones((edge, edge), np.uint8)
    inner, covered = cv2.erode(closed, square), np.maximum(contrast, 0)
    covered /= np.maximum(cv2.dilate(covered, square), np.float32(1e-3))
    return np.minimum(inner + (closed - inner) * covered, cv2.blur(closed, (edge, edge)))


def sky_contrast(levels: Image, down: Image) -> Image:
    """How many levels pixels of the sky (3, N) are darker than the median at their height (N,), in any channel.

    Zero where there is too little sky.
    """
    nothing = np.zeros(len(down), dtype=np.float32)
    if len(down) < MIN_SKY_BIN_PX:
        return nothing
    low = down.min()
    bin_height = np.float32(max(float(down.max() - low), 1e-6) / SKY_BINS)
    place = (down - low) * (1 / bin_height)
    part = slice(None, None, 1 + len(down) // MAX_SKY_PX)
    which = np.minimum(place[part].astype(np.uint8), SKY_BINS - 1)
    counts = np.bincount(which, minlength=SKY_BINS)
    filled = np.flatnonzero(counts >= MIN_SKY_BIN_PX)
    if not len(filled):
        return nothing
    bins = np.split(levels[:, part][:, np.argsort(which, kind="stable")], np.cumsum(counts)[:-1], axis=1)
    medians = np.stack([np.partition(bins[k], counts[k] // 2)[:, counts[k] // 2] for k in filled], axis=1)
    steps = (np.arange(SKY_BINS * SKY_STEPS) + 0.5) / SKY_STEPS
    usual = np.stack([np.interp(steps, filled + 0.5, channel) for channel in medians]).astype(np.float32)
    return max_channel(usual[:, np.minimum((place * SKY_STEPS).astype(np.int32), len(steps) - 1)] - levels)


def scale_length(length_px: int, width_px: int) -> int:
    """An odd length for an image of this width."""
    return max(1, round(length_px * width_px / REFERENCE_PX)) // 2 * 2 + 1


def transmissions(
    view: SeaView, bound: Image, range_m: Image | None, haze: HazeFit, config: GeometryConfig
) -> tuple[tuple[Image, Image], tuple[Image, Image]]:
    """Of sea and plain sky, and of objects before them: transmission of the haze, and of the clear day's air after it.

    (H, W) each, 1 in a plain sky. `bound` (H, W) is that of `find_objects`; `range_m` (H, W) holds measured ray
    lengths, NaN where unknown, and is None without a depth camera.
    """
    sea_t = np.exp(-haze.optical_depth(view.range_m))
    t, object_t = np.where(view.is_sea, sea_t, np.float32(1)), np.maximum(sea_t, bound)
    clear_t = np.where(view.is_sea, transmission(view.range_m, config.clear_beta_per_m), 1)
    object_clear_t = np.ones_like(sea_t)
    if range_m is not None:
        measured = np.isfinite(range_m)
        measured_t = np.exp(-haze.optical_depth(np.where(measured, range_m, 0)))
        t, object_t = (np.where(measured, measured_t, part) for part in (t, object_t))
        clear_t = np.where(measured, 1, clear_t)
    return (t, clear_t), (object_t, object_clear_t)


def signal_gain(t: Image, airlight: float, level_sigma: float, airlight_sigma: float, scene_sigma: float) -> Image:
    """Gain (H, W) on what is unexpected in I = J t + A (1 - t) + noise, for the most likely J, normal about its mean.

    It is near 1 / t in thin haze and falls to 0 where nothing but noise comes through. The noise includes a part of the
    airlight's error. The sigmas are those of `GeometryConfig`.
    """
    hidden = airlight_sigma * airlight * (1 - t)
    noise = np.float32(level_sigma**2) + hidden * hidden
    return np.asarray(t / (t * t + noise / np.float32(scene_sigma**2)), np.float32)
