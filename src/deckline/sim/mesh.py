"""Flat-shaded triangles from frusta: every solid of the ship is a polygon joined to another one above it.

Ship frame: x forward along the ship's axis, y to starboard, z down, origin on the deck plane at the stern.
A mesh is float32 (N, 9): position, unit normal, colour (0..1) of three vertices per triangle.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Mesh = NDArray[np.float32]
Rgb = tuple[float, float, float]


def triangles(corners_m: NDArray[np.float64], rgb: ArrayLike) -> Mesh:
    """Mesh of triangles (N, 3, 3); normals follow the winding."""
    normal = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    out = np.empty((len(corners_m), 3, 9), dtype=np.float32)
    out[..., :3] = corners_m
    out[..., 3:6] = normal[:, None]
    out[..., 6:] = np.asarray(rgb, dtype=np.float32)
    return out.reshape(-1, 9)


def frustum(
    lower_m: ArrayLike, lower_z_m: float, upper_m: ArrayLike, upper_z_m: float, rgb: ArrayLike, cap: bool = True
) -> Mesh:
    """Walls between two polygons (N, 2) of equal length at two heights, and a lid on convex upper ones.

    Normals point away from the lower polygon's middle.
    """
    lower, upper = np.asarray(lower_m, dtype=np.float64), np.asarray(upper_m, dtype=np.float64)
    if lower.shape != upper.shape or lower.ndim != 2 or lower.shape[1] != 2:
        raise ValueError(f"frustum needs two polygons (N, 2) of equal length, got {lower.shape}, {upper.shape}")
    low = np.column_stack([lower, np.full(len(lower), lower_z_m)])
    top = np.column_stack([upper, np.full(len(upper), upper_z_m)])
    low1, top1 = np.roll(low, -1, axis=0), np.roll(top, -1, axis=0)
    corners = np.concatenate([np.stack([low, low1, top], 1), np.stack([low1, top1, top], 1)])
    if cap:
        middle = np.broadcast_to(top.mean(axis=0), top.shape)
        corners = np.concatenate([corners, np.stack([middle, top, top1], 1)])
    return outward(triangles(corners, rgb), np.append(lower.mean(axis=0), (lower_z_m + upper_z_m) / 2))


def outward(mesh: Mesh, middle_m: ArrayLike) -> Mesh:
    """The mesh with every normal turned away from a point (3,)."""
    away = mesh[:, :3].reshape(-1, 3, 3).mean(axis=1) - np.asarray(middle_m, dtype=np.float32)
    inside = np.sum(away * mesh[::3, 3:6], axis=1) < 0
    turned = mesh.copy()
    turned[np.repeat(inside, 3), 3:6] *= -1
    return turned


def rectangle(x_m: float, y_m: float, length_m: float, width_m: float, yaw_rad: float = 0.0) -> NDArray[np.float64]:
    """Corners (4, 2) of a rectangle around (x, y), its length turned by yaw from x towards y."""
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * [length_m, width_m]
    return place(corners, x_m, y_m, yaw_rad)


def place(corners_m: ArrayLike, x_m: float, y_m: float, yaw_rad: float) -> NDArray[np.float64]:
    """Points (N, 2) turned by yaw about the origin and moved to (x, y)."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.asarray(corners_m) @ np.array([[c, s], [-s, c]]) + [x_m, y_m]


def box(x_m: float, y_m: float, base_z_m: float, size_m: Sequence[float], yaw_rad: float, rgb: ArrayLike) -> Mesh:
    """Box of (length, width, height) standing at z = base on the middle (x, y)."""
    base = rectangle(x_m, y_m, size_m[0], size_m[1], yaw_rad)
    return frustum(base, base_z_m, base, base_z_m - size_m[2], rgb)


def disc(x_m: float, y_m: float, radius_m: float, sides: int = 10) -> NDArray[np.float64]:
    """Regular polygon (sides, 2)."""
    angle = np.arange(sides) * 2 * np.pi / sides
    return np.stack([x_m + radius_m * np.cos(angle), y_m + radius_m * np.sin(angle)], axis=1)


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of many; empty for none."""
    return np.concatenate(meshes) if meshes else np.zeros((0, 9), dtype=np.float32)
