"""Where the deck's edge and the runway lines are.

Ship frame: x forward along the ship's axis, y to starboard, z down, origin on the deck plane at the stern.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

# Table 6 of the paper: w1 x + y + w0 = 0 in the world, z in metres down.
PAPER_LEFT = (0.16300, -35.788523)
PAPER_RIGHT = (0.15632, -20.889669)
PAPER_DECK_Z_M = 6.08
# Our reading. The lines run 9.07 degrees from the world's x axis, and the class's landing area lies about 9 degrees
# to port of the ship's axis, so the ship heads along -x. The published position of the carrier's model (y = 47.2)
# would put the ramp 20 m to starboard; 32 m puts the lines on the deck as on the real ships.
PAPER_STERN_M = (10.0, 32.0)
PAPER_LENGTH_M = 220.0
PAPER_DECK_HEIGHT_M = 20.0
CVN_SIZE_M = (332.85, 76.8)  # flight deck of the class, SPEC section 7
CVN_ANGLE_RAD = np.deg2rad(8.49)  # this and the next three: SPEC section 7, measured on a public model
CVN_SPACING_M = 21.8
CVN_LINES_M = (218.0, 239.0)
CVN_DECK_HEIGHT_M = 20.0
STATION_M = 2.5  # spacing of the deck edge's corners
EDGE_MARGIN_M = 1.5  # deck that is always left outside a runway line's middle, beside half its marking


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


def world_points(layout: Layout, points_m: NDArray[np.float64], up_m: float = 0.0) -> NDArray[np.float64]:
    """Deck points (N, 2) of the ship frame, raised by `up`, in the world (N, 3)."""
    return layout.world_from_ship.apply(np.column_stack([points_m, np.full(len(points_m), -up_m)]))


def paper_layout() -> Layout:
    """The ship that carries the paper's published lines (SPEC section 4, Table 6)."""
    world_from_ship = RigidTransform.from_components(
        np.array([*PAPER_STERN_M, PAPER_DECK_Z_M]), Rotation.from_euler("z", np.pi)
    )
    lines = []
    for slope, constant in (PAPER_LEFT, PAPER_RIGHT):
        start_x = PAPER_STERN_M[0] - 2.5
        end_x = start_x - PAPER_LENGTH_M / np.hypot(1.0, slope)
        world = np.array([[x, -constant - slope * x, PAPER_DECK_Z_M] for x in (start_x, end_x)])
        lines.append(world_from_ship.inv().apply(world)[:, :2])
    stations, port, starboard = cvn_outline(lines[0], lines[1])
    sea_z = PAPER_DECK_Z_M + PAPER_DECK_HEIGHT_M
    return Layout(stations, port, starboard, lines[0], lines[1], PAPER_DECK_HEIGHT_M, world_from_ship, sea_z)


def cvn_layout() -> Layout:
    """A large carrier: world north is ahead, the water is at world z = 0."""
    left, right = angled_lines((2.5, 5.0), CVN_ANGLE_RAD, (CVN_SPACING_M, CVN_SPACING_M), CVN_LINES_M)
    stations, port, starboard = cvn_outline(left, right)
    world_from_ship = RigidTransform.from_translation([0.0, 0.0, -CVN_DECK_HEIGHT_M])
    return Layout(stations, port, starboard, left, right, CVN_DECK_HEIGHT_M, world_from_ship, sea_z_m=0.0)


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


def cvn_outline(
    left_m: NDArray[np.float64], right_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Deck edge of the class, close to public plans: stations, port, starboard."""
    length, width = CVN_SIZE_M
    port = [(0.0, -18.0), (25.0, -21.0), (60.0, -23.0), (75.0, -39.0), (205.0, -41.0), (228.0, -25.0)]
    port += [(300.0, -17.0), (length, -11.0)]
    starboard = [(0.0, 21.0), (40.0, 22.0), (60.0, 33.0), (195.0, width - 41.0), (225.0, 26.0)]
    starboard += [(300.0, 17.0), (length, 11.0)]
    return outline(length, port, starboard, left_m, right_m)


def outline(
    length_m: float,
    port: list[tuple[float, float]],
    starboard: list[tuple[float, float]],
    left_m: NDArray[np.float64],
    right_m: NDArray[np.float64],
    margin_m: float = EDGE_MARGIN_M + 2.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Deck edge through corner points, widened where a runway line needs deck under it."""
    stations = np.linspace(0.0, length_m, round(length_m / STATION_M) + 1)
    edge_port = np.interp(stations, *np.transpose(port))
    edge_starboard = np.interp(stations, *np.transpose(starboard))
    for line in (left_m, right_m):
        on_line = (stations >= line[0, 0] - 6.0) & (stations <= line[1, 0] + 4.0)
        across = np.interp(stations[on_line], line[:, 0], line[:, 1])
        edge_port[on_line] = np.minimum(edge_port[on_line], across - margin_m)
        edge_starboard[on_line] = np.maximum(edge_starboard[on_line], across + margin_m)
    return stations, edge_port, edge_starboard


def random_layout(rng: np.random.Generator) -> Layout:
    """A ship that nobody built: size, deck shape, angle and lines are drawn widely."""
    length = rng.uniform(150.0, 345.0)
    height = rng.uniform(10.0, 25.0)
    spacing = rng.uniform(14.0, 30.0)
    angle = 0.0 if rng.random() < 0.15 else np.deg2rad(rng.uniform(2.0, 11.0))
    hand = 1.0 if rng.random() < 0.85 else -1.0
    runway = min(rng.uniform(100.0, 260.0), length * rng.uniform(0.6, 0.95), length - 12.0)
    lengths = tuple(runway * (1.0 - rng.uniform(0.0, 0.12, 2)))
    closing = 1.0 if rng.random() < 0.6 else rng.uniform(0.88, 1.04)
    offset = hand * np.sin(angle) * runway * rng.uniform(0.0, 0.45) + rng.uniform(-4.0, 4.0)
    start = (rng.uniform(0.5, 6.0) + spacing / 2 * np.sin(angle), offset)  # both lines begin on the deck
    left, right = angled_lines(start, hand * angle, (spacing, spacing * closing), (lengths[0], lengths[1]))
    stations, port, starboard = random_outline(length, left, right, rng)
    world_from_ship = RigidTransform.from_components(
        np.array([*rng.uniform(-400.0, 400.0, 2), -height]), Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
    )
    return Layout(stations, port, starboard, left, right, height, world_from_ship, sea_z_m=0.0)


def random_outline(
    length_m: float, left_m: NDArray[np.float64], right_m: NDArray[np.float64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """A random deck edge around the lines."""
    margin = EDGE_MARGIN_M + rng.uniform(2.0, 7.0)
    edges = []
    for side, stern in ((-1.0, left_m[0, 1]), (1.0, right_m[0, 1])):
        half = max(abs(stern) + margin, length_m * rng.uniform(0.05, 0.09))
        wide = half * rng.uniform(1.0, 1.5)
        out, back = np.sort(rng.uniform(0.1, 0.85, 2)) * length_m
        step = rng.uniform(2.0, 25.0)
        bow = half * rng.uniform(0.3, 1.0)
        corners = [(0.0, half), (out, half), (min(out + step, back), wide), (back, wide)]
        corners += [(min(back + step, 0.9 * length_m), half), (0.93 * length_m, half), (length_m, bow)]
        edges.append([(x, side * y) for x, y in corners])
    return outline(length_m, edges[0], edges[1], left_m, right_m, margin)
