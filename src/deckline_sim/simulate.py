"""Frames of a simulated recording: the same configuration and index always give the same frame."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from deckline.haze import triple
from deckline.types import Frame, Truth
from deckline_sim.camera.foreground import add_foreground
from deckline_sim.camera.imaging import Imaging, Shot, Surroundings
from deckline_sim.camera.lens import pinhole_for, random_lens
from deckline_sim.camera.measure import measure_pose
from deckline_sim.config import DRAWN, ImagingConfig, SimConfig, WeatherConfig
from deckline_sim.flight.approach import approach_view
from deckline_sim.flight.viewpoints import (
    ShipMotion,
    Viewpoint,
    away_view,
    draw_motion,
    from_any_side,
    glide_view,
    random_view,
    ship_pose,
    ship_velocity,
    view_towards,
)
from deckline_sim.scene.render import Renderer
from deckline_sim.scene.view import BEST, RenderQuality, RenderScene, random_quality
from deckline_sim.scene.weather import Weather, random_time_of_day, random_weather, sun_direction
from deckline_sim.ship.background import BackgroundKind, background_mesh
from deckline_sim.ship.layout import Layout, random_layout, truth_segments
from deckline_sim.ship.mesh import join
from deckline_sim.ship.ship import NO_RUNWAY, Ship, build_ship
from deckline_sim.visibility import draw_visibility

if TYPE_CHECKING:
    from deckline_sim.airfield.simulator import AirfieldSimulator

OPEN_SEA = 0.4  # part of the views without a runway that show no ship either
VEHICLE, CAMERA = "deckline", "front"
# Random streams: of a ship, of a frame, of a whole flight, of sun and weather with a seed, of views without a runway,
# of a picture of a flown path.
SHIP, FRAME, FLIGHT, SUN, WEATHER, DECKLESS, FLOWN = 2, 3, 4, 5, 6, 7, 8
OPEN, SHIPS, COAST, PAST, BARE = "open", "ships", "coast", "past", "bare"
CYCLE = (OPEN, SHIPS, COAST, PAST, BARE)  # one view without a runway of each in turn
RANGE_M = {SHIPS: (120.0, 2000.0), COAST: (300.0, 4000.0)}  # of the camera from its target
SEEN_SHARE = 0.5  # of the visibility: the farthest target, so that haze does not hide it
CANDIDATES = 400  # random ships searched for one without a runway; one in eight has none


@dataclass(frozen=True, eq=False)
class Scenery:
    """Weather, air, camera settings and quality of a picture."""

    weather: Weather
    visibility_m: float  # 2 % contrast; infinite is clear air
    imaging: ImagingConfig
    quality: RenderQuality = BEST
    with_ship: bool = True


class ShipSimulator:
    """Renders single frames of a recording in any order; holds the OpenGL context and the ship last used.

    Args:
        config: the recording.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
    """

    def __init__(self, config: SimConfig) -> None:
        self.config = config
        self.renderer = Renderer()
        self.imaging = Imaging(self.renderer.context)
        self.loaded = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the OpenGL context."""
        self.renderer.close()

    def frame(self, index: int) -> Frame:
        """Frame `index`: the same whatever was rendered before."""
        block = ship_block(self.config, index)
        if block != self.loaded:
            self.load(block)
        config, layout = self.config, self.ship.layout
        unrelated = config.trajectory == "random"
        own = np.random.default_rng([config.seed, FRAME, index])
        shared = (own if unrelated else np.random.default_rng([config.seed, FLIGHT])).spawn(5)  # one a flight
        for_view, for_noise, for_sea = own.spawn(3)
        if unrelated:
            view = random_view(config, layout, index, for_view, self.motion)
        else:
            view = approach_view(config, layout, index, self.motion)
        name = f"img_{VEHICLE}_{CAMERA}_0_{round(view.time_s * 1e9) + index}.png"
        with_ship = self.ship.runway or bool(for_sea.random() >= OPEN_SEA)
        return add_foreground(self._take(view, shared, for_noise, with_ship, name), config, index)

    def flown_frame(self, view: Viewpoint, name: str) -> Frame:
        """The picture of a view of one flight, whatever path it flies, with the weather and air of `frame`.

        Args:
            view: pose, camera, time and motion.
            name: of the frame's file.
        """
        if self.loaded != 0:
            self.load(0)
        shared = np.random.default_rng([self.config.seed, FLIGHT]).spawn(5)
        for_noise = np.random.default_rng([self.config.seed, FLOWN, round(view.time_s * 1e6)])
        return self._take(view, shared, for_noise, True, name)

    def _take(
        self,
        view: Viewpoint,
        shared: list[np.random.Generator],
        noise: np.random.Generator,
        with_ship: bool,
        name: str,
        visibility_m: float | None = None,
    ) -> Frame:
        """The picture of a view; `shared`: draws what a flight's frames share, `noise`: what each has of its own.

        Args:
            visibility_m: None: it is drawn.
        """
        config, train = self.config, self.config.preset == "train"
        for_weather, for_lens, for_air, for_picture, for_quality = shared
        if config.weather.seed is not None:
            for_weather = np.random.default_rng([config.weather.seed, WEATHER])
        weather = random_weather(for_weather, not train, self.weather, sun=self.renderer.sun)
        camera = random_lens(config.lens, view.camera, for_lens, wide=train)
        scenery = Scenery(
            weather,
            draw_visibility(config.visibility_m, for_air) if visibility_m is None else visibility_m,
            config.imaging,
            quality=random_quality(for_quality) if train else BEST,
            with_ship=with_ship,
        )
        return self.picture(replace(view, camera=camera), scenery, for_picture, noise, name)

    def load(self, block: int) -> None:
        """Build the ship of a block of frames, its motion and its sun, and load it into the renderer."""
        config, train = self.config, self.config.preset == "train"
        for_ship, for_sun, for_motion = np.random.default_rng([config.seed, SHIP, block]).spawn(3)
        self.ship: Ship = build_ship(config.preset, for_ship)
        if config.weather.seed is not None:
            for_sun = np.random.default_rng([config.weather.seed, SUN])
        time = config.weather.time_of_day or random_time_of_day(for_sun, fair=not train)
        sea, swell = config.weather.sea_state, config.motion.sea_state  # one that is not given follows the other
        sea_state = round(swell) if sea is None and swell is not None else sea
        self.weather: WeatherConfig = replace(config.weather, time_of_day=time, sea_state=sea_state)
        swell = sea if swell is None else swell
        self.motion: ShipMotion = draw_motion(replace(config.motion, sea_state=swell), train, for_motion)
        self.renderer.load(self.ship, sun_direction(for_sun, time))
        self.loaded = block

    def picture(
        self, view: Viewpoint, scenery: Scenery, recording: np.random.Generator, frame: np.random.Generator, name: str
    ) -> Frame:
        """The picture of a view, its camera's lens included, of the ship as it lies at the view's time.

        Args:
            recording: draws the values that a recording's frames share: the air and the sensor's settings.
            frame: draws the values of one frame: shake, noise.
            name: of the frame's file.

        Raises:
            ValueError: a camera that is not above the sea.
        """
        config, ship, weather, camera = self.config, self.ship, scenery.weather, view.camera
        layout = ship.layout.at_pose(ship_pose(ship.layout, self.motion, view.time_s))
        pose, how = view.world_from_camera, (scenery.with_ship, scenery.quality, layout.world_from_ship)
        shot = self.imaging.take(
            self.renderer.render(RenderScene(pinhole_for(camera), pose, weather, view.time_s, *how)),
            camera,
            pose,
            self._surroundings(view, scenery),
            scenery.imaging,
            recording,
            frame,
            wide=config.preset == "train",
            keep_clear=config.keep_clear and np.isfinite(scenery.visibility_m),
        )
        return Frame(
            file=name,
            time_s=view.time_s,
            image_rgb=shot.image_rgb,
            camera=camera,
            body_from_camera=view.body_from_camera,
            depth_m=shot.depth_m,
            world_from_body=measure_pose(view.world_from_body, view.time_s, config.navigation, config.seed),
            deck_z_m=float(ship.layout.world_from_ship.translation[2]),
            sea_z_m=float(layout.sea_z_m),
            truth=self._truth(shot, layout, view, weather),
        )

    def _surroundings(self, view: Viewpoint, scenery: Scenery) -> Surroundings:
        layout, weather = self.ship.layout, scenery.weather
        over_deck = view.velocity_m_s - ship_velocity(layout, self.motion, view.time_s)
        return Surroundings(
            horizon=weather.horizon_rgb,
            sun=weather.sun,
            sea_z_m=layout.sea_z_m,
            visibility_m=scenery.visibility_m,
            velocity_m_s=triple(over_deck),
            turning_rad_s=triple(view.world_from_body.rotation.apply(view.angular_rate_rad_s)),
        )

    def _truth(self, shot: Shot, layout: Layout, view: Viewpoint, weather: Weather) -> Truth:
        """The truth of a picture; `layout`: the ship at the picture's time."""
        left, right = truth_segments(layout) if self.ship.runway else (None, None)
        return Truth(
            left,
            right,
            centre_painted=self.ship.runway and self.ship.centre,
            visibility_m=shot.visibility_m,
            airlight_rgb=shot.airlight_rgb,
            clear_rgb=shot.clear_rgb,
            world_from_body=None if self.config.navigation.exact else view.world_from_body,
            world_from_ship=layout.world_from_ship,
            conditions=shot.records | {"weather": asdict(weather), "motion": asdict(self.motion)},
        )


class DecklessSimulator(ShipSimulator):
    """Frames of trajectory `deckless`; a ship, its sea and its light are drawn anew for every one."""

    def frame(self, index: int) -> Frame:
        """Frame `index`; its truth's conditions hold what it shows as "deckless"."""
        kind = CYCLE[index % len(CYCLE)]
        rng = np.random.default_rng([self.config.seed, DECKLESS, index])
        for_things, for_view, for_weather, for_lens, for_air, for_picture, for_noise, for_quality = rng.spawn(8)
        shared = [for_weather, for_lens, for_air, for_picture, for_quality]
        self.load(self._bare_ship(index) if kind == BARE else index)
        if kind in (OPEN, SHIPS, COAST):
            self._hide_ship(kind, for_things)
        visibility_m = draw_visibility(self.config.visibility_m, for_air)
        view = replace(self._deckless_view(kind, visibility_m, for_view), time_s=float(index))
        frame = self._take(view, shared, for_noise, kind in (PAST, BARE), f"deckless_{index}.png", visibility_m)
        if frame.truth is None:
            raise AssertionError("unreachable: the simulator knows the truth of its frames")
        conditions = {**frame.truth.conditions, "deckless": self._describe_kind(kind)}
        known = replace(frame, truth=replace(frame.truth, conditions=conditions))
        return add_foreground(known, self.config, index)

    def _bare_ship(self, index: int) -> int:
        """Number of a random ship that has no runway: its own draw is repeated, which is quicker than building it."""
        for block in range(index * CANDIDATES, (index + 1) * CANDIDATES):
            for_layout = np.random.default_rng([self.config.seed, SHIP, block]).spawn(3)[0].spawn(5)[0]
            if not random_layout(for_layout).on_land and for_layout.random() < NO_RUNWAY:
                return block
        raise AssertionError("unreachable: one random ship in eight has no runway")

    def _hide_ship(self, kind: str, rng: np.random.Generator) -> None:
        things: BackgroundKind = "ships" if kind == SHIPS else "coast"
        mesh = join([]) if kind == OPEN else background_mesh(self.ship.layout, rng, things)
        self.ship = replace(self.ship, runway=False, background=mesh)
        self.renderer.load(self.ship, self.renderer.sun)

    def _deckless_view(self, kind: str, visibility_m: float, rng: np.random.Generator) -> Viewpoint:
        config, layout, things = self.config, self.ship.layout, self.ship.background
        if kind in RANGE_M and len(things):
            low, high = np.minimum(RANGE_M[kind], SEEN_SHARE * visibility_m)
            target = things[rng.integers(len(things)), :3].astype(np.float64)
            return view_towards(config, target, float(np.exp(rng.uniform(np.log(low), np.log(high)))), rng)
        if kind == PAST and self.ship.runway:
            return away_view(config, layout, rng)
        if kind == BARE:
            return glide_view(config, layout, rng)
        return from_any_side(config, layout, rng, float(rng.uniform(-180.0, 180.0)))

    def _describe_kind(self, kind: str) -> str:
        on_land = self.ship.layout.on_land
        if kind == BARE:
            return "bare deck"
        if kind == PAST:
            return "past a runway" if on_land else "past a ship"
        if kind == OPEN or not len(self.ship.background):
            return "open land" if on_land else "open sea"
        return "other ships" if kind == SHIPS else "coast"


def open_simulator(config: SimConfig) -> "ShipSimulator | AirfieldSimulator":
    """The simulator of a recording.

    Raises:
        RendererError: no OpenGL through EGL on this machine; presets `airfield` and `pad` need none.
    """
    if config.preset in DRAWN:
        from deckline_sim.airfield.simulator import AirfieldSimulator

        return AirfieldSimulator(config)
    return DecklessSimulator(config) if config.trajectory == "deckless" else ShipSimulator(config)


def frames(config: SimConfig, start: int = 0) -> Iterator[Frame]:
    """Frames `start`, `start + 1`, ... of a recording.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
        ValueError: a negative start.
    """
    if start < 0:
        raise ValueError(f"start must not be negative, got {start}")
    with open_simulator(config) as simulator:
        for index in range(start, config.frames):
            yield simulator.frame(index)


def ship_block(config: SimConfig, index: int) -> int:
    """Which ship a frame shows: an approach has one, random views share one by `frames_per_ship`."""
    if config.trajectory == "deckless":
        return index
    return index // config.frames_per_ship if config.trajectory == "random" else 0
