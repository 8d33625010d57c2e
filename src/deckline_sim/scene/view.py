"""One picture: the renderer's input, the shaders' uniforms by name, and the renderer's output."""

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline_sim.scene.waves import TILE_WAVES, phase_speed_m_s
from deckline_sim.scene.weather import RIPPLE_RATIO, Weather
from deckline_sim.ship.ship import Ship

SAMPLES = 4  # per pixel, against jagged edges
NEAR_M, FAR_M = 1.0, 20000.0  # clip planes of the depth buffer, which only sorts surfaces
CROSSING = 0.73  # the second copy of the waves over the first, in size: the two never repeat together
DEPTHS_M = 1e9  # world z below which nothing is drawn on land
CLEAR_AIR_M = 1e9  # the ship's own haze is added by whoever takes the picture
Uniforms = dict[str, ArrayLike]


class Label(IntEnum):
    """What a pixel shows."""

    SKY = 0
    SURFACE = 1  # water, or the ground around a runway on land
    DECK = 2
    STRUCTURE = 3  # all else of the ship: hull, island, aircraft on deck
    BACKGROUND = 4  # other ships, coast


@dataclass(frozen=True)
class RenderQuality:
    """Anti-aliasing and texture filtering; low values resemble simpler renderers."""

    samples: int = SAMPLES  # per pixel, this many or 1, which leaves jagged edges
    anisotropy: float = 16.0  # of the deck's texture filter; 1 smears far markings together


BEST = RenderQuality()


@dataclass(frozen=True, eq=False)
class RenderScene:
    """The renderer's input: a pinhole camera's view of the loaded ship, or of its sea alone."""

    camera: Camera
    world_from_camera: RigidTransform
    weather: Weather
    time_s: float = 0.0
    with_ship: bool = True
    quality: RenderQuality = BEST
    world_from_ship: RigidTransform | None = None  # None: as the ship lies at rest


@dataclass(frozen=True, eq=False)
class Rendering:
    """The renderer's output."""

    radiance: NDArray[np.float32]  # (H, W, 3) linear light; 1 is what a white surface in full daylight sends
    depth_m: NDArray[np.float32]  # (H, W) along the optical axis; NaN in the sky

    @property
    def nearness(self) -> NDArray[np.float32]:
        """1 / depth (H, W), 0 in the sky."""
        known = np.where(np.isnan(self.depth_m), np.float32(np.inf), self.depth_m)
        return np.asarray(1.0 / known, np.float32)


def random_quality(rng: np.random.Generator) -> RenderQuality:
    """Mostly good."""
    anisotropy = float(rng.choice([1.0, 2.0, 4.0, 16.0], p=[0.15, 0.25, 0.25, 0.35]))
    return RenderQuality(samples=1 if rng.random() < 0.15 else SAMPLES, anisotropy=anisotropy)


def scene_uniforms(scene: RenderScene, ship: Ship, ship_pose: RigidTransform) -> Uniforms:
    """Everything that does not depend on which solid is drawn."""
    camera, weather = scene.camera, scene.weather
    layout, world_from_ship = ship.layout, ship_pose.as_matrix()
    values: Uniforms = {item.name: getattr(weather, item.name) for item in fields(weather)}
    low, heading = layout.outline_m.min(axis=0), world_from_ship[:2, 0]
    return (
        values
        | sea_uniforms(weather, scene.time_s)
        | {
            "lens": (camera.fx, camera.fy, camera.cx, camera.cy),
            "world_from_optical": scene.world_from_camera.rotation.as_matrix().T,
            "eye": scene.world_from_camera.translation,
            "sea_z": layout.sea_z_m,
            "clip_z": DEPTHS_M if layout.on_land else layout.sea_z_m,
            "ship": (*world_from_ship[:2, 3], *heading / np.linalg.norm(heading)),
            "wake": (ship.stern_half_m, weather.wake_spread, weather.wake_length_m, weather.wake * scene.with_ship),
            "hull_m": layout.length_m,
            "world_from_ship4": world_from_ship.T,
            "paint_area": (*low, *np.ptp(layout.outline_m, axis=0)),
            "noise_map": 0,
            "paint_map": 1,
            "wave_map": 2,
            "shadow_map": 3,
        }
    )


def solid_uniforms(scene: RenderScene, pose: RigidTransform, haze_m: float) -> Uniforms:
    """Transforms of a solid at world_from_solid `pose`, and the distance scale of the haze before it."""
    optical_from_solid = (scene.world_from_camera.inv() * pose).as_matrix()
    return {
        "clip_from_ship": (clip_from_optical(scene.camera) @ optical_from_solid).T,
        "depth_row": optical_from_solid[2],
        "down_row": pose.as_matrix()[2],
        "world_from_ship": pose.rotation.as_matrix().T,
        "haze_m": haze_m,
    }


def sea_uniforms(weather: Weather, time_s: float) -> Uniforms:
    """Sizes of the wave tile's copies, how far the waves in each have run, and how a rough sea mirrors.

    Source: mean Fresnel reflectance by Bruneton, Neyret and Holzschuch 2010.
    """
    lengths = weather.wave_length_m * np.array([1.0, CROSSING, 1.0 / RIPPLE_RATIO, 0.0])
    lengths[3] = weather.swell_length_m
    rough = weather.roughness
    return {
        "tiles_m": TILE_WAVES * lengths,
        "drift_m": [phase_speed_m_s(length) * time_s for length in lengths],
        "mirror": (5.0 * np.exp(-2.69 * rough), 1.0 / (1.0 + 22.7 * rough**1.5)),
        "wind": (np.cos(weather.wind_rad), np.sin(weather.wind_rad)),
    }


def clip_from_optical(camera: Camera) -> NDArray[np.float64]:
    """Projection (4, 4) of the optical frame to OpenGL's clip space, image row 0 at the bottom."""
    sx, sy = 2.0 / camera.width, 2.0 / camera.height
    a, b = (FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M)
    return np.array(
        [
            [camera.fx * sx, 0.0, (camera.cx + 0.5) * sx - 1.0, 0.0],
            [0.0, camera.fy * sy, (camera.cy + 0.5) * sy - 1.0, 0.0],
            [0.0, 0.0, a, b],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )
