"""Where raindrops before the lens draw streaks, and where drops sit on it, as quads for the GPU."""

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import Camera

# Marshall and Palmer 1948: N(D) = N0 exp(-L D), N0 = 8000 / (m^3 mm), L = 4.1 R^-0.21 / mm, R in mm/h.
DROPS_M3_MM, SLOPE_MM, SLOPE_EXPONENT = 8000.0, 4.1, -0.21
LEAST_MM, LARGE_MM = 0.5, 2.0  # smaller drops are not drawn; a large one decides how far away drops are drawn
LEAST_PX = 0.35  # apparent width of a large drop at that distance
NEAREST_M = 0.25
MOST_STREAKS = 4000  # of a picture, about: where there would be more, those nearest to the camera
SHORT_S = 1 / 1000  # exposure of the rain where no motion is to be seen
SIDES = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
RADIUS_SHARE = (0.006, 0.045)  # of the picture's width, drops on the lens, smallest and largest


def streaks(
    camera: Camera, drops_m_s: NDArray[np.float64], exposure_s: float, rain_mm_h: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Streaks (N, 6, 8): corners of two triangles, each pixel (2), place across and along (2), opacity, 0, 0, 0.

    Args:
        drops_m_s: (3,) velocity of the drops relative to the camera, optical frame.
    """
    slope = SLOPE_MM * rain_mm_h**SLOPE_EXPONENT
    density = DROPS_M3_MM / slope * np.exp(-slope * LEAST_MM)
    solid = camera.width / camera.fx * camera.height / camera.fy / 3.0  # volume is this times the depth's cube
    reach_m = min(
        camera.fx * LARGE_MM / 1000.0 / LEAST_PX, float(np.cbrt(NEAREST_M**3 + MOST_STREAKS / density / solid))
    )
    reach_m = max(reach_m, 2 * NEAREST_M)
    count = rng.poisson(density * solid * (reach_m**3 - NEAREST_M**3))
    distance = rng.uniform(NEAREST_M**3, reach_m**3, count) ** (1 / 3)
    pixel = rng.uniform(0.0, 1.0, (count, 2)) * [camera.width, camera.height] - 0.5
    size_m = (LEAST_MM + rng.exponential(1.0 / slope, count)) / 1000.0
    middle = camera.rays(pixel) * distance[:, None]
    half = np.asarray(drops_m_s) * (exposure_s or SHORT_S) / 2
    ends = [camera.project(np.maximum(middle + sign * half, [-np.inf, -np.inf, NEAREST_M / 2])) for sign in (-1, 1)]
    width = size_m * camera.fx / distance
    return streak_quads(ends[0], ends[1], width)


def streak_quads(
    start_px: NDArray[np.float64], end_px: NDArray[np.float64], width_px: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Quads (N, 6, 8) about segments (N, 2); opacity is the share of the exposure that a pixel is covered."""
    path = end_px - start_px
    length = np.linalg.norm(path, axis=1)
    along = path / np.maximum(length, 1e-9)[:, None]
    along[length < 1e-9] = [0.0, 1.0]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    drawn = np.maximum(width_px, 1.0)  # a thinner streak is drawn fainter instead
    opacity = width_px / drawn * width_px / (length + width_px)
    middle, half = (start_px + end_px) / 2, (length + drawn) / 2
    corners = middle[:, None] + SIDES[:, :1] * (across * drawn[:, None] / 2)[:, None]
    corners = corners + SIDES[:, 1:] * (along * half[:, None])[:, None]
    return _quads(corners, np.column_stack([opacity, np.zeros((len(opacity), 3))]))


def drops_on_lens(camera: Camera, count: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Drops (N, 6, 8): corners of two triangles, each pixel (2), place within (2), middle (2), radius, softness."""
    middle = rng.uniform(0.0, 1.0, (count, 2)) * [camera.width, camera.height]
    low, high = np.log(RADIUS_SHARE)
    radius = np.exp(low + (high - low) * rng.uniform(0.0, 1.0, count) ** 2) * camera.width
    softness = rng.uniform(0.15, 0.9) * rng.uniform(0.7, 1.1, count)  # how far the drops are out of focus
    corners = middle[:, None] + SIDES * radius[:, None, None]
    return _quads(corners, np.column_stack([middle, radius, softness]))


def _quads(corners: NDArray[np.float64], detail: NDArray[np.float64]) -> NDArray[np.float32]:
    count = len(corners)
    sides, details = np.broadcast_to(SIDES, (count, 6, 2)), np.broadcast_to(detail[:, None], (count, 6, 4))
    return np.concatenate([corners, sides, details], axis=2).astype(np.float32)
