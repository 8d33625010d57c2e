"""The sea as a posed camera sees it: every pixel's angle below the horizontal, and its range to the water."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

# Mean Earth radius times 6/5 for refraction near the horizon. Source: the sailors' dip of 1.76' sqrt(height / m).
EARTH_RADIUS_M = 6.371e6 * 6 / 5
CACHED_CAMERAS = 4  # whose rays are cached; 0.7 MB each for a lens with distortion, next to nothing for a pinhole
LENS_STEP = 1 / 80  # of the focal length between rays that are traced through a lens; with k1 = -0.1 wrong by 1e-5


@dataclass(frozen=True, eq=False)
class SeaView:
    """The sea as a camera sees it."""

    down: Float32
    """(H, W) sine of the ray's angle below the horizontal."""
    range_m: Float32
    """(H, W) ray length to the water; infinite in the sky."""
    height_m: float
    """Of the camera above the water."""

    @cached_property
    def is_sea(self) -> NDArray[np.bool_]:
        """(H, W), the pixels below the horizon."""
        return np.isfinite(self.range_m)

    @cached_property
    def sea_share(self) -> Float32:
        """(H, W) share of a pixel below the horizon, 0 to 1: an enlarged mask of whole pixels has steps."""
        if self.height_m <= 0 or min(self.down.shape) < 2:
            return self.is_sea.astype(np.float32)
        dip = np.float32(np.sqrt(2 * self.height_m / EARTH_RADIUS_M))
        down, across = np.gradient(self.down)
        pixel = np.maximum(np.hypot(down, across), np.float32(1e-9))
        return np.asarray(np.clip((self.down - dip) / pixel + 0.5, 0, 1), np.float32)


def view_sea(camera: Camera, world_from_camera: RigidTransform, sea_z_m: float) -> SeaView:
    """The sea seen by a camera; on a round Earth, so that the horizon lies a little below the horizontal.

    Args:
        camera: intrinsics; pixels that no ray reaches count as sky.
        world_from_camera: pose of the optical frame, world z down.
        sea_z_m: world z of the water.

    A ray that falls by sine s from height h meets a sphere of radius R after 2 h / (s + sqrt(s^2 - 2 h / R)), and
    nowhere when the root is not real; terms of h / R beside 1 are left out.
    """
    x, y = _slopes(camera)
    right, below, ahead = world_from_camera.rotation.as_matrix()[2].astype(np.float32)
    down = (right * x + (below * y + ahead)) / np.sqrt(x * x + (y * y + 1))
    np.nan_to_num(down, copy=False, nan=-1.0)
    return view_water(down, float(sea_z_m - world_from_camera.translation[2]))


def view_water(down: Float32, height_m: float) -> SeaView:
    """Water `height_m` below a camera whose pixels' rays point down by these sines (H, W)."""
    root = down * down - np.float32(2 * max(height_m, 0.0) / EARTH_RADIUS_M)
    seen = (down > 0) & (root > 0) & (height_m > 0)
    reach = down + np.sqrt(np.maximum(root, 0))
    ranges = np.full_like(down, np.inf)
    return SeaView(down, np.divide(np.float32(2 * height_m), reach, out=ranges, where=seen), height_m)


def ray_lengths(camera: Camera) -> Float32:
    """Length of the z = 1 ray of every pixel (H, W), as `Camera.ray_lengths`."""
    x, y = _slopes(camera)
    return np.sqrt(x * x + (y * y + 1))


@lru_cache(maxsize=CACHED_CAMERAS)
def _slopes(camera: Camera) -> tuple[Float32, Float32]:
    """Every pixel's ray, right and down for each step ahead: (1, W) and (H, 1) of a pinhole, else (H, W) each."""
    if not camera.has_distortion:
        x = (np.arange(camera.width) - camera.cx) / camera.fx
        y = (np.arange(camera.height) - camera.cy) / camera.fy
        return x[None].astype(np.float32), y[:, None].astype(np.float32)
    u, left, toward_right = _interpolation_nodes(camera.width, camera.fx)
    v, upper, toward_lower = _interpolation_nodes(camera.height, camera.fy)
    rays = camera.rays(np.stack([grid.ravel() for grid in np.meshgrid(u, v)], axis=1)).astype(np.float32)
    slopes = rays[:, :2].reshape(len(v), len(u), 2)
    rows = slopes[upper] + toward_lower[:, None, None] * (slopes[upper + 1] - slopes[upper])
    x, y = np.moveaxis(rows[:, left] + toward_right[None, :, None] * (rows[:, left + 1] - rows[:, left]), 2, 0)
    return np.ascontiguousarray(x), np.ascontiguousarray(y)


def _interpolation_nodes(count: int, focal_px: float) -> tuple[Float64, NDArray[np.intp], Float32]:
    """Evenly spread pixels (N,) whose rays are traced; the one before each of `count` pixels, and how far past it."""
    nodes = np.linspace(0, count - 1, 1 + max(1, int(np.ceil((count - 1) / max(1.0, focal_px * LENS_STEP)))))
    place = np.arange(count) * ((len(nodes) - 1) / max(1, count - 1))
    before = np.minimum(place.astype(np.intp), len(nodes) - 2)
    return nodes, before, (place - before).astype(np.float32)
