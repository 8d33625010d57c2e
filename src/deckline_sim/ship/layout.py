"""Where the deck's edge and the runway lines are, and how much room they leave.

Ship frame: x forward along the ship's axis, y to starboard, z down, origin on the deck plane at the stern.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.types import Segment
from deckline_sim.ship.mesh import Array, Mesh
from deckline_sim.ship.paint_shapes import axes
from deckline_sim.ship.ship_class import Point, ShipClass, Strip, WorldLines, load_class

DECKS = {"large": 0.28, "medium": 0.20, "axial": 0.17, "small": 0.10, "variant": 0.21, "land": 0.04}  # how often drawn
SIZES = {  # least and greatest length, height and line spacing, m, part of the decks without angle, angle, degrees
    "large": ((260.0, 345.0), (15.0, 23.0), (18.0, 29.0), 0.0, (3.0, 11.0)),
    "medium": ((170.0, 270.0), (11.0, 18.0), (13.5, 22.0), 0.0, (3.0, 11.0)),
    "axial": ((150.0, 285.0), (13.0, 22.0), (13.0, 24.0), 0.8, (0.5, 2.5)),
    "small": ((85.0, 140.0), (8.0, 14.0), (10.0, 15.0), 0.5, (1.0, 6.0)),
}
VARIED = {"cvn": 0.6, "axial": 0.25, "small": 0.15}  # classes whose decks are stretched into variants
MIRRORED = 0.08  # part of the variants whose port is to starboard
TO_PORT = 0.85  # part of the angled decks whose runway turns to port
PLACED_M = 400.0  # how far from the world's origin a ship may lie, north and east
STATION_M = 2.5  # spacing of the deck edge's corners
EDGE_MARGIN_M = 1.5  # deck that is always left outside a runway line's middle, beside half its marking
WIDE_MARGIN_M = EDGE_MARGIN_M + 2.0  # the same on ships that exist
EDGE_SHAPES = ("stepped", "sponsons", "straight", "tapered")  # of random decks
FLUSH_M = 0.03  # what rises less than this above the deck hides nothing
BEYOND_M = 6.0  # the runway stays clear this far beyond the end of its longer line
CLEAR_M = 3.5  # nothing above the deck comes closer to a runway line's middle than this
Edges = tuple[Array, Array, Array]  # stations (N,), port and starboard y (N,)
Sides = Sequence[Sequence[Point]]  # corners of the port and starboard edge, stern to bow
Lines = tuple[Array, Array]  # left and right runway line (2, 2) in the ship frame


@dataclass(frozen=True, eq=False)
class Layout:
    """Deck outline and runway lines of one ship."""

    stations_m: Array  # (N,) increasing x of the outline's corners
    port_m: Array  # (N,) y of the deck's port edge
    starboard_m: Array  # (N,) y of its starboard edge
    left_m: Array  # (2, 2) middle of the left edge marking: ramp end, far end
    right_m: Array  # (2, 2)
    deck_height_m: float  # above the water
    world_from_ship: RigidTransform  # where the ship is now; at rest until `at_pose`
    sea_z_m: float  # world z of the water, or of the ground under a land runway
    on_land: bool = False  # a runway on land: no hull, no water

    @property
    def length_m(self) -> float:
        return float(self.stations_m[-1])

    def at_pose(self, world_from_ship: RigidTransform) -> "Layout":
        """The same ship elsewhere: under way, rolling, pitching, heaving. The water stays where it is."""
        return replace(self, world_from_ship=world_from_ship)

    @property
    def outline_m(self) -> Array:
        """Deck edge (2 N, 2): port from stern to bow, starboard back."""
        port = np.column_stack([self.stations_m, self.port_m])
        return np.concatenate([port, np.column_stack([self.stations_m, self.starboard_m])[::-1]])

    def edges_at(self, x_m: float | Array) -> tuple[Any, Any]:
        """Port and starboard edge, y, at a station, or arrays of them at many."""
        return np.interp(x_m, self.stations_m, self.port_m), np.interp(x_m, self.stations_m, self.starboard_m)

    def half_width_at(self, x_m: float | Array, side: float) -> Any:
        """Distance of one edge from the ship's axis at stations; side -1 is port."""
        return np.interp(x_m, self.stations_m, self.starboard_m if side > 0 else -self.port_m)

    @property
    def centre_m(self) -> Array:
        """Centre line (2, 2): ramp end, far end."""
        return (self.left_m + self.right_m) / 2

    @property
    def spacing_m(self) -> float:
        """Distance between the lines' beginnings."""
        return float(np.hypot(*(self.right_m[0] - self.left_m[0])))


def world_points(layout: Layout, points_m: Array, up_m: float = 0.0) -> Array:
    """Deck points (N, 2) of the ship frame, raised by `up`, in the world (N, 3)."""
    return layout.world_from_ship.apply(np.column_stack([points_m, np.full(len(points_m), -up_m)]))


def truth_segments(layout: Layout) -> tuple[Segment, Segment]:
    """Middle of the left and of the right edge marking in the world, ramp end first."""
    left, right = world_points(layout, layout.left_m), world_points(layout, layout.right_m)
    return Segment(left[0], left[1]), Segment(right[0], right[1])


def class_layout(ship: ShipClass) -> Layout:
    """Layout of a ship class."""
    stern = np.array([*ship.stern_m, ship.sea_z_m - ship.deck_height_m])
    turn = Rotation.from_euler("z", np.deg2rad(ship.heading_deg))
    world_from_ship = RigidTransform.from_components(stern, turn)
    if ship.strip is not None:
        lines = strip_lines(ship.strip)
    elif ship.world_lines is not None:
        lines = lines_on_deck(ship.world_lines, world_from_ship)
    edges = deck_edges(ship.length_m, (ship.port_m, ship.starboard_m), lines)
    return Layout(*edges, *lines, ship.deck_height_m, world_from_ship, ship.sea_z_m, ship.on_land)


def lines_on_deck(lines: WorldLines, world_from_ship: RigidTransform) -> Lines:
    """Runway lines that are given in the world, in the ship frame on the deck plane."""
    ends = []
    for slope, constant in (lines.left, lines.right):
        x = np.array([lines.start_x_m, lines.start_x_m - lines.length_m / np.hypot(1.0, slope)])
        world = np.column_stack([x, -constant - slope * x, np.full(2, world_from_ship.translation[2])])
        ends.append(world_from_ship.inv().apply(world)[:, :2])
    return ends[0], ends[1]


def strip_lines(strip: Strip) -> Lines:
    """Runway lines of a strip."""
    angle, start = np.deg2rad(strip.port_angle_deg), np.asarray(strip.start_m)
    along = np.array([np.cos(angle), -np.sin(angle)])
    right = np.array([-along[1], along[0]])
    lines = []
    for side, length in zip((-0.5, 0.5), strip.lengths_m, strict=True):
        spacing, last_spacing = strip.spacing_m
        end_spacing = spacing + (last_spacing - spacing) * length / max(strip.lengths_m)
        lines.append(np.array([start + side * spacing * right, start + length * along + side * end_spacing * right]))
    return lines[0], lines[1]


def deck_edges(length_m: float, sides: Sides, lines_m: Lines, margin_m: float = WIDE_MARGIN_M) -> Edges:
    """Deck edge through the corner points of both sides, widened where a runway line needs deck under it."""
    stations = np.linspace(0.0, length_m, round(length_m / STATION_M) + 1)
    edge_port, edge_starboard = (np.interp(stations, *np.transpose(side)) for side in sides)
    for line in lines_m:
        on_line = (stations >= line[0, 0] - 6.0) & (stations <= line[1, 0] + 4.0)
        across = np.interp(stations[on_line], line[:, 0], line[:, 1])
        edge_port[on_line] = np.minimum(edge_port[on_line], across - margin_m)
        edge_starboard[on_line] = np.maximum(edge_starboard[on_line], across + margin_m)
    return stations, edge_port, edge_starboard


def random_layout(rng: Generator) -> Layout:
    """Size, deck shape, angle and lines are drawn widely."""
    kind = list(DECKS)[rng.choice(len(DECKS), p=list(DECKS.values()))]
    if kind == "land":
        return land_layout(rng)
    if kind == "variant":
        return class_layout(class_variant(load_class(list(VARIED)[rng.choice(3, p=list(VARIED.values()))]), rng))
    return ship_layout(kind, rng)


def class_variant(ship: ShipClass, rng: Generator) -> ShipClass:
    """A class with a strip, stretched, bent and laid elsewhere; only its deck and lines still matter.

    Raises:
        ValueError: a class whose lines are not given as a strip.
    """
    if ship.strip is None:
        raise ValueError(f"only a ship with a strip can be varied, got strip {ship.strip}")
    sx, sy, hand = rng.uniform(0.82, 1.06), rng.uniform(0.85, 1.15), 1.0 if rng.random() >= MIRRORED else -1.0
    edges = []
    for corners in (ship.port_m, ship.starboard_m):
        across = [hand * (y * sy + rng.normal(0.0, 0.003 * ship.length_m)) for _, y in corners]
        edges.append(tuple((x * sx, y) for (x, _), y in zip(corners, across, strict=True)))
    strip, spacing = ship.strip, sy * rng.uniform(0.9, 1.1) * ship.strip.spacing_m[0]
    angle_deg = strip.port_angle_deg + rng.normal(0.0, 1.2 if strip.port_angle_deg else 0.3)
    begin = rng.uniform(0.5, 4.0) + spacing / 2 * abs(np.sin(np.deg2rad(angle_deg)))  # both lines begin on the deck
    strip = Strip(
        (float(begin), hand * strip.start_m[1] * sy),
        hand * angle_deg,
        (spacing, spacing * (1.0 if rng.random() < 0.6 else rng.uniform(0.9, 1.03))),
        (strip.lengths_m[0] * sx * rng.uniform(0.88, 1.0), strip.lengths_m[1] * sx * rng.uniform(0.88, 1.0)),
    )
    height, stern = ship.deck_height_m * rng.uniform(0.75, 1.15), rng.uniform(-PLACED_M, PLACED_M, 2)
    port, starboard = edges if hand > 0.0 else edges[::-1]
    ship = replace(ship, stern_m=(float(stern[0]), float(stern[1])), heading_deg=rng.uniform(-180.0, 180.0))
    ship = replace(ship, strip=strip, deck_height_m=height)
    return replace(ship, length_m=ship.length_m * sx, port_m=port, starboard_m=starboard)


def ship_layout(kind: str, rng: Generator) -> Layout:
    """A ship of one kind."""
    *ranges, straight, angles_deg = SIZES[kind]
    angle_deg = 0.0 if straight and rng.random() < straight else rng.uniform(*angles_deg)
    sine = np.sin(np.deg2rad(angle_deg))
    length, height, spacing = (rng.uniform(*limits) for limits in ranges)
    hand = 1.0 if rng.random() < TO_PORT else -1.0
    runway = min(rng.uniform(0.5, 0.9) * length, rng.uniform(230.0, 260.0), length - 12.0)
    lengths = tuple(runway * (1.0 - rng.uniform(0.0, 0.12, 2)))
    closing = 1.0 if rng.random() < 0.6 else rng.uniform(0.88, 1.04)
    offset = hand * sine * runway * rng.uniform(0.0, 0.45) + rng.uniform(-0.15, 0.15) * spacing
    if kind == "axial" and rng.random() < 0.7:  # room for an island to starboard
        offset -= rng.uniform(0.1, 0.35) * spacing
    start = (rng.uniform(0.5, 6.0) + spacing / 2 * sine, offset)  # both lines begin on the deck
    lines = strip_lines(Strip(start, hand * angle_deg, (spacing, spacing * closing), lengths))
    return Layout(*random_edges(length, lines, rng), *lines, height, random_pose(height, rng), sea_z_m=0.0)


def land_layout(rng: Generator) -> Layout:
    """A straight runway with shoulders."""
    length, spacing, shoulder = rng.uniform(450.0, 1400.0), rng.uniform(17.0, 45.0), rng.uniform(2.0, 9.0)
    first = rng.uniform(2.0, 30.0)
    half = spacing / 2 + shoulder
    lines = strip_lines(Strip((first, 0.0), 0.0, (spacing, spacing), (length - first - 8.0,) * 2))
    sides = [[(0.0, side * half), (length, side * half)] for side in (-1.0, 1.0)]
    edges = deck_edges(length, sides, lines, min(shoulder, WIDE_MARGIN_M))
    height = rng.uniform(0.15, 0.5)
    return Layout(*edges, *lines, height, random_pose(height, rng), sea_z_m=0.0, on_land=True)


def random_pose(height_m: float, rng: Generator) -> RigidTransform:
    """World from ship of a ship at rest."""
    stern = np.array([*rng.uniform(-PLACED_M, PLACED_M, 2), -height_m])
    return RigidTransform.from_components(stern, Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)))


def random_edges(length_m: float, lines_m: Lines, rng: Generator) -> Edges:
    """A random deck edge around the lines."""
    margin = EDGE_MARGIN_M + (rng.uniform(1.0, 3.0) if length_m < 150.0 else rng.uniform(2.0, 7.0))
    same = EDGE_SHAPES[rng.integers(4)] if rng.random() < 0.35 else None
    edges = []
    for side, line in zip((-1.0, 1.0), lines_m, strict=True):
        half = max(abs(line[0, 1]) + margin, length_m * rng.uniform(0.05, 0.11))
        shape = EDGE_SHAPES[rng.choice(4, p=[0.3, 0.4, 0.12, 0.18])] if same is None else same
        corners = random_corners(shape, length_m, half, rng)
        if rng.random() < 0.4:  # stern corner cut away
            corners = [(0.0, corners[0][1] * rng.uniform(0.5, 0.95)), (rng.uniform(5.0, 18.0), half), *corners[1:]]
        edges.append([(x, side * y) for x, y in sorted(corners)])
    return deck_edges(length_m, edges, lines_m, margin)


def random_corners(shape: str, length_m: float, half_m: float, rng: Generator) -> list[Point]:
    """Corners of one deck edge, x and distance from the axis.

    `stepped`: wider amidships; `sponsons`: one or two before a long narrowing bow, as on carriers with catapults;
    `straight`: a rectangle, its bow corners perhaps cut; `tapered`: widest amidships, with a narrow bow.
    """
    if shape == "stepped":
        out, back = np.sort(rng.uniform(0.1, 0.85, 2)) * length_m
        step, wide = rng.uniform(2.0, 25.0), half_m * rng.uniform(1.0, 1.5)
        corners = [(0.0, half_m), (out, half_m), (min(out + step, back), wide), (back, wide)]
        corners += [(min(back + step, 0.9 * length_m), half_m), (0.93 * length_m, half_m)]
        return [*corners, (length_m, half_m * rng.uniform(0.3, 1.0))]
    if shape == "sponsons":
        corners = [(0.0, half_m)]
        for begin, end in pairwise(np.linspace(0.08, 0.78, rng.integers(1, 3) + 1) * length_m):
            a, b = np.sort(begin + (end - begin) * rng.uniform(0.05, 0.95, 2))
            wide = half_m * rng.uniform(1.1, 1.8)
            inner = (b - rng.uniform(0.1, 0.5) * (b - a), wide)
            corners += [(a, half_m), (a + 0.15 * (b - a), wide), inner, (b, half_m)]
        bow = half_m * rng.uniform(0.45, 0.85)
        return [*corners, (0.83 * length_m, (half_m + bow) / 2), (length_m, bow * rng.uniform(0.7, 1.0))]
    if shape == "straight":
        return [(0.0, half_m), (length_m * rng.uniform(0.88, 0.99), half_m), (length_m, half_m * rng.uniform(0.4, 1.0))]
    corners = [(0.0, half_m * rng.uniform(0.8, 1.0))]
    for least, greatest, narrow, wide in ((0.15, 0.45, 1.0, 1.3), (0.55, 0.75, 0.9, 1.1)):
        corners.append((length_m * rng.uniform(least, greatest), half_m * rng.uniform(narrow, wide)))
    return [*corners, (length_m, half_m * rng.uniform(0.2, 0.6))]


def runway_distance(layout: Layout, points_m: Array) -> Array:
    """How far deck points (..., 2) lie outside the strip between the runway lines; negative inside.

    The strip goes on beyond both ends of the lines.
    """
    sides = ((layout.left_m, -1.0), (layout.right_m, 1.0))
    return np.maximum(*(side * ((points_m - line[0]) @ axes(*line)[1]) for line, side in sides))


def edge_distance(layout: Layout, points_m: Array) -> Array:
    """How far deck points (..., 2) lie inside the deck's edge, measured across and along the ship; negative outside."""
    x, y = points_m[..., 0], points_m[..., 1]
    port, starboard = layout.edges_at(x)
    return np.minimum.reduce([y - port, starboard - y, x, layout.length_m - x])


def has_room(layout: Layout, runway: bool, polygon_m: Array, edge_m: float = 0.0) -> bool:
    """Whether a footprint (N, 2) lies on the deck, `edge` inside its edge, and clear of the runway if there is one."""
    if np.min(edge_distance(layout, polygon_m)) < edge_m:
        return False
    return not runway or bool(np.min(runway_distance(layout, polygon_m)) >= CLEAR_M)


def before_end(layout: Layout, points_m: Array, beyond_m: float = BEYOND_M) -> NDArray[np.bool_]:
    """Which deck points (..., 2) lie astern of a cross line so far beyond the runway's end."""
    along, _, length = axes(*layout.centre_m)
    far = max(length, *(axes(*line)[2] for line in (layout.left_m, layout.right_m))) + beyond_m
    return (points_m - layout.centre_m[0]) @ along < far


def clear_runway(layout: Layout, mesh: Mesh) -> Mesh:
    """A mesh without the faces above the deck that reach too close to the runway: a yard's end, a rail's corner."""
    points = mesh[:, :2].astype(np.float64)
    close = (mesh[:, 2] < -FLUSH_M) & (runway_distance(layout, points) < CLEAR_M) & before_end(layout, points)
    return mesh[np.repeat(~close.reshape(-1, 3).any(axis=1), 3)]
