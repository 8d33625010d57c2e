"""Superstructures on deck: stacked levels with windows and ledges, funnel, mast, radars, deck crane."""

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.clearance import has_room
from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import (
    Mesh,
    at_height,
    bars,
    box,
    boxes,
    disc,
    dome,
    frustum,
    join,
    loft,
    place,
    rectangle,
    triangles,
)
from deckline.sim.ship.paint import figures
from deckline.sim.ship.ship_class import Island

GLASS = np.array([0.07, 0.08, 0.1])
NO_ISLAND = 0.08  # part of the random ships that have none
STOREY_M = 2.9
OVERHANG = 0.95  # how much of its width an island may stand out over the deck's edge


def random_islands(layout: Layout, runway: bool, rng: np.random.Generator) -> tuple[Island, ...]:
    """None to two islands on the side away from the runway, where there is room."""
    islands: list[Island] = []
    across = float(layout.centre_m[1, 1] - layout.centre_m[0, 1])
    side = -1.0 if across > 8.0 or rng.random() < 0.04 else 1.0
    wanted = rng.choice([0, 1, 2], p=[NO_ISLAND, 0.77, 0.15])
    for _ in range(wanted):
        size = layout.length_m * rng.uniform(0.05, 0.2), rng.uniform(5.0, 12.5)
        height = float(np.clip(layout.length_m * rng.uniform(0.04, 0.09), 7.0, 27.0))
        for attempt in range(20):
            x = rng.uniform(0.25, 0.75) * layout.length_m
            edge = float(np.interp(x, layout.stations_m, layout.starboard_m if side > 0 else -layout.port_m))
            out = rng.uniform(-5.0, 1.0) if attempt < 8 else rng.uniform(0.0, OVERHANG) * size[1]
            y = side * (edge - size[1] / 2 + out)
            apart = all(abs(x - other.middle_m[0]) > (size[0] + other.length_m) / 2 + 6 for other in islands)
            if apart and has_room(layout, runway, rectangle(x, y, size[0] + 3.0, size[1] + 3.0), -size[1] - 2.0):
                islands.append(Island((x, y), size[0], size[1], height, height * rng.uniform(0.4, 1.4)))
                break
    return tuple(islands)


def support_mesh(layout: Layout, island: Island, paint: NDArray[np.float64]) -> Mesh:
    """A sponson under an island that stands out over the deck's edge."""
    x, y = island.middle_m
    side = np.sign(y)
    stations = x + island.length_m * np.array([-0.6, -0.5, 0.5, 0.6])
    edge = np.interp(stations, layout.stations_m, layout.starboard_m if side > 0 else -layout.port_m)
    outer = np.maximum(abs(y) + island.width_m / 2 + 0.8, edge)
    outer[[0, 3]] = edge[[0, 3]]
    if np.max(outer - edge) < 0.5:
        return join([])
    top = np.column_stack([np.r_[stations, stations[::-1]], side * np.r_[outer, edge[::-1] - 2.0]])
    low = np.column_stack([np.r_[stations, stations[::-1]], side * np.r_[edge - 3.0, edge[::-1] - 4.0]])
    depth = min(8.0, 0.6 * layout.deck_height_m)
    return loft([at_height(low, depth), at_height(top, 1.6), at_height(top, -0.02)], paint)


def island_mesh(
    layout: Layout, island: Island, runway: bool, paint: NDArray[np.float64], rng: np.random.Generator
) -> Mesh:
    """One superstructure with all that stands on it."""
    x, y = island.middle_m
    tint = paint * rng.uniform(0.9, 1.2)
    bevel = rng.uniform(0.08, 0.3)
    base = np.array([[-1, -1 + bevel], [-1 + bevel / 2, -1], [1 - bevel, -1], [1, -1 + 2 * bevel]])
    base = np.concatenate([base, base[::-1] * [1, -1]]) * [island.length_m / 2, island.width_m / 2]
    parts, up, shift = [], 0.0, 0.0
    levels = max(1, round(island.height_m / STOREY_M / rng.uniform(1.0, 1.8)))
    rise = island.height_m / levels
    narrow, lean = rng.uniform(0.86, 1.0), rng.uniform(0.86, 1.0)
    bridge = int(rng.integers(max(levels - 2, 0), levels))
    for k in range(levels):
        scale = np.array([lean**k * rng.uniform(0.92, 1.0), narrow**k * rng.uniform(0.9, 1.05 if k else 1.0)])
        foot, shift = base * scale, shift + rng.uniform(-0.3, 0.6) * k
        flare = rng.uniform(1.0, 1.04) if k == bridge else rng.uniform(0.95, 1.0)
        at = np.array([x + shift, y])
        parts.append(frustum(foot + at, -up, foot * flare + at, -up - rise, tint * rng.uniform(0.93, 1.07)))
        parts += level_details(foot + at, at, up, rise, k == bridge, tint, rng)
        up += rise
        top = foot
    around = x + shift, y, float(np.ptp(top[:, 0])), float(np.ptp(top[:, 1]))
    parts += roof_meshes(around, up, island.mast_m, tint, rng)
    parts.append(wall_number(island, rng))
    parts.append(support_mesh(layout, island, paint))
    parts.append(footing(layout, island, runway, tint, rng))
    return join(parts)


def level_details(
    foot_m: NDArray[np.float64],
    at_m: NDArray[np.float64],
    up_m: float,
    rise_m: float,
    bridge: bool,
    paint: NDArray[np.float64],
    rng: np.random.Generator,
) -> list[Mesh]:
    """Window band, ledge with rail, doors and boxes on the walls of one level."""
    parts = []
    grown = (foot_m - at_m) * (1.0 + 0.12 / np.ptp(foot_m[:, 1])) + at_m
    if bridge or rng.random() < 0.2:
        sill = -up_m - rise_m * rng.uniform(0.45, 0.6)
        tall = min(rng.uniform(0.8, 1.3), rise_m * 0.4)
        parts.append(frustum(grown, sill, (grown - at_m) * 1.02 + at_m, sill - tall, GLASS + rng.uniform(0.0, 0.1)))
    if rng.random() < 0.65:
        ledge = (foot_m - at_m) * (1.0 + 2 * rng.uniform(0.4, 1.4) / np.ptp(foot_m, axis=0)) + at_m
        z = -up_m - rise_m
        parts.append(loft([at_height(ledge, z + 0.25), at_height(ledge, z)], paint * rng.uniform(0.7, 1.1)))
        rail = at_height(ledge, z - 1.0)
        shade = paint * rng.uniform(0.8, 1.3)
        parts.append(
            bars(
                np.concatenate([rail, rail]),
                np.concatenate([np.roll(rail, -1, 0), rail + np.array([0, 0, 1.0])]),
                0.1,
                shade,
            )
        )
    count = int(rng.integers(2, 9))
    corner = rng.integers(len(foot_m), size=count)
    share = rng.uniform(0.1, 0.9, (count, 1))
    spots = grown[corner] * share + np.roll(grown, -1, axis=0)[corner] * (1 - share)
    heights = -up_m - rise_m * rng.uniform(0.05, 0.7, count)
    size = rng.uniform([0.5, 0.5, 0.6], [2.2, 0.9, 2.1], (count, 3))
    parts.append(boxes(np.column_stack([spots, heights]), size, 0.0, paint * rng.uniform(0.25, 1.35, (count, 1))))
    return parts


def roof_meshes(
    around_m: tuple[float, float, float, float],
    up_m: float,
    mast_m: float,
    paint: NDArray[np.float64],
    rng: np.random.Generator,
) -> list[Mesh]:
    """What stands on top of the middle (x, y) of a roof of (length, width)."""
    x, y, length, width = around_m
    parts = []
    if rng.random() < 0.6:
        foot = rectangle(x - length * rng.uniform(0.1, 0.35), y, length * rng.uniform(0.15, 0.3), width * 0.6)
        rise, shade = rng.uniform(2.0, 6.0), paint * rng.uniform(0.85, 1.0)
        lean = np.array([-rise * rng.uniform(0.0, 0.35), 0.0])
        parts.append(frustum(foot, -up_m, foot + lean, -up_m - rise, shade))
        parts.append(frustum(foot + lean, -up_m - rise, foot + 1.2 * lean, -up_m - rise - 1.0, GLASS))
    if mast_m > 0:
        parts += mast_meshes(x + length * rng.uniform(-0.1, 0.3), y, up_m, mast_m, paint, rng)
        if mast_m > 8 and rng.random() < 0.35:
            aft = x - length * rng.uniform(0.15, 0.4)
            parts += mast_meshes(aft, y, up_m, mast_m * rng.uniform(0.4, 0.8), paint, rng)
    for _ in range(rng.integers(0, 4)):
        radius = rng.uniform(0.6, 2.0)
        spot = x + length * rng.uniform(-0.45, 0.45), y + width * rng.uniform(-0.4, 0.4)
        parts.append(frustum(disc(*spot, radius * 0.5, 6), -up_m, disc(*spot, radius * 0.5, 6), -up_m - radius, paint))
        parts.append(dome(*spot, -up_m - 1.7 * radius, radius, np.full(3, rng.uniform(0.6, 0.92)), 8))
    if rng.random() < 0.5:
        parts.append(radar_panel(x + length * rng.uniform(-0.3, 0.3), y, up_m, paint, rng))
    whips = int(rng.integers(0, 7))
    if whips:
        starts = np.array([x, y, -up_m]) + rng.uniform(-0.5, 0.5, (whips, 3)) * [length, width, 0.0]
        lean = rng.normal(0.0, 0.6, (whips, 3)) * [1, 1, 0]
        parts.append(
            bars(starts, starts + lean - [0, 0, 1] * rng.uniform(3, 9, (whips, 1)), 0.12, paint * rng.uniform(0.6, 1.5))
        )
    return parts


def mast_meshes(
    x_m: float, y_m: float, up_m: float, rise_m: float, paint: NDArray[np.float64], rng: np.random.Generator
) -> list[Mesh]:
    """A pole, a tripod of lattice or a plated tower, with platforms, yards, aerials and a top."""
    thick, z = rng.uniform(0.35, 0.5) + 0.02 * rise_m, -up_m
    kind = rng.integers(3)
    shade = paint * rng.uniform(0.6, 1.25)
    parts: list[Mesh] = []
    if kind == 0:
        parts.append(frustum(disc(x_m, y_m, thick, 6), z, disc(x_m, y_m, thick * 0.4, 6), z - rise_m, shade))
    elif kind == 1:
        parts.append(lattice(x_m, y_m, z, rise_m, rng.uniform(1.2, 2.5), shade))
    else:
        foot = disc(x_m, y_m, rng.uniform(1.5, 2.8), 6)
        top = (foot - [x_m, y_m]) * rng.uniform(0.3, 0.6) + [x_m, y_m]
        parts.append(frustum(foot, z, top, z - 0.7 * rise_m, shade))
        parts.append(bars([[x_m, y_m, z - 0.7 * rise_m]], [[x_m, y_m, z - rise_m]], 0.5, shade))
    count = int(rng.integers(2, 6))
    at = z - rise_m * np.sort(rng.uniform(0.25, 0.97, count))
    half = rng.uniform(0.08, 0.34, count) * rise_m
    middle = np.column_stack([np.full(count, x_m), np.full(count, y_m), at])
    across = np.column_stack([np.zeros(count), half, np.zeros(count)])
    parts.append(bars(middle - across, middle + across, rng.uniform(0.15, 0.4, count), shade))
    ends = np.concatenate([middle + across * share for share in (-1.0, -0.6, 0.6, 1.0)])
    parts.append(bars(ends, ends - [0, 0, 1] * rng.uniform(0.5, 2.2, (len(ends), 1)), 0.14, shade))
    size = rng.uniform([0.8, 0.8, 0.3], [2.6, 2.6, 1.8], (count, 3))
    parts.append(boxes(middle, size, rng.uniform(-1, 1, count), shade * rng.uniform(0.7, 1.3, (count, 1))))
    if rng.random() < 0.6:
        parts.append(dome(x_m, y_m, z - rise_m - 0.4, rng.uniform(0.6, 1.5), np.full(3, rng.uniform(0.5, 0.9)), 8))
    if rng.random() < 0.6:
        parts.append(radar_panel(x_m, y_m, up_m + rise_m * rng.uniform(0.3, 0.8), shade, rng))
    return parts


def lattice(x_m: float, y_m: float, z_m: float, rise_m: float, half_m: float, rgb: NDArray[np.float64]) -> Mesh:
    """Four legs that close towards the top, with rings and diagonals."""
    rings = max(3, int(rise_m / 2.5))
    share = np.linspace(0.0, 1.0, rings + 1)
    corners = rectangle(0, 0, 2, 2)[None] * (half_m * (1 - 0.75 * share))[:, None, None] + [x_m, y_m]
    points = np.concatenate([corners, np.broadcast_to((z_m - rise_m * share)[:, None, None], (rings + 1, 4, 1))], 2)
    beside = np.roll(points, -1, axis=1)
    starts = [points[:-1], points[1:], points[:-1]]
    ends = [points[1:], beside[1:], beside[1:]]
    return bars(np.reshape(starts, (-1, 3)), np.reshape(ends, (-1, 3)), 0.16, rgb)


def radar_panel(x_m: float, y_m: float, up_m: float, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """A flat or grated antenna on a pedestal, turned anywhere."""
    wide, tall = rng.uniform(2.0, 7.0), rng.uniform(0.5, 3.0)
    yaw = rng.uniform(-np.pi, np.pi)
    foot = box(x_m, y_m, -up_m, (0.9, 0.9, 1.4), yaw, paint)
    return join([foot, box(x_m, y_m, -up_m - 1.3, (0.4, wide, tall), yaw, paint * rng.uniform(0.5, 1.3))])


def wall_number(island: Island, rng: np.random.Generator) -> Mesh:
    """The ship's number on the island's sides, sometimes."""
    if rng.random() < 0.5 or island.height_m < 6:
        return join([])
    tall = min(rng.uniform(1.5, 4.0), island.length_m * 0.25)
    text = str(rng.integers(1, 99))
    flat = figures(text, (0.0, 0.0), (1.0, 0.0), tall, (1.0, 1.0, 1.0))[:, :2].astype(np.float64)
    parts = []
    for side in (-1.0, 1.0):
        x = island.middle_m[0] + side * (flat[:, 0] - flat[:, 0].mean())
        y = np.full(len(x), island.middle_m[1] + side * (island.width_m / 2 + 0.1))
        corners = np.stack([x, y, flat[:, 1] - 0.2 * island.height_m - tall], -1).reshape(-1, 3, 3)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        back = normal[:, 1] * side < 0
        parts.append(
            triangles(np.where(back[:, None, None], corners[:, ::-1], corners), np.full(3, rng.uniform(0.7, 0.95)))
        )
    return join(parts)


def footing(layout: Layout, island: Island, runway: bool, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """A deck crane and lockers beside an island, where there is room."""
    x, y = island.middle_m
    parts = []
    for _ in range(rng.integers(0, 4)):
        at = x + rng.uniform(-0.5, 0.5) * island.length_m, y - np.sign(y) * (island.width_m / 2 + rng.uniform(0.8, 1.5))
        size = rng.uniform(1.0, 4.0), rng.uniform(0.8, 1.6), rng.uniform(0.8, 2.4)
        if has_room(layout, runway, rectangle(*at, size[0], size[1])):
            parts.append(box(*at, 0.0, size, 0.0, paint * rng.uniform(0.6, 1.3)))
    reach, yaw = rng.uniform(8.0, 20.0), rng.uniform(-np.pi, np.pi)
    foot = np.array([x - (island.length_m / 2 + rng.uniform(4.0, 10.0)) * rng.choice([-1.0, 1.0]), y])
    tip = place([[reach, 0.0]], foot[0], foot[1], yaw)[0]
    if rng.random() < 0.45 and has_room(layout, runway, np.array([foot - 1.5, foot + 1.5, tip, foot, tip + 1.0])):
        shade = (0.75, 0.58, 0.1) if rng.random() < 0.4 else paint
        rise = rng.uniform(3.0, 8.0)
        head = np.array([*foot, -rise])
        end = np.array([*tip, -rise - reach * rng.uniform(0.0, 0.6)])
        parts += [
            box(foot[0], foot[1], 0.0, (1.6, 1.6, rise), yaw, shade),
            bars([head, head], [end, end + np.array([0, 0, 0.9])], 0.5, shade),
        ]
    return join(parts)
