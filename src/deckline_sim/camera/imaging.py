"""From what the renderer drew to what the camera records: air, exposure, lens, sensor and depth camera, joined."""

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.haze import (
    Atmosphere,
    Triple,
    Wave,
    add_haze,
    beta_from_visibility,
    blend_airlight,
    scatter,
    triple,
    visibility_from_beta,
    world_rays,
)
from deckline_sim.camera.exposure import Exposure, ExposurePass, draw_exposure
from deckline_sim.camera.lens import Lens, pinhole_for, pixel_rays
from deckline_sim.camera.measure import measure_depth
from deckline_sim.camera.sensor import Sensor, develop, draw_sensor, finish, meter
from deckline_sim.config import AirConfig, AirModel, ImagingConfig
from deckline_sim.scene.gl import moderngl
from deckline_sim.scene.view import Rendering

PHYSICAL_SHARE = 0.5  # of the frames of preset train
WAVELENGTH_NM = np.array([610.0, 550.0, 465.0])  # middles of red, green and blue; visibility is quoted for green
HAZE_FROM_M = 1000.0  # visibility from which drops are small enough to colour the light; below it is fog
SCALE_HEIGHT_M = 1000.0  # of haze in the marine boundary layer
PATCH_WAVES = 5
MOST_COLOUR = 0.4  # deviation from grey, as a share, of drawn thick air: drops scatter all colours nearly alike
TINT = 0.04  # 1-sigma of the airlight's colour, from cold to warm
# Carbonneau's rain attenuation, ITU-R P.1814: 1.076 R^0.67 dB/km, R in mm/h.
RAIN_DB_PER_KM, RAIN_EXPONENT = 1.076, 0.67
DB_PER_NEPER = 10.0 / math.log(10.0)
METER_STEP = 4  # metering uses every fourth pixel
BRIGHTEST = 3.0  # light that thick air lets through at all: it dims the sun before the sun's glitter is seen through it
FAIR_STRENGTH = 0.15  # spread of the sensor's settings in the named presets, relative to training


def draw_model(config: AirConfig, rng: np.random.Generator, wide: bool) -> AirModel:
    """Which model a frame has."""
    physical = rng.random() < PHYSICAL_SHARE
    if config.model is not None:
        return config.model
    return "physical" if wide and physical else "paper"


def rain_extinction(rain_mm_h: float) -> float:
    """Extinction, 1/m, of rain. Source: Carbonneau's model in ITU-R P.1814."""
    return RAIN_DB_PER_KM * rain_mm_h**RAIN_EXPONENT / DB_PER_NEPER / 1000.0


def draw_air(
    config: AirConfig,
    visibility_m: float,
    rain_mm_h: float,
    horizon: ArrayLike,
    sun: ArrayLike,
    sea_z_m: float,
    rng: np.random.Generator,
    wide: bool,
) -> Atmosphere:
    """Air of the physical model.

    Args:
        visibility_m: 2 % contrast at the water, without the rain; infinite is clear.
        horizon: (3,) linear light of the clear sky at the horizon.
        sun: (3,) unit vector from the sun to the ground, world.
        sea_z_m: world z of the water.
        wide: draw what the configuration leaves open, as for preset train.
    """
    drawn = _draw_open_values(visibility_m, rng)
    values = drawn if wide else {"scale_height_m": SCALE_HEIGHT_M, "patchiness": 0.0, "patch_m": 400.0}
    values = {"angstrom": 0.0, "glow": 1.0} | values
    values |= {name: given for name in values if (given := getattr(config, name)) is not None}
    waves = draw_waves(values["patchiness"], values["patch_m"], rng)
    airlight = draw_airlight(np.asarray(horizon, dtype=np.float64), rng, wide)
    haze = 0.0 if math.isinf(visibility_m) else beta_from_visibility(visibility_m)
    extinction = haze * (WAVELENGTH_NM / WAVELENGTH_NM[1]) ** -values["angstrom"] + rain_extinction(rain_mm_h)
    return Atmosphere(
        extinction_per_m=triple(extinction),
        airlight=triple(airlight),
        base_z_m=float(sea_z_m),
        scale_height_m=values["scale_height_m"],
        glow=values["glow"],
        sun=triple(sun),
        waves=waves,
    )


def _draw_open_values(visibility_m: float, rng: np.random.Generator) -> dict[str, float]:
    kinds = rng.random(4)
    height = float(np.exp(rng.uniform(np.log(40.0), np.log(3000.0))))
    patchiness, patch = rng.uniform(0.1, 0.9), np.exp(rng.uniform(np.log(100.0), np.log(2000.0)))
    angstrom, glow = rng.uniform(0.0, 1.3), rng.exponential(1.0)
    return {
        "scale_height_m": height if kinds[0] < 0.6 else math.inf,
        "patchiness": float(patchiness) if kinds[1] < 0.5 else 0.0,
        "patch_m": float(patch),
        "angstrom": float(angstrom) if visibility_m > HAZE_FROM_M else 0.0,
        "glow": float(min(glow, 5.0)) if kinds[2] < 0.6 else 0.0,
    }


def draw_waves(patchiness: float, patch_m: float, rng: np.random.Generator) -> tuple[Wave, ...]:
    """Plane waves of random heading and phase about a wavelength, whose amplitudes add up to `patchiness`."""
    heading, phase = rng.uniform(0, 2 * np.pi, (2, PATCH_WAVES))
    number = 2 * np.pi / (patch_m * np.exp(rng.uniform(-0.7, 0.7, PATCH_WAVES)))
    share = rng.uniform(0.5, 1.0, PATCH_WAVES)
    amplitude = patchiness * share / share.sum()
    if patchiness == 0:
        return ()
    waves = np.column_stack([number * np.cos(heading), number * np.sin(heading), phase, amplitude])
    return tuple(map(tuple, waves.tolist()))


def draw_airlight(horizon: NDArray[np.float64], rng: np.random.Generator, wide: bool) -> NDArray[np.float64]:
    """Linear light (3,) of thick air under a sky with this horizon: the same within a few per cent, or if `wide`
    greyer, tinted or darker.

    Source: Koschmieder's law, in which the airlight is the light of the sky at the horizon.
    """
    (warmth, green), mixed = rng.normal(size=2), rng.uniform(0.0, 1.0)
    thick, darkness, brightness = rng.random() < 0.25, rng.uniform(0.3, 0.75), rng.uniform(0.75, 1.2)
    tint = np.exp(TINT * np.array([warmth, 0.4 * green, -warmth]))
    if not wide:
        return np.asarray(horizon * tint)
    grey = horizon.mean()
    colour = horizon - grey
    paled = min(1.0, MOST_COLOUR * grey / max(float(np.abs(colour).max()), 1e-9))
    air = grey + colour * paled * mixed
    return np.asarray(air * tint * (darkness if thick else brightness))


@dataclass(frozen=True)
class Surroundings:
    """The scene's values that the camera path uses."""

    horizon: Triple
    """(3,) linear light of the clear sky at the horizon."""
    sun: Triple
    """(3,) unit vector from the sun to the ground, world."""
    sea_z_m: float
    """World z of the water, m."""
    visibility_m: float
    """2 % contrast at the water, without rain, m; infinite: no air at all, in any rain."""
    velocity_m_s: Triple
    """(3,) of the camera relative to the ship, world, m/s."""
    turning_rad_s: Triple = (0.0, 0.0, 0.0)
    """(3,) of the camera, world, rad/s."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One recorded picture."""

    image_rgb: NDArray[np.uint8]
    """(H, W, 3) the picture."""
    clear_rgb: NDArray[np.uint8] | None
    """(H, W, 3) without haze, rain, motion blur, noise and JPEG; None: not asked for."""
    depth_m: NDArray[np.float32]
    """(H, W) as the depth camera measures it, m along the axis; NaN without a measurement."""
    visibility_m: float
    """2 % contrast at the water, with the rain, m."""
    airlight_rgb: Triple
    """(3,) 0..255, of thick air away from the sun."""
    records: dict[str, Any]
    """Plain numbers for scene.json: model, air, exposure, sensor."""


class Imaging:
    """The camera path; its GPU passes live on the renderer's OpenGL context."""

    def __init__(self, context: moderngl.Context) -> None:
        self.lens, self.exposure_pass = Lens(context), ExposurePass(context)

    def take(
        self,
        view: Rendering,
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
            recording: draws the values that a recording's frames share: the air and the sensor's settings.
            frame: draws the values of one frame: shake, noise.
            wide: draw what the configuration leaves open, as for preset train.
            keep_clear: also give the picture without haze, rain and motion blur.
        """
        pinhole = pinhole_for(camera)
        moving = scene.velocity_m_s, scene.turning_rad_s
        exposure = draw_exposure(config.exposure, pinhole, world_from_camera, *moving, recording, frame, wide)
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
            visibility_m=visibility(scene, exposure),
            airlight_rgb=airlight,
            records={"model": model, "air": air.to_mapping(), "exposure": asdict(exposure), "sensor": asdict(sensor)},
        )

    def _air(
        self, scene: Surroundings, config: AirConfig, rain_mm_h: float, rng: np.random.Generator, wide: bool
    ) -> tuple[AirModel, Atmosphere]:
        """The model and its air, which for the paper's is even and grey."""
        model = draw_model(config, rng, wide)
        rain = 0.0 if math.isinf(scene.visibility_m) else rain_mm_h
        air = draw_air(config, scene.visibility_m, rain, scene.horizon, scene.sun, scene.sea_z_m, rng, wide)
        if model == "paper":
            grey = (air.extinction_per_m[1],) * 3
            air = replace(air, extinction_per_m=grey, scale_height_m=math.inf, glow=0.0, waves=())
        return model, air

    def _expose(self, view: Rendering, pinhole: Camera, camera: Camera, exposure: Exposure) -> Rendering:
        """The view through the exposure and the lens."""
        exposed = self.exposure_pass.expose(view, pinhole, exposure)
        return self.lens.warp(exposed, pinhole, camera) if camera.has_distortion else exposed


def visibility(scene: Surroundings, exposure: Exposure) -> float:
    """Visibility, m, at the water in haze and rain; rain does not thicken clear air."""
    if math.isinf(scene.visibility_m) or exposure.rain_mm_h == 0:
        return scene.visibility_m
    return visibility_from_beta(beta_from_visibility(scene.visibility_m) + rain_extinction(exposure.rain_mm_h))


def display_levels(light: Triple, sensor: Sensor) -> Triple:
    """Levels 0..255 that a sensor shows of an even light."""
    return triple(develop(np.asarray(light, np.float32).reshape(1, 1, 3), sensor)[0, 0])


def scatter_view(view: Rendering, camera: Camera, world_from_camera: RigidTransform, air: Atmosphere) -> Rendering:
    """A pinhole's view through air of the physical model."""
    directions, lengths = world_rays(pixel_rays(camera), world_from_camera.rotation.as_matrix())
    light = np.minimum(view.radiance, np.float32(BRIGHTEST))
    eye = world_from_camera.translation
    return Rendering(scatter(light, view.depth_m * lengths, directions, eye, air), view.depth_m)


def meter_view(view: Rendering, air: Atmosphere, air_to_come: bool) -> float:
    """The light that automatic exposure measures, on every fourth pixel; `air_to_come`: the view lacks its even air.

    Depths serve as ray lengths, which is accurate enough for exposure.
    """
    light = view.radiance[::METER_STEP, ::METER_STEP]
    if air_to_come and any(air.extinction_per_m):
        depth = np.nan_to_num(view.depth_m[::METER_STEP, ::METER_STEP], nan=np.inf)
        t = np.exp(-np.float32(air.extinction_per_m[1]) * depth)[..., None]
        light = blend_airlight(light, np.asarray(air.airlight, np.float32), t)
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
