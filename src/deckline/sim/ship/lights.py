"""Lamps of a ship, for dusk and night: x, y, z (ship frame, metres), display colour 0..1 and relative strength."""

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import Mesh, Rgb
from deckline.sim.ship.paint import axes

WHITE, AMBER, RED = (1.0, 0.95, 0.85), (1.0, 0.6, 0.15), (1.0, 0.12, 0.08)
GREEN, BLUE = (0.2, 1.0, 0.45), (0.25, 0.4, 1.0)
LAMP_UP_M = 0.15  # deck lamps above the deck
FLOOD_UP_M = (6.0, 22.0)  # flood lamps
EDGE_STRENGTH, CENTRE_STRENGTH, DROP_STRENGTH, FLOOD_STRENGTH, DATUM_STRENGTH = 1.0, 0.7, 1.0, 6.0, 4.0
Lamps = NDArray[np.float32]


def deck_lights(layout: Layout, runway: bool, solids: Mesh, rng: np.random.Generator) -> Lamps:
    """Lamps (N, 7) of a deck: runway edges, centre and drop line where there is a runway, deck edge, flood lamps."""
    parts = [_deck_edge(layout, rng)]
    if not layout.on_land:
        parts.append(_floods(solids, rng))
    if runway:
        edge = (WHITE, WHITE, AMBER, GREEN)[rng.integers(4)]
        pitch = rng.uniform(30.0, 60.0) if layout.on_land else rng.uniform(6.0, 16.0)
        parts += [_along(line, pitch, edge, EDGE_STRENGTH) for line in (layout.left_m, layout.right_m)]
        if rng.random() < 0.8:
            parts.append(_along(layout.centre_m, pitch / 2, WHITE, CENTRE_STRENGTH))
        parts.append(_threshold(layout, rng))
        if not layout.on_land:
            parts += [_drop_line(layout, rng), _landing_aid(layout, rng)]
    return np.concatenate(parts)


def _lamps(points_m: NDArray[np.float64], rgb: Rgb, strength: float) -> Lamps:
    """Lamps of one kind at points (N, 3)."""
    lamps = np.empty((len(points_m), 7), dtype=np.float32)
    lamps[:, :3], lamps[:, 3:6], lamps[:, 6] = points_m, rgb, strength
    return lamps


def _along(line_m: NDArray[np.float64], pitch_m: float, rgb: Rgb, strength: float) -> Lamps:
    along, _, length = axes(*line_m)
    points = line_m[0] + np.arange(0.0, length, pitch_m)[:, None] * along
    return _lamps(np.column_stack([points, np.full(len(points), -LAMP_UP_M)]), rgb, strength)


def _threshold(layout: Layout, rng: np.random.Generator) -> Lamps:
    """Green lamps across the runway's beginning."""
    count = rng.integers(3, 12)
    part = np.linspace(0.0, 1.0, count)[:, None]
    points = layout.left_m[0] + part * (layout.right_m[0] - layout.left_m[0])
    return _lamps(np.column_stack([points, np.full(count, -LAMP_UP_M)]), GREEN, EDGE_STRENGTH)


def _drop_line(layout: Layout, rng: np.random.Generator) -> Lamps:
    """A vertical row on the stern that prolongs the centre line downwards."""
    z = np.arange(0.5, rng.uniform(0.35, 0.7) * layout.deck_height_m, rng.uniform(1.0, 2.5))
    y = layout.centre_m[0, 1]
    return _lamps(np.column_stack([np.zeros_like(z), np.full_like(z, y), z]), RED, DROP_STRENGTH)


def _landing_aid(layout: Layout, rng: np.random.Generator) -> Lamps:
    """The optical landing aid at the port deck edge: a row of green lamps and an amber or red one in their middle."""
    x = layout.centre_m[0, 0] + rng.uniform(0.35, 0.6) * axes(*layout.centre_m)[2]
    side = rng.uniform(-1.5, 0.5) + layout.edges_at(x)[0]
    y = np.concatenate([side + np.linspace(-2.5, -1.0, 4), side + np.linspace(1.0, 2.5, 4), [side]])
    up = np.append(np.full(8, 2.0), 2.0 + rng.uniform(-0.8, 0.8))
    lamps = _lamps(np.column_stack([np.full(9, x), y, -up]), GREEN, DATUM_STRENGTH)
    lamps[-1, 3:6] = AMBER if rng.random() < 0.7 else RED
    return lamps


def _deck_edge(layout: Layout, rng: np.random.Generator) -> Lamps:
    """Dim lamps along the deck's edge."""
    if rng.random() < 0.4:
        return _lamps(np.zeros((0, 3)), BLUE, 0.0)
    points = layout.outline_m[:: rng.integers(4, 16)]
    points = np.column_stack([points, np.full(len(points), -LAMP_UP_M)])
    return _lamps(points, BLUE if rng.random() < 0.6 else RED, rng.uniform(0.2, 0.6))


def _floods(solids: Mesh, rng: np.random.Generator) -> Lamps:
    """Flood lamps on those sides of an island that are seen from the deck, and from astern."""
    low, high = FLOOD_UP_M
    fits = (solids[:, 2] < -low) & (solids[:, 2] > -high) & (solids[:, 3] + solids[:, 4] < -0.5)
    places = solids[fits]
    chosen = places[rng.integers(len(places), size=rng.integers(0, 7))] if len(places) else places
    return _lamps(chosen[:, :3] + 0.3 * chosen[:, 3:6], WHITE if rng.random() < 0.6 else AMBER, FLOOD_STRENGTH)
