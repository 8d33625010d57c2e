"""Dehazing without a network: the pose says how far away the sea is, the image says what the air is like.

The haze is fitted to the sea (`haze_fit`), the transmission follows from ranges and details (`transmission`); a depth
camera replaces it where it sees something. I = J t + A (1 - t) is then solved for the most likely J: where haze leaves
no signal, that is the sea's own colour, so that plain sea in the result does not mean that nothing is there.

Air and objects are estimated in an image of at most ANALYSIS_PX; only the solution is made pixel by pixel.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.checks import check_image
from deckline.dehaze.base import Restored
from deckline.dehaze.haze_fit import (
    DISPLAY_WATER,
    LIGHT_WATER,
    HazeFit,
    NotFitted,
    SeaView,
    fit_haze,
    ray_lengths,
    view_sea,
)
from deckline.dehaze.transmission import GeometryConfig, estimate_scene, find_objects, transmissions
from deckline.types import Frame

Image = NDArray[np.float32]

ANALYSIS_PX = 640  # longer side of the image that air and objects are estimated in
NOISE_ROWS = 90  # about so many are read for noise
NOISE_WEIGHT = 2.0  # best in [1, 3] on preset paper with noise of 3 and 8 levels added
NOISE_PART = 0.9  # of the differences that count
NOISE_MEAN = 0.9297  # of a normal difference of sigma sqrt(2), in size, of that smallest part
STRIP_PX = 1 << 16  # solved at once: its few float maps stay in a core's cache


@dataclass(frozen=True, eq=False)
class GeometrySolution:
    """A frame whose air could be estimated."""

    image_rgb: NDArray[np.uint8]  # (H, W, 3) without its haze
    haze: HazeFit


class GeometryDehazer:
    """Dehazes frames with a pose and the height of sea or deck; a note says why others come out as they are."""

    def __init__(self, config: GeometryConfig | None = None, name: str = "geometry") -> None:
        self.name = name
        self.config = config or GeometryConfig()

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        return image_rgb.copy()  # an image alone says nothing about ranges

    def restore(self, frame: Frame) -> Restored:
        solution = self.solve(frame)
        if isinstance(solution, NotFitted):
            return Restored(frame.image_rgb.copy(), f"not dehazed: {solution.reason}")
        return Restored(solution.image_rgb)

    def solve(self, frame: Frame) -> GeometrySolution | NotFitted:
        """The frame without its haze and what its air is like, or why that cannot be told."""
        pose = frame.world_from_camera
        if pose is None:
            return NotFitted("the frame has no pose; give poses or choose another dehazer")
        sea_z_m, deck_z_m = frame.sea_z_m, frame.deck_z_m
        if deck_z_m is None:
            deck_z_m = sea_z_m  # raises no bound
        elif sea_z_m is None:
            sea_z_m = deck_z_m + self.config.sea_below_deck_m
        if sea_z_m is None or deck_z_m is None:
            return NotFitted("no height is known; give --sea-z-m or --deck-z-m, or choose another dehazer")
        if sea_z_m < deck_z_m:
            return NotFitted(f"the sea (z {sea_z_m:g} m) is above the deck (z {deck_z_m:g} m); z points down")
        small = downscale_frame(frame, ANALYSIS_PX)
        view = view_sea(small.camera, pose, sea_z_m)
        if view.height_m <= 0:
            return NotFitted(f"the camera is {-view.height_m:.1f} m below the sea")
        light = self.config.light
        planes = level_table(light)[np.ascontiguousarray(np.moveaxis(small.image_rgb, 2, 0))]
        small_noise, noise = (measure_sky_noise(image, view, light) for image in (small.image_rgb, frame.image_rgb))
        water = LIGHT_WATER if light == "linear" else DISPLAY_WATER
        haze = fit_haze(np.moveaxis(planes, 0, 2), view, water, small_noise)
        if isinstance(haze, NotFitted):
            return haze
        deck = view_sea(small.camera, pose, deck_z_m)
        objects, bound = find_objects(planes, view, deck, haze, with_noise(self.config, small_noise))
        clear = _remove_haze(frame, pose, sea_z_m, haze, objects, bound, with_noise(self.config, noise))
        return GeometrySolution(clear, haze)


def downscale_frame(frame: Frame, long_side_px: int) -> Frame:
    """A frame averaged down to this longer side, camera and depth with it, without truth; small ones stay."""
    import cv2

    height, width = frame.image_rgb.shape[:2]
    scale = min(1.0, long_side_px / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    if size == (width, height):
        return frame
    image = np.asarray(cv2.resize(frame.image_rgb, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    small = replace(frame, image_rgb=image, camera=frame.camera.resized(*size), depth_m=None, truth=None)
    if frame.depth_m is None:
        return small
    depth_m = cv2.resize(frame.depth_m, size, interpolation=cv2.INTER_NEAREST)
    return replace(small, depth_m=np.asarray(depth_m, dtype=np.float32))


def measure_sky_noise(image_rgb: NDArray[np.uint8], view: SeaView, light: str) -> float:
    """1-sigma of a pixel's noise in the sky of an image (H, W, 3), levels; `view` may be of another resolution."""
    import cv2

    rows = image_rgb[:: 1 + len(image_rgb) // NOISE_ROWS]
    size = (rows.shape[1], len(rows))
    sky = cv2.resize((~view.is_sea).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    levels, both = level_table(light)[rows], sky[:, 1:] & sky[:, :-1]
    return estimate_noise(levels[:, 1:][both] - levels[:, :-1][both])


def estimate_noise(differences: Image) -> float:
    """1-sigma of a pixel's noise from differences (N, 3) of neighbours, of which the largest are clouds and edges."""
    sizes = np.abs(differences).ravel()
    count = int(NOISE_PART * sizes.size)
    return float(np.partition(sizes, count)[:count].mean() / NOISE_MEAN) if count else 0.0


def with_noise(config: GeometryConfig, noise_sigma: float) -> GeometryConfig:
    """Settings for pixels with at least this noise, 1-sigma in levels."""
    return replace(config, level_sigma=max(config.level_sigma, NOISE_WEIGHT * noise_sigma))


def _remove_haze(
    frame: Frame,
    pose: RigidTransform,
    sea_z_m: float,
    haze: HazeFit,
    certainty: Image,
    bound: Image,
    config: GeometryConfig,
) -> NDArray[np.uint8]:
    """A frame's image (H, W, 3) with its haze thinned to a clear day's.

    `certainty` says how surely something is nearer than the sea, `bound` is its least transmission; both cover the
    whole image at any resolution.
    """
    import cv2

    height, width = frame.image_rgb.shape[:2]
    certainty, bound = (
        np.asarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
        for part in (certainty, bound)
    )
    levels, airlight = level_table(config.light), haze.airlight.astype(np.float32)[:, None, None]
    clear = np.empty_like(frame.image_rgb)
    step = max(1, STRIP_PX // width)
    for top in range(0, height, step):
        rows = slice(top, top + step)
        view = view_sea(frame.camera, pose, sea_z_m, rows)
        range_m = None if frame.depth_m is None else frame.depth_m[rows] * ray_lengths(frame.camera, rows)
        t, clear_t = transmissions(view, certainty[rows], bound[rows], range_m, haze, config)
        planes = np.ascontiguousarray(np.moveaxis(frame.image_rgb[rows], 2, 0))
        usual = np.where(view.is_sea, haze.clear_sea(view.down), airlight)
        solved = airlight + clear_t * (estimate_scene(levels[planes], usual, airlight, t, config) - airlight)
        solved = display_levels(solved) if config.light == "linear" else solved
        solved = np.clip(np.rint(solved), 0, 255).astype(np.uint8)
        clear[rows] = np.moveaxis(np.where(t == 1, planes, solved), 0, 2)
    return clear


def level_table(light: str) -> Image:
    """What display levels 0..255 are in the light that haze is counted in, (256,)."""
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
