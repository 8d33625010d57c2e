"""Everything of a ship that is not flat paint: its deck, hull, islands with masts, and deck clutter."""

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from deckline_sim.ship import mesh as m
from deckline_sim.ship.clutter import build_clutter
from deckline_sim.ship.hull import (
    SLAB_M,
    build_fittings,
    build_hull,
    digits,
    random_form,
    random_hull,
    side_ring,
)
from deckline_sim.ship.layout import CLEAR_M, Layout, before_end, clear_runway, has_room, runway_distance
from deckline_sim.ship.mesh import Array, Mesh
from deckline_sim.ship.ship_class import Hull, Island, ShipClass

STRAIGHT = 1e-5  # change of an edge's slope that makes no corner
GLASS = np.array([0.07, 0.08, 0.1])
NO_ISLAND = 0.08  # part of the random ships that have none
STOREY_M = 2.9
OVERHANG = 0.95  # share of an island's width that may overhang the deck's edge


def build_structure(layout: Layout, runway: bool, rng: Generator, spec: ShipClass | None = None) -> tuple[Mesh, float]:
    """Solids around a deck; above it, none between the runway's lines or close to them.

    Args:
        layout: deck and runway lines of a ship.
        runway: whether there are lines to leave clear.
        rng: of all that is random.
        spec: the ship's class, whose hull and islands are built; without one they are drawn at random.

    Returns:
        The solids, and half the width of the hull at the water's edge of the stern, where the wake begins.
    """
    hull = random_hull(layout, rng) if spec is None or spec.hull is None else spec.hull
    islands = random_islands(layout, runway, rng) if spec is None else spec.islands
    form = random_form(layout, hull, rng)
    paint = np.array(hull.rgb)
    deck = paint * rng.uniform(0.4, 0.8) if spec is None else np.array(spec.surface.rgb)
    parts = [
        build_slab(layout, runway, paint, rng),
        build_hull(hull, form, rng),
        build_fittings(form, hull.number, paint, rng),
        build_ski_jump(layout, runway, hull, deck),
        *(build_island(layout, island, runway, paint, rng) for island in islands),
        build_clutter(layout, runway, islands, rng),
    ]
    mesh = clear_runway(layout, m.join(parts)) if runway else m.join(parts)
    mesh[:, 6:] = np.clip(mesh[:, 6:], 0.0, 1.0)
    return mesh, float(form.half_width(form.stern_m[0], layout.deck_height_m, 1.0))


def deck_mesh(layout: Layout) -> Mesh:
    """The deck's surface as strips between its edges, facing up."""
    edges = np.column_stack([layout.port_m, layout.starboard_m])
    slopes = np.diff(edges, axis=0) / np.diff(layout.stations_m)[:, None]
    corner = np.concatenate([[True], np.any(np.abs(np.diff(slopes, axis=0)) > STRAIGHT, axis=1), [True]])
    port, starboard = (m.at_height(np.column_stack([layout.stations_m, y])[corner], 0.0) for y in edges.T)
    p0, p1, s1, s0 = m.strip(port, starboard).transpose(1, 0, 2)
    return m.triangles(np.concatenate([np.stack([p0, s1, p1], 1), np.stack([p0, s0, s1], 1)]), (0.0, 0.0, 0.0))


def build_slab(layout: Layout, runway: bool, paint: Array, rng: Generator) -> Mesh:
    """Edge and underside of the deck; the stern may be a round-down, painted or not.

    A round-down is what the hook may strike, curved or cut down, as wide as the runway or the stern.
    """
    edge, n = layout.outline_m, len(layout.stations_m)
    walls = m.frustum(edge, SLAB_M, edge, 0.0, paint * rng.uniform(0.6, 1.1), lid=False)
    under = m.quads(m.strip(m.at_height(edge[:n], SLAB_M), m.at_height(edge[n:][::-1], SLAB_M)), paint * 0.45)
    if rng.random() >= 0.7:
        return m.join([walls, under])
    y0, y1 = layout.port_m[0], layout.starboard_m[0]
    if runway and rng.random() < 0.5:
        spare = rng.uniform(1.5, 4.0)
        y0, y1 = max(y0, layout.left_m[0, 1] - spare), min(y1, layout.right_m[0, 1] + spare)
    reach, drop = rng.uniform(0.3, 3.0), rng.uniform(1.5, 3.5)
    profile = np.array([[0.0, 0.0], [-0.5, 0.15], [-0.85, 0.5], [-1.0, 1.0], [0.0, 1.0]]) * [reach, drop]
    ends = [np.column_stack([profile[:, 0], np.full(5, y), profile[:, 1]]) for y in (y0, y1)]
    white = rng.random() < 0.55
    shade = np.full(3, rng.uniform(0.6, 0.95)) if white else paint * rng.uniform(0.7, 1.1)
    colours = shade * np.array([1.0, 1.0, 1.0, 0.6, 0.6])[:, None]
    return m.join([walls, under, m.loft(ends, colours[None])])


def build_ski_jump(layout: Layout, runway: bool, hull: Hull, rgb: Array) -> Mesh:
    """The bow's ramp: a curved wedge clear of the runway, on the wider side only where the runway passes."""
    if hull.ramp_height_m <= 0 or hull.ramp_length_m <= 0:
        return m.join([])
    x = layout.length_m - hull.ramp_length_m * np.linspace(1.0, 0.0, 9)
    low, high = port, starboard = layout.edges_at(x)
    y = np.linspace(port, starboard, 60)
    points = np.stack([np.broadcast_to(x, y.shape), y], -1)
    blocked = (runway_distance(layout, points) < CLEAR_M + 1.5) & before_end(layout, points, 15.0)
    if runway and blocked.any():
        to_port, to_starboard = np.minimum(starboard, y[blocked].min()), np.maximum(port, y[blocked].max())
        wider = np.min(starboard - to_starboard) >= np.min(to_port - port)
        low, high = (to_starboard, starboard) if wider else (port, to_port)
    if np.min(high - low) < 6.0:
        return m.join([])
    z, zero = -hull.ramp_height_m * np.linspace(0.0, 1.0, 9) ** 1.7, np.zeros(9)
    corners = [(low, zero), (high, zero), (high, z), (low, z)]
    sections = np.stack([np.stack([x, y, up], -1) for y, up in corners], 1)
    return m.loft(sections, rgb * np.array([1.0, 1.1, 1.0, 1.1])[None, :, None])


def random_islands(layout: Layout, runway: bool, rng: Generator) -> tuple[Island, ...]:
    """None to two islands on the side away from the runway, where there is room."""
    islands: list[Island] = []
    across = float(layout.centre_m[1, 1] - layout.centre_m[0, 1])
    side = -1.0 if across > 8.0 or rng.random() < 0.04 else 1.0
    for _ in range(rng.choice([0, 1, 2], p=[NO_ISLAND, 0.77, 0.15])):
        length, width = layout.length_m * rng.uniform(0.05, 0.2), rng.uniform(5.0, 12.5)
        height = float(np.clip(layout.length_m * rng.uniform(0.04, 0.09), 7.0, 27.0))
        for attempt in range(20):
            x = rng.uniform(0.25, 0.75) * layout.length_m
            out = rng.uniform(-5.0, 1.0) if attempt < 8 else rng.uniform(0.0, OVERHANG) * width
            y = side * (layout.half_width_at(x, side) - width / 2 + out)
            apart = all(abs(x - other.middle_m[0]) > (length + other.length_m) / 2 + 6 for other in islands)
            if apart and has_room(layout, runway, m.rectangle(x, y, length + 3.0, width + 3.0), -width - 2.0):
                islands.append(Island((x, y), length, width, height, height * rng.uniform(0.4, 1.4)))
                break
    return tuple(islands)


def build_island(layout: Layout, island: Island, runway: bool, paint: Array, rng: Generator) -> Mesh:
    """One superstructure with its masts, radars, doors and boxes."""
    x, y = island.middle_m
    tint = paint * rng.uniform(0.9, 1.2)
    bevel = rng.uniform(0.08, 0.3)
    base = np.array([[-1, -1 + bevel], [-1 + bevel / 2, -1], [1 - bevel, -1], [1, -1 + 2 * bevel]])
    base = np.concatenate([base, base[::-1] * [1, -1]]) * [island.length_m / 2, island.width_m / 2]
    parts, up = [], 0.0
    levels = max(1, round(island.height_m / STOREY_M / rng.uniform(1.0, 1.8)))
    rise = island.height_m / levels
    narrow, lean = rng.uniform(0.86, 1.0), rng.uniform(0.86, 1.0)
    bridge = int(rng.integers(max(levels - 2, 0), levels))
    shift = 0.0
    for k in range(levels):
        scale = np.array([lean**k * rng.uniform(0.92, 1.0), narrow**k * rng.uniform(0.9, 1.05 if k else 1.0)])
        foot, shift = base * scale, shift + rng.uniform(-0.3, 0.6) * k
        flare = rng.uniform(1.0, 1.04) if k == bridge else rng.uniform(0.95, 1.0)
        at = np.array([x + shift, y])
        parts.append(m.frustum(foot + at, -up, foot * flare + at, -up - rise, tint * rng.uniform(0.93, 1.07)))
        parts.append(build_level(foot + at, at, up, rise, k == bridge, tint, rng))
        up += rise
    roof = x + shift, y, *np.ptp(foot, axis=0)
    parts.append(build_roof(roof, up, island.mast_m, tint, rng))
    parts.append(build_wall_number(island, rng))
    parts.append(build_support(layout, island, paint))
    parts.append(build_footing(layout, island, runway, tint, rng))
    return m.join(parts)


def build_level(
    foot_m: Array, at_m: Array, up_m: float, rise_m: float, bridge: bool, paint: Array, rng: Generator
) -> Mesh:
    """Window band, ledge with rail, doors and boxes on the walls of one level."""
    parts = []
    grown = (foot_m - at_m) * (1.0 + 0.12 / np.ptp(foot_m[:, 1])) + at_m
    if bridge or rng.random() < 0.2:
        sill = -up_m - rise_m * rng.uniform(0.45, 0.6)
        tall = min(rng.uniform(0.8, 1.3), rise_m * 0.4)
        parts.append(m.frustum(grown, sill, (grown - at_m) * 1.02 + at_m, sill - tall, GLASS + rng.uniform(0.0, 0.1)))
    if rng.random() < 0.65:
        ledge = (foot_m - at_m) * (1.0 + 2 * rng.uniform(0.4, 1.4) / np.ptp(foot_m, axis=0)) + at_m
        floor, rail = (m.at_height(ledge, -up_m - rise_m - above) for above in (0.0, 1.0))
        parts.append(m.loft([np.add(floor, (0.0, 0.0, 0.25)), floor], paint * rng.uniform(0.7, 1.1)))
        ends = np.concatenate([np.roll(rail, -1, 0), np.add(rail, (0.0, 0.0, 1.0))])
        parts.append(m.rods(np.concatenate([rail, rail]), ends, 0.1, paint * rng.uniform(0.8, 1.3)))
    count = int(rng.integers(2, 9))
    corner, share = rng.integers(len(foot_m), size=count), rng.uniform(0.1, 0.9, (count, 1))
    spots = grown[corner] * share + np.roll(grown, -1, axis=0)[corner] * (1 - share)
    spots = m.at_height(spots, -up_m - rise_m * rng.uniform(0.05, 0.7, count))
    size = rng.uniform([0.5, 0.5, 0.6], [2.2, 0.9, 2.1], (count, 3))
    return m.join([*parts, m.boxes(spots, size, paint * rng.uniform(0.25, 1.35, (count, 1)))])


def build_roof(roof_m: tuple[float, ...], up_m: float, mast_m: float, paint: Array, rng: Generator) -> Mesh:
    """Funnel, masts, radomes, a radar and whip aerials on a roof (x, y of its middle, length, width)."""
    x, y, length, width = roof_m
    parts = []
    if rng.random() < 0.6:
        foot = m.rectangle(x - length * rng.uniform(0.1, 0.35), y, length * rng.uniform(0.15, 0.3), width * 0.6)
        rise, shade = rng.uniform(2.0, 6.0), paint * rng.uniform(0.85, 1.0)
        lean = np.array([-rise * rng.uniform(0.0, 0.35), 0.0])
        parts.append(m.frustum(foot, -up_m, foot + lean, -up_m - rise, shade))
        parts.append(m.frustum(foot + lean, -up_m - rise, foot + 1.2 * lean, -up_m - rise - 1.0, GLASS))
    if mast_m > 0:
        parts += build_mast(x + length * rng.uniform(-0.1, 0.3), y, up_m, mast_m, paint, rng)
        if mast_m > 8 and rng.random() < 0.35:
            aft = x - length * rng.uniform(0.15, 0.4)
            parts += build_mast(aft, y, up_m, mast_m * rng.uniform(0.4, 0.8), paint, rng)
    for _ in range(rng.integers(0, 4)):
        radius = rng.uniform(0.6, 2.0)
        spot = x + length * rng.uniform(-0.45, 0.45), y + width * rng.uniform(-0.4, 0.4)
        foot = m.disc(*spot, radius * 0.5, 6)
        parts.append(m.frustum(foot, -up_m, foot, -up_m - radius, paint))
        parts.append(m.dome(*spot, -up_m - 1.7 * radius, radius, np.full(3, rng.uniform(0.6, 0.92))))
    if rng.random() < 0.5:
        parts += build_radar(x + length * rng.uniform(-0.3, 0.3), y, up_m, paint, rng)
    whips = int(rng.integers(0, 7))
    if whips:
        starts = np.array([x, y, -up_m]) + rng.uniform(-0.5, 0.5, (whips, 3)) * [length, width, 0.0]
        lean = rng.normal(0.0, 0.6, (whips, 3)) * [1, 1, 0] - [0, 0, 1] * rng.uniform(3, 9, (whips, 1))
        parts.append(m.rods(starts, starts + lean, 0.12, paint * rng.uniform(0.6, 1.5)))
    return m.join(parts)


def build_mast(x_m: float, y_m: float, up_m: float, rise_m: float, paint: Array, rng: Generator) -> list[Mesh]:
    """A pole, a tripod of lattice or a plated tower, with platforms, yards, aerials and a top."""
    thick, z = rng.uniform(0.35, 0.5) + 0.02 * rise_m, -up_m
    kind = rng.integers(3)
    shade = paint * rng.uniform(0.6, 1.25)
    if kind == 0:
        parts = [m.frustum(m.disc(x_m, y_m, thick, 6), z, m.disc(x_m, y_m, thick * 0.4, 6), z - rise_m, shade)]
    elif kind == 1:
        parts = [build_lattice(x_m, y_m, z, rise_m, rng.uniform(1.2, 2.5), shade)]
    else:
        foot = m.disc(x_m, y_m, rng.uniform(1.5, 2.8), 6)
        top = (foot - [x_m, y_m]) * rng.uniform(0.3, 0.6) + [x_m, y_m]
        parts = [m.frustum(foot, z, top, z - 0.7 * rise_m, shade)]
        parts.append(m.rods((x_m, y_m, z - 0.7 * rise_m), (x_m, y_m, z - rise_m), 0.5, shade))
    count = int(rng.integers(2, 6))
    at = z - rise_m * np.sort(rng.uniform(0.25, 0.97, count))
    half = rng.uniform(0.08, 0.34, count) * rise_m
    middle, across = m.at_height(np.full((count, 2), [x_m, y_m]), at), half[:, None] * [0.0, 1.0, 0.0]
    parts.append(m.rods(middle - across, middle + across, rng.uniform(0.15, 0.4, count), shade))
    ends = np.concatenate([middle + across * share for share in (-1.0, -0.6, 0.6, 1.0)])
    parts.append(m.rods(ends, ends - [0, 0, 1] * rng.uniform(0.5, 2.2, (len(ends), 1)), 0.14, shade))
    size, yaw = rng.uniform([0.8, 0.8, 0.3], [2.6, 2.6, 1.8], (count, 3)), rng.uniform(-1, 1, count)
    parts.append(m.boxes(middle, size, shade * rng.uniform(0.7, 1.3, (count, 1)), yaw))
    if rng.random() < 0.6:
        parts.append(m.dome(x_m, y_m, z - rise_m - 0.4, rng.uniform(0.6, 1.5), np.full(3, rng.uniform(0.5, 0.9))))
    if rng.random() < 0.6:
        parts += build_radar(x_m, y_m, up_m + rise_m * rng.uniform(0.3, 0.8), shade, rng)
    return parts


def build_lattice(x_m: float, y_m: float, z_m: float, rise_m: float, half_m: float, rgb: ArrayLike) -> Mesh:
    """Four legs that close towards the top, with rings and diagonals."""
    rings = max(3, int(rise_m / 2.5))
    share = np.linspace(0.0, 1.0, rings + 1)
    corners = m.rectangle(0, 0, 2, 2)[None] * (half_m * (1 - 0.75 * share))[:, None, None] + [x_m, y_m]
    points = np.concatenate([corners, np.broadcast_to((z_m - rise_m * share)[:, None, None], (rings + 1, 4, 1))], 2)
    beside = np.roll(points, -1, axis=1)
    starts, ends = [points[:-1], points[1:], points[:-1]], [points[1:], beside[1:], beside[1:]]
    return m.rods(np.reshape(starts, (-1, 3)), np.reshape(ends, (-1, 3)), 0.16, rgb)


def build_radar(x_m: float, y_m: float, up_m: float, paint: Array, rng: Generator) -> list[Mesh]:
    """A flat or grated antenna on a pedestal, turned anywhere."""
    wide, tall = rng.uniform(2.0, 7.0), rng.uniform(0.5, 3.0)
    yaw = rng.uniform(-np.pi, np.pi)
    pedestal = m.boxes((x_m, y_m, -up_m), (0.9, 0.9, 1.4), paint, yaw)
    return [pedestal, m.boxes((x_m, y_m, -up_m - 1.3), (0.4, wide, tall), paint * rng.uniform(0.5, 1.3), yaw)]


def build_wall_number(island: Island, rng: Generator) -> Mesh:
    """The ship's number on the island's sides, sometimes."""
    if rng.random() < 0.5 or island.height_m < 6:
        return m.join([])
    tall = min(rng.uniform(1.5, 4.0), island.length_m * 0.25)
    text, parts = str(rng.integers(1, 99)), []
    for side in (-1.0, 1.0):
        x, z = digits(text, tall, side)
        y = np.full(len(x), island.middle_m[1] + side * (island.width_m / 2 + 0.1))
        corners = np.stack([island.middle_m[0] + x, y, z - 0.2 * island.height_m - tall], -1).reshape(-1, 3, 3)
        parts.append(m.facing(corners, np.full(3, rng.uniform(0.7, 0.95)), (0.0, side, 0.0)))
    return m.join(parts)


def build_support(layout: Layout, island: Island, paint: Array) -> Mesh:
    """A sponson under an island that overhangs the deck's edge."""
    x, y = island.middle_m
    side = np.sign(y)
    stations = x + island.length_m * np.array([-0.6, -0.5, 0.5, 0.6])
    edge = layout.half_width_at(stations, side)
    outer = np.maximum(abs(y) + island.width_m / 2 + 0.8, edge)
    outer[[0, 3]] = edge[[0, 3]]
    if np.max(outer - edge) < 0.5:
        return m.join([])
    top, low = side_ring(stations, side, outer, edge - 2.0), side_ring(stations, side, edge - 3.0, edge - 4.0)
    depth = min(8.0, 0.6 * layout.deck_height_m)
    return m.loft([m.at_height(low, depth), m.at_height(top, 1.6), m.at_height(top, -0.02)], paint)


def build_footing(layout: Layout, island: Island, runway: bool, paint: Array, rng: Generator) -> Mesh:
    """A deck crane and lockers beside an island, where there is room."""
    x, y = island.middle_m
    parts = []
    for _ in range(rng.integers(0, 4)):
        at = x + rng.uniform(-0.5, 0.5) * island.length_m, y - np.sign(y) * (island.width_m / 2 + rng.uniform(0.8, 1.5))
        size = rng.uniform(1.0, 4.0), rng.uniform(0.8, 1.6), rng.uniform(0.8, 2.4)
        if has_room(layout, runway, m.rectangle(*at, size[0], size[1])):
            parts.append(m.boxes((*at, 0.0), size, paint * rng.uniform(0.6, 1.3)))
    reach, yaw = rng.uniform(8.0, 20.0), rng.uniform(-np.pi, np.pi)
    foot = np.array([x - (island.length_m / 2 + rng.uniform(4.0, 10.0)) * rng.choice([-1.0, 1.0]), y])
    tip = m.place([[reach, 0.0]], foot[0], foot[1], yaw)[0]
    if rng.random() < 0.45 and has_room(layout, runway, np.array([foot - 1.5, foot + 1.5, tip, foot, tip + 1.0])):
        shade = (0.75, 0.58, 0.1) if rng.random() < 0.4 else paint
        rise = rng.uniform(3.0, 8.0)
        head, end = np.array([*foot, -rise]), np.array([*tip, -rise - reach * rng.uniform(0.0, 0.6)])
        parts.append(m.boxes((*foot, 0.0), (1.6, 1.6, rise), shade, yaw))
        parts.append(m.rods([head, head], [end, end + np.array([0, 0, 0.9])], 0.5, shade))
    return m.join(parts)
