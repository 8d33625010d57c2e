"""One ship with its paint: what is drawn in a block of frames."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.sim.config import SimConfig
from deckline.sim.layout import Layout, cvn_layout, paper_layout, random_layout
from deckline.sim.markings import CVN_EDGE, PAPER_EDGE, DeckSurface, deck_coat, random_edge, random_surface
from deckline.sim.mesh import Mesh
from deckline.sim.paint import Coat
from deckline.sim.structure import build_structure
from deckline.sim.weather import sun_direction

NO_RUNWAY = 0.08  # part of the training ships without a runway
TEXELS_PER_M = 12.0
TRAIN_TEXELS_PER_M = 8.0  # coarser: a new deck is painted every few frames


@dataclass(frozen=True, eq=False)
class Ship:
    """All that is drawn of a ship."""

    layout: Layout
    coat: Coat
    surface: DeckSurface
    solids: Mesh
    stern_half_m: float
    texels_per_m: float  # of the deck's paint


def build_ship(config: SimConfig, block: int) -> tuple[Ship, bool, NDArray[np.float64]]:
    """Ship of a block of frames, whether it has a runway, and the sun's direction (3,) in the world."""
    rng = np.random.default_rng([config.seed, 2, block])
    runway = config.preset != "train" or rng.random() >= NO_RUNWAY
    if config.preset == "paper":
        layout, style = paper_layout(), PAPER_EDGE
    elif config.preset == "cvn":
        layout, style = cvn_layout(), CVN_EDGE
    else:
        layout, style = random_layout(rng), random_edge(rng)
    structure = build_structure(layout, runway, rng)
    coat = deck_coat(layout, style, runway, rng)
    texels = TRAIN_TEXELS_PER_M if config.preset == "train" else TEXELS_PER_M
    ship = Ship(layout, coat, random_surface(rng), structure.mesh, structure.stern_half_m, texels)
    return ship, runway, sun_direction(rng)
