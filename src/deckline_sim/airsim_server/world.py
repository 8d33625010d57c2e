"""The simulated world behind the server: a ship in its weather, one vehicle, its cameras.

Clients replace the frozen `WorldState` as a whole, so that a picture shows one instant of it and of the vehicle's pose.
Only the thread that made the world owns OpenGL and draws; any thread may read the rest.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera, camera_mount
from deckline.types import Frame
from deckline_sim.airsim_server.kinematics import Ground
from deckline_sim.airsim_server.settings import SEGMENTATION, AirSimSettings
from deckline_sim.airsim_server.sim_clock import SimClock, SolarClock, light_at
from deckline_sim.airsim_server.surface_normals import draw_normals, surface_normals
from deckline_sim.airsim_server.vehicle import Vehicle
from deckline_sim.camera.lens import random_lens
from deckline_sim.camera.measure import measure_depth
from deckline_sim.config import SimConfig
from deckline_sim.flight.approach import approach_view
from deckline_sim.flight.viewpoints import Viewpoint, ship_pose, steady_velocity
from deckline_sim.scene.view import RenderQuality, RenderScene
from deckline_sim.scene.weather import Weather, random_weather
from deckline_sim.ship.layout import edge_distance
from deckline_sim.simulate import FLIGHT, FRAME, Scenery, ShipSimulator
from deckline_sim.visibility import draw_visibility

FOG_VISIBILITY_M = 50.0  # visibility at 2 % contrast that Fog 1 makes of clear air: dense fog
RAIN_MM_H = 50.0  # of Rain 1: violent rain begins there (Met Office)
CLEAR_M = 30.0  # a point so far above the steady deck, or off the ship's end, is clear of the swinging deck
LOW_M = 10.0  # over the deck; from lower, smooth edges can take a software renderer minutes
RAY_RAD, RAY_PX = 1e-3, 3  # the view of a distance sensor, whose middle pixel is read


@dataclass(frozen=True, eq=False)
class WorldState:
    """The values that clients set, and the vehicle's pose at an instant."""

    world_from_body: RigidTransform
    mounts: Mapping[str, RigidTransform] = field(default_factory=dict)  # body_from_mount, of moved cameras
    fovs_deg: Mapping[str, float] = field(default_factory=dict)  # horizontal, likewise
    distance_mounts: Mapping[str, RigidTransform] = field(default_factory=dict)  # body_from_mount, likewise
    weather: bool = False  # whether fog, rain and wetness have an effect
    fog: float = 0.0  # 0..1
    rain: float = 0.0
    wet: float = 0.0
    solar_clock: SolarClock | None = None
    api_control: bool = False
    armed: bool = False
    object_ids: Mapping[str, int] = field(default_factory=dict)  # for segmentation, of objects that were given one
    filters: Mapping[tuple[str, int], Any] = field(default_factory=dict)  # of detections, by camera and image type


class World:
    """The simulated world. One thread creates it, takes its pictures and closes it.

    The vehicle starts at the first frame of a recorded approach of this config.

    Raises:
        RendererError: no OpenGL through EGL.
    """

    def __init__(self, config: SimConfig, settings: AirSimSettings, clock: SimClock) -> None:
        self.config, self.settings, self.clock = config, settings, clock
        self._simulator = ShipSimulator(config)
        self._simulator.load(0)
        self._sun = self._simulator.renderer.sun
        self._time_of_day = self._simulator.weather.time_of_day
        self._drawn = 0  # pictures so far
        self.layout = self._simulator.ship.layout  # of the ship at rest
        start = settings.start
        if start is None:
            start = approach_view(config, self.layout, 0, self._simulator.motion).world_from_body
        self._start = self._state = WorldState(start)
        self.vehicle = Vehicle(start, clock, self.ground, self.ship_pose)

    def close(self) -> None:
        """Free the renderer; only on the world's own thread."""
        self._simulator.close()

    def reset(self) -> None:
        """Restore the first state; the time continues."""
        self._state = self._start
        self.vehicle.reset()

    @property
    def home_m(self) -> NDArray[np.float64]:
        """The vehicle's start (3,), world NED: AirSim's home."""
        return np.array(self._start.world_from_body.translation)

    @property
    def state(self) -> WorldState:
        """The state now."""
        return self.snapshot()[0]

    def snapshot(self) -> tuple[WorldState, float]:
        """The state now, and the simulated time, s."""
        motion = self.vehicle.read()
        return replace(self._state, world_from_body=motion.pose), motion.time_s

    def change(self, **values: Any) -> None:
        """Set parts of the state; only on one thread."""
        self._state = replace(self._state, **values)

    def mount(self, name: str, state: WorldState | None = None) -> RigidTransform:
        """body_from_mount of a camera, by its own name."""
        return (state or self.state).mounts.get(name, self.settings.cameras[name].mount)

    def distance_mount(self, name: str) -> RigidTransform:
        """body_from_mount of a distance sensor."""
        return self.state.distance_mounts.get(name, self.settings.distances[name].mount)

    def camera(self, name: str, image_type: int, state: WorldState | None = None) -> Camera:
        """The pinhole behind a camera's pictures of a type."""
        capture = self.settings.cameras[name].capture(image_type)
        fov_deg = (state or self.state).fovs_deg.get(name, capture.fov_deg)
        return Camera.from_fov(capture.width, capture.height, math.radians(fov_deg))

    def ship_pose(self, time_s: float | None = None) -> RigidTransform:
        """world_from_ship at a simulated time; None: now."""
        time_s = self.clock.seconds() if time_s is None else time_s
        motion = self._simulator.motion
        still = not any((motion.speed_m_s, motion.roll_rad, motion.pitch_rad, motion.heave_m))
        return self.layout.world_from_ship if still else ship_pose(self.layout, motion, time_s)

    def ground(self, position_m: NDArray[np.float64], time_s: float) -> Ground:
        """What lies below a point (3,): the deck, also of a point inside the hull, or water or ground."""
        layout = self.layout
        above_sea_m = float(layout.sea_z_m - position_m[2])
        stern_m = layout.world_from_ship.translation + time_s * steady_velocity(layout, self._simulator.motion)
        away_m = math.hypot(*(position_m - stern_m)[:2])
        if above_sea_m < layout.deck_height_m + CLEAR_M and away_m < layout.length_m + CLEAR_M:
            x, y, z = self.ship_pose(time_s).inv().apply(position_m)
            if edge_distance(layout, np.array([x, y])) > 0.0:
                return Ground("Deck", -float(z))
        return Ground("Ground" if layout.on_land else "Sea", above_sea_m)

    def outline(self, name: str) -> NDArray[np.float64]:
        """Points (N, 3) in the ship frame that bound the deck, or the whole ship."""
        if name == "Deck":
            return np.pad(self.layout.outline_m, ((0, 0), (0, 1)))
        points = self._simulator.ship.solids[:, :3].astype(np.float64)
        return np.array(list(product(*zip(points.min(axis=0), points.max(axis=0), strict=True))))

    def distance(self, world_from_mount: RigidTransform, time_s: float) -> float:
        """Distance along a mount's x axis to the first surface, m; NaN: none. Only on the world's own thread."""
        _, weather, _, _ = self._view(next(iter(self.settings.cameras)), SEGMENTATION, self.state, time_s)
        camera = Camera.from_fov(RAY_PX, RAY_PX, RAY_RAD)
        scene = RenderScene(
            camera, world_from_mount * camera_mount(), weather, time_s, world_from_ship=self.ship_pose(time_s)
        )
        return float(self._simulator.renderer.depth(scene)[RAY_PX // 2, RAY_PX // 2])

    def picture(self, name: str, image_type: int, state: WorldState, time_s: float) -> Frame:
        """A camera's picture; only on the world's own thread. A camera that is not above the sea is a ValueError."""
        view, weather, air_rng, picture_rng = self._view(name, image_type, state, time_s)
        scenery = self._scenery(state, weather, draw_visibility(self.config.visibility_m, air_rng))
        below = self.ground(view.world_from_camera.translation, time_s)
        if below.name == "Deck" and below.height_m < LOW_M:
            scenery = replace(scenery, quality=RenderQuality(samples=1))
        return self._simulator.picture(view, scenery, picture_rng, self._noise_rng(), f"{name} {image_type}")

    def depth(
        self, name: str, image_type: int, state: WorldState, time_s: float
    ) -> tuple[Camera, NDArray[np.float32] | None]:
        """Camera with its lens, and depth (H, W) of `picture`, m along the axis, NaN where nothing is seen.

        Only a lens with distortion makes it draw the picture. Errors as `picture`.
        """
        view, weather, _, _ = self._view(name, image_type, state, time_s)
        if view.camera.has_distortion:
            return view.camera, self.picture(name, image_type, state, time_s).depth_m
        pose, ship = view.world_from_camera, self.ship_pose(time_s)
        true_m = self._simulator.renderer.depth(RenderScene(view.camera, pose, weather, time_s, world_from_ship=ship))
        return view.camera, measure_depth(true_m, self.config.depth, self._noise_rng())

    def labels(self, name: str, image_type: int, state: WorldState, time_s: float) -> NDArray[np.uint8]:
        """What a camera's pixels (H, W) show, as `Label`, without distortion; errors as `picture`."""
        return self._simulator.renderer.labels(self._pinhole(name, image_type, state, time_s))

    def normals(self, name: str, image_type: int, state: WorldState, time_s: float) -> NDArray[np.uint8]:
        """AirSim's picture (H, W, 3) of a camera's surface normals, without distortion; errors as `picture`."""
        scene = self._pinhole(name, image_type, state, time_s)
        normals = surface_normals(self._simulator.renderer.depth(scene), scene.camera)
        return draw_normals(normals, scene.world_from_camera.rotation)

    def _pinhole(self, name: str, image_type: int, state: WorldState, time_s: float) -> RenderScene:
        view, weather, _, _ = self._view(name, image_type, state, time_s)
        camera, ship = self.camera(name, image_type, state), self.ship_pose(time_s)
        return RenderScene(camera, view.world_from_camera, weather, time_s, world_from_ship=ship)

    def _view(
        self, name: str, image_type: int, state: WorldState, time_s: float
    ) -> tuple[Viewpoint, Weather, np.random.Generator, np.random.Generator]:
        """Where a camera is, the weather there, and the randomness of the air and of the camera's picture."""
        self._set_light(state, time_s)
        weather_rng, lens_rng, air_rng, picture_rng, _ = np.random.default_rng([self.config.seed, FLIGHT]).spawn(5)
        wide = self.config.preset == "train"
        weather = random_weather(weather_rng, not wide, self._simulator.weather, sun=self._simulator.renderer.sun)
        camera = random_lens(self.config.lens, self.camera(name, image_type, state), lens_rng, wide=wide)
        body_from_camera = self.mount(name, state) * camera_mount()
        view = Viewpoint(state.world_from_body, camera, time_s, body_from_camera=body_from_camera)
        return view, weather, air_rng, picture_rng

    def _noise_rng(self) -> np.random.Generator:
        self._drawn += 1
        return np.random.default_rng([self.config.seed, FRAME, self._drawn])

    def _scenery(self, state: WorldState, weather: Weather, clear_m: float) -> Scenery:
        imaging = self.config.imaging
        if state.weather and state.rain > 0.0:
            imaging = replace(imaging, exposure=replace(imaging.exposure, rain_mm_h=RAIN_MM_H * state.rain))
        if state.weather and state.wet > 0.0:
            weather = replace(weather, wet=state.wet)
        fog = state.fog if state.weather else 0.0
        return Scenery(weather, foggy_visibility(clear_m, fog), imaging)

    def _set_light(self, state: WorldState, time_s: float) -> None:
        """Set the sun's direction and the time of day."""
        simulator = self._simulator
        time, sun = self._time_of_day, self._sun
        if state.solar_clock is not None:
            time, sun = light_at(state.solar_clock.at(time_s), self.settings.origin[0])
        if not np.array_equal(sun, simulator.renderer.sun):
            simulator.renderer.load(simulator.ship, sun)
        simulator.weather = replace(simulator.weather, time_of_day=time)


def foggy_visibility(clear_m: float, fog: float) -> float:
    """Visibility, m at 2 % contrast, of air of visibility `clear_m` with AirSim's Fog 0..1: extinctions add up.

    1 / V = 1 / V_clear + fog / 50 m, so that Fog 0.1 makes 500 m of clear air.
    Source: Koschmieder's law; the 50 m are our choice.
    """
    extinction = 1.0 / clear_m + fog / FOG_VISIBILITY_M  # times the visibility of 1 m
    return 1.0 / extinction if extinction > 0.0 else math.inf
