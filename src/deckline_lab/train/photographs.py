"""Synthetic haze in photographs, whose depth and pose are unknown, and the camera's effects on it.

A photograph's depth is synthetic: a plane that rises to the horizon, filtered along the picture's edges, and sky where
the picture is smooth from the top down. No single range is right, but the haze is plausible: it thickens upwards,
follows the outlines of objects and is opaque in the sky.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.dehaze.airlight import find_sky, find_smooth_top
from deckline.dehaze.filters import guided_coefficients
from deckline.dehaze.pixel_map import display_levels, linear_levels
from deckline.dehaze.veil import to_full_scale
from deckline.geometry import Camera
from deckline.haze import beta_from_visibility
from deckline_lab.train.clear_views import ClearView, horizon_colour
from deckline_lab.train.view_sets import Views, open_pictures
from deckline_sim.camera import phone

Levels = NDArray[np.uint8]
Map = NDArray[np.float32]

MEDIAN_RANGE_M = 300.0  # of a photograph's surface
FARTHEST = 30.0  # times that
NO_SKY_HORIZON = (-0.4, 0.3)  # row of the horizon where there is no sky, as a share of the height
RANGE_WINDOW, RANGE_EPS = 1 / 12, 1e-3  # of the width, and on the variance: outlines in the made-up depth
PATCH_CELLS, PATCH_SIGMA = (2, 5), 0.15  # cells across of the air's patches; 1-sigma of ln(extinction)
GRADIENT = 0.2  # of the airlight from the middle to a border, at most
GLOW_SHARE, GLOW = 0.3, 0.3  # of the pictures, with a patch of sky that is so much brighter at most
TONE_SHARE = 0.6  # of the pictures get a camera's tone and colour
LEFT = 0.15  # transmission at which half of the contrast is to be restored; what is hidden stays hidden


def made_up_ranges(clear_rgb: Levels, rng: np.random.Generator) -> Map:
    """A plausible range (H, W), m, of every pixel of a photograph (H, W, 3); infinite for sky."""
    image = to_full_scale(clear_rgb)
    height, width = image.shape[:2]
    sky = _without_islands(find_sky(image, find_smooth_top(image)))
    columns = sky.any(axis=0)
    if columns.mean() > 0.3:
        horizon = float(np.median((height - sky[::-1].argmax(axis=0))[columns]))
    else:
        horizon = rng.uniform(*NO_SKY_HORIZON) * height
    below = np.maximum(np.arange(height) + 0.5 - horizon, height / 100).astype(np.float32)
    ln_range = np.broadcast_to(-np.log(below)[:, None], (height, width)).astype(np.float32)
    radius = max(4, round(width * RANGE_WINDOW))
    slope, offset = guided_coefficients(image.mean(axis=2), ln_range, radius, RANGE_EPS)
    ranges = np.exp(slope * image.mean(axis=2) + offset)
    surface = ranges[~sky] if not sky.all() else ranges
    ranges *= MEDIAN_RANGE_M / np.median(surface)
    ranges = np.minimum(ranges, FARTHEST * MEDIAN_RANGE_M)
    return np.where(sky, np.float32(np.inf), ranges)


def _without_islands(sky: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Sky (H, W) with all that does not reach the picture's lower border: clouds, and corners of dark lenses."""
    _, labels = cv2.connectedComponents((~sky).astype(np.uint8), connectivity=8)
    return sky | ~np.isin(labels, np.unique(labels[-1][~sky[-1]]))


def open_photographs(folder: Path, long_side_px: int, held_out: float) -> Views[ClearView]:
    """The photographs of a folder as clear views with made-up ranges, those for training.

    Raises:
        ValueError: no pictures in it.
    """
    count, read = open_pictures(folder, long_side_px)

    def load(index: int) -> ClearView:
        clear = read(index)
        ranges = made_up_ranges(clear, np.random.default_rng(index))
        camera = Camera.unknown(clear.shape[1], clear.shape[0])
        return ClearView(clear, ranges.astype(np.float16), horizon_colour(clear, ranges), camera)

    return Views({folder: (count, load)}, [folder], held_out, train=True)


def add_camera_air(
    view: ClearView, visibility_m: float, airlight: NDArray[np.float64], rng: np.random.Generator
) -> tuple[Levels, Levels, Map]:
    """A clear view in air of no known law, as some camera shows it.

    Args:
        view: (H, W, 3).
        visibility_m: 2 % contrast, in the mean over the picture.
        airlight: (3,) 0..255.
        rng: of air and camera.

    Returns:
        Hazy picture and its target, (H, W, 3), and the transmission (H, W). The target is the same camera's picture in
        thin air: what haze hides wholly stays hidden.
    """
    shape = view.clear_rgb.shape[:2]
    patches = np.exp(PATCH_SIGMA * _smooth_noise(shape, int(rng.integers(*PATCH_CELLS)), rng))
    t = np.exp(-np.float32(beta_from_visibility(visibility_m)) * patches * view.range_m.astype(np.float32))
    light = _uneven(np.asarray(airlight, np.float32), shape, rng)
    scattered = _scatter_linear if rng.random() < 0.5 else _scatter
    mixed = scattered(view.clear_rgb, light, t)
    target = scattered(view.clear_rgb, light, (1 + LEFT) * t / (t + LEFT))
    hazy, wanted = (np.rint(picture).astype(np.uint8) for picture in (mixed, target))
    if rng.random() < TONE_SHARE:
        seed = int(rng.integers(0, 2**32))
        hazy, wanted = (
            phone.apply_effects(picture, phone.TONE, np.random.default_rng(seed)) for picture in (hazy, wanted)
        )
    return phone.apply_effects(hazy, phone.WEAR, rng), wanted, t


def _scatter(clear_rgb: Levels, light: Map, t: Map) -> Map:
    return np.asarray(light + t[..., None] * (clear_rgb - light), np.float32)


def _scatter_linear(clear_rgb: Levels, light: Map, t: Map) -> Map:
    """The same in linear light (sRGB)."""
    linear = linear_levels(np.arange(256)).astype(np.float32)
    air = linear_levels(light).astype(np.float32)
    return np.asarray(display_levels(air + t[..., None] * (linear[clear_rgb] - air)), np.float32)


def _uneven(airlight: Map, shape: tuple[int, int], rng: np.random.Generator) -> Map:
    """Airlight (H, W, 3), 0..255, brighter to one side and, now and then, around the sun."""
    height, width = shape
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    across, down = rng.uniform(-GRADIENT, GRADIENT, 2)
    share = 1 + across * x + down * y
    if rng.random() < GLOW_SHARE:
        centre, spread = rng.uniform([-1.0, -1.2], [1.0, 0.2]), rng.uniform(0.3, 1.0)
        share += rng.uniform(0, GLOW) * np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (2 * spread**2))
    return np.clip(airlight * share[..., None], 0, 255).astype(np.float32)


def _smooth_noise(shape: tuple[int, int], cells: int, rng: np.random.Generator) -> Map:
    """(H, W), mean 0, about 1-sigma 1."""
    coarse = rng.standard_normal((cells, cells), dtype=np.float32)
    return np.asarray(cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)
