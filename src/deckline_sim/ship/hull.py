"""The hull under a deck, with its transom, and what hangs on it: sponsons, openings, walks, numbers, rust, aerials.

The hull is one loft through frames. A frame's corners lie on levels, from under the deck down to the keel; every
level has its own stern, bow and half width, so that bows rake and sides flare.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from deckline_sim.ship.layout import CLEAR_M, Layout, runway_distance
from deckline_sim.ship.mesh import Array, Mesh, at_height, boxes, disc, dome, facing, join, loft, quads, rods, strip
from deckline_sim.ship.paint_shapes import figures
from deckline_sim.ship.ship_class import Hull

SLAB_M = 1.6  # depth of the deck's edge
DRAUGHT_M = 5.0  # how far hulls reach below the water, where the renderer cuts them off
BOOT_M = 1.2  # height of the dark stripe above the water
STATIONS = np.array([0.0, 0.04, 0.12, 0.3, 0.5, 0.65, 0.76, 0.85, 0.92, 0.97, 1.0])  # of frames, along a level
LIMIT_M = 0.5  # the hull's top stays this far inside the deck's edge
BOOTS = np.array([[0.16, 0.05, 0.05], [0.08, 0.08, 0.09], [0.35, 0.1, 0.08], [0.05, 0.07, 0.1]])
PROUD_M = 0.12  # distance of painted panels from the hull's side
RAIL_M = 1.1  # height of a railing
RUST = np.array([0.42, 0.26, 0.17])


@dataclass(frozen=True, eq=False)
class HullForm:
    """The shape of a hull."""

    layout: Layout
    beam_m: float  # half width at the water, amidships
    stern_m: tuple[float, float]  # x of the transom at the water and under the deck
    bow_m: tuple[float, float]  # x of the stem at the water and under the deck
    transom: float  # width of the transom at the water, of the beam
    flare: float  # width under the deck over that at the water
    curve: float  # exponent of the flare over height: 1 is straight
    bow_width: float  # width under the deck at the bow, of the beam: small is pointed

    def ends(self, z_m: ArrayLike) -> tuple[Array, Array]:
        """x of the transom and of the stem at heights."""
        rise = self.rise(z_m)
        stern = self.stern_m[0] + (self.stern_m[1] - self.stern_m[0]) * rise
        return stern, self.bow_m[0] + (self.bow_m[1] - self.bow_m[0]) * rise

    def rise(self, z_m: ArrayLike) -> Array:
        """0 at the water, 1 under the deck."""
        height = self.layout.deck_height_m
        return np.clip((height - np.asarray(z_m, dtype=np.float64)) / (height - SLAB_M), 0.0, 1.0)

    def half_width(self, x_m: float | Array, z_m: ArrayLike, side: float) -> Array:
        """Distance of the hull's side from the ship's axis; side -1 is port."""
        stern, bow = self.ends(z_m)
        s, t = np.clip((x_m - stern) / (bow - stern), 0.0, 1.0), self.transom
        water = np.interp(s, [0.0, 0.12, 0.3, 0.6, 0.76, 0.9, 1.0], [t, (1 + t) / 2, 1.0, 1.0, 0.82, 0.38, 0.015])
        widths = [(1 + t) / 2, 1.0, 1.0, (1 + self.bow_width) / 2, self.bow_width]
        top = self.flare * np.interp(s, [0.0, 0.2, 0.75, 0.92, 1.0], widths)
        half = self.beam_m * (water + (top - water) * self.rise(z_m) ** self.curve)
        return np.minimum(half, np.maximum(self.layout.half_width_at(x_m, side) - LIMIT_M, 0.2))


def random_hull(layout: Layout, rng: Generator) -> Hull:
    """Colours and proportions of a warship that nobody built."""
    width = float(np.median(layout.starboard_m - layout.port_m))
    bow = str(rng.choice(["blunt", "raked", "ski-jump"], p=[0.35, 0.45, 0.2]))
    grey = rng.uniform(0.4, 0.75) * np.array([0.97, 1.0, 1.03]) * rng.uniform(0.96, 1.04, 3)
    ramp = (rng.uniform(2.0, 6.0), rng.uniform(0.12, 0.22) * layout.length_m) if bow == "ski-jump" else (0.0, 0.0)
    beam, stern_x = float(rng.uniform(0.55, 0.85) * width), float(rng.uniform(0.5, 6.0))
    number = str(rng.integers(2, 99)) if rng.random() < 0.7 else ""
    return Hull(beam, bow, tuple(grey.tolist()), stern_x, *ramp, number)  # type: ignore[arg-type]


def random_form(layout: Layout, hull: Hull, rng: Generator) -> HullForm:
    """The part of a hull's shape that its data leave open."""
    stem, stern = layout.length_m - rng.uniform(1.0, 3.0), hull.stern_x_m
    stern_m = (stern + rng.uniform(-0.3, 3.0), stern)
    bow_m = (stem - rng.uniform(0.02, 0.09) * layout.length_m, stem)
    transom, flare, curve = rng.uniform([0.7, 1.05, 1.0], [1.0, 1.5, 2.2])
    bow_width = rng.uniform(0.5, 0.9) if hull.bow == "blunt" else rng.uniform(0.05, 0.35)
    return HullForm(layout, hull.beam_m / 2, stern_m, bow_m, transom, flare, curve, bow_width)


def build_hull(hull: Hull, form: HullForm, rng: Generator) -> Mesh:
    """The hull with its boot stripe; its transom may open into a dark hangar or mooring deck."""
    height = form.layout.deck_height_m
    top, bottom = SLAB_M + rng.uniform(0.5, 2.5), height * rng.uniform(0.42, 0.72)
    opening = (top, bottom) if rng.random() < 0.65 and bottom - top > 1.5 else ()
    boot = height - BOOT_M * rng.uniform(0.3, 1.5)
    levels = np.sort([SLAB_M, *(opening or [0.4 * height]), 0.82 * height, boot, height, height + DRAUGHT_M])
    paint, dark = np.array(hull.rgb), BOOTS[rng.integers(len(BOOTS))]
    stern, bow = form.ends(levels)
    x = stern + STATIONS[:, None] * (bow - stern)  # (K, L)
    z = np.broadcast_to(levels, x.shape)
    sides = [np.stack([x, side * form.half_width(x, z, side), z], -1) for side in (-1.0, 1.0)]
    frames = np.concatenate([sides[0], sides[1][:, ::-1]], axis=1)
    middle = (levels[:-1] + levels[1:]) / 2
    band = np.where((middle > boot)[:, None], dark, paint * np.interp(middle, [0, height], [1.04, 0.9])[:, None])
    around = np.concatenate([band, dark[None], band[::-1], paint[None] * 0.5])
    shade = rng.uniform(0.94, 1.06, (len(STATIONS) - 1, len(around), 1))
    body = loft(frames, around * shade, (False, True))
    return join([body, build_transom(sides[0][0], sides[1][0], band, opening, rng)])


def build_transom(port_m: Array, starboard_m: Array, band: Array, opening: tuple[float, ...], rng: Generator) -> Mesh:
    """The stern plate, level by level, around an opening between two levels, behind which lies a hall."""
    faces, colours, halls = [], [], []
    reach = rng.uniform(0.55, 0.92, 2)
    for (p0, p1), (s0, s1), rgb in zip(pairwise(port_m), pairwise(starboard_m), band, strict=True):
        if opening and opening[0] <= (p0[2] + p1[2]) / 2 <= opening[1]:
            y0, y1 = -reach[0] * min(-p0[1], -p1[1]), reach[1] * min(s0[1], s1[1])
            hole = np.array([[p0[0], y0, p0[2]], [p0[0], y1, p0[2]], [p1[0], y1, p1[2]], [p1[0], y0, p1[2]]])
            faces += [[p0, p1, hole[3], hole[0]], [hole[1], hole[2], s1, s0]]
            colours += [rgb, rgb]
            a, b, c, d = hole
            e, f, g, h = hole + np.array([rng.uniform(4.0, 12.0), 0.0, 0.0])
            hall = np.array([[e, h, g, f], [a, e, f, b], [d, c, g, h], [a, d, h, e], [b, f, g, c]])
            shades = np.array([[0.75], [0.4], [1.25], [0.8], [0.8]])  # back, ceiling, floor, walls
            halls.append(quads(hall, rgb * rng.uniform(0.25, 0.6) * shades))
        else:
            faces.append([p0, p1, s1, s0])
            colours.append(rgb)
    return join([quads(np.array(faces), np.array(colours) * rng.uniform(0.92, 1.05)), *halls])


def build_fittings(form: HullForm, number: str, paint: Array, rng: Generator) -> Mesh:
    """Everything on both sides of the hull and on its stern."""
    parts = [build_stern(form, paint, rng)]
    rails = rng.random() < 0.8
    for side in (-1.0, 1.0):
        parts += [build_sponson(form, side, paint, rng, rails) for _ in range(rng.integers(1, 6))]
        parts += [build_bay(form, side, paint, rng) for _ in range(rng.integers(0, 4))]
        if number:
            parts.append(build_side_number(form, side, number, rng))
        if rng.random() < 0.75:
            parts.append(build_walk(form.layout, side, paint, rng, rails))
        parts.append(build_streaks(form, side, rng))
    return join(parts)


def points_on_side(form: HullForm, x_m: ArrayLike, z_m: ArrayLike, side: float, out_m: float = PROUD_M) -> Array:
    """Points (..., 3) of the hull's side at stations and heights, standing off by `out`."""
    x, z = np.broadcast_arrays(np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64))
    return np.stack([x, side * (form.half_width(x, z, side) + out_m), z], -1)


def side_ring(stations_m: Array, side: float, outer_m: Array, inner_m: Array) -> Array:
    """A polygon (2 N, 2) along one side of a ship, from stations and distances from its axis (N,)."""
    return np.column_stack([np.r_[stations_m, stations_m[::-1]], side * np.r_[outer_m, inner_m[::-1]]])


def build_sponson(form: HullForm, side: float, paint: Array, rng: Generator, rails: bool) -> Mesh:
    """A gallery under an overhang, wedge-shaped below, with a railing, a dome or a launcher."""
    layout, reach = form.layout, rng.uniform(8.0, 55.0)
    x = rng.uniform(0.0, 0.8 * layout.length_m - reach / 2)
    z = rng.uniform(SLAB_M + 0.6, min(5.5, 0.4 * layout.deck_height_m))
    low_z = min(z + rng.uniform(1.5, 8.0), 0.8 * layout.deck_height_m)
    stations = x + reach * np.array([0.0, rng.uniform(0.02, 0.25), rng.uniform(0.75, 0.98), 1.0])
    inner = form.half_width(stations, low_z, side) - 0.6
    hull_top = form.half_width(stations, z, side)
    outer = np.maximum(layout.half_width_at(stations, side) * rng.uniform(0.9, 1.06), hull_top)
    outer[[0, 3]] = np.minimum(outer[[0, 3]], hull_top[[0, 3]] + rng.uniform(0.0, 4.0))
    top, low = (side_ring(stations, side, edge, inner) for edge in (outer, inner + 0.3))
    lip = z + rng.uniform(0.5, 1.8)
    tint = paint * rng.uniform(0.85, 1.12)
    rings = [at_height(ring, up) for ring, up in ((low, max(low_z, lip + 0.3)), (top, lip), (top, z))]
    parts = [loft(rings, tint)]
    walk = np.column_stack([stations, side * (outer - 0.15), np.full(4, z)])
    if rails:
        parts.append(build_railing(walk, tint * 1.05))
    at = walk[1] + (walk[2] - walk[1]) * rng.uniform(0.1, 0.9) - [0.0, side * 1.8, 0.0]
    kind = rng.integers(4) if runway_distance(layout, at[:2]) > CLEAR_M + 2.0 else -1
    if kind == 0:  # a close-in gun's white dome
        white = np.full(3, rng.uniform(0.7, 0.92))
        parts += [boxes(at, (1.6, 1.6, 1.0), tint), dome(at[0], at[1], z - 1.9, 0.9, white, 6)]
    elif kind == 1:
        parts.append(boxes(at, (3.0, 2.4, 1.8), tint * 0.9, rng.uniform(0, np.pi)))
    return join(parts)


def build_railing(path_m: Array, rgb: ArrayLike, spacing_m: float = 4.0) -> Mesh:
    """Two rails on posts along points (N, 3)."""
    lifted = [path_m - [0.0, 0.0, up] for up in (0.55, RAIL_M)]
    length = np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum()
    at = np.linspace(0.0, len(path_m) - 1.0, max(2, int(length / spacing_m)))
    posts = np.stack([np.interp(at, np.arange(len(path_m)), path_m[:, k]) for k in range(3)], -1)
    starts = np.concatenate([*(line[:-1] for line in lifted), posts])
    ends = np.concatenate([*(line[1:] for line in lifted), posts - [0.0, 0.0, RAIL_M]])
    return rods(starts, ends, 0.09, rgb)


def build_bay(form: HullForm, side: float, paint: Array, rng: Generator) -> Mesh:
    """An opening to the hangar or a boat deck: a dark panel with a lighter sill."""
    height = form.layout.deck_height_m
    first = rng.uniform(0.08, 0.7) * form.layout.length_m
    x = np.linspace(first, first + rng.uniform(5.0, 26.0), 5)
    top, sill = height * rng.uniform(0.2, 0.35), height * rng.uniform(0.42, 0.6)
    shades = [paint * rng.uniform(0.2, 0.5), paint * rng.uniform(0.9, 1.2)]
    rows = [points_on_side(form, x, z, side) for z in (top, sill, min(sill + 0.5, 0.95 * height))]
    panels = zip(pairwise(rows), shades, strict=True)
    return join([facing(strip(*pair), shade, (0.0, side, 0.0)) for pair, shade in panels])


def build_walk(layout: Layout, side: float, paint: Array, rng: Generator, rails: bool) -> Mesh:
    """A walk below the deck's edge and a safety net outside it, along parts of the side."""
    edge = layout.starboard_m if side > 0 else layout.port_m
    wide, drop = rng.uniform(0.9, 2.0), rng.uniform(0.4, 1.8)
    slope = 0.35 if rng.random() < 0.5 else 0.0
    x, y = layout.stations_m[::2], edge[::2] - side * 0.2
    inner = np.stack([x, y, np.full_like(x, drop)], -1)
    outer = np.stack([x, y + side * wide, np.full_like(x, drop - slope)], -1)
    present = np.repeat(rng.random(-(-(len(x) - 1) // 4)) < 0.7, 4)[: len(x) - 1]
    if not present.any():
        return join([])
    shade = paint * rng.uniform(0.45, 1.0)
    kerb = strip(outer, outer + np.array([0.0, 0.0, 0.35]))[present]
    parts = [facing(strip(inner, outer)[present], shade, (0.0, 0.0, -1.0))]
    parts.append(facing(kerb, shade * 0.8, (0.0, side, 0.0)))
    if rails and drop >= RAIL_M:  # the rail of a higher walk would rise above the deck
        starts, ends = outer[:-1][present], outer[1:][present]
        up = np.array([0.0, 0.0, RAIL_M])
        parts.append(rods(np.concatenate([starts - up, starts]), np.concatenate([ends - up, starts - up]), 0.08, shade))
    return join(parts)


def digits(text: str, height_m: float, side: float) -> tuple[Array, Array]:
    """Corners (N,) of a number that is read from outside a ship: x about its middle, and z below its top."""
    flat = figures(text, ((0.0, 0.0), (1.0, 0.0)), height_m, (1.0, 1.0, 1.0))[:, :2].astype(np.float64)
    return side * (flat[:, 0] - flat[:, 0].mean()), flat[:, 1]


def build_side_number(form: HullForm, side: float, number: str, rng: Generator) -> Mesh:
    """The hull number near the bow."""
    height = form.layout.deck_height_m
    x, z = digits(number, height * rng.uniform(0.18, 0.4), side)
    at = form.bow_m[0] * rng.uniform(0.82, 0.93), height * rng.uniform(0.3, 0.5)
    corners = points_on_side(form, at[0] + x, at[1] + z, side).reshape(-1, 3, 3)
    return facing(corners, np.full(3, rng.uniform(0.6, 0.95)), (0.0, side, 0.0))


def build_streaks(form: HullForm, side: float, rng: Generator) -> Mesh:
    """Rust and water marks that run down from the deck."""
    count = int(rng.integers(0, 26))
    if count == 0:
        return join([])
    height = form.layout.deck_height_m
    x = rng.uniform(0.03, 0.9, count) * form.layout.length_m
    wide, top = rng.uniform(0.1, 0.6, count), rng.uniform(SLAB_M, 0.6 * height, count)
    foot = np.minimum(top + rng.uniform(1.0, 8.0, count), height)
    outline = ((-wide, top), (wide, top), (0.4 * wide, foot), (0 * x, foot))
    corners = np.stack([points_on_side(form, x + dx, z, side, 0.07) for dx, z in outline], 1)
    shade = rng.uniform(0.7, 1.1, (count, 1)) * (RUST if rng.random() < 0.6 else np.full(3, 0.3))
    return facing(corners, shade, (0.0, side, 0.0))


def build_edge_gear(layout: Layout, runway: bool, rng: Generator) -> list[Mesh]:
    """Whip aerials, upright or folded out, and the landing officer's platform with the optical landing aid."""
    parts = []
    count = int(rng.integers(0, 10))
    if count:
        side = rng.choice([-1.0, 1.0], count)
        x = rng.uniform(0.05, 0.95, count) * layout.length_m
        port, starboard = layout.edges_at(x)
        foot = np.column_stack([x, np.where(side > 0, starboard, port) + side * 1.5, np.full(count, 0.9)])
        lean = rng.uniform(0.95, 1.6, count) if rng.random() < 0.5 else rng.uniform(0.0, 0.25, count)
        tall = rng.uniform(5.0, 11.0, count)
        tip = foot + np.column_stack([0 * x, side * np.sin(lean) * tall, -np.cos(lean) * tall])
        near = np.minimum(runway_distance(layout, foot[:, :2]), runway_distance(layout, tip[:, :2]))
        clear = (near > 4.0) | (not runway)
        parts.append(rods(foot[clear], tip[clear], 0.22, np.full(3, rng.uniform(0.3, 0.9))))
    return parts + build_landing_aid(layout, rng) if runway and rng.random() < 0.55 else parts


def build_landing_aid(layout: Layout, rng: Generator) -> list[Mesh]:
    """A lens between rows of green lamps beyond the port edge, and the landing officer's screen aft of it."""
    start, end = layout.left_m
    parts = []
    for share, wide, tall in ((rng.uniform(0.25, 0.5), rng.uniform(3.0, 8.0), 1.6), (rng.uniform(0.08, 0.2), 2.5, 1.8)):
        x = float(start[0] + share * (end[0] - start[0]))
        y = layout.edges_at(x)[0] - wide / 2 - 0.3
        if runway_distance(layout, np.array([[x, y + wide / 2]]))[0] < 4.0:
            continue
        parts.append(boxes((x, y, 1.4), (2.4, wide + 0.6, 0.4), (0.35, 0.36, 0.38)))
        parts.append(boxes((x, y, 1.0), (0.4, wide, tall), (0.12, 0.12, 0.13)))
        if tall < 1.7:
            lamps, lit = [[x - 0.3, y + k * wide, 0.3] for k in (-0.4, -0.25, 0.25, 0.4)], rng.uniform(0.3, 1.0)
            parts.append(boxes(lamps, (0.1, 0.13 * wide, 0.3), lit * np.array([0.2, 0.95, 0.4])))
            parts.append(boxes((x - 0.3, y, 0.8), (0.1, 0.08 * wide, 1.4), lit * np.array([0.95, 0.5, 0.2])))
    return parts


def build_stern(form: HullForm, paint: Array, rng: Generator) -> Mesh:
    """Galleries with railings across the stern, lamps, fairleads, and the drop line below the ramp."""
    height, parts = form.layout.deck_height_m, []
    left, right = (float(form.half_width(form.stern_m[1], SLAB_M, side)) for side in (-1.0, 1.0))
    for _ in range(rng.integers(0, 4)):
        z = height * rng.uniform(0.3, 0.75)
        x = float(form.ends(z)[0])
        y = rng.uniform(-left, right * 0.6)
        wide, deep = min(rng.uniform(4.0, 24.0), right - y), rng.uniform(1.0, 3.0)
        low, top = ([[x + 0.5, y], [x - d, y], [x - d, y + wide], [x + 0.5, y + wide]] for d in (0.2, deep))
        sections = [at_height(low, z + rng.uniform(0.8, 2.5)), at_height(top, z)]
        parts.append(loft(sections, paint * rng.uniform(0.8, 1.15), (False, True)))
        path = at_height([[x, y], [x - deep, y], [x - deep, y + wide], [x, y + wide]], z)
        parts.append(build_railing(path, paint * rng.uniform(0.9, 1.4), 2.0))
    count = int(rng.integers(0, 8))
    if count:
        heights = height * rng.uniform(0.15, 0.9, count)
        at = np.stack([form.ends(heights)[0] - 0.05, rng.uniform(-left, right, count) * 0.85, heights], -1)
        size = np.column_stack([np.full(count, 0.5), rng.uniform(0.5, 3.5, count), rng.uniform(0.4, 1.8, count)])
        parts.append(boxes(at, size, paint * rng.uniform(0.3, 1.5, (count, 1))))
    if rng.random() < 0.5:
        parts.append(build_drop_line(form, rng))
    if rng.random() < 0.3:  # round fairleads in a row just above the water
        z = height * rng.uniform(0.6, 0.8)
        x, ring = float(form.ends(z)[0]), disc(0.0, 0.0, rng.uniform(0.3, 0.6), 6)
        for y in np.linspace(-left * 0.7, right * 0.7, int(rng.integers(3, 7))):
            sections = [np.column_stack([np.full(6, x + dx), np.add(ring, (y, z))]) for dx in (0.3, -0.25)]
            parts.append(loft(sections, (0.07, 0.07, 0.08)))
    return join(parts)


def build_drop_line(form: HullForm, rng: Generator) -> Mesh:
    """The painted bar on the stern that continues the centre line downwards, white or with a yellow part."""
    y, shares = form.layout.centre_m[0, 1], [rng.uniform(*part) for part in ((0.15, 0.35), (0.4, 0.6), (0.6, 0.9))]
    z = SLAB_M + (form.layout.deck_height_m - SLAB_M) * np.array([0.0, *shares])
    x = form.ends(z)[0] - rng.uniform(0.1, 0.6)
    half = rng.uniform(0.3, 0.7)
    port, starboard = (np.stack([x, np.full(4, y + side * half), z], -1) for side in (-1.0, 1.0))
    faces = np.stack([port[:-1], starboard[:-1], starboard[1:], port[1:]], 1)
    white = np.full(3, rng.uniform(0.6, 0.95))
    middle = np.array([0.8, 0.65, 0.1]) if rng.random() < 0.5 else white
    return facing(faces, np.array([white, middle, white]), (-1.0, 0.0, 0.0))
