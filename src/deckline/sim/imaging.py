"""From what the renderer drew to what the camera records: air, exposure, lens, sensor and depth camera, joined."""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.haze import Atmosphere, Triple, add_haze, beta_from_visibility, scatter, world_rays
from deckline.sim.atmosphere import AirConfig, draw_air, draw_model, rain_extinction
from deckline.sim.depth_camera import DepthConfig, measure_depth
from deckline.sim.exposure import Exposure, FilmConfig, draw_exposure
from deckline.sim.film import Film
from deckline.sim.gl import moderngl
from deckline.sim.lens import Lens, LensConfig, pinhole_for, pixel_rays
from deckline.sim.render import View
from deckline.sim.sensor import SensorConfig, develop, draw_sensor, finish, meter

METER_STEP = 4  # metering looks at every fourth pixel
FAIR_STRENGTH = 0.15  # how far the sensor strays in the named presets, of what training wants


@dataclass(frozen=True)
class ImagingConfig:
    """The camera, the air before it and its depth camera."""

    lens: LensConfig = field(default_factory=LensConfig)
    film: FilmConfig = field(default_factory=FilmConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    air: AirConfig = field(default_factory=AirConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)


@dataclass(frozen=True)
class Surroundings:
    """What the camera path needs to know of the scene."""

    horizon: Triple  # linear light of the clear sky at the horizon
    sun: Triple  # unit vector from the sun to the ground, world
    sea_z_m: float  # world z of the water
    visibility_m: float  # 2 % contrast at the water, without rain; infinite is clear
    velocity_m_s: Triple  # of the camera relative to the ship, world


@dataclass(frozen=True, eq=False)
class Shot:
    """One recorded picture."""

    image_rgb: NDArray[np.uint8]  # (H, W, 3)
    clear_rgb: NDArray[np.uint8]  # (H, W, 3) without air, noise and JPEG
    depth_m: NDArray[np.float32]  # (H, W) as the depth camera measures it, NaN where nothing was seen
    true_depth_m: NDArray[np.float32]  # (H, W) NaN in the sky
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
    ) -> Shot:
        """The picture that `camera` records of what its pinhole saw.

        Args:
            view: rendered with `pinhole_for(camera)`.
            world_from_camera: in the middle of the exposure.
            recording: draws what a recording keeps: the air and the sensor's settings.
            frame: draws what every frame has of its own: shaking, noise.
            wide: draw what the configuration leaves open, as for preset train.
        """
        pinhole = pinhole_for(camera)
        exposure = draw_exposure(config.film, pinhole, world_from_camera, scene.velocity_m_s, frame, wide)
        model = draw_model(config.air, recording, wide)
        rain = exposure.rain_mm_h
        air = draw_air(config.air, scene.visibility_m, rain, scene.horizon, scene.sun, scene.sea_z_m, recording, wide)
        thick = model == "physical" and any(air.extinction_per_m)
        seen = view
        if thick:
            directions, lengths = world_rays(pixel_rays(pinhole), world_from_camera.rotation.as_matrix())
            range_m = view.depth_m * lengths
            light = scatter(view.radiance, range_m, directions, world_from_camera.translation, air)
            seen = View(light, view.depth_m)
        strength = 1.0 if wide else FAIR_STRENGTH
        level = metered(seen, air, model == "paper")
        sensor = draw_sensor(config.sensor, strength, level, recording)
        taken = self._taken(view, pinhole, camera, exposure)
        clear = develop(taken.radiance, sensor)
        airlight = develop(np.asarray(air.airlight, np.float32).reshape(1, 1, 3), sensor)[0, 0].astype(np.float64)
        image = clear
        if thick:
            image = develop(self._taken(seen, pinhole, camera, exposure).radiance, sensor)
        elif model == "paper":
            image = paper_haze(clear, taken.depth_m, camera, scene.visibility_m, rain, airlight)
        records = {"model": model, "air": air.to_mapping(), "exposure": asdict(exposure), "sensor": asdict(sensor)}
        return Shot(
            image_rgb=finish(image, sensor, frame),
            clear_rgb=clear,
            depth_m=measure_depth(taken.depth_m, config.depth, frame),
            true_depth_m=taken.depth_m,
            airlight_rgb=(float(airlight[0]), float(airlight[1]), float(airlight[2])),
            records=records,
        )

    def _taken(self, view: View, pinhole: Camera, camera: Camera, exposure: Exposure) -> View:
        """The view through the exposure and the lens."""
        exposed = View(self.film.expose(view.radiance, view.depth_m, pinhole, exposure), view.depth_m)
        return self.lens.warp(exposed, pinhole, camera) if camera.has_distortion else exposed


def metered(view: View, air: Atmosphere, through_air: bool) -> float:
    """The light that automatic exposure goes by, with even air yet to come or already there.

    Ray lengths are taken for depths here: exposure needs no more.
    """
    light, depth = (
        view.radiance[::METER_STEP, ::METER_STEP],
        np.nan_to_num(view.depth_m[::METER_STEP, ::METER_STEP], nan=np.inf),
    )
    if through_air and any(air.extinction_per_m):
        t = np.exp(-np.float32(air.extinction_per_m[1]) * depth)[..., None]
        light = light * t + np.asarray(air.airlight, np.float32) * (1 - t)
    return meter(light)


def paper_haze(
    clear_rgb: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    camera: Camera,
    visibility_m: float,
    rain_mm_h: float,
    airlight: NDArray[np.float64],
) -> NDArray[np.uint8]:
    """The paper's haze, and the rain's, on a clear picture (H, W, 3); airlight (3,) in 0..255."""
    haze = 0.0 if np.isinf(visibility_m) else beta_from_visibility(visibility_m)
    extinction = haze + rain_extinction(rain_mm_h)
    if extinction == 0:
        return clear_rgb
    rays = pixel_rays(camera)
    lengths = np.sqrt(np.einsum("hwc,hwc->hw", rays, rays))
    return add_haze(clear_rgb, depth_m * lengths, extinction, airlight)
