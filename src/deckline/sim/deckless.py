"""Rendered views in which there is no runway to find: open sea and land, other ships, coasts, bare decks."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import Camera
from deckline.sim.camera.lens import random_lens
from deckline.sim.config import SimConfig
from deckline.sim.flight.random_views import away_view, draw_fov, from_any_side, glide_view
from deckline.sim.flight.viewpoint import Viewpoint, looking
from deckline.sim.scene.quality import random_quality
from deckline.sim.scene.weather import random_weather
from deckline.sim.ship.background import Kind, background_mesh
from deckline.sim.ship.layout import random_layout
from deckline.sim.ship.mesh import join
from deckline.sim.ship.ship import NO_RUNWAY
from deckline.sim.simulate import SHIP, Scenery, Simulator, draw_visibility
from deckline.types import Frame

OPEN, SHIPS, COAST, PAST, BARE = "open", "ships", "coast", "past", "bare"
CYCLE = (OPEN, SHIPS, COAST, PAST, BARE)  # one frame of each in turn
STREAM = 7  # of random numbers, apart from the simulator's own
RANGE_M = {SHIPS: (120.0, 2000.0), COAST: (300.0, 4000.0)}  # of the camera from what it looks at
SEEN_SHARE = 0.5  # of the visibility: nothing that is looked at lies farther, or it would be hidden
ELEVATION_DEG = (2.0, 8.0)  # of the camera over what it looks at, as on a glide path
NUDGE_DEG = (4.0, 3.0, 6.0)  # 1-sigma of roll, pitch and yaw about that direction
CANDIDATES = 400  # ships that are looked through for one without a runway; one in eight has none


class DecklessSimulator(Simulator):
    """Frames of trajectory `deckless`; a ship, its sea and its light are drawn anew for every one."""

    def frame(self, index: int) -> Frame:
        """Frame `index`; its truth's conditions say under "deckless" what it shows."""
        kind = CYCLE[index % len(CYCLE)]
        rng = np.random.default_rng([self.config.seed, STREAM, index])
        for_things, for_view, for_weather, for_lens, for_air, for_picture, for_noise, for_quality = rng.spawn(8)
        self.load(self._bare_ship(index) if kind == BARE else index)
        if kind in (OPEN, SHIPS, COAST):
            self._hide_ship(kind, for_things)
        visibility_m = draw_visibility(self.config.visibility_m, for_air)
        view = replace(self._viewpoint(kind, visibility_m, for_view), time_s=float(index))
        scenery = Scenery(
            random_weather(for_weather, False, self.weather, sun=self.renderer.sun),
            visibility_m,
            self.config.imaging,
            random_quality(for_quality),
            with_ship=kind in (PAST, BARE),
        )
        camera = random_lens(self.config.lens, view.camera, for_lens, wide=True)
        frame = self.picture(replace(view, camera=camera), scenery, for_picture, for_noise, f"deckless_{index}.png")
        if frame.truth is None:
            raise AssertionError("unreachable: the simulator knows the truth of its frames")
        conditions = {**frame.truth.conditions, "deckless": self._words(kind)}
        return replace(frame, truth=replace(frame.truth, conditions=conditions))

    def _bare_ship(self, index: int) -> int:
        """Number of a random ship that has no runway: its own draw is repeated, which is quicker than building it."""
        for block in range(index * CANDIDATES, (index + 1) * CANDIDATES):
            for_layout = np.random.default_rng([self.config.seed, SHIP, block]).spawn(3)[0].spawn(5)[0]
            if not random_layout(for_layout).on_land and for_layout.random() < NO_RUNWAY:
                return block
        raise AssertionError("unreachable: one random ship in eight has no runway")

    def _hide_ship(self, kind: str, rng: np.random.Generator) -> None:
        things: Kind = "ships" if kind == SHIPS else "coast"
        mesh = join([]) if kind == OPEN else background_mesh(self.ship.layout, rng, things)
        self.ship = replace(self.ship, runway=False, background=mesh)
        self.renderer.load(self.ship, self.renderer.sun)

    def _viewpoint(self, kind: str, visibility_m: float, rng: np.random.Generator) -> Viewpoint:
        config, layout, things = self.config, self.ship.layout, self.ship.background
        if kind in RANGE_M and len(things):
            low, high = np.minimum(RANGE_M[kind], SEEN_SHARE * visibility_m)
            target = things[rng.integers(len(things)), :3].astype(np.float64)
            return _looking_at(config, target, float(np.exp(rng.uniform(np.log(low), np.log(high)))), rng)
        if kind == PAST and self.ship.runway:
            return away_view(config, layout, rng)
        if kind == BARE:
            return glide_view(config, layout, rng)
        return from_any_side(config, layout, rng, float(rng.uniform(-180.0, 180.0)))

    def _words(self, kind: str) -> str:
        on_land = self.ship.layout.on_land
        if kind == BARE:
            return "bare deck"
        if kind == PAST:
            return "past a runway" if on_land else "past a ship"
        if kind == OPEN or not len(self.ship.background):
            return "open land" if on_land else "open sea"
        return "other ships" if kind == SHIPS else "coast"


def _looking_at(
    config: SimConfig, target_m: NDArray[np.float64], range_m: float, rng: np.random.Generator
) -> Viewpoint:
    azimuth = rng.uniform(0.0, 2 * np.pi)
    height_m = range_m * np.tan(np.deg2rad(rng.uniform(*ELEVATION_DEG)))
    away = np.array([range_m * np.cos(azimuth), range_m * np.sin(azimuth), -height_m])
    nudge = np.deg2rad(np.clip(rng.normal(0.0, 1.0, 3), -2.4, 2.4) * NUDGE_DEG)
    camera = Camera.from_fov(config.width, config.height, draw_fov(config, rng))
    return Viewpoint(looking(target_m + away, target_m, nudge), camera, 0.0)
