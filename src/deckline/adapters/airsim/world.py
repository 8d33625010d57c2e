"""The simulated world behind the server: a ship in its weather, one vehicle, its cameras.

What clients set is one frozen `State`, replaced whole, so that a picture sees one instant of it. Pictures are taken on
the one thread that made the world, which owns OpenGL; everything else may be asked from anywhere.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.clock import Clock
from deckline.adapters.airsim.daytime import Daytime, light_at
from deckline.adapters.airsim.settings import SEGMENTATION, Settings
from deckline.adapters.airsim.structs import MOUNT_FROM_OPTICAL
from deckline.geometry import Camera
from deckline.sim.camera.depth_camera import measure_depth
from deckline.sim.camera.lens import random_lens
from deckline.sim.config import SimConfig
from deckline.sim.flight.motion import ship_pose
from deckline.sim.flight.trajectory import approach_view
from deckline.sim.flight.viewpoint import Viewpoint
from deckline.sim.scene.weather import Weather, random_weather
from deckline.sim.simulate import FLIGHT, FRAME, Scenery, Simulator, draw_visibility
from deckline.types import Frame

FOG_VISIBILITY_M = 50.0  # visibility at 2 % contrast that Fog 1 makes of clear air: dense fog, SPEC section 6
# Segmentation's colours by `Label`: sky, water or ground, deck, the rest of the ship, other ships and coast.
LABEL_RGB = np.array([[0, 0, 0], [0, 90, 200], [220, 60, 40], [240, 200, 40], [60, 170, 80]], dtype=np.uint8)
RAIN_MM_H = 50.0  # of Rain 1: violent rain begins there (Met Office)


@dataclass(frozen=True, eq=False)
class State:
    """What clients set."""

    world_from_body: RigidTransform
    mounts: Mapping[str, RigidTransform] = field(default_factory=dict)  # body_from_mount, where it was set
    fovs_deg: Mapping[str, float] = field(default_factory=dict)  # horizontal, where it was set
    weather: bool = False  # whether the next three count
    fog: float = 0.0  # 0..1
    rain: float = 0.0
    wet: float = 0.0
    daytime: Daytime | None = None
    api_control: bool = False


class World:
    """Make it, take its pictures and close it on one thread.

    Args:
        config: ship, seed, weather, air and camera, as for a recorded approach, whose first frame is where the vehicle
            starts.
        settings: vehicle and cameras.
        clock: the simulated time.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
    """

    def __init__(self, config: SimConfig, settings: Settings, clock: Clock) -> None:
        self.config, self.settings, self.clock = config, settings, clock
        self._simulator = Simulator(config)
        self._simulator.load(0)
        self._sun = self._simulator.renderer.sun
        self._time_of_day = self._simulator.weather.time_of_day
        self._drawn = 0  # pictures so far
        start = approach_view(config, self._simulator.ship.layout, 0, config.flight, self._simulator.motion)
        self._start = State(start.world_from_body)
        self.state = self._start

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._simulator.__exit__(kind, error, trace)

    def reset(self) -> None:
        """As it was at the beginning, but for the time."""
        self.state = self._start

    def mount(self, name: str, state: State | None = None) -> RigidTransform:
        """body_from_mount of a camera, by its own name."""
        set_mounts = (state or self.state).mounts
        return set_mounts[name] if name in set_mounts else self.settings.cameras[name].mount

    def camera(self, name: str, image_type: int, state: State | None = None) -> Camera:
        """The pinhole behind a camera's pictures of a type."""
        capture = self.settings.cameras[name].capture(image_type)
        fov_deg = (state or self.state).fovs_deg.get(name, capture.fov_deg)
        return Camera.from_fov(capture.width, capture.height, math.radians(fov_deg))

    def ship_pose(self) -> RigidTransform:
        """world_from_ship now."""
        return self._ship_at(self.clock.seconds())

    def picture(self, name: str, image_type: int, state: State, time_s: float) -> Frame:
        """What a camera sees in a state of the world; only on the world's own thread.

        Raises:
            ValueError: a camera that is not above the sea.
        """
        view, weather, for_air, for_picture = self._view(name, image_type, state, time_s)
        scenery = self._scenery(state, weather, draw_visibility(self.config.visibility_m, for_air))
        return self._simulator.picture(view, scenery, for_picture, self._for_noise(), f"{name} {image_type}")

    def depth(self, name: str, image_type: int, state: State, time_s: float) -> NDArray[np.float32]:
        """The depth (H, W) of `picture`, m along the axis, NaN where nothing is seen, without drawing the picture.

        Only where no lens bends it (`bends`), which takes a whole picture.

        Raises:
            ValueError: a camera that is not above the sea.
        """
        view, weather, _, _ = self._view(name, image_type, state, time_s)
        true_m = self._simulator.renderer.depth(
            view.camera, view.world_from_camera, weather, time_s, world_from_ship=self._ship_at(time_s)
        )
        return measure_depth(true_m, self.config.depth, self._for_noise())

    def segmentation(self, name: str, state: State, time_s: float) -> NDArray[np.uint8]:
        """What a camera's pixels (H, W, 3) show, in the colours of `LABEL_RGB`; lenses do not bend it.

        Raises:
            ValueError: a camera that is not above the sea.
        """
        view, weather, _, _ = self._view(name, SEGMENTATION, state, time_s)
        camera = self.camera(name, SEGMENTATION, state)
        labels = self._simulator.renderer.labels(
            camera, view.world_from_camera, weather, time_s, world_from_ship=self._ship_at(time_s)
        )
        return LABEL_RGB[labels]

    def _view(
        self, name: str, image_type: int, state: State, time_s: float
    ) -> tuple[Viewpoint, Weather, np.random.Generator, np.random.Generator]:
        """Where a camera is, the weather there, and what draws the air and the camera's picture."""
        self._light(state, time_s)
        for_weather, for_lens, for_air, for_picture, _ = np.random.default_rng([self.config.seed, FLIGHT]).spawn(5)
        wide = self.config.preset == "train"
        weather = random_weather(for_weather, not wide, self._simulator.weather, sun=self._simulator.renderer.sun)
        camera = random_lens(self.config.lens, self.camera(name, image_type, state), for_lens, wide=wide)
        body_from_camera = self.mount(name, state) * MOUNT_FROM_OPTICAL
        view = Viewpoint(state.world_from_body, camera, time_s, body_from_camera=body_from_camera)
        return view, weather, for_air, for_picture

    @property
    def bends(self) -> bool:
        """Whether the cameras' lenses bend what they see."""
        for_lens = np.random.default_rng([self.config.seed, FLIGHT]).spawn(5)[1]
        pinhole = Camera.from_fov(self.config.width, self.config.height, math.radians(self.config.fov_deg))
        return random_lens(self.config.lens, pinhole, for_lens, wide=self.config.preset == "train").has_distortion

    def _for_noise(self) -> np.random.Generator:
        """What draws that which every picture has of its own."""
        self._drawn += 1
        return np.random.default_rng([self.config.seed, FRAME, self._drawn])

    def _ship_at(self, time_s: float) -> RigidTransform:
        return ship_pose(self._simulator.ship.layout, self._simulator.motion, time_s)

    def _scenery(self, state: State, weather: Weather, clear_m: float) -> Scenery:
        imaging = self.config.imaging
        if state.weather and state.rain > 0.0:
            imaging = replace(imaging, film=replace(imaging.film, rain_mm_h=RAIN_MM_H * state.rain))
        if state.weather and state.wet > 0.0:
            weather = replace(weather, wet=state.wet)
        fog = state.fog if state.weather else 0.0
        return Scenery(weather, foggy_visibility(clear_m, fog), imaging)

    def _light(self, state: State, time_s: float) -> None:
        """Put the sun where the time of day has it."""
        simulator = self._simulator
        time, sun = self._time_of_day, self._sun
        if state.daytime is not None:
            time, sun = light_at(state.daytime.at(time_s), self.settings.origin[0])
        if not np.array_equal(sun, simulator.renderer.sun):
            simulator.renderer.load(simulator.ship, sun)
        simulator.weather = replace(simulator.weather, time_of_day=time)


def foggy_visibility(clear_m: float, fog: float) -> float:
    """Visibility, m at 2 % contrast, with AirSim's Fog 0..1 in air of another: extinctions add up.

    1 / V = 1 / V_clear + fog / 50 m, so that Fog 0.1 makes 500 m of clear air.
    Source: Koschmieder's law; the 50 m are our choice.
    """
    thinness = 1.0 / clear_m + fog / FOG_VISIBILITY_M
    return 1.0 / thinness if thinness > 0.0 else math.inf
