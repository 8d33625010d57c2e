"""Other ships: escorts, merchantmen, boats, and a carrier without paint, floating around the origin.

Vessel frame: x forward, y to starboard, z down, z = 0 at the water.
"""

import numpy as np
from numpy.typing import ArrayLike

from deckline.sim.ship.aircraft import prototype
from deckline.sim.ship.hull import DRAUGHT_M
from deckline.sim.ship.island import mast_meshes
from deckline.sim.ship.layout import random_layout
from deckline.sim.ship.mesh import (
    Mesh,
    at_height,
    bars,
    boxes,
    dome,
    frustum,
    instances,
    join,
    loft,
    quads,
    rectangle,
    triangles,
)
from deckline.sim.ship.structure import build_structure

HULLS = np.array(
    [[0.12, 0.14, 0.2], [0.45, 0.14, 0.1], [0.1, 0.1, 0.1], [0.16, 0.3, 0.22], [0.2, 0.35, 0.55], [0.8, 0.8, 0.78]]
)
CARGO = np.array(
    [[0.55, 0.2, 0.14], [0.18, 0.3, 0.5], [0.7, 0.7, 0.68], [0.2, 0.4, 0.3], [0.75, 0.55, 0.15], [0.4, 0.4, 0.42]]
)
DARK = np.array([0.08, 0.09, 0.11])
VESSELS = ("escort", "merchant", "boat", "carrier")


def vessel_mesh(kind: str, rng: np.random.Generator) -> tuple[Mesh, float]:
    """A vessel of a kind and its length, m.

    Raises:
        ValueError: an unknown kind.
    """
    builders = {"escort": escort, "merchant": merchant, "boat": boat, "carrier": carrier}
    if kind not in builders:
        raise ValueError(f"a vessel must be one of {VESSELS}, got {kind!r}")
    mesh, length = builders[kind](rng)
    mesh[:, 6:] = np.clip(mesh[:, 6:], 0.0, 1.0)
    return mesh, length


def body(
    length_m: float, beam_m: float, freeboard_m: float, rgb: ArrayLike, boot: ArrayLike, sheer_m: float = 0.0
) -> Mesh:
    """A ship's hull: full amidships, raked and raised at the bow, with a boot stripe and a flat deck."""
    s = np.array([0.0, 0.08, 0.3, 0.6, 0.8, 0.92, 1.0])
    top = beam_m / 2 * np.array([0.85, 0.95, 1.0, 1.0, 0.85, 0.5, 0.03])
    water = beam_m / 2 * np.array([0.75, 0.9, 0.97, 0.95, 0.62, 0.25, 0.01])
    up = -freeboard_m - sheer_m * np.clip((s - 0.5) / 0.5, 0.0, 1.0) ** 2
    x = (s - 0.5) * length_m
    rake = np.where(s > 0.7, (s - 0.7) / 0.3 * 0.06 * length_m, 0.0)
    levels = [(x, top, up), (x - 0.8 * rake, water + 0.15 * (top - water), np.full(7, -0.12 * freeboard_m))]
    levels.append((x - rake, water, np.full(7, max(DRAUGHT_M, 0.05))))
    sides = [np.stack([np.stack([a, side * half, z], -1) for a, half, z in levels], 1) for side in (-1.0, 1.0)]
    frames = np.concatenate([sides[0], sides[1][:, ::-1]], axis=1)
    paint, low = np.asarray(rgb, dtype=np.float64), np.asarray(boot, dtype=np.float64)
    return loft(frames, np.array([paint, low, low, low, paint, 0.8 * paint])[None])


def escort(rng: np.random.Generator) -> tuple[Mesh, float]:
    """A frigate or destroyer: gun, bridge, masts, funnels, hangar and a flight deck aft."""
    length = rng.uniform(80.0, 175.0)
    beam, free = length * rng.uniform(0.1, 0.14), length * rng.uniform(0.035, 0.055)
    grey = rng.uniform(0.42, 0.72) * np.array([0.96, 1.0, 1.04])
    parts = [body(length, beam, free, grey, DARK, 0.02 * length)]
    house = [(-0.2, 0.16, 0.8, 0.05), (0.02, 0.2, 0.6, 0.04), (0.17, 0.16, 0.9, 0.075), (0.17, 0.09, 0.75, 0.11)]
    for s, span, wide, tall in house:
        base = rectangle(s * length, 0.0, span * length * rng.uniform(0.8, 1.2), wide * beam)
        lean = (base - [s * length, 0.0]) * [0.92, 0.82] + [s * length, 0.0]
        rise = tall * length * rng.uniform(0.8, 1.15)
        parts.append(frustum(base, -free + 0.5, lean, -free - rise, grey * rng.uniform(0.92, 1.08)))
    bridge = 0.17 * length, free + 0.085 * length
    parts.append(boxes([[bridge[0], 0.0, -bridge[1]]], (0.11 * length, 0.86 * beam, 1.1), 0.0, DARK))
    for s in rng.choice([[0.08], [0.08, -0.08], [-0.04]][rng.integers(3)], 1):
        foot = rectangle(s * length, 0.0, 0.06 * length, 0.4 * beam)
        parts.append(frustum(foot, -free, foot * [1, 0.8], -free - 0.1 * length, grey))
        parts.append(boxes([[s * length, 0.0, -free - 0.1 * length]], (0.05 * length, 0.3 * beam, 1.0), 0.0, DARK))
    parts += mast_meshes(0.13 * length, 0.0, free + 0.1 * length, length * rng.uniform(0.08, 0.16), grey, rng)
    gun = [0.33 * length, 0.0, -free - 0.006 * length]
    parts += [
        boxes([gun], (4.5, 3.2, 2.6), 0.0, grey),
        bars([np.add(gun, [0, 0, -1.8])], [np.add(gun, [7, 0, -2.6])], 0.35, grey),
    ]
    parts.append(dome(-0.2 * length, 0.0, -free - 0.065 * length, 1.3, (0.85, 0.85, 0.85), 6))
    deck = np.array([-0.41 * length, 0.0, -free - 0.06])
    parts.append(boxes([deck], (0.16 * length, 0.84 * beam, 0.05), 0.0, grey * 0.45))
    for y in (-0.3, 0.0, 0.3):
        parts.append(
            boxes([deck + np.array([0, y * beam, -0.06])], (0.15 * length, 0.3, 0.02), 0.0, (0.85, 0.85, 0.85))
        )
    if rng.random() < 0.3:
        parts.append(instances(prototype("helicopter"), [deck - [0, 0, 0.1]], 0.0, 14.0, grey))
    return join(parts), length


def merchant(rng: np.random.Generator) -> tuple[Mesh, float]:
    """A tanker, a bulk carrier or a container ship: a white house aft, pipes, hatches or boxes before it."""
    length = rng.uniform(90.0, 330.0)
    beam, free = length * rng.uniform(0.13, 0.17), length * rng.uniform(0.025, 0.055)
    hull, deck = HULLS[rng.integers(len(HULLS))], np.array([0.42, 0.2, 0.15]) * rng.uniform(0.7, 1.4)
    parts = [body(length, beam, free, hull, (0.42, 0.12, 0.1), 0.01 * length)]
    parts.append(boxes([[-0.05 * length, 0.0, -free]], (0.7 * length, 0.8 * beam, 0.1), 0.0, deck))
    tall, white = rng.uniform(12.0, 24.0), np.full(3, rng.uniform(0.75, 0.92))
    house = [-0.4 * length, 0.0, -free + 0.3]
    parts.append(boxes([house], (0.07 * length, 0.8 * beam, tall), 0.0, white))
    parts.append(boxes([[-0.39 * length, 0.0, -free - tall]], (0.04 * length, 1.05 * beam, 3.0), 0.0, white))
    parts.append(boxes([[-0.368 * length, 0.0, -free - tall - 0.9]], (0.3, 1.0 * beam, 1.2), 0.0, DARK))
    rows = np.arange(4.0, tall - 1.0, 3.0)
    panes = np.column_stack([np.full(len(rows), -0.4 * length), np.zeros(len(rows)), -free - rows])
    parts.append(boxes(panes, (0.0705 * length, 0.7 * beam, 0.9), 0.0, DARK * 2))
    parts.append(
        boxes([[-0.45 * length, 0.0, -free]], (0.03 * length, 0.25 * beam, tall + 5.0), 0.0, CARGO[rng.integers(6)])
    )
    kind = rng.integers(3)
    if kind == 0:
        starts = np.array([[-0.35 * length, y, -free - 1.5] for y in np.array([-0.08, 0.0, 0.08]) * beam])
        parts.append(bars(starts, starts + np.array([0.75 * length, 0, 0]), 0.7, deck * 1.3))
        posts = np.array([[x * length, side * 3.0, -free] for x in (-0.1, 0.1, 0.3) for side in (-1, 1)])
        parts.append(bars(posts, posts - [0, 0, 10.0], 0.6, white))
    elif kind == 1:
        hatches = np.array([[x * length, 0.0, -free] for x in np.arange(-0.28, 0.36, 0.1)])
        parts.append(boxes(hatches, (0.07 * length, 0.6 * beam, 2.0), 0.0, deck * 1.2))
        cranes = hatches[::2] + np.array([0.05 * length, 0.0, 0.0])
        parts.append(bars(cranes, cranes - [0, 0, 16.0], 1.5, white))
    else:
        x, y = np.meshgrid(np.arange(-0.33, 0.38, 13.5 / length) * length, np.arange(-0.42, 0.43, 5.2 / beam) * beam)
        stack = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -free)])
        size = np.column_stack([np.full(x.size, 12.3), np.full(x.size, 5.0), 2.6 * rng.integers(1, 7, x.size)])
        parts.append(boxes(stack, size, 0.0, CARGO[rng.integers(6, size=x.size)]))
    return join(parts), length


def boat(rng: np.random.Generator) -> tuple[Mesh, float]:
    """A fishing or motor boat, or a sailing one."""
    length = rng.uniform(8.0, 32.0)
    hull, white = HULLS[rng.integers(len(HULLS))], np.full(3, rng.uniform(0.75, 0.95))
    beam, free = length * rng.uniform(0.22, 0.32), length * rng.uniform(0.06, 0.1)
    parts = [body(length, beam, free, hull, hull * 0.5, 0.05 * length)]
    if rng.random() < 0.25:
        sail = np.array([[0.28, 0.0, -0.1], [-0.3, 0.0, -0.12], [0.05, 0.0, -1.15]]) * length
        parts += [triangles(sail[None], white), triangles(sail[None, ::-1], white)]
        parts.append(bars([[0.05 * length, 0, -free]], [[0.05 * length, 0, -1.2 * length]], 0.15, white * 0.7))
        return join(parts), length
    at = rng.uniform(-0.25, 0.15) * length
    parts.append(boxes([[at, 0.0, -free]], (0.28 * length, 0.65 * beam, 0.14 * length), 0.0, white))
    parts.append(boxes([[at, 0.0, -free - 0.08 * length]], (0.285 * length, 0.67 * beam, 0.035 * length), 0.0, DARK))
    parts.append(bars([[at, 0, -free]], [[at, 0, -free - 0.4 * length]], 0.02 * length, white * 0.8))
    return join(parts), length


def carrier(rng: np.random.Generator) -> tuple[Mesh, float]:
    """Another flight deck, bare of any marking."""
    layout = random_layout(rng)
    while layout.on_land:
        layout = random_layout(rng)
    solids = build_structure(layout, False, rng).mesh
    x, port, starboard = layout.stations_m, layout.port_m, layout.starboard_m
    edges = [at_height(np.column_stack([x, edge]), 0.0) for edge in (port, starboard)]
    faces = np.stack([edges[0][:-1], edges[0][1:], edges[1][1:], edges[1][:-1]], 1)
    faces = faces[:, ::-1]  # looking up
    deck = quads(faces, rng.uniform(0.2, 0.38) * np.ones(3))
    whole = join([solids, deck])
    whole[:, :3] -= np.array([layout.length_m / 2, 0.0, layout.deck_height_m], dtype=np.float32)
    return whole, layout.length_m


def foam_mesh(length_m: float, beam_m: float, rng: np.random.Generator) -> Mesh:
    """The wake on the water astern of a vessel under way, wider and weaker with distance."""
    stretch = length_m * rng.uniform(1.0, 4.0)
    x = -length_m / 2 - stretch * np.linspace(0.0, 1.0, 7)
    half = beam_m * (0.4 + 0.6 * np.linspace(0.0, 1.0, 7)) * rng.uniform(0.8, 1.2, 7)
    left, right = (at_height(np.column_stack([x, side * half]), -0.03) for side in (-1.0, 1.0))
    shade = np.linspace(0.75, 0.3, 6)[:, None] * np.array([0.9, 1.0, 1.02])
    return quads(np.stack([left[:-1], left[1:], right[1:], right[:-1]], 1), shade)
