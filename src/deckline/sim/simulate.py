"""Frames of a simulated recording: the same configuration and index always give the same frame."""

from collections.abc import Iterator
from functools import lru_cache
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import Camera, camera_mount
from deckline.haze import add_haze, beta_from_visibility
from deckline.sim.config import SimConfig
from deckline.sim.layout import Layout, world_points
from deckline.sim.render import BEST, Renderer, View, random_quality
from deckline.sim.sensor import DISPLAY_GAMMA, Sensor, add_noise, develop, random_sensor
from deckline.sim.ship import Ship, build_ship
from deckline.sim.trajectory import Viewpoint, approach_view, random_view
from deckline.sim.weather import Weather, horizon_airlight, random_airlight, random_weather, sun_direction
from deckline.types import Frame, Segment, Truth

OPEN_SEA = 0.5  # part of the views without a runway that show no ship either
FAIR_SENSOR = 0.15  # how far the camera strays in the named presets, of what training wants
VEHICLE, CAMERA = "deckline", "front"


class Simulator:
    """Renders single frames of a recording in any order; holds the OpenGL context and the ship last used.

    Args:
        config: the recording.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
    """

    def __init__(self, config: SimConfig) -> None:
        self.config = config
        self.renderer = Renderer()
        self.loaded = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.renderer.__exit__(kind, error, trace)

    def frame(self, index: int) -> Frame:
        """Frame `index`: the same whatever was rendered before."""
        block = block_of(self.config, index)
        if block != self.loaded:
            rng = np.random.default_rng([self.config.seed, 2, block])
            self.ship = build_ship(self.config.preset, rng)
            self.renderer.load(self.ship, sun_direction(rng))
            self.loaded = block
        return _frame(self.config, index, self.renderer, self.ship)


def block_of(config: SimConfig, index: int) -> int:
    """Which ship a frame shows: an approach has one, random views share one by `frames_per_ship`."""
    return index // config.frames_per_ship if config.trajectory == "random" else 0


def frames(config: SimConfig, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
    """Frames `start`, `start + 1`, ... of a recording, before `stop` (None: all).

    Raises:
        RendererError: no OpenGL through EGL on this machine.
        ValueError: a negative start.
    """
    if start < 0:
        raise ValueError(f"start must not be negative, got {start}")
    with Simulator(config) as simulator:
        for index in range(start, config.frames if stop is None else min(stop, config.frames)):
            yield simulator.frame(index)


def _frame(config: SimConfig, index: int, renderer: Renderer, ship: Ship) -> Frame:
    rng = np.random.default_rng([config.seed, 3, index])
    approach = config.trajectory == "approach"
    whole = np.random.default_rng([config.seed, 4]) if approach else rng  # an approach keeps its weather
    fair = config.preset != "train"  # the named ships sail on fair days, as the paper's does
    weather = random_weather(whole, fair, sun=renderer.sun)
    quality = BEST if fair else random_quality(rng)
    view = approach_view(config, ship.layout, index) if approach else random_view(config, ship.layout, index, rng)
    open_sea = not ship.runway and bool(rng.random() < OPEN_SEA)
    picture = renderer.render(
        view.camera, view.world_from_body * camera_mount(), weather, view.time_s, not open_sea, quality
    )
    sky_level = float(np.mean(weather.horizon_rgb)) ** (1 / DISPLAY_GAMMA)
    sensor = random_sensor(FAIR_SENSOR if fair else 1.0, sky_level, whole)
    visibility, airlight = draw_haze(config, weather, sensor, whole)
    clear = develop(picture.radiance, sensor)
    hazy = _hazy(clear, picture, view, visibility, airlight)
    left, right = truth_segments(ship.layout) if ship.runway else (None, None)
    truth = Truth(
        left,
        right,
        visibility_m=visibility,
        airlight_rgb=(float(airlight[0]), float(airlight[1]), float(airlight[2])),
        clear_rgb=clear if config.keep_clear and np.isfinite(visibility) else None,
    )
    depth = np.where(picture.depth_m <= config.depth_range_m, picture.depth_m, np.float32(np.nan))
    return Frame(
        file=f"img_{VEHICLE}_{CAMERA}_0_{round(view.time_s * 1e9) + index}.png",
        time_s=view.time_s,
        image_rgb=add_noise(hazy, sensor, rng),
        camera=view.camera,
        depth_m=depth,
        world_from_body=view.world_from_body,
        deck_z_m=float(ship.layout.world_from_ship.translation[2]),
        truth=truth,
    )


def _hazy(
    clear: NDArray[np.uint8], picture: View, view: Viewpoint, visibility_m: float, airlight: NDArray[np.float64]
) -> NDArray[np.uint8]:
    if np.isinf(visibility_m):
        return clear
    camera = view.camera
    range_m = picture.depth_m * _ray_lengths(camera.width, camera.height, camera.fx)
    return add_haze(clear, range_m, beta_from_visibility(visibility_m), airlight)


@lru_cache(maxsize=4)
def _ray_lengths(width: int, height: int, focal_px: float) -> NDArray[np.float32]:
    """Camera.ray_lengths of the simulator's pinhole, kept because a recording seldom changes its camera."""
    return Camera(width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0).ray_lengths()


def draw_haze(
    config: SimConfig, weather: Weather, sensor: Sensor, rng: np.random.Generator
) -> tuple[float, NDArray[np.float64]]:
    """Visibility, m, uniform in the configured limits, and airlight (3,) in 0..255."""
    low, high = config.visibility_m
    visibility = high if low == high or np.isinf(high) else float(rng.uniform(low, high))
    horizon = np.array(weather.horizon_rgb)
    if config.preset == "train":
        return visibility, random_airlight((horizon * sensor.gain) ** (1 / DISPLAY_GAMMA), rng)
    light = horizon.astype(np.float32).reshape(1, 1, 3)
    return visibility, horizon_airlight(develop(light, sensor)[0, 0].astype(np.float64), rng)


def truth_segments(layout: Layout) -> tuple[Segment, Segment]:
    """Middle of the left and of the right edge marking in the world, ramp end first."""
    left, right = world_points(layout, layout.left_m), world_points(layout, layout.right_m)
    return Segment(left[0], left[1]), Segment(right[0], right[1])
