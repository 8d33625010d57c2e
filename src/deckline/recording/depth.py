"""From a stored depth map to metres along the optical axis, and the checks that files fit each other."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import Camera
from deckline.recording.netpbm import FAR_DEPTH_M

DEPTH_PLANAR, DEPTH_PERSPECTIVE = 1, 2  # AirSim's image types: along the axis, along each pixel's ray


def along_axis(
    stored: NDArray[np.float32], camera: Camera, depth_type: int, far_m: float = FAR_DEPTH_M
) -> NDArray[np.float32]:
    """Stored depth (H, W) -> depth along the optical axis, metres, NaN where nothing was seen.

    Args:
        depth_type: DEPTH_PLANAR, or DEPTH_PERSPECTIVE for lengths along each pixel's ray.
        far_m: stored values from here on, and those that are not positive and finite, become NaN.
    """
    with np.errstate(invalid="ignore"):
        seen = (stored > 0) & (stored < far_m)
    depth: NDArray[np.float32] = np.where(seen, stored, np.float32(np.nan))
    return depth if depth_type == DEPTH_PLANAR else depth / _ray_lengths(camera)


def check_size(camera: Camera, shape: tuple[int, ...]) -> None:
    """Raises ValueError when intrinsics were made for another image size."""
    if (camera.height, camera.width) != tuple(shape):
        raise ValueError(
            f"the intrinsics are for {camera.width}x{camera.height} px but the image is {shape[1]}x{shape[0]} px; "
            f"give a camera file made for this size"
        )


def check_depth_size(shape: tuple[int, ...], camera: Camera, name: str) -> None:
    """Raises ValueError when a depth map has another size than its image."""
    if tuple(shape) != (camera.height, camera.width):
        raise ValueError(
            f"depth {name} is {shape[1]}x{shape[0]} px but the image is {camera.width}x{camera.height} px; "
            f"record both at one size"
        )


def _ray_lengths(camera: Camera) -> NDArray[np.float32]:
    """Cached by value: a recording names its camera anew in each frame."""
    size = (camera.width, camera.height)
    return _ray_lengths_of((*size, camera.fx, camera.fy, camera.cx, camera.cy, tuple(camera.distortion)))


@lru_cache(maxsize=4)
def _ray_lengths_of(key: tuple) -> NDArray[np.float32]:
    return Camera(*key).ray_lengths()
