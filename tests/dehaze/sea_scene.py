"""Seas in haze, made from closed forms."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera, attitude, camera_mount
from deckline.types import Frame

CAMERA = Camera.from_fov(320, 180, np.radians(60))
DECK_Z_M, SEA_Z_M, EYE_Z_M = -20.0, 0.0, -60.0
AIRLIGHT, WATER = np.array([150.0, 165.0, 180.0]), np.array([45.0, 60.0, 70.0])
SEA = np.array([25.0, 45.0, 55.0])
MIRROR = 0.3 * (AIRLIGHT - SEA)  # what grazing water adds


def world_from_body(pitch_deg: float = -8.0, roll_deg: float = 3.0, eye_z_m: float = EYE_Z_M) -> RigidTransform:
    return RigidTransform.from_components(
        [0.0, 0.0, eye_z_m], attitude(np.radians(roll_deg), np.radians(pitch_deg), 1.0)
    )


def ray_z(pose: RigidTransform, camera: Camera = CAMERA) -> np.ndarray:
    """Sine of every pixel's angle below the horizontal, (H, W), of a camera that looks along the nose."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return rays @ (pose * camera_mount()).rotation.as_matrix()[2]


def sea_pair(
    beta_per_m: float, *, seed: int = 0, texture: float = 3.0, bank_per_m: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """A hazy sea and the same without haze, (H, W, 3) uint8; the sky is the airlight. The water is flat."""
    down = ray_z(world_from_body())[..., None]
    range_m = np.where(down > 0, (SEA_Z_M - EYE_Z_M) / np.maximum(down, 1e-9), 1e9)
    t = np.exp(-beta_per_m * range_m - (bank_per_m * range_m) ** 4)
    waves = np.random.default_rng(seed).normal(0, texture, (*down.shape[:2], 1))
    clear = np.where(down > 0, SEA + MIRROR * (1 - np.clip(down, 0, 1)) ** 5 + waves, AIRLIGHT)
    hazy = np.where(down > 0, AIRLIGHT + t * (clear - AIRLIGHT), AIRLIGHT)
    return np.rint(hazy).astype(np.uint8), np.rint(clear).astype(np.uint8)


def draw_horizon(
    size: tuple[int, int], row: float, slope: float, haze: float, seed: int = 0, noise: float = 2.0
) -> np.ndarray:
    """A plain sky over water that fades towards a line; `haze` in image widths, 0 is clear air. (H, W, 3) uint8."""
    width, height = size
    v, u = np.mgrid[0:height, 0:width]
    below = (v - row - slope * (u - (width - 1) / 2)) / width
    t = np.where(below > 0, np.exp(-haze / np.maximum(below, 1e-9)), 0)[..., None]
    waves = np.random.default_rng(seed).normal(0, noise, (height, width, 1))
    return np.rint(np.clip(AIRLIGHT + t * (WATER - AIRLIGHT + 4 * waves) + waves, 0, 255)).astype(np.uint8)


def frame_of(image: np.ndarray, **changes: object) -> Frame:
    given = {"camera": CAMERA, "world_from_body": world_from_body(), "deck_z_m": DECK_Z_M} | changes
    return Frame("sea.png", 0.0, image, **given)
