"""Dehazing without a network: the pose says how far away the sea is, the picture says what the air is like.

Every pixel's transmission t has two lower bounds, and the larger one is taken. Nothing lies below the sea, so its
range bounds t from below. No light is negative or beyond full scale, so a dark or bright detail bounds t as well;
what stands out of the sea, as a ship does, is nearer than the sea behind it, and there this bound is the larger one,
and the deck's plane a better one still. A depth camera replaces them all where it sees something.

I = J t + A (1 - t) is then solved for the most likely J: where haze leaves no signal, that is the sea's own colour:
plain sea in the result does not mean that nothing is there.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.base import Restored, check_image
from deckline.dehaze.haze_fit import HazeFit, NotFitted, fit_haze
from deckline.dehaze.sea_view import SeaView, sea_view
from deckline.haze import transmission
from deckline.types import Frame

Image = NDArray[np.float32]

REFERENCE_PX = 1280  # image width that lengths in pixels are meant for
OBJECT_SIGMAS = (1.0, 2.5)  # of noise off the airlight where haze hides the sea: as object_levels
SKY_BINS = 40  # of equal width in the sine of the elevation
MIN_SKY_BIN_PX = 60


@dataclass(frozen=True)
class GeometryConfig:
    """Lengths in pixels are meant for images REFERENCE_PX wide and scaled for others."""

    light: Literal["display", "linear"] = "display"  # what haze adds to: the picture's levels, or sRGB's light
    sea_below_deck_m: float = 20.0  # flight deck above water; Nimitz class
    clear_beta_per_m: float = 1e-4  # what is left in the picture: a clear day's air, visibility 39 km
    level_sigma: float = 2.0  # of a pixel's noise, levels 0..255
    airlight_sigma: float = 0.02  # of the airlight's share in a pixel, as a fraction of it
    scene_sigma: float = 40.0  # of ship and waves about the sea's mean colour, levels
    object_levels: tuple[float, float] = (12.0, 30.0)  # off the hazy sea or sky: surely not an object, surely one
    standing_out: tuple[float, float] = (1.1, 1.5)  # bound over the sea's transmission: surely sea, surely nearer
    window_px: int = 15  # over which one dark detail speaks for its neighbours
    object_range_m: float = 1500.0  # ships farther away count as being here; keeps clear pictures as they are
    darkest: float = 0.2  # of the airlight: what light a ship's darkest detail still sends
    min_object_t: float = 0.2  # above the horizon; fainter objects are left in the haze

    def __post_init__(self) -> None:
        if self.light not in ("display", "linear"):
            raise ValueError(f'light must be "display" or "linear", got {self.light!r}')
        for name in ("sea_below_deck_m", "level_sigma", "scene_sigma", "window_px", "object_range_m", "min_object_t"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("clear_beta_per_m", "airlight_sigma"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if not 0 <= self.darkest < 1:
            raise ValueError(f"darkest must lie in [0, 1), got {self.darkest}")
        for name in ("object_levels", "standing_out"):
            low, high = getattr(self, name)
            if not 0 <= low < high:
                raise ValueError(f"{name} must rise from 0 or more, got {low} to {high}")


class GeometryDehazer:
    """Dehazes frames that have a pose and a deck height; others come out as they are, with a note that says why."""

    def __init__(self, config: GeometryConfig | None = None, name: str = "geometry") -> None:
        self.name = name
        self.config = config or GeometryConfig()

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        return image_rgb.copy()  # an image alone says nothing about ranges

    def restore(self, frame: Frame) -> Restored:
        views = self._views(frame)
        if isinstance(views, NotFitted):
            return Restored(frame.image_rgb.copy(), f"not dehazed: {views.reason}")
        view, deck = views
        linear = self.config.light == "linear"
        image = (linear_levels(np.arange(256)) if linear else np.arange(256, dtype=np.float32))[frame.image_rgb]
        haze = fit_haze(image, view)
        if isinstance(haze, NotFitted):
            return Restored(frame.image_rgb.copy(), f"not dehazed: {haze.reason}")
        range_m = None if frame.depth_m is None else frame.depth_m * frame.camera.ray_lengths()
        clear = remove_haze(image, range_m, view, deck, haze, self.config)
        clear = display_levels(clear) if linear else clear
        return Restored(np.clip(np.rint(clear), 0, 255).astype(np.uint8))

    def _views(self, frame: Frame) -> tuple[SeaView, SeaView] | NotFitted:
        """The sea and the deck's plane."""
        pose = frame.world_from_camera
        if pose is None:
            return NotFitted("the frame has no pose; give poses or choose another dehazer")
        if frame.deck_z_m is None:
            return NotFitted("the deck's height is unknown; give --deck-z-m or choose another dehazer")
        view = sea_view(frame.camera, pose, frame.deck_z_m + self.config.sea_below_deck_m)
        if view.height_m <= 0:
            return NotFitted(f"the camera is {-view.height_m:.1f} m below the sea")
        return view, sea_view(frame.camera, pose, frame.deck_z_m)


def remove_haze(
    image: Image, range_m: Image | None, view: SeaView, deck: SeaView, haze: HazeFit, config: GeometryConfig
) -> Image:
    """A picture with its haze thinned to a clear day's.

    Args:
        image: (H, W, 3) levels 0..255, of the display or of light, as `haze` was fitted.
        range_m: (H, W) measured ray lengths, NaN where unknown; None without a depth camera.
        view: the sea in this picture.
        deck: the deck's plane, seen as if it were endless.
        haze: its air.
        config: the rest.

    Returns:
        (H, W, 3), levels that may leave 0..255.
    """
    airlight = haze.airlight.astype(np.float32)
    sea_t = np.exp(-haze.optical_depth(view.range_m))
    sea = haze.clear_sea(view.down)
    farthest = np.exp(-haze.optical_depth(np.float32(config.object_range_m)))
    bound = np.maximum(bounded_t(image, airlight, config), farthest)
    bound = raised_to_deck(bound, sea_t, np.exp(-haze.optical_depth(deck.range_m)), config)
    share = object_share(image, airlight + sea_t[..., None] * (sea - airlight), sea_t, bound, view, config)
    t = np.where(view.is_sea, np.maximum(sea_t, share * bound), 1 - share * (1 - np.maximum(bound, sea_t)))
    kept = np.where(view.is_sea, share + (1 - share) * transmission(view.range_m, config.clear_beta_per_m), 1)
    if range_m is not None:
        measured = np.isfinite(range_m)
        t = np.where(measured, np.exp(-haze.optical_depth(np.where(measured, range_m, 0))), t)
        kept = np.where(measured, 1, kept)
    usual = np.where(view.is_sea[..., None], sea, airlight)
    clear = airlight + kept[..., None] * (most_likely(image, usual, airlight, t, config) - airlight)
    return np.where((t == 1)[..., None], image, clear)


def linear_levels(display: NDArray) -> Image:
    """Light, 0..255, of display levels 0..255. Source: IEC 61966-2-1 (sRGB)."""
    x = np.asarray(display, dtype=np.float32) / 255
    return np.asarray(255 * np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4), dtype=np.float32)


def display_levels(light: Image) -> Image:
    """The inverse of `linear_levels`; light beyond 0..255 is clipped."""
    y = np.clip(light, 0, 255) / 255
    return np.asarray(255 * np.where(y <= 0.0031308, 12.92 * y, 1.055 * y ** (1 / 2.4) - 0.055), dtype=np.float32)


def most_likely(image: Image, usual: Image, airlight: Image, t: Image, config: GeometryConfig) -> Image:
    """The scene J (H, W, 3) of I = J t + A (1 - t) + noise, when J is spread about its usual colour (H, W, 3).

    Both spreads are normal, so J is the usual colour plus a gain times what is unexpected in I. The gain is near 1 / t
    in thin haze and falls to 0 where nothing but noise comes through. The noise has a part of the airlight's error.
    """
    hidden = config.airlight_sigma * (1 - t) * airlight.mean()
    noise = np.float32(config.level_sigma**2) + hidden * hidden
    gain = t / (t * t + noise / np.float32(config.scene_sigma**2))
    return np.asarray(usual + gain[..., None] * (image - airlight - t[..., None] * (usual - airlight)))


def bounded_t(image: Image, airlight: Image, config: GeometryConfig) -> Image:
    """Least transmission (H, W) that the darkest or brightest detail about a pixel allows.

    J <= 255 gives t >= (I - A) / (255 - A). J >= 0 gives t >= (A - I) / A, and a little more, as ships are not black.
    Source: He et al. 2011 for the dark side.
    """
    import cv2

    darker = (airlight - image) / np.maximum((1 - np.float32(config.darkest)) * airlight, 1)
    brighter = (image - airlight) / np.maximum(255 - airlight, 1)
    bound = strongest(np.maximum(darker, brighter))
    window = scaled_px(config.window_px, image.shape[1])
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

    off_sea = strongest(np.abs(image - hazy_sea))
    darker = strongest(sky_levels(image, view) - image)
    waves = np.where(view.is_sea, sea_t, 1)
    low, high = (
        config.level_sigma * sigmas * (1 - waves) + level * waves
        for sigmas, level in zip(OBJECT_SIGMAS, config.object_levels, strict=True)
    )
    share = np.clip((np.where(view.is_sea, off_sea, darker) - low) / (high - low), 0, 1)
    share *= np.where(view.is_sea, 1, np.clip(bound / config.min_object_t - 1, 0, 1))
    _, labels = cv2.connectedComponents((share > 0.5).astype(np.uint8))
    standing = np.isin(labels, np.unique(labels[view.is_sea]))
    share *= view.is_sea | standing
    window = scaled_px(config.window_px, image.shape[1])
    closed = cv2.morphologyEx(share.astype(np.float32), cv2.MORPH_CLOSE, np.ones((window, window), np.uint8))
    edge = scaled_px(config.window_px // 3, image.shape[1])
    return np.asarray(cv2.blur(closed, (edge, edge)), dtype=np.float32)


def sky_levels(image: Image, view: SeaView) -> Image:
    """Median colour (H, W, 3) of the sky at each pixel's elevation; meaningless below the horizon."""
    sky = ~view.is_sea
    if np.count_nonzero(sky) < MIN_SKY_BIN_PX:
        return image
    down, levels = view.down[sky], image[sky]
    edges = np.linspace(down.min(), down.max(), SKY_BINS + 1)
    which = np.digitize(down, edges[1:-1])
    filled = [k for k in range(SKY_BINS) if np.count_nonzero(which == k) >= MIN_SKY_BIN_PX]
    if not filled:
        return image
    medians = np.array([np.median(levels[which == k], axis=0) for k in filled])
    middles = (edges[filled] + edges[np.array(filled) + 1]) / 2
    channels = [np.interp(view.down, middles, medians[:, c]) for c in range(3)]
    return np.stack(channels, axis=2).astype(np.float32)


def strongest(levels: Image) -> Image:
    """Largest of three channels, (H, W, 3) -> (H, W); numpy's own reduction is slow over short axes."""
    return np.maximum(np.maximum(levels[..., 0], levels[..., 1]), levels[..., 2])


def scaled_px(length_px: int, width_px: int) -> int:
    """An odd length for an image of this width."""
    return max(1, round(length_px * width_px / REFERENCE_PX)) // 2 * 2 + 1
