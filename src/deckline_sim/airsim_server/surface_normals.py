"""Normals of the surfaces that a camera sees, from their depth."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deckline.geometry import Camera

UNREAL_FROM_NED = np.array([1.0, 1.0, -1.0])  # Unreal's world: north, east, up


def surface_normals(depth_m: NDArray[np.float32], camera: Camera) -> NDArray[np.float64]:
    """Unit normals (H, W, 3), optical axes, towards the camera; zero where nothing is seen.

    The inverse depth of a plane n . P = d is linear in the pixel: 1 / z = n . ((u - cx) / fx, (v - cy) / fy, 1) / d.
    Its steps along row and column are those to the neighbour on the same surface: the smaller of two.

    Args:
        depth_m: (H, W) along the optical axis, NaN where nothing is seen.
        camera: a pinhole.
    """
    inverse = 1.0 / depth_m.astype(np.float64)
    across, down = _smaller_steps(inverse, axis=1), _smaller_steps(inverse, axis=0)
    u, v = np.meshgrid(np.arange(camera.width) - camera.cx, np.arange(camera.height) - camera.cy)
    normals = -np.stack([camera.fx * across, camera.fy * down, inverse - u * across - v * down], axis=-1)
    return np.nan_to_num(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def _smaller_steps(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """The smaller step of each value (H, W): from its predecessor or to its successor; 0 without either."""
    none = np.full_like(np.take(values, [0], axis), np.nan)
    steps = np.diff(values, axis=axis)
    before, after = np.concatenate([none, steps], axis), np.concatenate([steps, none], axis)
    is_after = np.isnan(before) | (np.abs(after) <= np.abs(before))
    return np.nan_to_num(np.where(is_after & ~np.isnan(after), after, before))


def draw_normals(normals: NDArray[np.float64], world_from_camera: Rotation) -> NDArray[np.uint8]:
    """Normals (H, W, 3), optical axes, as AirSim's picture (H, W, 3): (n + 1) / 2 of north, east and up as red to blue.

    Source: AirSim's NormalsMaterial with TargetGamma 1; 0 is 127.
    """
    world = world_from_camera.apply(normals.reshape(-1, 3)).reshape(normals.shape) * UNREAL_FROM_NED
    return (255.0 * np.clip((world + 1.0) / 2.0, 0.0, 1.0)).astype(np.uint8)
