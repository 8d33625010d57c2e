"""Flat-shaded triangles: solids are rows of polygons, each joined to the next.

Ship frame: x forward along the ship's axis, y to starboard, z down, origin on the deck plane at the stern.
A mesh is float32 (N, 9): position, unit normal, colour (0..1) of three vertices per triangle. Normals follow the
winding, and those of a solid point out of it.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mesh = NDArray[np.float32]
Rgb = tuple[float, float, float]
WHITE: Rgb = (1.0, 1.0, 1.0)
FLAT_M2 = 1e-8  # a triangle with less than this (twice its area) is left out


def triangles(corners_m: Array, rgb: ArrayLike) -> Mesh:
    """Mesh of triangles (N, 3, 3); normals follow the winding. Colour (3,), (N, 1, 3) or (N, 3, 3)."""
    normal = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    length = np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    out = np.empty((len(corners_m), 3, 9), dtype=np.float32)
    out[..., :3] = corners_m
    out[..., 3:6] = normal[:, None]
    out[..., 6:] = np.asarray(rgb, dtype=np.float32)
    return out.reshape(-1, 9)


def quads(corners_m: ArrayLike, rgb: ArrayLike) -> Mesh:
    """Mesh of flat four-cornered faces (N, 4, 3); colour (3,) or (N, 3)."""
    corners = np.asarray(corners_m, dtype=np.float64)
    colour = np.broadcast_to(np.asarray(rgb, dtype=np.float32), (len(corners), 3))
    return triangles(corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 3), np.repeat(colour, 2, axis=0)[:, None])


def facing(corners_m: Array, rgb: ArrayLike, direction: ArrayLike) -> Mesh:
    """Triangles (N, 3, 3) or quads (N, 4, 3), flipped where their normals point against a direction (3,)."""
    first, second, last = corners_m[:, 0], corners_m[:, 1], corners_m[:, -1]
    back = np.cross(second - first, last - first) @ np.asarray(direction, dtype=np.float64) < 0
    corners = np.where(back[:, None, None], corners_m[:, ::-1], corners_m)
    return triangles(corners, rgb) if corners.shape[1] == 3 else quads(corners, rgb)


def strip(first_m: Array, second_m: Array) -> Array:
    """Corners (N - 1, 4, K) of the faces between two rows of points (N, K)."""
    return np.stack([first_m[:-1], first_m[1:], second_m[1:], second_m[:-1]], axis=1)


def loft(sections_m: ArrayLike, rgb: ArrayLike, ends: tuple[bool, bool] = (True, True)) -> Mesh:
    """A solid through polygons (K, N, 3), its normals pointing out.

    Args:
        sections_m: the polygons in order; consecutive ones are joined corner by corner.
        rgb: colour (3,), or (K - 1, N, 3) of the wall between corners n and n + 1 of sections k and k + 1.
        ends: whether the first and the last polygon, which must then be star-shaped about their middles, are closed.
    """
    sections = np.asarray(sections_m, dtype=np.float64)
    count, around = sections.shape[:2]
    beside = np.roll(sections, -1, axis=1)
    a, b, c, d = sections[:-1], beside[:-1], beside[1:], sections[1:]
    walls = np.concatenate([np.stack([a, b, c], 2).reshape(-1, 3, 3), np.stack([a, c, d], 2).reshape(-1, 3, 3)])
    middles = sections[[0, -1]].mean(axis=1)[:, None] + np.zeros((1, around, 1))
    first = np.stack([middles[0], beside[0], sections[0]], 1)
    last = np.stack([middles[1], sections[-1], beside[-1]], 1)
    corners = np.concatenate([walls, first, last])
    wall_rgb = np.broadcast_to(np.asarray(rgb, dtype=np.float64), (count - 1, around, 3))
    colours = np.concatenate([wall_rgb.reshape(-1, 3)] * 2 + [wall_rgb[0], wall_rgb[-1]])
    used = np.repeat([True, True, *ends], [(count - 1) * around] * 2 + [around] * 2)
    origin = corners.reshape(-1, 3).mean(axis=0)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.sum((corners[:, 0] - origin) * normal) < 0:  # six times the volume
        corners = corners[:, ::-1]
    used &= np.einsum("ij,ij->i", normal, normal) > FLAT_M2**2
    return triangles(corners[used], colours[used, None])


def frustum(low_m: ArrayLike, z_m: float, top_m: ArrayLike, top_z_m: float, rgb: ArrayLike, lid: bool = True) -> Mesh:
    """Walls between two polygons (N, 2) of equal length at two heights, and a lid on star-shaped upper ones."""
    return loft([at_height(low_m, z_m), at_height(top_m, top_z_m)], rgb, (False, lid))


def at_height(points_m: ArrayLike, z_m: ArrayLike) -> Array:
    """Points (N, 2) at one height or at a height each, (N, 3)."""
    points = np.asarray(points_m, dtype=np.float64)
    return np.column_stack([points, np.broadcast_to(z_m, len(points))])


def instances(
    mesh: Mesh, at_m: ArrayLike, yaw_rad: ArrayLike = 0.0, size: ArrayLike = 1.0, rgb: ArrayLike = WHITE
) -> Mesh:
    """Copies of a mesh: stretched by positive sizes, turned from x towards y, moved, their colours multiplied.

    Args:
        at_m: (3,) or (M, 3). yaw_rad: one or (M,). size: one, (3,), (M, 1) or (M, 3). rgb: (3,) or (M, 3).
    """
    at = np.asarray(at_m, dtype=np.float32).reshape(-1, 1, 3)
    count = len(at)
    scale, colour = (np.broadcast_to(np.asarray(v, dtype=np.float32), (count, 3))[:, None] for v in (size, rgb))
    yaw = np.broadcast_to(np.asarray(yaw_rad, dtype=np.float32), (count,))[:, None]
    c, s = np.cos(yaw), np.sin(yaw)
    position, normal = mesh[None, :, :3] * scale, mesh[None, :, 3:6] / scale
    normal /= np.sqrt(np.einsum("ijk,ijk->ij", normal, normal))[..., None]
    out = np.empty((count, len(mesh), 9), dtype=np.float32)
    for first, vectors in ((0, position), (3, normal)):
        out[..., first] = c * vectors[..., 0] - s * vectors[..., 1]
        out[..., first + 1] = s * vectors[..., 0] + c * vectors[..., 1]
        out[..., first + 2] = vectors[..., 2]
    out[..., :3] += at
    out[..., 6:] = np.clip(mesh[None, :, 6:] * colour, 0.0, 1.0)
    return out.reshape(-1, 9)


def rectangle(x_m: float, y_m: float, length_m: float, width_m: float, yaw_rad: float = 0.0) -> Array:
    """Corners (4, 2) of a rectangle around (x, y), its length turned by yaw from x towards y."""
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * [length_m, width_m]
    return place(corners, x_m, y_m, yaw_rad)


def place(corners_m: ArrayLike, x_m: float, y_m: float, yaw_rad: float) -> Array:
    """Points (N, 2) turned by yaw about the origin and moved to (x, y)."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.asarray(corners_m) @ np.array([[c, s], [-s, c]]) + [x_m, y_m]


@cache
def unit_box() -> Mesh:
    """A white cube of 1 m whose floor is centred at the origin."""
    return loft([at_height(rectangle(0, 0, 1, 1), z) for z in (0.0, -1.0)], WHITE)


def boxes(at_m: ArrayLike, size_m: ArrayLike, rgb: ArrayLike, yaw_rad: ArrayLike = 0.0) -> Mesh:
    """Closed boxes, placed by the middles of their floors.

    Args:
        at_m: (3,) or (M, 3). size_m: length, width, height, (3,) or (M, 3). rgb: (3,) or (M, 3). yaw_rad: one or (M,).
    """
    return instances(unit_box(), at_m, yaw_rad, size_m, rgb)


def rods(starts_m: ArrayLike, ends_m: ArrayLike, thick_m: ArrayLike, rgb: ArrayLike) -> Mesh:
    """Square rods without ends between points (3,) or (M, 3); thickness and colour one or per rod."""
    starts, ends = (np.asarray(points, dtype=np.float64).reshape(-1, 3) for points in (starts_m, ends_m))
    thick = np.broadcast_to(np.asarray(thick_m, dtype=np.float64), (len(starts),))[:, None] / 2
    along = ends - starts
    helper = np.where(np.abs(along[:, 2:]) > 0.9 * np.linalg.norm(along, axis=1)[:, None], [1.0, 0, 0], [0, 0, 1.0])
    side = np.cross(along, helper)
    side *= thick / np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(side, along)
    up *= thick / np.linalg.norm(up, axis=1)[:, None]
    ring = np.stack([side + up, side - up, -side - up, -side + up], 1)
    near, far = starts[:, None] + ring, ends[:, None] + ring
    faces = np.stack([near, np.roll(near, -1, 1), np.roll(far, -1, 1), far], 2).reshape(-1, 4, 3)
    colour = np.broadcast_to(np.asarray(rgb, dtype=np.float64), (len(starts), 3))
    return quads(faces, np.repeat(colour, 4, axis=0))


def disc(x_m: float, y_m: float, radius_m: float, sides: int = 10) -> Array:
    """Regular polygon (sides, 2)."""
    angle = np.arange(sides) * 2 * np.pi / sides
    return np.stack([x_m + radius_m * np.cos(angle), y_m + radius_m * np.sin(angle)], axis=1)


def dome(x_m: float, y_m: float, middle_z_m: float, radius_m: float, rgb: ArrayLike, sides: int = 8) -> Mesh:
    """A ball of rings: radomes."""
    rise = np.sin(np.linspace(-np.pi / 2, np.pi / 2, 6))
    rings = [at_height(disc(x_m, y_m, radius_m * np.sqrt(1 - r * r), sides), middle_z_m - radius_m * r) for r in rise]
    return loft(rings, rgb)


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of many; empty for none."""
    return np.concatenate(meshes) if meshes else np.zeros((0, 9), dtype=np.float32)
