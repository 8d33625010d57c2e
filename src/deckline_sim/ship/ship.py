"""One ship with its paint and lamps, or a runway on land: what is drawn in a block of frames.

Lamps are float32 (N, 7), for dusk and night: x, y, z (ship frame, metres), display colour 0..1, relative strength.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from deckline_sim.ship.background import background_mesh
from deckline_sim.ship.clutter import load_aircraft, prototype
from deckline_sim.ship.deck_paint import build_coat
from deckline_sim.ship.layout import Layout, class_layout, random_layout
from deckline_sim.ship.mesh import Array, Mesh, Rgb, at_height, boxes, disc, frustum, instances, join, loft
from deckline_sim.ship.paint_shapes import Coat, axes
from deckline_sim.ship.random_plan import random_plan, random_surface
from deckline_sim.ship.ship_class import DeckSurface, load_class
from deckline_sim.ship.structure import build_structure

NO_RUNWAY = 0.12  # part of the training ships without a runway
DAMAGED = 0.35  # part of the training ships whose edge markings are interrupted
TEXELS_PER_M = 12.0
TRAIN_TEXELS_PER_M = 8.0  # coarser: a new deck is painted every few frames
LONGEST_TEXELS = 4096.0  # a long runway's paint is coarser still
WHITE, AMBER, RED = (1.0, 0.95, 0.85), (1.0, 0.6, 0.15), (1.0, 0.12, 0.08)
GREEN, BLUE = (0.2, 1.0, 0.45), (0.25, 0.4, 1.0)
LAMP_UP_M = 0.15  # deck lamps above the deck
FLOOD_UP_M = (6.0, 22.0)  # flood lamps
EDGE_STRENGTH, CENTRE_STRENGTH, DROP_STRENGTH, FLOOD_STRENGTH, DATUM_STRENGTH = 1.0, 0.7, 1.0, 6.0, 4.0
WALLS = np.array([[75, 72, 66], [60, 62, 64], [55, 35, 28], [85, 85, 83], [45, 50, 45]]) / 100
LEAVES = np.array([[20, 32, 14], [26, 36, 18], [32, 36, 16], [16, 27, 15]]) / 100
CLEAR_OF_STRIP_M = 45.0  # from a runway line on land to the nearest thing


@dataclass(frozen=True, eq=False)
class Ship:
    """All that is drawn of a ship."""

    layout: Layout
    coat: Coat
    surface: DeckSurface
    solids: Mesh  # ship frame
    stern_half_m: float  # half width of the hull at the water's edge of the stern; 0 on land
    texels_per_m: float  # of the deck's paint
    runway: bool = True  # whether edge lines are painted on it
    centre: bool = True  # whether a centre line is painted between them
    lights: Mesh = field(default_factory=lambda: np.zeros((0, 7), dtype=np.float32))  # ship frame
    background: Mesh = field(default_factory=lambda: join([]))  # other ships and coast, world frame, the ship at rest


def build_ship(preset: str, rng: Generator) -> Ship:
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
    if layout.on_land:
        solids, stern_half_m = build_airfield(layout, for_solids), 0.0
    else:
        solids, stern_half_m = build_structure(layout, runway, for_solids, spec)
    coat = build_coat(layout, plan, surface, runway, worn, for_paint)
    texels = min(TRAIN_TEXELS_PER_M if spec is None else TEXELS_PER_M, LONGEST_TEXELS / layout.length_m)
    lights = build_lights(layout, runway, solids, for_lights)
    background = background_mesh(layout, for_background, "random" if spec is None else "fair")
    centre = runway and plan.centre is not None
    return Ship(layout, coat, surface, solids, stern_half_m, texels, runway, centre, lights, background)


def build_lights(layout: Layout, runway: bool, solids: Mesh, rng: Generator) -> Mesh:
    """Lamps of a deck: runway edges, centre and drop line where there is a runway, deck edge, flood lamps."""
    parts = []
    if rng.random() >= 0.4:
        points = at_height(layout.outline_m[:: rng.integers(4, 16)], -LAMP_UP_M)
        parts.append(lamps(points, BLUE if rng.random() < 0.6 else RED, rng.uniform(0.2, 0.6)))
    if not layout.on_land:
        # Flood lamps hang on those sides of an island that are seen from the deck, and from astern.
        height, facing = -solids[:, 2], solids[:, 3] + solids[:, 4]
        places = solids[(height > FLOOD_UP_M[0]) & (height < FLOOD_UP_M[1]) & (facing < -0.5)]
        floods = places[rng.integers(len(places), size=rng.integers(0, 7))] if len(places) else places
        rgb = WHITE if rng.random() < 0.6 else AMBER
        parts.append(lamps(floods[:, :3] + 0.3 * floods[:, 3:6], rgb, FLOOD_STRENGTH))
    if runway:
        edge = (WHITE, WHITE, AMBER, GREEN)[rng.integers(4)]
        pitch = rng.uniform(30.0, 60.0) if layout.on_land else rng.uniform(6.0, 16.0)
        parts += [lamps_along(line, pitch, edge, EDGE_STRENGTH) for line in (layout.left_m, layout.right_m)]
        if rng.random() < 0.8:
            parts.append(lamps_along(layout.centre_m, pitch / 2, WHITE, CENTRE_STRENGTH))
        across = np.linspace(0.0, 1.0, rng.integers(3, 12))[:, None] * (layout.right_m[0] - layout.left_m[0])
        parts.append(lamps(at_height(layout.left_m[0] + across, -LAMP_UP_M), GREEN, EDGE_STRENGTH))
        if not layout.on_land:
            z = np.arange(0.5, rng.uniform(0.35, 0.7) * layout.deck_height_m, rng.uniform(1.0, 2.5))
            drop_line = at_height(np.full((len(z), 2), [0.0, layout.centre_m[0, 1]]), z)
            parts += [lamps(drop_line, RED, DROP_STRENGTH), landing_aid_lamps(layout, rng)]
    return np.concatenate([lamps(np.zeros((0, 3)), WHITE, 0.0), *parts])


def lamps(points_m: Array, rgb: Rgb, strength: float) -> Mesh:
    """Lamps of one kind at points (N, 3)."""
    return np.column_stack([points_m, np.full((len(points_m), 4), [*rgb, strength])]).astype(np.float32)


def lamps_along(line_m: Array, pitch_m: float, rgb: Rgb, strength: float) -> Mesh:
    """Lamps along a line (2, 2) on deck, the first one at its start."""
    along, _, length = axes(*line_m)
    points = line_m[0] + np.arange(0.0, length, pitch_m)[:, None] * along
    return lamps(at_height(points, -LAMP_UP_M), rgb, strength)


def landing_aid_lamps(layout: Layout, rng: Generator) -> Mesh:
    """The optical landing aid at the port deck edge: a row of green lamps and an amber or red one in their middle."""
    x = layout.centre_m[0, 0] + rng.uniform(0.35, 0.6) * axes(*layout.centre_m)[2]
    side = rng.uniform(-1.5, 0.5) + layout.edges_at(x)[0]
    y = side + np.array([*np.linspace(-2.5, -1.0, 4), *np.linspace(1.0, 2.5, 4), 0.0])
    up = np.append(np.full(8, 2.0), 2.0 + rng.uniform(-0.8, 0.8))
    row = lamps(np.column_stack([np.full(9, x), y, -up]), GREEN, DATUM_STRENGTH)
    row[-1, 3:6] = AMBER if rng.random() < 0.7 else RED
    return row


def build_airfield(layout: Layout, rng: Generator) -> Mesh:
    """Woods, buildings and an apron on both sides of a runway on land, none of them astern of its beginning."""
    parts = build_woods(layout, rng)
    if rng.random() < 0.8:
        parts += build_hangars(layout, rng)
    for _ in range(rng.integers(0, 12)):
        size = rng.uniform([8, 6, 3], [40, 25, 12])
        beyond = rng.uniform(CLEAR_OF_STRIP_M + 40.0, 700.0)
        at = ground_point(layout, rng.uniform(-0.3, 2.0), beyond, rng)
        yaw = rng.uniform(-np.pi, np.pi)
        parts.append(boxes(at, size, WALLS[rng.integers(len(WALLS))], yaw))
    return join(parts)


def ground_point(layout: Layout, share: float, out_m: float, rng: Generator) -> Array:
    """A point on the ground (3,): a share of the runway's length from its beginning, so far out on either side."""
    along, right, length = axes(*layout.centre_m)
    out = rng.choice([-1.0, 1.0]) * (layout.spacing_m / 2 + out_m)
    return np.array([*(layout.centre_m[0] + share * length * along + out * right), layout.deck_height_m])


def build_woods(layout: Layout, rng: Generator) -> list[Mesh]:
    """Clumps and rows of trees: a cone or a ball on a trunk, far enough out."""
    along, right, length = axes(*layout.centre_m)
    half, spots = layout.spacing_m / 2, [np.zeros((0, 2))]
    for _ in range(rng.integers(0, 14)):
        middle = rng.uniform(-0.2, 2.2) * length, rng.choice([-1.0, 1.0]) * (half + rng.uniform(90.0, 900.0))
        spread = (rng.uniform(20.0, 250.0), rng.uniform(4.0, 40.0))
        spots.append(middle + rng.normal(size=(rng.integers(4, 45), 2)) * spread)
    if len(spots) == 1:
        return []
    local = np.concatenate(spots)
    local = local[np.abs(local[:, 1]) > half + CLEAR_OF_STRIP_M + 20.0]
    at = at_height(layout.centre_m[0] + local[:, :1] * along + local[:, 1:] * right, layout.deck_height_m)
    tall = rng.uniform(4.0, 16.0, (len(at), 1))
    size = np.concatenate([tall * rng.uniform(0.3, 0.6, (len(at), 1))] * 2 + [tall], axis=1)
    tint = LEAVES[rng.integers(len(LEAVES), size=len(at))] * rng.uniform(0.7, 1.2, (len(at), 1))
    pointed = rng.random(len(at)) < rng.random()
    kinds = ((True, pointed), (False, ~pointed))
    return [instances(tree(fir), at[own], 0.0, size[own], tint[own]) for fir, own in kinds]


def tree(pointed: bool) -> Mesh:
    """A fir or a round tree of height 1 and width 1."""
    rings = ((0.1, 0.5), (0.55, 0.28), (1.0, 0.02)) if pointed else ((0.2, 0.2), (0.45, 0.5), (0.8, 0.42), (1.0, 0.1))
    crown = loft([at_height(disc(0, 0, radius, 6), -up) for up, radius in rings], (1.0, 1.0, 1.0))
    return join([crown, frustum(disc(0, 0, 0.06, 4), 0.0, disc(0, 0, 0.05, 4), -0.25, (1.2, 0.8, 0.8))])


def build_hangars(layout: Layout, rng: Generator) -> list[Mesh]:
    """A row of hangars with round roofs, a control tower, and aircraft on the apron before them."""
    along, right, _ = axes(*layout.centre_m)
    yaw = float(np.arctan2(along[1], along[0]))
    first = ground_point(layout, rng.uniform(0.1, 0.7), rng.uniform(120.0, 350.0), rng)
    side = np.sign((first[:2] - layout.centre_m[0]) @ right)
    ahead, inwards = np.array([*along, 0.0]), np.array([*(-side * right), 0.0])
    wall = WALLS[rng.integers(len(WALLS))]
    size = rng.uniform([25, 20, 8], [50, 40, 15])
    parts = [shed(first + k * (size[0] + 12.0) * ahead, size, yaw, wall) for k in range(rng.integers(1, 5))]
    tower, tall = first - 45.0 * ahead, rng.uniform(15.0, 35.0)
    parts.append(boxes(tower, (6.0, 6.0, tall), wall, yaw))
    parts.append(boxes(tower - [0, 0, tall], (9.0, 9.0, 3.0), (0.1, 0.12, 0.14), yaw))
    parts.append(boxes(tower - [0, 0, tall + 3.0], (9.5, 9.5, 0.6), wall, yaw))
    kind, count = str(rng.choice(list(load_aircraft()["kinds"]))), int(rng.integers(0, 9))
    at = first + (size[1] / 2 + 22.0) * inwards + 24.0 * np.arange(count)[:, None] * ahead
    return [*parts, instances(prototype(kind), at, yaw - side * np.pi / 2, 16.0, rng.uniform(0.4, 0.9) * np.ones(3))]


def shed(at_m: ArrayLike, size_m: Array, yaw_rad: float, rgb: Array) -> Mesh:
    """A hall of (length, width, height) whose roof is an arch."""
    length, width, height = size_m
    angle = np.linspace(0.0, np.pi, 7)
    arch = np.column_stack([width / 2 * np.cos(angle), -height * (0.5 + 0.5 * np.sin(angle))])
    profile = np.concatenate([[[width / 2, 0.0]], arch, [[-width / 2, 0.0]]])
    ends = [np.column_stack([np.full(len(profile), x), profile]) for x in (-length / 2, length / 2)]
    doors = boxes([[0.0, y, 0.0] for y in (-width / 2, width / 2)], (0.7 * length, 0.3, 0.45 * height), rgb * 0.5)
    return instances(join([loft(ends, rgb), doors]), at_m, yaw_rad)
