"""What stands on deck: aircraft in rows, clusters and anywhere, vehicles, crates, people, gear along the edge."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.aircraft import KINDS, extents, prototype
from deckline.sim.ship.clearance import edge_distance, has_room, runway_distance
from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import Mesh, bars, box, boxes, instances, join, place, quads, rectangle
from deckline.sim.ship.ship_class import Island

COATS = np.array(
    [
        [0.62, 0.64, 0.67],
        [0.52, 0.55, 0.58],
        [0.72, 0.74, 0.76],
        [0.35, 0.38, 0.42],
        [0.45, 0.55, 0.66],
        [0.9, 0.9, 0.9],
    ]
)  # greys of aircraft, one blue-grey, white
VEHICLES = np.array(
    [[0.82, 0.66, 0.12], [0.85, 0.85, 0.83], [0.6, 0.15, 0.12], [0.3, 0.36, 0.27], [0.5, 0.52, 0.54], [0.2, 0.2, 0.22]]
)
JERSEYS = np.array(
    [
        [0.9, 0.8, 0.1],
        [0.15, 0.5, 0.2],
        [0.75, 0.12, 0.12],
        [0.9, 0.9, 0.9],
        [0.15, 0.25, 0.6],
        [0.45, 0.2, 0.5],
        [0.4, 0.26, 0.15],
    ]
)  # the crew's trades by colour
GAP_M = 0.8  # between parked things


@dataclass(eq=False)
class Lot:
    """The deck as a car park: what is taken so far."""

    layout: Layout
    runway: bool
    taken_m: list[tuple[float, float, float]] = field(default_factory=list)  # x, y, radius

    def take(self, footprint_m: NDArray[np.float64], edge_m: float = 0.0) -> bool:
        """Whether a rectangle (4, 2) is free; if so it is taken."""
        beside = np.roll(footprint_m, 1, axis=0)
        outline = np.concatenate([footprint_m + share * (beside - footprint_m) for share in (0.0, 0.25, 0.5, 0.75)])
        if not has_room(self.layout, self.runway, outline, edge_m):
            return False
        wanted = discs(footprint_m)
        if self.taken_m:
            others = np.array(self.taken_m)
            gaps = np.hypot(*(others[:, None, :2] - wanted[:, :2]).transpose(2, 0, 1))
            if np.any(gaps < others[:, None, 2] + wanted[:, 2] + GAP_M):
                return False
        self.taken_m += [(float(x), float(y), float(radius)) for x, y, radius in wanted]
        return True


def discs(rectangle_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Circles (N, 3) of x, y, radius along a rectangle's longer axis, which stand for it."""
    first, second = rectangle_m[1] - rectangle_m[0], rectangle_m[2] - rectangle_m[1]
    long, short = sorted((first, second), key=lambda side: -float(np.hypot(*side)))
    length, width = float(np.hypot(*long)), float(np.hypot(*short))
    share = np.linspace(-0.5, 0.5, int(np.ceil(length / width)) + 1)[:, None] * (1 - width / length)
    middles = rectangle_m.mean(axis=0) + share * long
    return np.column_stack([middles, np.full(len(middles), width / 2)])


def clutter_mesh(layout: Layout, runway: bool, islands: tuple[Island, ...], rng: np.random.Generator) -> Mesh:
    """Everything loose on deck; sometimes a full air wing, sometimes nothing."""
    lot = Lot(layout, runway)
    for island in islands:
        for x in np.arange(-0.5, 0.51, 0.25) * island.length_m + island.middle_m[0]:
            lot.taken_m.append((float(x), island.middle_m[1], island.width_m * 0.5))
    fullness = rng.choice([0.0, 0.3, 1.0], p=[0.12, 0.38, 0.5])
    return join([
        aircraft_mesh(lot, islands, fullness, rng),
        vehicles_mesh(lot, islands, fullness, rng),
        people_mesh(lot, rng),
        edge_mesh(layout, runway, rng),
        deflectors_mesh(lot, rng),
    ])  # fmt: skip


def aircraft_mesh(lot: Lot, islands: tuple[Island, ...], fullness: float, rng: np.random.Generator) -> Mesh:
    """Rows along the deck's edge, a pack beside the island, and some anywhere."""
    names = list(KINDS)
    wing = rng.choice(names, size=3)  # a ship carries few types
    coat = COATS[rng.integers(len(COATS))]
    spots: list[tuple[float, float, float]] = []
    for side in (-1.0, 1.0):
        for _ in range(rng.integers(0, 1 + round(5 * fullness))):
            spots += row_spots(lot.layout, side, rng)
    for island in islands:
        if rng.random() < fullness:
            x = island.middle_m[0] + rng.choice([-1.0, 1.0]) * (island.length_m / 2 + rng.uniform(12.0, 30.0))
            spots += pack_spots(x, island.middle_m[1] - np.sign(island.middle_m[1]) * rng.uniform(0.0, 10.0), rng)
    if rng.random() < 0.6 * fullness:
        x = rng.uniform(0.7, 0.95) * lot.layout.length_m
        spots += pack_spots(x, rng.uniform(*lot.layout.edges_at(x)), rng)
    for _ in range(rng.integers(0, 1 + round(36 * fullness))):
        x = rng.uniform(0.05, 0.95) * lot.layout.length_m
        spots.append((x, rng.uniform(*lot.layout.edges_at(x)), rng.uniform(-np.pi, np.pi)))
    parts: dict[str, list[tuple[float, ...]]] = {}
    kind, scale = str(wing[0]), min(1.0, lot.layout.length_m / 150.0)
    for x, y, yaw in spots:
        kind = str(rng.choice(wing)) if rng.random() < 0.3 else kind
        size = KINDS[kind] * scale
        length, width = extents(kind)
        if lot.take(rectangle(x, y, size * length, size * width, yaw), -2.0):
            parts.setdefault(kind, []).append((x, y, yaw, size, *(coat * rng.uniform(0.9, 1.1))))
    meshes = []
    for name, placed in parts.items():
        table = np.array(placed)
        at = np.column_stack([table[:, :2], np.zeros(len(table))])
        meshes.append(instances(prototype(name), at, table[:, 2], table[:, 3:4], table[:, 4:]))
    return join(meshes)


def row_spots(layout: Layout, side: float, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Side by side along a deck edge, noses inwards at an angle."""
    start = rng.uniform(0.02, 0.8) * layout.length_m
    x = np.arange(start, min(start + rng.uniform(30.0, 140.0), 0.97 * layout.length_m), rng.uniform(8.0, 14.0))
    edge = np.interp(x, layout.stations_m, layout.starboard_m if side > 0 else layout.port_m)
    turn = rng.uniform(0.35, 1.5) * (1.0 if rng.random() < 0.7 else -1.0)
    yaw = -side * (np.pi / 2 - turn * 0.6)
    y = edge - side * rng.uniform(6.0, 9.5)
    return [(float(a), float(b), float(yaw + rng.normal(0.0, 0.03))) for a, b in zip(x, y, strict=True)]


def pack_spots(x_m: float, y_m: float, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """A tight pack around a point: rows of aircraft that all point about the same way."""
    yaw, heading = rng.uniform(-np.pi, np.pi), rng.choice([0.0, np.pi / 2, -np.pi / 2])
    pitch = rng.uniform(11.0, 18.0), rng.uniform(9.0, 13.0)
    grid = np.stack(np.meshgrid(np.arange(rng.integers(1, 4)), np.arange(rng.integers(2, 6))), -1).reshape(-1, 2)
    turned = yaw if rng.random() < 0.4 else heading + rng.normal(0.0, 0.1)
    spots = place((grid - grid.mean(axis=0)) * pitch, x_m, y_m, turned) + rng.normal(0.0, 0.4, grid.shape)
    return [(float(x), float(y), float(turned + rng.normal(0.0, 0.05))) for x, y in spots]


def vehicles_mesh(lot: Lot, islands: tuple[Island, ...], fullness: float, rng: np.random.Generator) -> Mesh:
    """Tractors, fork lifts, fire engines, crates, pallets, and the big deck crane."""
    parts = []
    for _ in range(rng.integers(0, 3 + round(22 * fullness))):
        x = rng.uniform(0.03, 0.97) * lot.layout.length_m
        y, yaw = rng.uniform(*lot.layout.edges_at(x)), rng.uniform(-np.pi, np.pi)
        if islands and rng.random() < 0.5:
            x = islands[0].middle_m[0] + rng.normal(0.0, 0.7) * islands[0].length_m
            y = islands[0].middle_m[1] - np.sign(islands[0].middle_m[1]) * rng.uniform(4.0, 14.0)
        length, width = rng.uniform(1.5, 6.0), rng.uniform(0.8, 2.4)
        if not lot.take(rectangle(x, y, length, width, yaw)):
            continue
        rgb = VEHICLES[rng.integers(len(VEHICLES))] * rng.uniform(0.8, 1.15)
        parts.append(boxes([[x, y, -0.25]], (length, width, rng.uniform(0.5, 1.3)), yaw, rgb))
        if rng.random() < 0.6:
            shift = np.array([np.cos(yaw), np.sin(yaw)]) * length * rng.uniform(-0.3, 0.3)
            cab = (0.3 * length, 0.85 * width, rng.uniform(0.5, 1.6))
            parts.append(boxes([[*(np.array([x, y]) + shift), -0.8]], cab, yaw, rgb * rng.uniform(0.3, 1.1)))
    if rng.random() < 0.25:
        parts.append(deck_crane(lot, rng))
    return join(parts)


def deck_crane(lot: Lot, rng: np.random.Generator) -> Mesh:
    """The yellow wheeled crane for crashed aircraft, its jib lowered."""
    for _ in range(10):
        x, yaw = rng.uniform(0.2, 0.8) * lot.layout.length_m, rng.uniform(-np.pi, np.pi)
        y = rng.uniform(*lot.layout.edges_at(x))
        footprint = rectangle(x, y, 20.0, 3.5, yaw)
        if lot.take(footprint):
            break
    else:
        return join([])
    rgb, ahead = np.array([0.8, 0.62, 0.1]) * rng.uniform(0.8, 1.1), np.array([np.cos(yaw), np.sin(yaw), 0.0])
    side = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    middle = np.array([x, y, 0.0])
    back, tip = middle - 4.0 * ahead, middle + 9.5 * ahead - [0.0, 0.0, rng.uniform(3.0, 8.0)]
    wheels = np.array([back + a * ahead + b * side for a in (-3.0, 3.5) for b in (-1.2, 1.2)])
    parts = [
        boxes([back - [0, 0, 0.7]], (9.0, 2.8, 1.3), yaw, rgb),
        boxes(wheels, (1.5, 0.6, 1.5), yaw, (0.12, 0.12, 0.12)),
    ]
    parts.append(boxes([back - 2.0 * ahead - [0, 0, 2.0]], (3.0, 2.6, 1.8), yaw, rgb * 0.9))
    heads = np.array([back - [0, 0, 2.2] + 0.5 * k * side for k in (-1, 1)])
    parts.append(bars(heads, np.array([tip, tip]), 0.35, rgb))
    mast = back - [0, 0, 6.5]
    parts.append(bars([back - [0, 0, 2.0], mast], [mast, tip], [0.5, 0.12], rgb))
    return join(parts)


def people_mesh(lot: Lot, rng: np.random.Generator) -> Mesh:
    """Crew in groups, jerseys by trade, and rows of them along an edge on some days."""
    groups = int(rng.integers(0, 7))
    layout = lot.layout
    at = []
    for _ in range(groups):
        x = rng.uniform(0.03, 0.95) * layout.length_m
        y = rng.uniform(*layout.edges_at(x))
        at.append(np.array([x, y]) + rng.normal(0.0, 3.0, (rng.integers(1, 9), 2)))
    if rng.random() < 0.08:
        manned = np.arange(0.1 * layout.length_m, 0.9 * layout.length_m, 3.0)
        at.append(np.column_stack([manned, np.interp(manned, layout.stations_m, layout.starboard_m) - 1.0]))
    points = np.concatenate(at) if at else np.zeros((0, 2))
    ahead = np.array([0.5, 0.0])  # where the edge turns sharply, the way across alone would mislead
    clear = np.minimum(edge_distance(layout, points + ahead), edge_distance(layout, points - ahead)) > 0.5
    if lot.runway:
        clear &= runway_distance(layout, points) > 4.0
    points = points[clear]
    if not len(points):
        return join([])
    yaw = rng.uniform(-np.pi, np.pi, len(points))
    floor = np.column_stack([points, np.zeros(len(points))])
    jersey, legs = JERSEYS[rng.integers(len(JERSEYS), size=len(points))], np.array([0.2, 0.22, 0.3])
    parts = [boxes(floor, (0.25, 0.4, 0.85), yaw, legs), boxes(floor - [0, 0, 0.85], (0.3, 0.5, 0.65), yaw, jersey)]
    return join([*parts, boxes(floor - [0, 0, 1.5], (0.24, 0.24, 0.27), yaw, jersey)])


def edge_mesh(layout: Layout, runway: bool, rng: np.random.Generator) -> Mesh:
    """Whip aerials, upright or folded out, rafts, and the landing officer's platform with the optical landing aid."""
    parts = []
    count = int(rng.integers(0, 10))
    if count:
        side = rng.choice([-1.0, 1.0], count)
        x = rng.uniform(0.05, 0.95, count) * layout.length_m
        edges = [np.interp(x, layout.stations_m, edge) for edge in (layout.port_m, layout.starboard_m)]
        foot = np.column_stack([x, np.where(side > 0, *edges[::-1]) + side * 1.5, np.full(count, 0.9)])
        folded = rng.random() < 0.5
        lean = rng.uniform(0.95, 1.6, count) if folded else rng.uniform(0.0, 0.25, count)
        tall = rng.uniform(5.0, 11.0, count)
        tip = foot + np.column_stack([0 * x, side * np.sin(lean) * tall, -np.cos(lean) * tall])
        clear = (runway_distance(layout, foot[:, :2]) > 4.0) & (runway_distance(layout, tip[:, :2]) > 4.0) | (
            not runway
        )
        parts.append(bars(foot[clear], tip[clear], 0.22, np.full(3, rng.uniform(0.3, 0.9))))
    if runway and rng.random() < 0.55:
        parts.append(landing_aid(layout, rng))
    return join(parts)


def landing_aid(layout: Layout, rng: np.random.Generator) -> Mesh:
    """A lens between rows of green lamps beyond the port edge, and the landing officer's screen aft of it."""
    start, end = layout.left_m
    parts = []
    for share, wide, tall in ((rng.uniform(0.25, 0.5), rng.uniform(3.0, 8.0), 1.6), (rng.uniform(0.08, 0.2), 2.5, 1.8)):
        x = float(start[0] + share * (end[0] - start[0]))
        y = layout.edges_at(x)[0] - wide / 2 - 0.3
        if runway_distance(layout, np.array([[x, y + wide / 2]]))[0] < 4.0:
            continue
        parts.append(box(x, y, 1.4, (2.4, wide + 0.6, 0.4), 0.0, (0.35, 0.36, 0.38)))
        parts.append(box(x, y, 1.0, (0.4, wide, tall), 0.0, (0.12, 0.12, 0.13)))
        if tall < 1.7:
            lamps = np.array([[x - 0.3, y + k * wide, 0.3] for k in (-0.4, -0.25, 0.25, 0.4)])
            lit = rng.uniform(0.3, 1.0)
            parts.append(boxes(lamps, (0.1, 0.13 * wide, 0.3), 0.0, lit * np.array([0.2, 0.95, 0.4])))
            parts.append(boxes([[x - 0.3, y, 0.8]], (0.1, 0.08 * wide, 1.4), 0.0, lit * np.array([0.95, 0.5, 0.2])))
    return join(parts)


def deflectors_mesh(lot: Lot, rng: np.random.Generator) -> Mesh:
    """Raised jet blast deflectors: tilted plates on the foredeck."""
    parts = []
    for _ in range(rng.integers(0, 3)):
        x = rng.uniform(0.3, 0.75) * lot.layout.length_m
        y, wide, deep = rng.uniform(*lot.layout.edges_at(x)), rng.uniform(7.0, 11.0), rng.uniform(2.5, 4.0)
        if not lot.take(rectangle(x, y, 4.5, wide)):
            continue
        y0, y1, up = y - wide / 2, y + wide / 2, -deep * 0.75
        plate = np.array([[[x, y0, 0], [x, y1, 0], [x - 1.8, y1, up], [x - 1.8, y0, up]]])
        parts += [quads(plate, (0.33, 0.33, 0.34)), quads(plate[:, ::-1] - [0.05, 0, 0], (0.25, 0.25, 0.26))]
    return join(parts)
