"""One ship with its paint: what is drawn in a block of frames."""

from dataclasses import dataclass, field

import numpy as np

from deckline.sim.ship.background import background_mesh
from deckline.sim.ship.deck_paint import deck_coat
from deckline.sim.ship.layout import Layout, class_layout, random_layout
from deckline.sim.ship.lights import Lamps, deck_lights
from deckline.sim.ship.mesh import Mesh, join
from deckline.sim.ship.paint import Coat
from deckline.sim.ship.plan import DeckSurface
from deckline.sim.ship.random_plan import random_plan, random_surface
from deckline.sim.ship.ship_class import load_class
from deckline.sim.ship.structure import build_structure
from deckline.sim.ship.weathering import DAMAGED

NO_RUNWAY = 0.12  # part of the training ships without a runway
TEXELS_PER_M = 12.0
TRAIN_TEXELS_PER_M = 8.0  # coarser: a new deck is painted every few frames
LONGEST_TEXELS = 4096.0  # a long runway's paint is coarser still


@dataclass(frozen=True, eq=False)
class Ship:
    """All that is drawn of a ship."""

    layout: Layout
    coat: Coat
    surface: DeckSurface
    solids: Mesh  # ship frame
    stern_half_m: float
    texels_per_m: float  # of the deck's paint
    runway: bool = True  # whether edge lines are painted on it
    centre: bool = True  # whether a centre line is painted between them
    lights: Lamps = field(default_factory=lambda: np.zeros((0, 7), dtype=np.float32))  # ship frame
    background: Mesh = field(default_factory=lambda: join([]))  # other ships and coast, world frame, the ship at rest


def build_ship(preset: str, rng: np.random.Generator) -> Ship:
    """A ship of a class, or a random one for `train`; its wear, clutter and lamps are random in both.

    Raises:
        ValueError: an unknown preset.
    """
    for_layout, for_solids, for_paint, for_lights, for_background = rng.spawn(5)
    if preset == "train":
        layout, spec = random_layout(for_layout), None
        runway = layout.on_land or bool(for_layout.random() >= NO_RUNWAY)
        plan, surface = random_plan(layout, runway, for_paint), random_surface(for_paint)
        worn = bool(for_paint.random() < DAMAGED)
    else:
        spec = load_class(preset)
        layout, runway, plan, worn = class_layout(spec), True, spec.plan, False
        surface = spec.surface
    structure = build_structure(layout, runway, for_solids, spec)
    coat = deck_coat(layout, plan, surface, runway, worn, for_paint)
    texels = min(TRAIN_TEXELS_PER_M if spec is None else TEXELS_PER_M, LONGEST_TEXELS / layout.length_m)
    lights = deck_lights(layout, runway, structure.mesh, for_lights)
    background = background_mesh(layout, for_background, "random" if spec is None else "fair")
    centre = runway and plan.centre is not None
    solids, stern_half_m = structure.mesh, structure.stern_half_m
    return Ship(layout, coat, surface, solids, stern_half_m, texels, runway, centre, lights, background)
