"""Everything of a ship that is not flat paint: hull, sponsons, island, aircraft and vehicles on deck."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.sim.layout import Layout
from deckline.sim.mesh import Mesh, box, disc, frustum, join, outward, place, rectangle, triangles
from deckline.sim.paint import axes

SLAB_M = 1.6  # depth of the deck's edge
GREY = np.array([0.98, 1.0, 1.03])


@dataclass(frozen=True, eq=False)
class Structure:
    """Solids, and the hull's width where the wake begins."""

    mesh: Mesh
    stern_half_m: float  # half width of the hull at the water's edge of the stern


def build_structure(layout: Layout, runway: bool, rng: np.random.Generator) -> Structure:
    """Random solids around a deck, none of them on the runway."""
    paint = rng.uniform(0.25, 0.6) * GREY * rng.uniform(0.95, 1.05, 3)
    hull, stern_half = hull_mesh(layout, paint, rng)
    island = island_mesh(layout, runway, paint, rng)
    parked = parked_mesh(layout, runway, rng)
    mesh = join([slab_mesh(layout, paint, rng), hull, island, parked])
    return Structure(mesh, stern_half)


def slab_mesh(layout: Layout, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """Edge and underside of the deck; the stern may be a painted round-down."""
    edge = layout.outline_m
    n = len(layout.stations_m)
    inset = edge.copy()
    inset[0, 0] = inset[-1, 0] = -rng.uniform(0.0, 1.5)
    walls = frustum(inset, SLAB_M, edge, 0.0, paint * rng.uniform(0.5, 1.1), cap=False)
    if rng.random() < 0.45:
        ramp = np.flatnonzero(np.all(walls[:, 0].reshape(-1, 3) < 0.01, axis=1))
        shade = rng.uniform(0.5, 0.95)
        for k in ramp:
            walls[3 * k : 3 * k + 3, 6:] = shade
    under = np.array(
        [[[*edge[k], SLAB_M], [*edge[k + 1], SLAB_M], [*edge[2 * n - 1 - k], SLAB_M]] for k in range(n - 1)]
        + [
            [[*edge[k + 1], SLAB_M], [*edge[2 * n - 2 - k], SLAB_M], [*edge[2 * n - 1 - k], SLAB_M]]
            for k in range(n - 1)
        ]
    )
    return join([walls, outward(triangles(under, paint * 0.5), (layout.length_m / 2, 0.0, 0.0))])


def hull_mesh(layout: Layout, paint: NDArray[np.float64], rng: np.random.Generator) -> tuple[Mesh, float]:
    """Flared hull with a flat stern, and sponsons under the deck's overhangs."""
    height, length = layout.deck_height_m, layout.length_m
    beam = rng.uniform(0.28, 0.42) * float(np.median(layout.starboard_m - layout.port_m))
    x = np.array([rng.uniform(1.0, 6.0), 0.3 * length, 0.7 * length, 0.88 * length, 0.97 * length])
    water = beam * np.array([rng.uniform(0.75, 1.0), 1.0, 0.95, 0.55, 0.04])
    top = beam * np.array([rng.uniform(0.95, 1.15), 1.1, 1.1, 0.95, 0.6])
    port, starboard = (np.interp(x, layout.stations_m, edge) for edge in (layout.port_m, layout.starboard_m))
    right, left = np.minimum(top, starboard - 0.5), np.minimum(top, -port - 0.5)
    low = np.concatenate([np.column_stack([x, water]), np.column_stack([x, -water])[::-1]])
    high = np.concatenate([np.column_stack([x, right]), np.column_stack([x, -left])[::-1]])
    parts = [frustum(low, height, high, SLAB_M, paint, cap=False)]
    parts += stern_details(x[0], left[0], right[0], height, paint, rng)
    for edge, side in ((layout.port_m, -1.0), (layout.starboard_m, 1.0)):
        for _ in range(rng.integers(1, 5)):
            parts.append(sponson(layout, edge, side, beam, paint, rng))
    return join(parts), float(water[0])


def stern_details(
    x_m: float, left_m: float, right_m: float, height_m: float, paint: NDArray[np.float64], rng: np.random.Generator
) -> list[Mesh]:
    """Dark opening, galleries and a drop line on the stern."""
    parts = []

    def panel(y0: float, y1: float, up0: float, up1: float, rgb: ArrayLike, out: float) -> Mesh:
        x = x_m - out
        z0, z1 = height_m * (1 - up0), height_m * (1 - up1)
        z1 = max(z1, SLAB_M)
        corners = np.array([[[x, y0, z0], [x, y1, z0], [x, y1, z1]], [[x, y0, z0], [x, y1, z1], [x, y0, z1]]])
        return outward(triangles(corners, rgb), (x_m + 50.0, 0.0, height_m / 2))

    if rng.random() < 0.65:
        reach, low = rng.uniform(0.4, 0.85), rng.uniform(0.3, 0.55)
        shade = paint * rng.uniform(0.15, 0.6)
        parts.append(panel(-left_m * reach, right_m * reach, low, low + rng.uniform(0.12, 0.4), shade, 0.4))
    for _ in range(rng.integers(0, 5)):
        y, up = rng.uniform(-left_m, right_m * 0.5), rng.uniform(0.1, 0.8)
        shade = paint * rng.uniform(0.3, 1.5)
        parts.append(panel(y, y + rng.uniform(2, 12), up, up + rng.uniform(0.02, 0.1), shade, 0.6))
    if rng.random() < 0.5:
        y, low = rng.uniform(-0.2, 0.3) * right_m, rng.uniform(0.1, 0.5)
        white = rng.uniform(0.6, 0.95)
        parts.append(panel(y - 0.5, y + 0.5, low, 0.97, [white] * 3, 0.8))
        if rng.random() < 0.6:
            parts.append(panel(y - 0.5, y + 0.5, low + 0.12, 0.75, (0.8, 0.65, 0.1), 1.0))
    return parts


def sponson(
    layout: Layout,
    edge_m: NDArray[np.float64],
    side: float,
    beam_m: float,
    paint: NDArray[np.float64],
    rng: np.random.Generator,
) -> Mesh:
    """A wedge that carries an overhanging part of the deck."""
    x = rng.uniform(0.0, 0.75) * layout.length_m
    reach = rng.uniform(10.0, 60.0)
    inside = np.interp([x, x + reach], layout.stations_m, edge_m) * rng.uniform(0.9, 1.12)
    top = np.array([[x, side * beam_m * 0.9], [x, inside[0]], [x + reach, inside[1]], [x + reach, side * beam_m * 0.9]])
    low = top.copy()
    low[1:3, 1] = side * beam_m * 1.02
    z = rng.uniform(SLAB_M + 0.5, 4.5)
    return frustum(low, layout.deck_height_m * rng.uniform(0.4, 0.75), top, z, paint * rng.uniform(0.8, 1.15))


def runway_distance(layout: Layout, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far deck points (N, 2) lie outside the strip between the runway lines; negative inside."""
    distances = []
    for line, side in ((layout.left_m, -1.0), (layout.right_m, 1.0)):
        _, right, _ = axes(*line)
        distances.append(side * ((points_m - line[0]) @ right))
    return np.maximum(distances[0], distances[1])


def island_mesh(layout: Layout, runway: bool, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """Zero to two islands of stacked blocks with a mast and radars, to starboard where there is room."""
    parts = []
    for _ in range(rng.choice([0, 1, 2], p=[0.07, 0.75, 0.18])):
        size = np.array([rng.uniform(14, 45), rng.uniform(7, 12)])
        for _ in range(12):
            x = rng.uniform(0.25, 0.75) * layout.length_m
            y = float(np.interp(x, layout.stations_m, layout.starboard_m)) - size[1] / 2 - rng.uniform(-3.0, 3.0)
            base = rectangle(x, y, size[0], size[1])
            if not runway or np.min(runway_distance(layout, base)) > 4.0:
                break
        else:
            continue
        up, tint = 0.0, paint * rng.uniform(0.85, 1.2)
        for _ in range(rng.integers(2, 5)):
            rise, shrink = rng.uniform(2.5, 6.0), rng.uniform(0.75, 1.0)
            upper = (base - [x, y]) * shrink + [x, y]
            parts.append(frustum(base, -up, upper, -up - rise, tint))
            parts.append(box(x, y, -up - rise + 1.4, (*(np.ptp(upper, axis=0) + 0.3), 0.9), 0.0, tint * 0.25))
            base, up = upper * 1.0 + [rng.uniform(-1, 1), 0.0], up + rise
        parts.append(mast_mesh(x, y, up, tint, rng))
    return join(parts)


def mast_mesh(x_m: float, y_m: float, up_m: float, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """A pole with yards and radar antennas."""
    rise, thick = rng.uniform(8.0, 24.0), rng.uniform(0.4, 2.0)
    low, top = disc(x_m, y_m, thick, 6), disc(x_m, y_m, thick * 0.4, 6)
    parts = [frustum(low, -up_m, top, -up_m - rise, paint)]
    for _ in range(rng.integers(2, 6)):
        z = -up_m - rise * rng.uniform(0.2, 1.0)
        size = (rng.uniform(0.3, 1.2), rng.uniform(2.0, 10.0), rng.uniform(0.2, 2.5))
        parts.append(box(x_m + rng.uniform(-2, 2), y_m, z, size, rng.uniform(-0.6, 0.6), paint * rng.uniform(0.6, 1.3)))
    if rng.random() < 0.4:
        ball = disc(x_m - 3.0, y_m, rng.uniform(1.0, 2.2), 8)
        parts.append(frustum(ball, -up_m, ball, -up_m - 2.5, np.ones(3) * 0.75))
    return join(parts)


def parked_mesh(layout: Layout, runway: bool, rng: np.random.Generator) -> Mesh:
    """Aircraft and vehicles on the rest of the deck, sometimes many, sometimes none."""
    parts = []
    colours = [
        (0.55, 0.57, 0.6),
        (0.4, 0.42, 0.45),
        (0.75, 0.6, 0.1),
        (0.8, 0.8, 0.8),
        (0.5, 0.12, 0.1),
        (0.25, 0.3, 0.22),
    ]
    for _ in range(rng.integers(0, 30)):
        x = rng.uniform(0.05, 0.95) * layout.length_m
        y, yaw = rng.uniform(*layout.edges_at(x)), rng.uniform(-np.pi, np.pi)
        aircraft = rng.random() < 0.65
        size = rng.uniform(10.0, 18.0) if aircraft else rng.uniform(2.0, 7.0)
        shape = rectangle(x, y, size, size * 0.6, yaw)
        if runway and np.min(runway_distance(layout, shape)) < 3.5:
            continue
        rgb = np.array(colours[rng.integers(2) if aircraft else rng.integers(len(colours))]) * rng.uniform(0.7, 1.2)
        parts.append(aircraft_mesh(x, y, yaw, size, rgb) if aircraft else vehicle_mesh(x, y, yaw, size, rgb, rng))
    return join(parts)


def aircraft_mesh(x_m: float, y_m: float, yaw_rad: float, size_m: float, rgb: NDArray[np.float64]) -> Mesh:
    """Fuselage, wings and twin fins."""
    body = place(
        np.array([[-0.5, -0.07], [0.25, -0.07], [0.5, -0.01], [0.5, 0.01], [0.25, 0.07], [-0.5, 0.07]]) * size_m,
        x_m,
        y_m,
        yaw_rad,
    )
    wing = place(
        np.array([[-0.3, -0.38], [-0.15, -0.38], [0.15, 0.0], [-0.15, 0.38], [-0.3, 0.38], [-0.25, 0.0]]) * size_m,
        x_m,
        y_m,
        yaw_rad,
    )
    parts = [frustum(body, -0.9, body, -2.3, rgb), frustum(wing, -1.6, wing, -1.9, rgb * 0.9)]
    for side in (-0.1, 0.1):
        fx, fy = place(np.array([[-0.42 * size_m, side * size_m]]), x_m, y_m, yaw_rad)[0]
        parts.append(box(fx, fy, -1.9, (0.16 * size_m, 0.15, 2.4), yaw_rad, rgb * 0.95))
    return join(parts)


def vehicle_mesh(
    x_m: float, y_m: float, yaw_rad: float, size_m: float, rgb: NDArray[np.float64], rng: np.random.Generator
) -> Mesh:
    """A box on a box: tractors, cranes, crates."""
    low = box(x_m, y_m, 0.0, (size_m, size_m * 0.5, rng.uniform(0.8, 2.0)), yaw_rad, rgb)
    top = box(x_m, y_m, -1.2, (size_m * 0.35, size_m * 0.4, rng.uniform(0.5, 4.0)), yaw_rad, rgb * 0.8)
    return join([low, top])
