"""The aircraft in films: a flat-shaded solid, projected with a view's camera and filled from back to front."""

import math
from functools import cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.haze import beta_from_visibility, blend_airlight, transmission
from deckline.report.draw import Image
from deckline_sim.landing.aircraft import AIRCRAFT_TYPES
from deckline_sim.ship.clutter import build_wing, prototype
from deckline_sim.ship.mesh import Mesh, join, rods

# The simulator's parked delta, stretched to an A-4: length and span are public dimensions. The other numbers place its
# main wheels where JSBSim's A-4 has them; they are our own.
LENGTH_M, SPAN_M, SPAN_OF_LENGTH = 12.2, 8.4, 0.62
ORIGIN_M = (0.92, 0.0, 1.21)  # of the parked delta, on the ground, from the centre of gravity
TAILPLANE, TAILPLANE_Z = ((-0.36, 0.02), (-0.46, 0.14), (-0.52, 0.14), (-0.5, 0.02)), -0.2  # in lengths
HOOK_ROOT_M = (-1.8, 0.0, 0.1)
HOOK_THICK_M, HOOK_RGB = 0.14, (0.15, 0.15, 0.15)
NEAR_M = 0.5  # what is nearer to a camera is not drawn
LIGHT = np.array([0.25, -0.35, -0.9]) / math.hypot(0.25, 0.35, 0.9)  # towards the light, world
SHADE = 0.45  # brightness of a face in the shade, of one in the light
SMOOTH = 3  # pixels are drawn this many times finer, across and down


@cache
def airframe_mesh(aircraft: str) -> Mesh:
    """Triangles of an aircraft from its centre of gravity, body frame, m; all are drawn as an A-4.

    Args:
        aircraft: a name of `AIRCRAFT_TYPES`; its hook is drawn.
    """
    parts = join([prototype("delta"), build_wing(TAILPLANE, TAILPLANE_Z)])
    scale = np.array([1.0, SPAN_M / (SPAN_OF_LENGTH * LENGTH_M), 1.0])
    parts[:, :3] = parts[:, :3] * (LENGTH_M * scale) + ORIGIN_M
    parts[:, 3:6] /= scale
    parts[:, 3:6] /= np.linalg.norm(parts[:, 3:6], axis=1, keepdims=True)
    return join([parts, rods(HOOK_ROOT_M, AIRCRAFT_TYPES[aircraft].hook_m, HOOK_THICK_M, HOOK_RGB)])


def draw_aircraft(
    image: Image,
    mesh: Mesh,
    world_from_body: RigidTransform,
    camera: Camera,
    world_from_camera: RigidTransform,
    airlight_rgb: ArrayLike,
    visibility_m: float,
) -> Image:
    """The picture (H, W, 3) with an aircraft in its haze; nothing of the picture hides it.

    Args:
        image: RGB.
        mesh: of `airframe_mesh`.
        world_from_body: the aircraft.
        camera: of the picture's size.
        world_from_camera: its pose.
        airlight_rgb: (3,) of the picture, 0 to 255; a white surface is as bright.
        visibility_m: 2 % contrast, m; infinite: clear air.
    """
    camera_from_body = world_from_camera.inv() * world_from_body
    corners = camera_from_body.apply(mesh[:, :3].astype(np.float64)).reshape(-1, 3, 3)
    normals = mesh[::3, 3:6].astype(np.float64)
    is_shown = (corners[..., 2] > NEAR_M).all(1)
    is_shown &= np.einsum("ij,ij->i", camera_from_body.rotation.apply(normals), corners[:, 0]) < 0
    if not is_shown.any():
        return image.copy()
    light = SHADE + (1 - SHADE) * np.clip(world_from_body.rotation.apply(normals) @ LIGHT, 0.0, 1.0)
    rgb = mesh[::3, 6:].astype(np.float64) * light[:, None] * np.asarray(airlight_rgb)
    distance_m = np.linalg.norm(camera_from_body.translation)
    rgb = blend_airlight(rgb, np.asarray(airlight_rgb), transmission(distance_m, beta_from_visibility(visibility_m)))
    order = np.flatnonzero(is_shown)[np.argsort(-corners[is_shown].mean(1)[:, 2])]
    return _fill(image, camera.project(corners[order].reshape(-1, 3)).reshape(-1, 3, 2), rgb[order])


def _fill(image: Image, corners_px: NDArray[np.float64], rgb: NDArray[np.float64]) -> Image:
    """Fill triangles (N, 3, 2) px with colours (N, 3), the last one on top, with smooth edges."""
    height, width = image.shape[:2]
    low = np.floor(corners_px.min((0, 1))).astype(int) - 1
    high = np.ceil(corners_px.max((0, 1))).astype(int) + 2
    (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, (width, height))
    shown = image.copy()
    if left >= right or top >= bottom:
        return shown
    part = shown[top:bottom, left:right]
    fine = np.repeat(np.repeat(part, SMOOTH, axis=0), SMOOTH, axis=1)
    placed = np.rint((corners_px + 0.5 - (left, top)) * SMOOTH - 0.5).clip(-30000, 30000).astype(np.int32)
    for triangle, colour in zip(placed, rgb.tolist(), strict=True):
        cv2.fillConvexPoly(fine, triangle, colour)
    shown[top:bottom, left:right] = cv2.resize(fine, part.shape[1::-1], interpolation=cv2.INTER_AREA)
    return shown
