"""Dehazing without a network: the pose says how far away the sea is, the picture says what the air is like.

Every pixel's transmission t has two lower bounds, and the larger one is taken. Nothing lies below the sea, so its
range bounds t from below. No light is negative or beyond full scale, so a dark or bright detail bounds t as well;
what stands out of the sea, as a ship does, is nearer than the sea behind it, and there this bound is the larger one,
and the deck's plane a better one still. A depth camera replaces them all where it sees something.

I = J t + A (1 - t) is then solved for the most likely J: where haze leaves no signal, that is the sea's own colour:
plain sea in the result does not mean that nothing is there.

The air and what stands out are looked for in a picture of at most LOOK_PX; only the solution is made pixel by pixel.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.base import Restored, check_image
from deckline.dehaze.geometry_config import GeometryConfig
from deckline.dehaze.haze_fit import DISPLAY_WATER, LIGHT_WATER, HazeFit, NotFitted, fit_haze
from deckline.dehaze.objects import bounded_t, object_share, raised_to_deck
from deckline.dehaze.sea_view import SeaView, ray_lengths, sea_view
from deckline.haze import transmission
from deckline.types import Frame

Image = NDArray[np.float32]

LOOK_PX = 640  # longer side of the picture that air and objects are looked for in
NOISE_ROWS = 90  # about so many are looked at for noise
NOISE_WEIGHT = 2.0  # best in [1, 3] on preset paper with noise of 3 and 8 levels added
NOISE_PART = 0.9  # of the differences that count
NOISE_MEAN = 0.9297  # of a normal difference of sigma sqrt(2), in size, of that smallest part
STRIP_PX = 1 << 16  # solved at once: its few float maps stay in a core's cache


@dataclass(frozen=True, eq=False)
class Solved:
    """A frame whose air could be told."""

    image_rgb: NDArray[np.uint8]  # (H, W, 3) without its haze
    haze: HazeFit
    known: Image  # (H, W) how surely the range of what is seen is known, 0 (the sky, left as it is) to 1


class GeometryDehazer:
    """Dehazes frames with a pose and the height of sea or deck; a note says why others come out as they are."""

    def __init__(self, config: GeometryConfig | None = None, name: str = "geometry") -> None:
        self.name = name
        self.config = config or GeometryConfig()

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        return image_rgb.copy()  # an image alone says nothing about ranges

    def restore(self, frame: Frame) -> Restored:
        solved = self.solve(frame)
        if isinstance(solved, NotFitted):
            return Restored(frame.image_rgb.copy(), f"not dehazed: {solved.reason}")
        return Restored(solved.image_rgb)

    def solve(self, frame: Frame) -> Solved | NotFitted:
        """The frame without its haze and what its air is like, or why that cannot be told."""
        pose = frame.world_from_camera
        if pose is None:
            return NotFitted("the frame has no pose; give poses or choose another dehazer")
        heights = self._heights(frame)
        if heights is None:
            return NotFitted("no height is known; give --sea-z-m or --deck-z-m, or choose another dehazer")
        sea_z_m, deck_z_m = heights
        if sea_z_m < deck_z_m:
            return NotFitted(f"the sea (z {sea_z_m:g} m) is above the deck (z {deck_z_m:g} m); z points down")
        small = smaller(frame, LOOK_PX)
        view = sea_view(small.camera, pose, sea_z_m)
        if view.height_m <= 0:
            return NotFitted(f"the camera is {-view.height_m:.1f} m below the sea")
        planes = level_table(self.config.light)[np.ascontiguousarray(np.moveaxis(small.image_rgb, 2, 0))]
        water = LIGHT_WATER if self.config.light == "linear" else DISPLAY_WATER
        seen, full = (noise_of_sky(picture, view, self.config.light) for picture in (small.image_rgb, frame.image_rgb))
        haze = fit_haze(np.moveaxis(planes, 0, 2), view, water, seen)
        if isinstance(haze, NotFitted):
            return haze
        deck = sea_view(small.camera, pose, deck_z_m)
        share, bound = nearer_things(planes, view, deck, haze, for_noise(self.config, seen))
        clear, known = remove_haze(frame, sea_z_m, haze, share, bound, for_noise(self.config, full))
        return Solved(clear, haze, known)

    def _heights(self, frame: Frame) -> tuple[float, float] | None:
        """World z of sea and deck; without a deck's height the sea's is taken for it, and raises nothing."""
        if frame.sea_z_m is None:
            deck_z_m = frame.deck_z_m
            return None if deck_z_m is None else (deck_z_m + self.config.sea_below_deck_m, deck_z_m)
        return frame.sea_z_m, frame.sea_z_m if frame.deck_z_m is None else frame.deck_z_m


def smaller(frame: Frame, long_side_px: int) -> Frame:
    """A frame averaged down to this longer side, its camera with it; small ones stay as big. Depth is left out."""
    import cv2

    height, width = frame.image_rgb.shape[:2]
    scale = min(1.0, long_side_px / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    if size == (width, height):
        return replace(frame, depth_m=None)
    image = np.asarray(cv2.resize(frame.image_rgb, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return replace(frame, image_rgb=image, camera=frame.camera.resized(*size), depth_m=None, truth=None)


def noise_of_sky(image_rgb: NDArray[np.uint8], view: SeaView, light: str) -> float:
    """1-sigma of a pixel's noise in the sky of a picture (H, W, 3), levels; `view` may be of another resolution."""
    import cv2

    rows = image_rgb[:: 1 + len(image_rgb) // NOISE_ROWS]
    size = (rows.shape[1], len(rows))
    sky = cv2.resize((~view.is_sea).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    levels, both = level_table(light)[rows], sky[:, 1:] & sky[:, :-1]
    return noise_sigma(levels[:, 1:][both] - levels[:, :-1][both])


def for_noise(config: GeometryConfig, noise_sigma: float) -> GeometryConfig:
    """Settings for pixels with at least this noise, 1-sigma in levels."""
    return replace(config, level_sigma=max(config.level_sigma, NOISE_WEIGHT * noise_sigma))


def noise_sigma(differences: Image) -> float:
    """1-sigma of a pixel's noise from differences (N, 3) of neighbours, of which the largest are clouds and edges."""
    sizes = np.abs(differences).ravel()
    count = int(NOISE_PART * sizes.size)
    return float(np.partition(sizes, count)[:count].mean() / NOISE_MEAN) if count else 0.0


def nearer_things(
    image: Image, view: SeaView, deck: SeaView, haze: HazeFit, config: GeometryConfig
) -> tuple[Image, Image]:
    """What is nearer than the sea: how surely (H, W), and the least transmission (H, W) that it has if it is.

    Args:
        image: (3, H, W) levels 0..255, of the display or of light, as `haze` was fitted.
        view: the sea in this picture.
        deck: the deck's plane, seen as if it were endless.
        haze: its air.
        config: the rest.
    """
    airlight = haze.airlight.astype(np.float32)[:, None, None]
    sea_t = np.exp(-haze.optical_depth(view.range_m))
    farthest = np.exp(-haze.optical_depth(np.float32(config.object_range_m)))
    bound = np.maximum(bounded_t(image, airlight, config), farthest)
    bound = raised_to_deck(bound, sea_t, np.exp(-haze.optical_depth(deck.range_m)), config)
    hazy_sea = airlight + sea_t * (haze.clear_sea(view.down) - airlight)
    return object_share(image, hazy_sea, sea_t, bound, view, config), bound


def remove_haze(
    frame: Frame, sea_z_m: float, haze: HazeFit, share: Image, bound: Image, config: GeometryConfig
) -> tuple[NDArray[np.uint8], Image]:
    """A frame's picture (H, W, 3) with its haze thinned to a clear day's, and how surely ranges are known (H, W).

    Args:
        frame: picture, camera, pose, and depth where a depth camera gives it.
        sea_z_m: world z of the water.
        haze: its air.
        share: how surely something is nearer than the sea, of the whole picture at any resolution.
        bound: its least transmission, as `share`.
        config: the rest.

    Raises:
        ValueError: a frame without a pose.
    """
    import cv2

    if frame.world_from_camera is None:
        raise ValueError(f"{frame.file}: a pose is needed")
    height, width = frame.image_rgb.shape[:2]
    size, smooth = (width, height), cv2.INTER_LINEAR
    share, bound = (np.asarray(cv2.resize(a, size, interpolation=smooth), np.float32) for a in (share, bound))
    levels = level_table(config.light)
    clear, known = np.empty_like(frame.image_rgb), share.copy()
    step = max(1, STRIP_PX // width)
    for top in range(0, height, step):
        rows = slice(top, top + step)
        view = sea_view(frame.camera, frame.world_from_camera, sea_z_m, rows)
        range_m = None if frame.depth_m is None else frame.depth_m[rows] * ray_lengths(frame.camera, rows)
        known[rows][view.is_sea if range_m is None else view.is_sea | np.isfinite(range_m)] = 1
        t, kept = transmissions(view, share[rows], bound[rows], range_m, haze, config)
        planes = np.ascontiguousarray(np.moveaxis(frame.image_rgb[rows], 2, 0))
        solved = thinned(levels[planes], view, haze, t, kept, config)
        solved = np.clip(np.rint(solved), 0, 255).astype(np.uint8)
        clear[rows] = np.moveaxis(np.where(t == 1, planes, solved), 0, 2)
    return clear, known


def transmissions(
    view: SeaView, share: Image, bound: Image, range_m: Image | None, haze: HazeFit, config: GeometryConfig
) -> tuple[Image, Image]:
    """Transmission of the haze and of the clear day's air that takes its place, (H, W) each; 1 in a plain sky.

    Args:
        range_m: (H, W) measured ray lengths, NaN where unknown; None without a depth camera.
        view, share, bound, haze, config: as in `remove_haze`, all (H, W).
    """
    sea_t = np.exp(-haze.optical_depth(view.range_m))
    sea_kept = share + (1 - share) * transmission(view.range_m, config.clear_beta_per_m)
    t = np.where(view.is_sea, np.maximum(sea_t, share * bound), 1 - share * (1 - bound))
    kept = np.where(view.is_sea, sea_kept, 1)
    if range_m is not None:
        measured = np.isfinite(range_m)
        t = np.where(measured, np.exp(-haze.optical_depth(np.where(measured, range_m, 0))), t)
        kept = np.where(measured, 1, kept)
    return t, kept


def thinned(image: Image, view: SeaView, haze: HazeFit, t: Image, kept: Image, config: GeometryConfig) -> Image:
    """Display levels (3, H, W) of what is seen through clear air where `image` (3, H, W) shows it through haze."""
    airlight = haze.airlight.astype(np.float32)[:, None, None]
    usual = np.where(view.is_sea, haze.clear_sea(view.down), airlight)
    clear = airlight + kept * (most_likely(image, usual, airlight, t, config) - airlight)
    return display_levels(clear) if config.light == "linear" else clear


def most_likely(image: Image, usual: Image, airlight: Image, t: Image, config: GeometryConfig) -> Image:
    """The scene J (3, H, W) of I = J t + A (1 - t) + noise, when J is spread about its usual colour (3, H, W).

    Both spreads are normal, so J is the usual colour plus a gain times what is unexpected in I. The gain is near 1 / t
    in thin haze and falls to 0 where nothing but noise comes through. The noise has a part of the airlight's error.
    """
    hidden = config.airlight_sigma * (1 - t) * airlight.mean()
    noise = np.float32(config.level_sigma**2) + hidden * hidden
    gain = t / (t * t + noise / np.float32(config.scene_sigma**2))
    return np.asarray(usual + gain * (image - airlight - t * (usual - airlight)))


def level_table(light: str) -> Image:
    """What display levels 0..255 come to in the light that haze is counted in, (256,)."""
    display = np.arange(256, dtype=np.float32)
    return linear_levels(display) if light == "linear" else display


def linear_levels(display: NDArray) -> Image:
    """Light, 0..255, of display levels 0..255. Source: IEC 61966-2-1 (sRGB)."""
    x = np.asarray(display, dtype=np.float32) / 255
    return np.asarray(255 * np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4), dtype=np.float32)


def display_levels(light: Image) -> Image:
    """The inverse of `linear_levels`; light beyond 0..255 is clipped."""
    y = np.clip(light, 0, 255) / 255
    return np.asarray(255 * np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1 / 2.4) - 0.055), dtype=np.float32)
