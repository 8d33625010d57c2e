"""What hangs on a hull: sponsons, galleries, openings, nets and walks along the deck's edge, numbers, rust."""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.sim.ship.clearance import CLEAR_M, runway_distance
from deckline.sim.ship.hull import SLAB_M, Form, half_width, stem_and_stern
from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import Mesh, at_height, bars, boxes, disc, dome, frustum, join, loft, quads, triangles
from deckline.sim.ship.paint import figures

PROUD_M = 0.12  # how far painted panels stand off the hull's side
RAIL_M = 1.1  # height of a railing
RUST = np.array([0.42, 0.26, 0.17])


def side_meshes(layout: Layout, form: Form, number: str, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """Everything on both sides and on the stern."""
    parts = [stern_details(form, paint, rng)]
    rails = rng.random() < 0.8
    for side in (-1.0, 1.0):
        parts += [sponson(form, side, paint, rng, rails) for _ in range(rng.integers(1, 6))]
        parts += [bay(form, side, paint, rng) for _ in range(rng.integers(0, 4))]
        if number:
            parts.append(side_number(form, side, number, rng))
        if rng.random() < 0.75:
            parts.append(deck_walk(layout, side, paint, rng, rails))
        parts.append(streaks(form, side, rng))
    return join(parts)


def on_side(form: Form, x_m: ArrayLike, z_m: ArrayLike, side: float, out_m: float = PROUD_M) -> NDArray[np.float64]:
    """Points (..., 3) of the hull's side at stations and heights, standing off by `out`."""
    x, z = np.broadcast_arrays(np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64))
    return np.stack([x, side * (half_width(form, x, z, side) + out_m), z], -1)


def facing(corners_m: NDArray[np.float64], rgb: ArrayLike, away: ArrayLike) -> Mesh:
    """Quads (N, 4, 3) turned so that they look along a direction (3,)."""
    a, b, d = corners_m[:, 0], corners_m[:, 1], corners_m[:, 3]
    back = np.cross(b - a, d - a) @ np.asarray(away, dtype=np.float64) < 0
    return quads(np.where(back[:, None, None], corners_m[:, ::-1], corners_m), rgb)


def sponson(form: Form, side: float, paint: NDArray[np.float64], rng: np.random.Generator, rails: bool) -> Mesh:
    """A gallery under an overhang, wedge-shaped below, with a railing, a dome or a launcher."""
    layout, reach = form.layout, rng.uniform(8.0, 55.0)
    x = rng.uniform(0.0, 0.8 * layout.length_m - reach / 2)
    z = rng.uniform(SLAB_M + 0.6, min(5.5, 0.4 * layout.deck_height_m))
    low_z = min(z + rng.uniform(1.5, 8.0), 0.8 * layout.deck_height_m)
    stations = x + reach * np.array([0.0, rng.uniform(0.02, 0.25), rng.uniform(0.75, 0.98), 1.0])
    edge = np.interp(stations, layout.stations_m, layout.starboard_m if side > 0 else -layout.port_m)
    inner = half_width(form, stations, np.full(4, low_z), side) - 0.6
    hull_top = half_width(form, stations, np.full(4, z), side)
    outer = np.maximum(edge * rng.uniform(0.9, 1.06), hull_top)
    outer[[0, 3]] = np.minimum(outer[[0, 3]], hull_top[[0, 3]] + rng.uniform(0.0, 4.0))
    top = np.stack([np.r_[stations, stations[::-1]], side * np.r_[outer, inner[::-1]]], -1)
    low = np.stack([np.r_[stations, stations[::-1]], side * np.r_[inner + 0.3, inner[::-1]]], -1)
    lip = z + rng.uniform(0.5, 1.8)
    tint = paint * rng.uniform(0.85, 1.12)
    rings = [at_height(ring, up) for ring, up in ((low, max(low_z, lip + 0.3)), (top, lip), (top, z))]
    parts = [loft(rings, tint)]
    walk = np.column_stack([stations, side * (outer - 0.15), np.full(4, z)])
    if rails:
        parts.append(railing(walk, tint * 1.05))
    at = walk[1] + (walk[2] - walk[1]) * rng.uniform(0.1, 0.9) - [0.0, side * 1.8, 0.0]
    kind = rng.integers(4) if runway_distance(layout, at[:2]) > CLEAR_M + 2.0 else -1
    if kind == 0:  # a close-in gun's white dome
        white = np.full(3, rng.uniform(0.7, 0.92))
        parts += [boxes([at], (1.6, 1.6, 1.0), 0.0, tint), dome(at[0], at[1], z - 1.9, 0.9, white, 6)]
    elif kind == 1:
        parts.append(boxes([at], (3.0, 2.4, 1.8), rng.uniform(0, np.pi), tint * 0.9))
    return join(parts)


def railing(path_m: NDArray[np.float64], rgb: ArrayLike, spacing_m: float = 4.0) -> Mesh:
    """Two rails on posts along points (N, 3)."""
    lifted = [path_m - [0.0, 0.0, up] for up in (0.55, RAIL_M)]
    length = np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum()
    at = np.linspace(0.0, len(path_m) - 1.0, max(2, int(length / spacing_m)))
    posts = np.stack([np.interp(at, np.arange(len(path_m)), path_m[:, k]) for k in range(3)], -1)
    starts = np.concatenate([*(line[:-1] for line in lifted), posts])
    ends = np.concatenate([*(line[1:] for line in lifted), posts - [0.0, 0.0, RAIL_M]])
    return bars(starts, ends, 0.09, rgb)


def bay(form: Form, side: float, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """An opening to the hangar or a boat deck: a dark panel with a lighter sill."""
    height = form.layout.deck_height_m
    x0 = rng.uniform(0.08, 0.7) * form.layout.length_m
    x1 = x0 + rng.uniform(5.0, 26.0)
    z0 = height * rng.uniform(0.2, 0.35)
    z1 = height * rng.uniform(0.42, 0.6)
    x = np.linspace(x0, x1, 5)
    shades = [paint * rng.uniform(0.2, 0.5), paint * rng.uniform(0.9, 1.2)]
    rows = [on_side(form, x, z, side) for z in (z0, z1, min(z1 + 0.5, 0.95 * height))]
    faces = [np.stack([low[:-1], low[1:], up[1:], up[:-1]], 1) for low, up in pairwise(rows)]
    return join([facing(face, shade, (0.0, side, 0.0)) for face, shade in zip(faces, shades, strict=True)])


def deck_walk(layout: Layout, side: float, paint: NDArray[np.float64], rng: np.random.Generator, rails: bool) -> Mesh:
    """A walk below the deck's edge and a safety net outside it, along parts of the side."""
    edge = layout.starboard_m if side > 0 else layout.port_m
    wide, drop = rng.uniform(0.9, 2.0), rng.uniform(0.4, 1.8)
    net = rng.random() < 0.5
    x, y = layout.stations_m[::2], edge[::2] - side * 0.2
    corners = np.stack(
        [np.stack([x, y, np.full_like(x, drop)], -1),
         np.stack([x, y + side * wide, np.full_like(x, drop - (0.35 if net else 0.0))], -1)]
    )  # fmt: skip
    present = np.repeat(rng.random(-(-(len(x) - 1) // 4)) < 0.7, 4)[: len(x) - 1]
    inner, outer = corners
    strips = np.stack([inner[:-1], inner[1:], outer[1:], outer[:-1]], 1)[present]
    if not len(strips):
        return join([])
    shade = paint * rng.uniform(0.45, 1.0)
    parts = [facing(strips, shade, (0.0, 0.0, -1.0))]
    sill = outer + np.array([0.0, 0.0, 0.35])
    kerb = np.stack([outer[:-1], outer[1:], sill[1:], sill[:-1]], 1)[present]
    parts.append(facing(kerb, shade * 0.8, (0.0, side, 0.0)))
    if rails and drop >= RAIL_M:  # a lower walk's rail would stand above the deck
        starts, ends = outer[:-1][present], outer[1:][present]
        up = np.array([0.0, 0.0, RAIL_M])
        parts.append(bars(np.concatenate([starts - up, starts]), np.concatenate([ends - up, starts - up]), 0.08, shade))
    return join(parts)


def side_number(form: Form, side: float, number: str, rng: np.random.Generator) -> Mesh:
    """The hull number near the bow, read from outside."""
    height = form.layout.deck_height_m
    tall = height * rng.uniform(0.18, 0.4)
    coat = figures(number, (0.0, 0.0), (1.0, 0.0), tall, (1.0, 1.0, 1.0))[:, :2].astype(np.float64)
    x = form.bow_m[0] * rng.uniform(0.82, 0.93) + side * (coat[:, 0] - coat[:, 0].mean())
    z = height * rng.uniform(0.3, 0.5) + coat[:, 1]
    corners = on_side(form, x, z, side).reshape(-1, 3, 3)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    back = normal[:, 1] * side < 0
    return triangles(np.where(back[:, None, None], corners[:, ::-1], corners), np.full(3, rng.uniform(0.6, 0.95)))


def streaks(form: Form, side: float, rng: np.random.Generator) -> Mesh:
    """Rust and water marks that run down from the deck."""
    count = int(rng.integers(0, 26))
    if count == 0:
        return join([])
    height = form.layout.deck_height_m
    x = rng.uniform(0.03, 0.9, count) * form.layout.length_m
    wide, z0 = rng.uniform(0.1, 0.6, count), rng.uniform(SLAB_M, 0.6 * height, count)
    z1 = np.minimum(z0 + rng.uniform(1.0, 8.0, count), height)
    corners = [
        on_side(form, x + dx, z, side, 0.07) for dx, z in ((-wide, z0), (wide, z0), (0.4 * wide, z1), (0 * x, z1))
    ]
    shade = rng.uniform(0.7, 1.1, (count, 1)) * (RUST if rng.random() < 0.6 else np.full(3, 0.3))
    return facing(np.stack(corners, 1), shade, (0.0, side, 0.0))


def stern_details(form: Form, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """Galleries with railings across the stern, lamps, hawse holes, and the drop line below the ramp."""
    height, parts = form.layout.deck_height_m, []
    left, right = (float(half_width(form, np.array(form.stern_m[1]), np.array(SLAB_M), s)) for s in (-1.0, 1.0))
    for _ in range(rng.integers(0, 4)):
        z = height * rng.uniform(0.3, 0.75)
        x = float(stem_and_stern(form, np.array(z))[0])
        y = rng.uniform(-left, right * 0.6)
        wide, deep = min(rng.uniform(4.0, 24.0), right - y), rng.uniform(1.0, 3.0)
        low = [[x + 0.5, y], [x - 0.2, y], [x - 0.2, y + wide], [x + 0.5, y + wide]]
        top = [[x + 0.5, y], [x - deep, y], [x - deep, y + wide], [x + 0.5, y + wide]]
        parts.append(frustum(low, z + rng.uniform(0.8, 2.5), top, z, paint * rng.uniform(0.8, 1.15)))
        path = np.array([[x, y, z], [x - deep, y, z], [x - deep, y + wide, z], [x, y + wide, z]])
        parts.append(railing(path, paint * rng.uniform(0.9, 1.4), 2.0))
    count = int(rng.integers(0, 8))
    if count:
        heights = height * rng.uniform(0.15, 0.9, count)
        across = rng.uniform(-left, right, count) * 0.85
        at = np.stack([stem_and_stern(form, heights)[0] - 0.05, across, heights], -1)
        size = np.column_stack([np.full(count, 0.5), rng.uniform(0.5, 3.5, count), rng.uniform(0.4, 1.8, count)])
        parts.append(boxes(at, size, 0.0, paint * rng.uniform(0.3, 1.5, (count, 1))))
    if rng.random() < 0.5:
        parts.append(drop_line(form, rng))
    if rng.random() < 0.3:
        parts.append(fairleads(form, left, right, rng))
    return join(parts)


def drop_line(form: Form, rng: np.random.Generator) -> Mesh:
    """The painted bar on the stern that continues the centre line downwards, white or with a yellow part."""
    height = form.layout.deck_height_m
    y = form.layout.centre_m[0, 1]
    z = SLAB_M + (height - SLAB_M) * np.array(
        [0.0, rng.uniform(0.15, 0.35), rng.uniform(0.4, 0.6), rng.uniform(0.6, 0.9)]
    )
    x = stem_and_stern(form, z)[0] - rng.uniform(0.1, 0.6)
    half = rng.uniform(0.3, 0.7)
    rows = [np.stack([x, np.full(4, y + side * half), z], -1) for side in (-1.0, 1.0)]
    faces = np.stack([rows[0][:-1], rows[1][:-1], rows[1][1:], rows[0][1:]], 1)
    white = np.full(3, rng.uniform(0.6, 0.95))
    middle = np.array([0.8, 0.65, 0.1]) if rng.random() < 0.5 else white
    return facing(faces, np.array([white, middle, white]), (-1.0, 0.0, 0.0))


def fairleads(form: Form, left_m: float, right_m: float, rng: np.random.Generator) -> Mesh:
    """A row of round fairleads just above the water."""
    z = form.layout.deck_height_m * rng.uniform(0.6, 0.8)
    x = float(stem_and_stern(form, np.array(z))[0])
    ring = disc(0.0, 0.0, rng.uniform(0.3, 0.6), 6)
    parts = []
    for y in np.linspace(-left_m * 0.7, right_m * 0.7, int(rng.integers(3, 7))):
        sections = [np.column_stack([np.full(6, x + dx), y + ring[:, 0], z + ring[:, 1]]) for dx in (0.3, -0.25)]
        parts.append(loft(sections, (0.07, 0.07, 0.08)))
    return join(parts)
