"""Two ships, and places of views relative to their runways."""

import numpy as np

from deckline_sim.ship.layout import class_layout
from deckline_sim.ship.paint_shapes import axes
from deckline_sim.ship.ship_class import load_class

CVN, PAPER_SHIP = (class_layout(load_class(name)) for name in ("cvn", "paper"))


def positions(views):
    return np.array([view.world_from_body.translation for view in views])


def over_deck(layout, views):
    """Distances to the ramp, to the right of the centre line, and above the deck (N,) each, of N views."""
    points = layout.world_from_ship.inv().apply(positions(views))
    along, right, _ = axes(*layout.centre_m)
    across = points[:, :2] - layout.centre_m[0]
    return -across @ along, across @ right, -points[:, 2]
