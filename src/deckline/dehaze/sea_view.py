"""How far away the sea is in every pixel, from the camera's pose alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera

# Mean Earth radius times 6/5 for refraction near the horizon. Source: the sailors' dip of 1.76' sqrt(height / m).
EARTH_RADIUS_M = 6.371e6 * 6 / 5


@dataclass(frozen=True, eq=False)
class SeaView:
    """The sea as a camera sees it."""

    down: NDArray[np.float32]  # (H, W) sine of the ray's angle below the horizontal
    range_m: NDArray[np.float32]  # (H, W) ray length to the water; infinite in the sky
    height_m: float  # of the camera above the water

    @property
    def is_sea(self) -> NDArray[np.bool_]:
        """(H, W), the pixels below the horizon."""
        return np.isfinite(self.range_m)


def sea_view(camera: Camera, world_from_camera: RigidTransform, sea_z_m: float) -> SeaView:
    """The sea seen by a camera; on a round Earth, so that the horizon lies a little below the horizontal.

    Args:
        camera: intrinsics; pixels that no ray reaches count as sky.
        world_from_camera: pose of the optical frame, world z down.
        sea_z_m: world z of the water.

    A ray that falls by sine s from height h meets a sphere of radius R after 2 h / (s + sqrt(s^2 - 2 h / R)), and
    nowhere when the root is not real; terms of h / R beside 1 are left out.
    """
    height = float(sea_z_m - world_from_camera.translation[2])
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1))
    down = (rays @ world_from_camera.rotation.as_matrix()[2]) / np.linalg.norm(rays, axis=1)
    below = down * down - 2 * max(height, 0.0) / EARTH_RADIUS_M
    seen = (down > 0) & (below > 0) & (height > 0)
    reach = down + np.sqrt(np.where(seen, below, 0))
    ranges = np.where(seen, 2 * height / np.where(seen, reach, 1), np.inf)
    shape = (camera.height, camera.width)
    return SeaView(
        np.nan_to_num(down, nan=-1.0).reshape(shape).astype(np.float32),
        ranges.reshape(shape).astype(np.float32),
        height,
    )
