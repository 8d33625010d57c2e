"""Clutter on deck: aircraft in rows, packs and anywhere, vehicles, crates, people, blast deflectors.

Aircraft are prototypes of unit length around the origin, nose to +x, wheels on z = 0, colours as tints.
"""

import tomllib
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from deckline_sim.ship import mesh as m
from deckline_sim.ship.hull import build_edge_gear
from deckline_sim.ship.layout import Layout, edge_distance, has_room, runway_distance
from deckline_sim.ship.mesh import WHITE, Array, Mesh, Rgb
from deckline_sim.ship.ship_class import Island

AIRCRAFT = Path(__file__).parent / "aircraft.toml"
# Greys of aircraft, one blue-grey, white; colours of vehicles; jerseys of the crew's trades.
COATS = np.array([[62, 64, 67], [52, 55, 58], [72, 74, 76], [35, 38, 42], [45, 55, 66], [90, 90, 90]]) / 100
VEHICLES = np.array([[82, 66, 12], [85, 85, 83], [60, 15, 12], [30, 36, 27], [50, 52, 54], [20, 20, 22]]) / 100
JERSEYS = [[90, 80, 10], [15, 50, 20], [75, 12, 12], [90, 90, 90], [15, 25, 60], [45, 20, 50], [40, 26, 15]]
GAP_M = 0.8  # between parked things
DeckPose = tuple[float, float, float]  # x, y, m, and yaw, rad, on deck


@cache
def load_aircraft() -> dict[str, Any]:
    """Lengths and parts of all kinds of aircraft, and the shapes of these parts."""
    return tomllib.loads(AIRCRAFT.read_text(encoding="utf-8"))


@cache
def prototype(kind: str) -> Mesh:
    """An aircraft of length 1; its greys are multiplied by an instance's colour."""
    shapes = {"body": build_body, "wing": build_wing, "fin": build_fin, "rings": build_rings, "rotor": build_rotor}
    builders: dict[str, Any] = shapes | {"solid": m.loft, "boxes": m.boxes, "rods": m.rods}
    parts = [part for name in load_aircraft()["kinds"][kind]["parts"] for part in load_aircraft()["parts"][name]]
    return m.join([builders[part["shape"]](**part["of"]) for part in parts])


@cache
def extents(kind: str) -> tuple[float, float]:
    """Twice how far an aircraft of length 1 reaches from its origin, along and across."""
    along, across = 2 * np.abs(prototype(kind)[:, :2]).max(axis=0)
    return float(along), float(across)


def build_body(x: list[float], radii: list[float], z: float | list[float], rgb: Rgb = WHITE, y: float = 0.0) -> Mesh:
    """A body of hexagonal sections along x, their middles at one height or a height each."""
    sections = zip(x, radii, np.broadcast_to(z, len(x)), strict=True)
    ring = m.disc(0.0, 0.0, 1.0, 6)
    mesh = m.loft([np.column_stack([np.full(6, at), r * ring + [0.0, up]]) for at, r, up in sections], rgb)
    mesh[:, 1] += y
    return mesh


def build_wing(outline: ArrayLike, z: float, thick: float = 0.012) -> Mesh:
    """A flat wing of any convex starboard outline (N, 2), its underside at z, and its mirror image to port."""
    halves = [np.asarray(outline) * [1.0, side] for side in (1.0, -1.0)]
    return m.join([m.loft([m.at_height(half, up) for up in (z, z - thick)], (0.95, 0.95, 0.95)) for half in halves])


def build_fin(x: float, y: float, base_z: float, chord: float, rise: float, cant: float = 0.0) -> Mesh:
    """A swept vertical tail."""
    corners = np.array([[0, 0], [chord, 0], [0.35 * chord, rise], [-0.15 * chord, rise]])
    across = y + cant * corners[:, 1]
    faces = [np.column_stack([x + corners[:, 0], across + side, base_z - corners[:, 1]]) for side in (-0.006, 0.006)]
    return m.loft(faces, (0.85, 0.85, 0.85))


def build_rings(
    x: float, radii: list[float], z: list[float], rgb: Rgb, sides: int, ends: tuple[bool, bool] = (True, True)
) -> Mesh:
    """A round body of upright axis."""
    rings = [m.at_height(m.disc(x, 0.0, radius, sides), up) for radius, up in zip(radii, z, strict=True)]
    return m.loft(rings, rgb, ends)


def build_rotor(hub: list[float], folded: bool) -> Mesh:
    """Five rotor blades, spread or folded aft."""
    angle = np.pi + np.linspace(-0.12, 0.12, 5) if folded else np.arange(5) * 2 * np.pi / 5 + 0.3
    reach = np.column_stack([np.cos(angle), np.sin(angle), np.full(5, 0.08)]) * (0.55 if folded else 0.48)
    return m.rods(np.tile(hub, (5, 1)), hub + reach, 0.022, (0.22, 0.22, 0.24))


@dataclass(eq=False)
class DeckOccupancy:
    """Which places of a deck are occupied."""

    layout: Layout
    runway: bool
    occupied_m: list[tuple[float, float, float]] = field(default_factory=list)  # x, y, radius

    def reserve(self, footprint_m: Array, edge_m: float = 0.0) -> bool:
        """Whether a rectangle (4, 2) is free; if so it is occupied from now on."""
        beside = np.roll(footprint_m, 1, axis=0)
        outline = np.concatenate([footprint_m + share * (beside - footprint_m) for share in (0.0, 0.25, 0.5, 0.75)])
        if not has_room(self.layout, self.runway, outline, edge_m):
            return False
        sides = (footprint_m[1] - footprint_m[0], footprint_m[2] - footprint_m[1])
        long, short = sorted(sides, key=lambda side: -float(np.hypot(*side)))
        length, width = float(np.hypot(*long)), float(np.hypot(*short))
        share = np.linspace(-0.5, 0.5, int(np.ceil(length / width)) + 1)[:, None] * (1 - width / length)
        wanted = footprint_m.mean(axis=0) + share * long  # middles of discs along the longer axis
        if self.occupied_m:
            others = np.array(self.occupied_m)
            gaps = np.hypot(*(others[:, None, :2] - wanted).transpose(2, 0, 1))
            if np.any(gaps < others[:, None, 2] + width / 2 + GAP_M):
                return False
        self.occupied_m += [(x, y, width / 2) for x, y in wanted.tolist()]
        return True

    def draw_point(self, margin: float, rng: Generator) -> tuple[float, float]:
        """A point anywhere on deck, `margin` of its length away from stern and bow."""
        x = rng.uniform(margin, 1.0 - margin) * self.layout.length_m
        return x, rng.uniform(*self.layout.edges_at(x))


def build_clutter(layout: Layout, runway: bool, islands: tuple[Island, ...], rng: Generator) -> Mesh:
    """Everything loose on deck; sometimes a full air wing, sometimes nothing."""
    lot = DeckOccupancy(layout, runway)
    for island in islands:
        for x in np.arange(-0.5, 0.51, 0.25) * island.length_m + island.middle_m[0]:
            lot.occupied_m.append((float(x), island.middle_m[1], island.width_m * 0.5))
    fullness = rng.choice([0.0, 0.3, 1.0], p=[0.12, 0.38, 0.5])
    parts = [park_aircraft(lot, islands, fullness, rng), *park_vehicles(lot, islands, fullness, rng)]
    parts += [*place_crew(lot, rng), *build_edge_gear(layout, runway, rng), *build_deflectors(lot, rng)]
    return m.join(parts)


def park_aircraft(lot: DeckOccupancy, islands: tuple[Island, ...], fullness: float, rng: Generator) -> Mesh:
    """Rows along the deck's edge, a pack beside the island, and some anywhere."""
    wing = rng.choice(list(load_aircraft()["kinds"]), size=3)  # a ship carries few types
    coat = COATS[rng.integers(len(COATS))]
    spots: list[DeckPose] = []
    for side in (-1.0, 1.0):
        for _ in range(rng.integers(0, 1 + round(5 * fullness))):
            spots += row_spots(lot.layout, side, rng)
    for island in islands:
        if rng.random() < fullness:
            x, y = island.middle_m
            x += rng.choice([-1.0, 1.0]) * (island.length_m / 2 + rng.uniform(12.0, 30.0))
            spots += pack_spots(x, y - np.sign(y) * rng.uniform(0.0, 10.0), rng)
    if rng.random() < 0.6 * fullness:
        x = rng.uniform(0.7, 0.95) * lot.layout.length_m
        spots += pack_spots(x, rng.uniform(*lot.layout.edges_at(x)), rng)
    for _ in range(rng.integers(0, 1 + round(36 * fullness))):
        spots.append((*lot.draw_point(0.05, rng), rng.uniform(-np.pi, np.pi)))
    parked: dict[str, list[tuple[float, ...]]] = {}
    kind, scale = str(wing[0]), min(1.0, lot.layout.length_m / 150.0)
    for x, y, yaw in spots:
        kind = str(rng.choice(wing)) if rng.random() < 0.3 else kind
        size = load_aircraft()["kinds"][kind]["length_m"] * scale
        length, width = extents(kind)
        if lot.reserve(m.rectangle(x, y, size * length, size * width, yaw), -2.0):
            parked.setdefault(kind, []).append((x, y, 0.0, yaw, size, *(coat * rng.uniform(0.9, 1.1))))
    tables = {name: np.array(rows) for name, rows in parked.items()}
    return m.join([m.instances(prototype(name), t[:, :3], t[:, 3], t[:, 4:5], t[:, 5:]) for name, t in tables.items()])


def row_spots(layout: Layout, side: float, rng: Generator) -> list[DeckPose]:
    """Side by side along a deck edge, noses inwards at an angle."""
    start = rng.uniform(0.02, 0.8) * layout.length_m
    x = np.arange(start, min(start + rng.uniform(30.0, 140.0), 0.97 * layout.length_m), rng.uniform(8.0, 14.0))
    turn = rng.uniform(0.35, 1.5) * (1.0 if rng.random() < 0.7 else -1.0)
    yaw = -side * (np.pi / 2 - turn * 0.6)
    y = side * (layout.half_width_at(x, side) - rng.uniform(6.0, 9.5))
    return [(a, b, yaw + rng.normal(0.0, 0.03)) for a, b in zip(x, y, strict=True)]


def pack_spots(x_m: float, y_m: float, rng: Generator) -> list[DeckPose]:
    """A tight pack around a point: rows of aircraft that all point about the same way."""
    yaw, heading = rng.uniform(-np.pi, np.pi), rng.choice([0.0, np.pi / 2, -np.pi / 2])
    pitch = rng.uniform(11.0, 18.0), rng.uniform(9.0, 13.0)
    grid = np.stack(np.meshgrid(np.arange(rng.integers(1, 4)), np.arange(rng.integers(2, 6))), -1).reshape(-1, 2)
    turned = yaw if rng.random() < 0.4 else heading + rng.normal(0.0, 0.1)
    spots = m.place((grid - grid.mean(axis=0)) * pitch, x_m, y_m, turned) + rng.normal(0.0, 0.4, grid.shape)
    return [(x, y, turned + rng.normal(0.0, 0.05)) for x, y in spots]


def park_vehicles(lot: DeckOccupancy, islands: tuple[Island, ...], fullness: float, rng: Generator) -> list[Mesh]:
    """Tractors, fork lifts, fire engines, crates, pallets, and the big deck crane."""
    parts = []
    for _ in range(rng.integers(0, 3 + round(22 * fullness))):
        (x, y), yaw = lot.draw_point(0.03, rng), rng.uniform(-np.pi, np.pi)
        if islands and rng.random() < 0.5:
            x, y = islands[0].middle_m
            x += rng.normal(0.0, 0.7) * islands[0].length_m
            y -= np.sign(y) * rng.uniform(4.0, 14.0)
        length, width = rng.uniform(1.5, 6.0), rng.uniform(0.8, 2.4)
        if not lot.reserve(m.rectangle(x, y, length, width, yaw)):
            continue
        rgb = VEHICLES[rng.integers(len(VEHICLES))] * rng.uniform(0.8, 1.15)
        parts.append(m.boxes((x, y, -0.25), (length, width, rng.uniform(0.5, 1.3)), rgb, yaw))
        if rng.random() < 0.6:
            at = np.array([x, y]) + np.array([np.cos(yaw), np.sin(yaw)]) * length * rng.uniform(-0.3, 0.3)
            cab = (0.3 * length, 0.85 * width, rng.uniform(0.5, 1.6))
            parts.append(m.boxes((*at, -0.8), cab, rgb * rng.uniform(0.3, 1.1), yaw))
    return parts + park_crane(lot, rng) if rng.random() < 0.25 else parts


def park_crane(lot: DeckOccupancy, rng: Generator) -> list[Mesh]:
    """The yellow wheeled crane for crashed aircraft, its jib lowered; none where ten tries find no room."""
    for _ in range(10):
        x, yaw = rng.uniform(0.2, 0.8) * lot.layout.length_m, rng.uniform(-np.pi, np.pi)
        y = rng.uniform(*lot.layout.edges_at(x))
        if lot.reserve(m.rectangle(x, y, 20.0, 3.5, yaw)):
            break
    else:
        return []
    rgb, up = np.array([0.8, 0.62, 0.1]) * rng.uniform(0.8, 1.1), np.array([0.0, 0.0, -1.0])
    ahead, side = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    middle = np.array([x, y, 0.0])
    back, tip = middle - 4.0 * ahead, middle + 9.5 * ahead + rng.uniform(3.0, 8.0) * up
    wheels = np.array([back + a * ahead + b * side for a in (-3.0, 3.5) for b in (-1.2, 1.2)])
    heads, mast = np.array([back + 2.2 * up + 0.5 * k * side for k in (-1, 1)]), back + 6.5 * up
    return [
        m.boxes(back + 0.7 * up, (9.0, 2.8, 1.3), rgb, yaw),
        m.boxes(wheels, (1.5, 0.6, 1.5), (0.12, 0.12, 0.12), yaw),
        m.boxes(back - 2.0 * ahead + 2.0 * up, (3.0, 2.6, 1.8), rgb * 0.9, yaw),
        m.rods(heads, [tip, tip], 0.35, rgb),
        m.rods([back + 2.0 * up, mast], [mast, tip], [0.5, 0.12], rgb),
    ]


def place_crew(lot: DeckOccupancy, rng: Generator) -> list[Mesh]:
    """Crew in groups, jerseys by trade, and rows of them along an edge on some days."""
    layout, at = lot.layout, [np.zeros((0, 2))]
    for _ in range(rng.integers(0, 7)):
        x = rng.uniform(0.03, 0.95) * layout.length_m
        y = rng.uniform(*layout.edges_at(x))
        at.append(np.array([x, y]) + rng.normal(0.0, 3.0, (rng.integers(1, 9), 2)))
    if rng.random() < 0.08:
        manned = np.arange(0.1 * layout.length_m, 0.9 * layout.length_m, 3.0)
        at.append(np.column_stack([manned, layout.edges_at(manned)[1] - 1.0]))
    points = np.concatenate(at)
    ahead = np.array([0.5, 0.0])  # where the edge turns sharply, the way across alone would mislead
    clear = np.minimum(edge_distance(layout, points + ahead), edge_distance(layout, points - ahead)) > 0.5
    if lot.runway:
        clear &= runway_distance(layout, points) > 4.0
    points = points[clear]
    if not len(points):
        return []
    yaw = rng.uniform(-np.pi, np.pi, len(points))
    jersey, legs = np.array(JERSEYS)[rng.integers(len(JERSEYS), size=len(points))] / 100, np.array([0.2, 0.22, 0.3])
    people = (((0.25, 0.4, 0.85), 0.0, legs), ((0.3, 0.5, 0.65), 0.85, jersey), ((0.24, 0.24, 0.27), 1.5, jersey))
    return [m.boxes(m.at_height(points, -up), size, rgb, yaw) for size, up, rgb in people]


def build_deflectors(lot: DeckOccupancy, rng: Generator) -> list[Mesh]:
    """Raised jet blast deflectors: tilted plates on the foredeck."""
    parts = []
    for _ in range(rng.integers(0, 3)):
        x = rng.uniform(0.3, 0.75) * lot.layout.length_m
        y, wide, deep = rng.uniform(*lot.layout.edges_at(x)), rng.uniform(7.0, 11.0), rng.uniform(2.5, 4.0)
        if lot.reserve(m.rectangle(x, y, 4.5, wide)):
            y0, y1, up = y - wide / 2, y + wide / 2, -deep * 0.75
            plate = np.array([[[x, y0, 0], [x, y1, 0], [x - 1.8, y1, up], [x - 1.8, y0, up]]])
            parts += [m.quads(plate, (0.33, 0.33, 0.34)), m.quads(plate[:, ::-1] - [0.05, 0, 0], (0.25, 0.25, 0.26))]
    return parts
