"""Everything of a ship that is not flat paint: hull, sponsons, islands, aircraft and vehicles on deck."""

from dataclasses import dataclass

import numpy as np

from deckline.sim.ship.clearance import clear_of_runway
from deckline.sim.ship.clutter import clutter_mesh
from deckline.sim.ship.hull import half_width, hull_mesh, random_form, random_hull, ski_jump, slab_mesh
from deckline.sim.ship.island import island_mesh, random_islands
from deckline.sim.ship.land import land_mesh
from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import Mesh, join, triangles
from deckline.sim.ship.ship_class import ShipClass
from deckline.sim.ship.sides import side_meshes

STRAIGHT = 1e-5  # change of an edge's slope that makes no corner


@dataclass(frozen=True, eq=False)
class Structure:
    """Solids, and the hull's width where the wake begins."""

    mesh: Mesh
    stern_half_m: float  # half width of the hull at the water's edge of the stern; 0 on land


def build_structure(layout: Layout, runway: bool, rng: np.random.Generator, spec: ShipClass | None = None) -> Structure:
    """Solids around a deck; above it, none between the runway's lines or close to them.

    Args:
        layout: deck and runway lines.
        runway: whether the lines are there to be kept clear.
        spec: the ship's class, whose hull and islands are built; without one they are drawn at random.
    """
    if layout.on_land:
        return Structure(land_mesh(layout, rng), 0.0)
    hull = random_hull(layout, rng) if spec is None or spec.hull is None else spec.hull
    islands = random_islands(layout, runway, rng) if spec is None else spec.islands
    form = random_form(layout, hull, rng)
    paint = np.array(hull.rgb)
    deck = paint * rng.uniform(0.4, 0.8) if spec is None else np.array(spec.surface.rgb)
    parts = [
        slab_mesh(layout, runway, paint, rng),
        hull_mesh(layout, hull, form, rng),
        side_meshes(layout, form, hull.number, paint, rng),
        ski_jump(layout, runway, hull, deck),
        *(island_mesh(layout, island, runway, paint, rng) for island in islands),
        clutter_mesh(layout, runway, islands, rng),
    ]
    mesh = clear_of_runway(layout, join(parts)) if runway else join(parts)
    mesh[:, 6:] = np.clip(mesh[:, 6:], 0.0, 1.0)
    stern = np.array(form.stern_m[0])
    return Structure(mesh, float(half_width(form, stern, np.array(layout.deck_height_m), 1.0)))


def deck_mesh(layout: Layout) -> Mesh:
    """The deck's surface as strips between its edges, facing up."""
    edges = np.column_stack([layout.port_m, layout.starboard_m])
    slopes = np.diff(edges, axis=0) / np.diff(layout.stations_m)[:, None]
    corner = np.concatenate([[True], np.any(np.abs(np.diff(slopes, axis=0)) > STRAIGHT, axis=1), [True]])
    x, (port, starboard) = layout.stations_m[corner], edges[corner].T
    zero = np.zeros(len(x) - 1)
    p0, p1 = np.column_stack([x[:-1], port[:-1], zero]), np.column_stack([x[1:], port[1:], zero])
    s0, s1 = np.column_stack([x[:-1], starboard[:-1], zero]), np.column_stack([x[1:], starboard[1:], zero])
    return triangles(np.concatenate([np.stack([p0, s1, p1], 1), np.stack([p0, s0, s1], 1)]), (0.0, 0.0, 0.0))
