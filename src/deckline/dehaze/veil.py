"""Dehazing from one image alone: an airlight that follows the sky, and a veil under the darkest detail.

I = J (1 - V) + A V. The airlight A is a smooth surface through the sky; a plain sky is therefore left as it is. The
veil V comes from the dark channel, less what a scene's darkest details send themselves, smoothed along the image's
edges. No pixel has more of it than leaves its darkest colour some light, and less of it comes off where no detail
is seen: fog that gets darker towards the horizon stays fog. More of it comes off in thick fog than in haze, where what
is seen would get glows and smears. J is the most likely scene where noise and an uncertain airlight pass for little
signal. A picture whose dark places are dark, or that is colourful, is hardly changed: only the level of its darkest
details and its colours distinguish an overcast scene from a hazy one.

Sources: He, Sun and Tang 2011 (dark channel); Tarel and Hautiere, "Fast visibility restoration from a single color or
gray level image", 2009 (atmospheric veil); He, Sun and Tang 2013 (guided filter). The airlight's surface, the strength
and the tone are ours, chosen by eye on photographs of fog that are not part of this project.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_image
from deckline.dehaze.airlight import estimate_airlight_surface
from deckline.dehaze.base import DehazeResult, linear_step
from deckline.dehaze.filters import (
    dark_channel,
    estimate_noise,
    guided_coefficients,
    max_channel,
    mean_channel,
    min_channel,
)
from deckline.types import Frame

Image = NDArray[np.float32]

ANALYSIS_PX = 480  # longer side of the image that air and veil are estimated in
PATCH = 1 / 60  # of its width, as the next three: the dark channel's window
GUIDE_RADIUS = 1 / 24
GUIDE_EPS = 1e-3
MAX_VEIL = 0.92
STRENGTH = (0.6, 0.95)  # of the veil that is taken off: in haze, in thick fog; He et al. take 0.95 of every
THICK = (0.8, 0.9)  # mean dark channel outside the sky. In less, 0.95 shows glows and smears beside what is seen
OWN_LIGHT = 0.18  # of the airlight: what a scene's darkest details send themselves
LEAST_LIGHT = 0.1, 0.25  # of the airlight, and of a pixel's own darkest colour over it: no mast gets darker
DETAIL = 0.001  # of full scale: how much an image varies about its blurred self where half of the veil is sure
DETAIL_SIGMA, DETAIL_SIDE = 3, 3  # px, of the blur; of the mean over that difference
DETAIL_GAP = 0.03  # of the width: details no farther apart are one object
DETAIL_RADIUS, DETAIL_EPS = 0.015, 1e-4  # of the width; of the filter that fits the certainty to the object's edges
LEAST_SURE = 0.2  # of the veil comes off where no detail is seen
STRIP_PX = 1 << 16  # solved at once: its few float maps stay in a core's cache
NIGHT = (0.1, 0.2)  # airlight, share of full scale: nothing is done, everything is done
COLOURED = (0.35, 0.45)  # its saturation: haze, a blue sky or a sunset; 0.21 at most in 45 photographs of fog
WARM = (0.1, 0.2)  # red less blue, over its brightest colour: haze, a low sun; 0.09 at most but for one sunrise
DARKEST = (0.03, 0.2, 0.5)  # dark channel over airlight, 2nd percentile: no haze, haze; what that weighs
MEAN = (0.3, 0.55, 0.7)  # its mean outside the sky: the same
COLOURS = (0.19, 0.28)  # mean saturation under a white airlight, outside the sky: haze, none
FAR_ROWS = 0.06  # of the height, next under the sky: what is far, where haze leaves the least colour
FAR_COLOURS = (0.12, 0.16)  # its mean saturation: haze, none
LEAST_COLOUR = 0.05  # of the airlight: darker pixels have the noise's colours
SCENE_SIGMA = 0.12  # of full scale: how much a scene varies about the airlight
MIN_NOISE, NOISE_WEIGHT = 0.008, 1.5  # of full scale, 1-sigma; times what neighbours differ by
GREY_SIGMA, COLOUR_SIGMA = 0.006, 0.05  # of the airlight's own grey and colour, of full scale
BRIGHT, BRIGHT_SHARE = 0.1, 0.3  # what is so much brighter than the airlight gets this share: full scale is near
SMOOTH_PX = 8  # radius in which noise is averaged; compression makes blocks of 8 and 16 px
SMOOTH_NOISE = 1.5  # sigmas of the contrast that is taken for noise
TONE_SHARE = 0.8  # of the brightness lost with the veil is restored
MIN_GAMMA = 0.55
LEVELS = 4096  # of the table that gives it back


@dataclass(frozen=True, eq=False)
class Air:
    """The air of one image, at the analysis' resolution."""

    airlight: Image
    """(h, w, 3) of full scale."""
    sigma: Image
    """(h, w) 1-sigma of the airlight."""
    slope: Image
    """(h, w) of the veil V = slope * grey + offset."""
    offset: Image
    """(h, w)."""
    share: Image
    """(h, w, 3) of the contrast C' = share * image + shift whose noise is averaged out."""
    shift: Image
    """(h, w, 3)."""
    noise: float
    """1-sigma of a pixel, of full scale."""
    strength: float
    """Share of the dark channel's veil that is removed."""

    def in_rows(self, rows: range, height: int, width: int) -> "Air":
        """The air in some rows of an image of another size; all of it at once would be slow to allocate."""
        import cv2

        last = len(self.sigma) - 1
        y = ((np.array(rows, np.float32) + 0.5) * len(self.sigma) / height - 0.5).clip(0, last)
        above = np.minimum(y.astype(np.intp), max(last - 1, 0))
        share, size = (y - above).astype(np.float32)[:, None, None], (width, len(rows))

        def stretch(part: Image) -> Image:
            between = part[above] + share * (part[np.minimum(above + 1, last)] - part[above])
            return np.asarray(cv2.resize(between, size), np.float32)

        sigma, slope, offset = np.moveaxis(stretch(np.dstack([self.sigma, self.slope, self.offset])), 2, 0)
        airlight, kept, shift = (stretch(part) for part in (self.airlight, self.share, self.shift))
        return Air(airlight, sigma, slope, offset, kept, shift, self.noise, self.strength)


class VeilDehazer:
    """Dehazes images without a pose; one that shows no haze comes out as it is, with a note."""

    name = "veil"

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return self._restore(image_rgb).image_rgb

    def restore(self, frame: Frame) -> DehazeResult:
        return self._restore(frame.image_rgb)

    def _restore(self, image_rgb: NDArray[np.uint8]) -> DehazeResult:
        import cv2

        check_image(image_rgb)
        height, width = image_rgb.shape[:2]
        scale = min(1.0, ANALYSIS_PX / max(height, width))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        small, sample = (
            to_full_scale(cv2.resize(image_rgb, size, interpolation=way)) for way in (cv2.INTER_AREA, cv2.INTER_NEAREST)
        )
        noise = estimate_noise(np.diff(image_rgb[:: max(1, height // 90)].astype(np.int16), axis=1)) / 255
        air = estimate_air(small, sample, noise, max(1, round(SMOOTH_PX * scale)))
        if air.strength == 0:
            return DehazeResult(image_rgb.copy(), "not dehazed: the picture is dark, or its dark places show no haze")
        return DehazeResult(remove_veil(image_rgb, air, find_gamma(small, air)))


def to_full_scale(levels: NDArray) -> Image:
    """Levels 0..255 as float32 shares of full scale."""
    return np.asarray(levels, np.float32) / np.float32(255)


def estimate_air(image: Image, sample: Image, noise: float, radius_px: int) -> Air:
    """Airlight and veil of an image.

    Args:
        image: (h, w, 3) of full scale, averaged from a larger one.
        sample: (h, w, 3) single pixels of that one.
        noise: of its pixels, 1-sigma.
        radius_px: in which the noise is averaged out.
    """
    import cv2

    width = image.shape[1]
    air = estimate_airlight_surface(image)
    airlight = air.colour
    patch = max(3, round(width * PATCH))
    ratio = image / airlight
    # An opening of the smallest channel follows edges better than its minimum alone.
    opened = cv2.dilate(dark_channel(ratio, patch), np.ones((patch, patch), np.uint8))
    dark = cv2.GaussianBlur(opened, (0, 0), patch / 2).clip(0, 1)
    colours, far = saturation(ratio), _far_side(air.sky)
    below = dark[~air.sky]
    strength = _haziness(below, colours[~air.sky], colours[far], airlight.mean(axis=(0, 1)))
    if strength > 0:
        strength *= float(np.interp(below.mean(), THICK, STRENGTH))
    veil = strength * np.clip((dark - OWN_LIGHT) / (1 - OWN_LIGHT), 0, 1)
    veil = np.minimum(veil, own_veil(image, airlight)).clip(0)
    grey = mean_channel(image)
    veil *= LEAST_SURE + (1 - LEAST_SURE) * detail_certainty(grey)
    slope, offset = guided_coefficients(grey, veil, max(4, round(width * GUIDE_RADIUS)), GUIDE_EPS)
    noise = max(MIN_NOISE, NOISE_WEIGHT * noise)
    share, shift = smooth_noise(image - airlight, sample - airlight, noise, radius_px)
    return Air(airlight, air.sigma, slope, offset, share, shift - share * airlight, noise, strength)


def detail_certainty(grey: Image) -> Image:
    """Certainty, 0 to 1, that each pixel of an image (h, w) of full scale belongs to an object in the haze.

    It ends at the object's edge: with its surroundings cleared as well, a ship has a dark glow about it.
    """
    import cv2

    width = grey.shape[1]
    gap = max(3, round(width * DETAIL_GAP))
    fine = cv2.blur(np.abs(grey - cv2.GaussianBlur(grey, (0, 0), DETAIL_SIGMA)), (DETAIL_SIDE, DETAIL_SIDE))
    filled = cv2.morphologyEx(fine, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (gap, gap)))
    certainty = np.asarray(filled / (filled + np.float32(DETAIL)), dtype=np.float32)
    slope, offset = guided_coefficients(grey, certainty, max(2, round(width * DETAIL_RADIUS)), DETAIL_EPS)
    return np.asarray((slope * grey + offset).clip(0, 1), dtype=np.float32)


def _far_side(sky: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The rows (h, w) next under the sky, also (h, w); without a sky the first rows."""
    import cv2

    rows = max(1, round(len(sky) * FAR_ROWS))
    upwards = np.ones((2 * rows + 1, 1), np.uint8)
    upwards[rows + 1 :] = 0
    near = cv2.dilate(sky.astype(np.uint8), upwards, borderType=cv2.BORDER_CONSTANT, borderValue=1)
    return (near > 0) & ~sky


def _haziness(dark: Image, saturations: Image, far_saturations: Image, airlight: Image) -> float:
    """How surely an image is hazy, 0 to 1. A colourful scene is not: haze takes colours away, most in the distance.

    Args:
        dark: (N,) its dark channel over the airlight, outside the sky.
        saturations: (N,) of its colours over the airlight, outside the sky.
        far_saturations: (M,) of those next under the sky.
        airlight: (3,) mean, of full scale; haze has little colour.
    """
    if not len(dark):
        return 0.0
    parts = [
        weight * linear_step(value, low, high)
        for value, (low, high, weight) in ((float(np.percentile(dark, 2)), DARKEST), (float(dark.mean()), MEAN))
    ]
    coloured = linear_step(float(np.ptp(airlight) / airlight.max()), *COLOURED)
    warm = linear_step(float((airlight[0] - airlight[2]) / airlight.max()), *WARM)
    colours = linear_step(float(saturations.mean()), *COLOURS)
    far_colours = linear_step(float(far_saturations.mean()), *FAR_COLOURS) if len(far_saturations) else 0.0
    sure = min(1.0, sum(parts)) * linear_step(float(airlight.mean()), *NIGHT)
    return sure * (1 - coloured) * (1 - warm) * (1 - colours) * (1 - far_colours)


def saturation(image: Image) -> Image:
    """Of colours (H, W, 3), 0 to 1: (H, W)."""
    least, most = min_channel(image), max_channel(np.moveaxis(image, 2, 0))
    return np.asarray((most - least) / np.maximum(most, np.float32(LEAST_COLOUR)), dtype=np.float32)


def estimate_scene(image: Image, air: Air) -> Image:
    """The most likely scene (H, W, 3) of full scale, not clipped; the air is of the image's size.

    Only what differs from the airlight by more than noise and its own colour error is drawn apart; the rest stays.
    What is brighter than the airlight nears full scale without reaching it.
    """
    import cv2

    level = mean_channel(image)
    veil = np.minimum(air.slope * level + air.offset, own_veil(image, air.airlight)).clip(0, MAX_VEIL)
    t = 1 - veil
    variance = air.noise**2 + np.square(air.sigma * veil)
    more = np.maximum(t / (t * t + variance / SCENE_SIGMA**2), 1) - 1
    contrast = air.share * image
    contrast += air.shift
    grey = mean_channel(contrast)
    grey_square = grey * grey
    squares = 3 * np.maximum(mean_channel(contrast * contrast) - grey_square, 0)
    colour_share = squares / (squares + COLOUR_SIGMA**2)
    sure_grey = grey * grey_square / (grey_square + GREY_SIGMA**2)
    more *= 1 - (1 - BRIGHT_SHARE) * np.clip(sure_grey / BRIGHT, 0, 1)
    room = np.maximum(1 - level, 1e-3)
    more *= room / (room + more * np.maximum(sure_grey, 0))
    gain, shift = more * colour_share, more * (sure_grey - colour_share * grey)
    contrast *= cv2.merge([gain] * 3)
    contrast += cv2.merge([shift] * 3)
    contrast += image
    return contrast


def own_veil(image: Image, airlight: Image) -> Image:
    """The largest veil (H, W) that leaves a pixel's darkest colour its least light; lighter pixels retain more."""
    import cv2

    darkest = min_channel(np.asarray(cv2.divide(image, airlight), np.float32))
    light = LEAST_LIGHT[0] + LEAST_LIGHT[1] * np.minimum(darkest, 1)
    return np.asarray((darkest - light) / (1 - light), dtype=np.float32)


def smooth_noise(contrast: Image, sample: Image, noise: float, radius_px: int) -> tuple[Image, Image]:
    """Share and shift (h, w, 3) of the contrast share * C + shift: ripples as small as noise are averaged out.

    Compression's are, too; edges stay.

    Args:
        contrast: (h, w, 3), averaged from a larger one.
        sample: (h, w, 3) single pixels of that one, which vary as it does.
        noise: 1-sigma, of full scale.
        radius_px: of the square window.

    Source: He, Sun and Tang 2013, the guided filter with the image as its own guide; He and Sun, "Fast guided filter",
    2015 (at a lower resolution).
    """
    import cv2

    side = (2 * radius_px + 1,) * 2
    mean, sampled = cv2.blur(contrast, side), cv2.blur(sample, side)
    variance = np.maximum(cv2.blur(sample * sample, side) - sampled * sampled, 0)
    share = cv2.blur(variance / (variance + np.float32((SMOOTH_NOISE * noise) ** 2)), side)
    return np.asarray(share, np.float32), np.asarray(mean - share * mean, np.float32)


def find_gamma(small: Image, air: Air) -> float:
    """The exponent that restores TONE_SHARE of the brightness lost with the veil."""
    scene = estimate_scene(small, air).clip(0, 1)
    bright, mean = float(small.mean()), float(scene.mean())
    if mean >= bright or mean < 1e-3:
        return 1.0
    return float(np.clip(np.log(mean + TONE_SHARE * (bright - mean)) / np.log(mean), MIN_GAMMA, 1))


def tone_table(gamma: float, airlight: float) -> NDArray[np.uint8]:
    """Levels (LEVELS,) that a gamma lifts, less towards white and not from half way between the airlight and it on."""
    level = np.linspace(0, 1, LEVELS)
    share = np.clip(1 - np.square(level / ((1 + airlight) / 2)), 0, 1)
    return np.asarray(np.rint(255 * (level + share * (level**gamma - level))), dtype=np.uint8)


def remove_veil(image_rgb: NDArray[np.uint8], air: Air, gamma: float) -> NDArray[np.uint8]:
    """An image (H, W, 3) of any size without its veil, strip by strip."""
    height, width = image_rgb.shape[:2]
    table = tone_table(gamma, float(air.airlight.mean()))
    clear = np.empty_like(image_rgb)
    step = max(1, STRIP_PX // width)
    for top in range(0, height, step):
        rows = range(top, min(top + step, height))
        scene = estimate_scene(to_full_scale(image_rgb[top : rows.stop]), air.in_rows(rows, height, width))
        clear[top : rows.stop] = table[(scene * (LEVELS - 1) + 0.5).clip(0, LEVELS - 1).astype(np.intp)]
    return clear
