"""Where the deck's edge and the runway lines are.

Ship frame: x forward along the ship's axis, y to starboard, z down, origin on the deck plane at the stern.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.sim.ship.deck_edge import EDGE_MARGIN_M, outline, random_outline
from deckline.sim.ship.ship_class import Place, ShipClass, Strip, WorldLines, load_class

DeckKind = Literal["large", "medium", "axial", "small", "variant", "land"]
DECKS: dict[DeckKind, float] = {
    "large": 0.28, "medium": 0.20, "axial": 0.17, "small": 0.10, "variant": 0.21, "land": 0.04,
}  # fmt: skip
VARIED = {"cvn": 0.6, "axial": 0.25, "small": 0.15}  # classes whose decks are stretched into variants
MIRRORED = 0.08  # part of the variants whose port is to starboard
TO_PORT = 0.85  # part of the angled decks whose runway turns to port
PLACED_M = 400.0  # how far from the world's origin a ship may lie, north and east


@dataclass(frozen=True, eq=False)
class Layout:
    """Deck outline and runway lines of one ship."""

    stations_m: NDArray[np.float64]  # (N,) increasing x of the outline's corners
    port_m: NDArray[np.float64]  # (N,) y of the deck's port edge
    starboard_m: NDArray[np.float64]  # (N,) y of its starboard edge
    left_m: NDArray[np.float64]  # (2, 2) middle of the left edge marking: ramp end, far end
    right_m: NDArray[np.float64]  # (2, 2)
    deck_height_m: float  # above the water
    world_from_ship: RigidTransform  # where the ship is now; at rest until `posed`
    sea_z_m: float  # world z of the water, or of the ground under a land runway
    on_land: bool = False  # a runway on land: no hull, no water

    @property
    def length_m(self) -> float:
        return float(self.stations_m[-1])

    def posed(self, world_from_ship: RigidTransform) -> "Layout":
        """The same ship elsewhere: under way, rolling, pitching, heaving. The water stays where it is."""
        return replace(self, world_from_ship=world_from_ship)

    @property
    def outline_m(self) -> NDArray[np.float64]:
        """Deck edge (2 N, 2): port from stern to bow, starboard back."""
        port = np.column_stack([self.stations_m, self.port_m])
        return np.concatenate([port, np.column_stack([self.stations_m, self.starboard_m])[::-1]])

    def edges_at(self, x_m: float) -> tuple[float, float]:
        """Port and starboard edge, y, at a station."""
        port, starboard = (np.interp(x_m, self.stations_m, edge) for edge in (self.port_m, self.starboard_m))
        return float(port), float(starboard)

    @property
    def centre_m(self) -> NDArray[np.float64]:
        """Centre line (2, 2): ramp end, far end."""
        return (self.left_m + self.right_m) / 2

    @property
    def spacing_m(self) -> float:
        """Distance between the lines' beginnings."""
        return float(np.hypot(*(self.right_m[0] - self.left_m[0])))


def world_points(layout: Layout, points_m: NDArray[np.float64], up_m: float = 0.0) -> NDArray[np.float64]:
    """Deck points (N, 2) of the ship frame, raised by `up`, in the world (N, 3)."""
    return layout.world_from_ship.apply(np.column_stack([points_m, np.full(len(points_m), -up_m)]))


def class_layout(ship: ShipClass) -> Layout:
    """Layout of a ship class."""
    place = ship.place
    world_from_ship = RigidTransform.from_components(
        np.array([*place.stern_m, place.sea_z_m - ship.deck_height_m]),
        Rotation.from_euler("z", np.deg2rad(place.heading_deg)),
    )
    if ship.strip is not None:
        strip = ship.strip
        left, right = angled_lines(strip.start_m, np.deg2rad(strip.port_angle_deg), strip.spacing_m, strip.lengths_m)
    elif ship.world_lines is not None:
        left, right = world_lines(ship.world_lines, world_from_ship)
    elif ship.lines is not None:
        left, right = np.array(ship.lines.left_m), np.array(ship.lines.right_m)
    edges = outline(ship.length_m, ship.port_m, ship.starboard_m, left, right)
    return Layout(*edges, left, right, ship.deck_height_m, world_from_ship, place.sea_z_m, ship.on_land)


def world_lines(lines: WorldLines, world_from_ship: RigidTransform) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Left and right line (2, 2) in the ship frame of two that are given in the world, on the deck plane."""
    found = []
    for slope, constant in (lines.left, lines.right):
        end_x = lines.start_x_m - lines.length_m / np.hypot(1.0, slope)
        z = world_from_ship.translation[2]
        world = np.array([[x, -constant - slope * x, z] for x in (lines.start_x_m, end_x)])
        found.append(world_from_ship.inv().apply(world)[:, :2])
    return found[0], found[1]


def angled_lines(
    start_m: tuple[float, float], port_angle_rad: float, spacing_m: tuple[float, float], lengths_m: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Left and right line (2, 2) about a centre line that starts at `start` and turns to port.

    The spacing goes from the first number at the ramp to the second at the end of the longer line.
    """
    along = np.array([np.cos(port_angle_rad), -np.sin(port_angle_rad)])
    right = np.array([-along[1], along[0]])
    lines = []
    for side, length in zip((-0.5, 0.5), lengths_m, strict=True):
        end_spacing = spacing_m[0] + (spacing_m[1] - spacing_m[0]) * length / max(lengths_m)
        first = np.asarray(start_m) + side * spacing_m[0] * right
        last = np.asarray(start_m) + length * along + side * end_spacing * right
        lines.append(np.array([first, last]))
    return lines[0], lines[1]


def random_layout(rng: np.random.Generator) -> Layout:
    """Size, deck shape, angle and lines are drawn widely."""
    kind = list(DECKS)[rng.choice(len(DECKS), p=list(DECKS.values()))]
    if kind == "land":
        return _land_layout(rng)
    if kind == "variant":
        return class_layout(class_variant(load_class(list(VARIED)[rng.choice(3, p=list(VARIED.values()))]), rng))
    return ship_layout(kind, rng)


def class_variant(ship: ShipClass, rng: np.random.Generator) -> ShipClass:
    """A class with a strip, stretched, bent and laid elsewhere; only its deck and lines still matter.

    Raises:
        ValueError: a class whose lines are not given as a strip.
    """
    if ship.strip is None:
        raise ValueError(f"only a ship with a strip can be varied, got {ship.name}")
    sx, sy, hand = rng.uniform(0.82, 1.06), rng.uniform(0.85, 1.15), 1.0 if rng.random() >= MIRRORED else -1.0
    edges = []
    for corners in (ship.port_m, ship.starboard_m):
        moved = [hand * (y * sy + rng.normal(0.0, 0.003 * ship.length_m)) for _, y in corners]
        edges.append(tuple((x * sx, y) for (x, _), y in zip(corners, moved, strict=True)))
    strip, spacing = ship.strip, sy * rng.uniform(0.9, 1.1) * ship.strip.spacing_m[0]
    angle_deg = strip.port_angle_deg + rng.normal(0.0, 1.2 if strip.port_angle_deg else 0.3)
    begin = rng.uniform(0.5, 4.0) + spacing / 2 * abs(np.sin(np.deg2rad(angle_deg)))  # both lines begin on the deck
    strip = Strip(
        (float(begin), hand * strip.start_m[1] * sy),
        hand * angle_deg,
        (spacing, spacing * (1.0 if rng.random() < 0.6 else rng.uniform(0.9, 1.03))),
        (strip.lengths_m[0] * sx * rng.uniform(0.88, 1.0), strip.lengths_m[1] * sx * rng.uniform(0.88, 1.0)),
    )
    height = ship.deck_height_m * rng.uniform(0.75, 1.15)
    stern = rng.uniform(-PLACED_M, PLACED_M, 2)
    place = Place((float(stern[0]), float(stern[1])), rng.uniform(-180.0, 180.0))
    port, starboard = edges if hand > 0.0 else edges[::-1]
    return replace(
        ship,
        length_m=ship.length_m * sx,
        deck_height_m=height,
        port_m=port,
        starboard_m=starboard,
        strip=strip,
        place=place,
    )


def ship_layout(kind: DeckKind, rng: np.random.Generator) -> Layout:
    """A ship of one kind."""
    length, height, spacing, angle = _sizes(kind, rng)
    hand = 1.0 if rng.random() < TO_PORT else -1.0
    runway = min(rng.uniform(0.5, 0.9) * length, rng.uniform(230.0, 260.0), length - 12.0)
    lengths = tuple(runway * (1.0 - rng.uniform(0.0, 0.12, 2)))
    closing = 1.0 if rng.random() < 0.6 else rng.uniform(0.88, 1.04)
    offset = hand * np.sin(angle) * runway * rng.uniform(0.0, 0.45) + rng.uniform(-0.15, 0.15) * spacing
    if kind == "axial" and rng.random() < 0.7:  # room for an island to starboard
        offset -= rng.uniform(0.1, 0.35) * spacing
    start = (rng.uniform(0.5, 6.0) + spacing / 2 * np.sin(angle), offset)  # both lines begin on the deck
    left, right = angled_lines(start, hand * angle, (spacing, spacing * closing), (lengths[0], lengths[1]))
    edges = random_outline(length, left, right, rng)
    return Layout(*edges, left, right, height, _somewhere(height, rng), sea_z_m=0.0)


def _sizes(kind: DeckKind, rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Deck length, height and line spacing, m, and the runway's angle, rad."""
    if kind == "small":
        angle = 0.0 if rng.random() < 0.5 else np.deg2rad(rng.uniform(1.0, 6.0))
        return rng.uniform(85.0, 140.0), rng.uniform(8.0, 14.0), rng.uniform(10.0, 15.0), angle
    if kind == "axial":
        angle = 0.0 if rng.random() < 0.8 else np.deg2rad(rng.uniform(0.5, 2.5))
        return rng.uniform(150.0, 285.0), rng.uniform(13.0, 22.0), rng.uniform(13.0, 24.0), angle
    angle = np.deg2rad(rng.uniform(3.0, 11.0))
    if kind == "medium":
        return rng.uniform(170.0, 270.0), rng.uniform(11.0, 18.0), rng.uniform(13.5, 22.0), angle
    return rng.uniform(260.0, 345.0), rng.uniform(15.0, 23.0), rng.uniform(18.0, 29.0), angle


def _land_layout(rng: np.random.Generator) -> Layout:
    """A straight runway with shoulders."""
    length, spacing, shoulder = rng.uniform(450.0, 1400.0), rng.uniform(17.0, 45.0), rng.uniform(2.0, 9.0)
    first = rng.uniform(2.0, 30.0)
    half = spacing / 2 + shoulder
    left, right = angled_lines((first, 0.0), 0.0, (spacing, spacing), (length - first - 8.0,) * 2)
    corners = [[(0.0, side * half), (length, side * half)] for side in (-1.0, 1.0)]
    edges = outline(length, corners[0], corners[1], left, right, min(shoulder, EDGE_MARGIN_M + 2.0))
    height = rng.uniform(0.15, 0.5)
    return Layout(*edges, left, right, height, _somewhere(height, rng), sea_z_m=0.0, on_land=True)


def _somewhere(height_m: float, rng: np.random.Generator) -> RigidTransform:
    return RigidTransform.from_components(
        np.array([*rng.uniform(-PLACED_M, PLACED_M, 2), -height_m]),
        Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)),
    )
