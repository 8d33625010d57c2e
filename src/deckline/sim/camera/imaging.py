"""From what the renderer drew to what the camera records: air, exposure, lens, sensor and depth camera, joined."""

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.haze import Atmosphere, Triple, add_haze, beta_from_visibility, scatter, visibility_from_beta, world_rays
from deckline.sim.camera.air import draw_air, draw_model, rain_extinction
from deckline.sim.camera.config import AirConfig, ImagingConfig, Model
from deckline.sim.camera.exposure import Exposure, Film, draw_exposure
from deckline.sim.camera.lens import Lens, pinhole_for, pixel_rays
from deckline.sim.camera.measure import measure_depth
from deckline.sim.camera.sensor import Sensor, develop, draw_sensor, finish, meter
from deckline.sim.scene.gl import moderngl
from deckline.sim.scene.view import View

METER_STEP = 4  # metering looks at every fourth pixel
BRIGHTEST = 3.0  # light that thick air lets through at all: it dims the sun before the sun's glitter is seen through it
FAIR_STRENGTH = 0.15  # how far the sensor strays in the named presets, of what training wants


@dataclass(frozen=True)
class Surroundings:
    """What the camera path needs to know of the scene."""

    horizon: Triple  # linear light of the clear sky at the horizon
    sun: Triple  # unit vector from the sun to the ground, world
    sea_z_m: float  # world z of the water
    visibility_m: float  # 2 % contrast at the water, without rain; infinite: no air at all, in any rain
    velocity_m_s: Triple  # of the camera relative to the ship, world
    turning_rad_s: Triple = (0.0, 0.0, 0.0)  # of the camera, world


@dataclass(frozen=True, eq=False)
class Shot:
    """One recorded picture."""

    image_rgb: NDArray[np.uint8]  # (H, W, 3)
    # (H, W, 3) without haze, rain, blur by motion, noise and JPEG; None: not asked for
    clear_rgb: NDArray[np.uint8] | None
    depth_m: NDArray[np.float32]  # (H, W) as the depth camera measures it, NaN where nothing was seen
    true_depth_m: NDArray[np.float32]  # (H, W) NaN in the sky
    visibility_m: float  # 2 % contrast at the water, with the rain
    airlight_rgb: Triple  # 0..255, of thick air away from the sun
    records: dict[str, Any]  # plain numbers for scene.json: model, air, exposure, sensor


class Imaging:
    """The camera path; its GPU passes live on the renderer's OpenGL context."""

    def __init__(self, context: moderngl.Context) -> None:
        self.lens, self.film = Lens(context), Film(context)

    def take(
        self,
        view: View,
        camera: Camera,
        world_from_camera: RigidTransform,
        scene: Surroundings,
        config: ImagingConfig,
        recording: np.random.Generator,
        frame: np.random.Generator,
        wide: bool,
        keep_clear: bool = True,
    ) -> Shot:
        """The picture that `camera` records of what its pinhole saw.

        Args:
            view: rendered with `pinhole_for(camera)`.
            world_from_camera: in the middle of the exposure.
            recording: draws what a recording keeps: the air and the sensor's settings.
            frame: draws what every frame has of its own: shaking, noise.
            wide: draw what the configuration leaves open, as for preset train.
            keep_clear: also give the picture without haze, rain and motion blur.
        """
        pinhole = pinhole_for(camera)
        moving = scene.velocity_m_s, scene.turning_rad_s
        exposure = draw_exposure(config.film, pinhole, world_from_camera, *moving, recording, frame, wide)
        model, air = self._air(scene, config.air, exposure.rain_mm_h, recording, wide)
        thick = model == "physical" and any(air.extinction_per_m)
        seen = scatter_view(view, pinhole, world_from_camera, air) if thick else view
        level = meter_view(seen, air, model == "paper")
        sensor = draw_sensor(config.sensor, 1.0 if wide else FAIR_STRENGTH, level, recording)
        taken = self._expose(seen, pinhole, camera, exposure)
        image = clear = develop(taken.radiance, sensor)
        if keep_clear and (thick or not exposure.still):
            clear = develop(self._expose(view, pinhole, camera, Exposure()).radiance, sensor)
        airlight = display_levels(air.airlight, sensor)
        if model == "paper":
            image = paper_haze(image, taken.depth_m, camera, air.extinction_per_m[1], airlight)
        return Shot(
            image_rgb=finish(image, sensor, frame),
            clear_rgb=clear if keep_clear else None,
            depth_m=measure_depth(taken.depth_m, config.depth, frame),
            true_depth_m=taken.depth_m,
            visibility_m=visibility(scene, exposure),
            airlight_rgb=airlight,
            records={"model": model, "air": air.to_mapping(), "exposure": asdict(exposure), "sensor": asdict(sensor)},
        )

    def _air(
        self, scene: Surroundings, config: AirConfig, rain_mm_h: float, rng: np.random.Generator, wide: bool
    ) -> tuple[Model, Atmosphere]:
        """The model and its air, which for the paper's is even and grey."""
        model = draw_model(config, rng, wide)
        rain = 0.0 if math.isinf(scene.visibility_m) else rain_mm_h
        air = draw_air(config, scene.visibility_m, rain, scene.horizon, scene.sun, scene.sea_z_m, rng, wide)
        if model == "paper":
            grey = (air.extinction_per_m[1],) * 3
            air = replace(air, extinction_per_m=grey, scale_height_m=math.inf, glow=0.0, waves=())
        return model, air

    def _expose(self, view: View, pinhole: Camera, camera: Camera, exposure: Exposure) -> View:
        """The view through the exposure and the lens."""
        exposed = self.film.expose(view, pinhole, exposure)
        return self.lens.warp(exposed, pinhole, camera) if camera.has_distortion else exposed


def visibility(scene: Surroundings, exposure: Exposure) -> float:
    """Visibility, m, at the water in haze and rain; rain does not thicken clear air."""
    if math.isinf(scene.visibility_m) or exposure.rain_mm_h == 0:
        return scene.visibility_m
    return visibility_from_beta(beta_from_visibility(scene.visibility_m) + rain_extinction(exposure.rain_mm_h))


def display_levels(light: Triple, sensor: Sensor) -> Triple:
    """Levels 0..255 that a sensor shows of an even light."""
    level = develop(np.asarray(light, np.float32).reshape(1, 1, 3), sensor)[0, 0]
    return float(level[0]), float(level[1]), float(level[2])


def scatter_view(view: View, camera: Camera, world_from_camera: RigidTransform, air: Atmosphere) -> View:
    """A pinhole's view through air of the physical model."""
    directions, lengths = world_rays(pixel_rays(camera), world_from_camera.rotation.as_matrix())
    light = np.minimum(view.radiance, np.float32(BRIGHTEST))
    eye = world_from_camera.translation
    return View(scatter(light, view.depth_m * lengths, directions, eye, air), view.depth_m)


def meter_view(view: View, air: Atmosphere, air_to_come: bool) -> float:
    """The light that automatic exposure goes by, on every fourth pixel of a view whose even air may be yet to come.

    Ray lengths are taken for depths here: exposure needs no more.
    """
    light = view.radiance[::METER_STEP, ::METER_STEP]
    if air_to_come and any(air.extinction_per_m):
        depth = np.nan_to_num(view.depth_m[::METER_STEP, ::METER_STEP], nan=np.inf)
        t = np.exp(-np.float32(air.extinction_per_m[1]) * depth)[..., None]
        light = light * t + np.asarray(air.airlight, np.float32) * (1 - t)
    return meter(light)


def paper_haze(
    clear_rgb: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    camera: Camera,
    extinction_per_m: float,
    airlight: Triple,
) -> NDArray[np.uint8]:
    """The paper's haze on a clear picture (H, W, 3); airlight in 0..255."""
    if extinction_per_m == 0:
        return clear_rgb
    rays = pixel_rays(camera)
    lengths = np.sqrt(np.einsum("hwc,hwc->hw", rays, rays))
    return add_haze(clear_rgb, depth_m * lengths, extinction_per_m, airlight)
