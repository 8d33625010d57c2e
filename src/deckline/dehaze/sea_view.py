"""How far away the sea is in every pixel, from the camera's pose alone."""

from dataclasses import astuple, dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera

# Mean Earth radius times 6/5 for refraction near the horizon. Source: the sailors' dip of 1.76' sqrt(height / m).
EARTH_RADIUS_M = 6.371e6 * 6 / 5
CAMERAS_KEPT = 4  # whose rays are remembered; 66 MB each for a 4K lens with distortion, next to nothing for a pinhole
LENS_STEP = 1 / 80  # of the focal length between rays that are traced through a lens; with k1 = -0.1 wrong by 1e-5
ALL_ROWS = slice(None)

Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SeaView:
    """The sea as a camera sees it."""

    down: Float32  # (H, W) sine of the ray's angle below the horizontal
    range_m: Float32  # (H, W) ray length to the water; infinite in the sky
    height_m: float  # of the camera above the water

    @property
    def is_sea(self) -> NDArray[np.bool_]:
        """(H, W), the pixels below the horizon."""
        return np.isfinite(self.range_m)


def sea_view(camera: Camera, world_from_camera: RigidTransform, sea_z_m: float, rows: slice = ALL_ROWS) -> SeaView:
    """The sea seen by a camera; on a round Earth, so that the horizon lies a little below the horizontal.

    Args:
        camera: intrinsics; pixels that no ray reaches count as sky.
        world_from_camera: pose of the optical frame, world z down.
        sea_z_m: world z of the water.
        rows: of the picture, the only ones to look at.

    A ray that falls by sine s from height h meets a sphere of radius R after 2 h / (s + sqrt(s^2 - 2 h / R)), and
    nowhere when the root is not real; terms of h / R beside 1 are left out.
    """
    height = float(sea_z_m - world_from_camera.translation[2])
    x, y = _slopes_of_rows(camera, rows)
    right, below, ahead = world_from_camera.rotation.as_matrix()[2].astype(np.float32)
    down = (right * x + (below * y + ahead)) / np.sqrt(x * x + (y * y + 1))
    np.nan_to_num(down, copy=False, nan=-1.0)
    root = down * down - np.float32(2 * max(height, 0.0) / EARTH_RADIUS_M)
    seen = (down > 0) & (root > 0) & (height > 0)
    reach = down + np.sqrt(np.maximum(root, 0))
    ranges = np.full_like(down, np.inf)
    return SeaView(down, np.divide(np.float32(2 * height), reach, out=ranges, where=seen), height)


def ray_lengths(camera: Camera, rows: slice = ALL_ROWS) -> Float32:
    """Length of the z = 1 ray of every pixel (H, W) of these rows, as `Camera.ray_lengths`."""
    x, y = _slopes_of_rows(camera, rows)
    return np.sqrt(x * x + (y * y + 1))


def _slopes_of_rows(camera: Camera, rows: slice) -> tuple[Float32, Float32]:
    x, y = _slopes(astuple(camera))
    return (x if len(x) == 1 else x[rows]), y[rows]


@lru_cache(maxsize=CAMERAS_KEPT)
def _slopes(intrinsics: tuple) -> tuple[Float32, Float32]:
    """Every pixel's ray, right and down for each step ahead: (1, W) and (H, 1) of a pinhole, else (H, W) each."""
    camera = Camera(*intrinsics)
    if not camera.has_distortion:
        x = (np.arange(camera.width) - camera.cx) / camera.fx
        y = (np.arange(camera.height) - camera.cy) / camera.fy
        return x[None].astype(np.float32), y[:, None].astype(np.float32)
    u, left, toward_right = _traced(camera.width, camera.fx)
    v, upper, toward_lower = _traced(camera.height, camera.fy)
    rays = camera.rays(np.stack([grid.ravel() for grid in np.meshgrid(u, v)], axis=1)).astype(np.float32)
    slopes = rays[:, :2].reshape(len(v), len(u), 2)
    rows = slopes[upper] + toward_lower[:, None, None] * (slopes[upper + 1] - slopes[upper])
    x, y = np.moveaxis(rows[:, left] + toward_right[None, :, None] * (rows[:, left + 1] - rows[:, left]), 2, 0)
    return np.ascontiguousarray(x), np.ascontiguousarray(y)


def _traced(count: int, focal_px: float) -> tuple[NDArray[np.float64], NDArray[np.intp], Float32]:
    """Evenly spread pixels (N,) whose rays are traced; the one before each of `count` pixels, and how far past it."""
    nodes = np.linspace(0, count - 1, 1 + max(1, int(np.ceil((count - 1) / max(1.0, focal_px * LENS_STEP)))))
    place = np.arange(count) * ((len(nodes) - 1) / max(1, count - 1))
    before = np.minimum(place.astype(np.intp), len(nodes) - 2)
    return nodes, before, (place - before).astype(np.float32)
