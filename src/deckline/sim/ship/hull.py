"""The hull under a deck: slab, flared sides, transom with its opening, bow, and a ski jump.

The hull is one loft through frames. A frame's corners lie on levels, from under the deck down to the keel; every
level has its own stern, bow and half width, so that bows rake and sides flare.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.clearance import CLEAR_M, before_end, runway_distance
from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import Mesh, frustum, join, loft, quads
from deckline.sim.ship.ship_class import Hull

SLAB_M = 1.6  # depth of the deck's edge
DRAUGHT_M = 5.0  # how far hulls reach below the water, where the renderer cuts them off
BOOT_M = 1.2  # height of the dark stripe above the water
STATIONS = np.array([0.0, 0.04, 0.12, 0.3, 0.5, 0.65, 0.76, 0.85, 0.92, 0.97, 1.0])  # of frames, along a level
LIMIT_M = 0.5  # the hull's top stays this far inside the deck's edge
BOOTS = ((0.16, 0.05, 0.05), (0.08, 0.08, 0.09), (0.35, 0.1, 0.08), (0.05, 0.07, 0.1))


@dataclass(frozen=True, eq=False)
class Form:
    """The shape of a hull."""

    layout: Layout
    beam_m: float  # half width at the water, amidships
    stern_m: tuple[float, float]  # x of the transom at the water and under the deck
    bow_m: tuple[float, float]  # x of the stem at the water and under the deck
    transom: float  # width of the transom at the water, of the beam
    flare: float  # width under the deck over that at the water
    curve: float  # exponent of the flare over height: 1 is straight
    bow_width: float  # width under the deck at the bow, of the beam: small is pointed


def random_hull(layout: Layout, rng: np.random.Generator) -> Hull:
    """Colours and proportions of a warship that nobody built."""
    width = float(np.median(layout.starboard_m - layout.port_m))
    bow = str(rng.choice(["blunt", "raked", "ski-jump"], p=[0.35, 0.45, 0.2]))
    grey = rng.uniform(0.4, 0.75) * np.array([0.97, 1.0, 1.03]) * rng.uniform(0.96, 1.04, 3)
    ramp = (rng.uniform(2.0, 6.0), rng.uniform(0.12, 0.22) * layout.length_m) if bow == "ski-jump" else (0.0, 0.0)
    return Hull(
        beam_m=float(rng.uniform(0.55, 0.85) * width),
        bow=bow,  # type: ignore[arg-type]
        rgb=(float(grey[0]), float(grey[1]), float(grey[2])),
        stern_x_m=float(rng.uniform(0.5, 6.0)),
        ramp_height_m=float(ramp[0]),
        ramp_length_m=float(ramp[1]),
        number=str(rng.integers(2, 99)) if rng.random() < 0.7 else "",
    )


def random_form(layout: Layout, hull: Hull, rng: np.random.Generator) -> Form:
    """The part of a hull's shape that its data leave open."""
    length = layout.length_m
    blunt = hull.bow == "blunt"
    stem = length - rng.uniform(1.0, 3.0)
    return Form(
        layout,
        beam_m=hull.beam_m / 2,
        stern_m=(hull.stern_x_m + rng.uniform(-0.3, 3.0), hull.stern_x_m),
        bow_m=(stem - rng.uniform(0.02, 0.09) * length, stem),
        transom=rng.uniform(0.7, 1.0),
        flare=rng.uniform(1.05, 1.5),
        curve=rng.uniform(1.0, 2.2),
        bow_width=rng.uniform(0.5, 0.9) if blunt else rng.uniform(0.05, 0.35),
    )


def stem_and_stern(form: Form, z_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x of the transom and of the stem at heights."""
    rise = np.clip((form.layout.deck_height_m - z_m) / (form.layout.deck_height_m - SLAB_M), 0.0, 1.0)
    stern = form.stern_m[0] + (form.stern_m[1] - form.stern_m[0]) * rise
    return stern, form.bow_m[0] + (form.bow_m[1] - form.bow_m[0]) * rise


def half_width(form: Form, x_m: NDArray[np.float64], z_m: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    """Distance of the hull's side from the ship's axis; side -1 is port."""
    layout = form.layout
    rise = np.clip((layout.deck_height_m - z_m) / (layout.deck_height_m - SLAB_M), 0.0, 1.0)
    stern, bow = stem_and_stern(form, z_m)
    s = np.clip((x_m - stern) / (bow - stern), 0.0, 1.0)
    t = form.transom
    water = np.interp(s, [0.0, 0.12, 0.3, 0.6, 0.76, 0.9, 1.0], [t, (1 + t) / 2, 1.0, 1.0, 0.82, 0.38, 0.015])
    top = form.flare * np.interp(
        s, [0.0, 0.2, 0.75, 0.92, 1.0], [(1 + t) / 2, 1.0, 1.0, (1 + form.bow_width) / 2, form.bow_width]
    )
    half = form.beam_m * (water + (top - water) * rise**form.curve)
    edge = np.interp(x_m, layout.stations_m, layout.starboard_m if side > 0 else -layout.port_m)
    return np.minimum(half, np.maximum(edge - LIMIT_M, 0.2))


def hull_mesh(layout: Layout, hull: Hull, form: Form, rng: np.random.Generator) -> Mesh:
    """The hull with its boot stripe; its transom may open into a dark hangar or mooring deck."""
    height = layout.deck_height_m
    top, bottom = SLAB_M + rng.uniform(0.5, 2.5), height * rng.uniform(0.42, 0.72)
    opening = (top, bottom) if rng.random() < 0.65 and bottom - top > 1.5 else None
    boot = height - BOOT_M * rng.uniform(0.3, 1.5)
    inner = [*opening] if opening else [0.4 * height]
    levels = np.array([SLAB_M, *inner, 0.82 * height, boot, height, height + max(DRAUGHT_M, 0.01)])
    levels = np.sort(levels)
    paint, dark = np.array(hull.rgb), np.array(BOOTS[rng.integers(len(BOOTS))])
    stern, bow = stem_and_stern(form, levels)
    x = stern + STATIONS[:, None] * (bow - stern)  # (K, L)
    z = np.broadcast_to(levels, x.shape)
    sides = [np.stack([x, side * half_width(form, x, z, side), z], -1) for side in (-1.0, 1.0)]
    frames = np.concatenate([sides[0], sides[1][:, ::-1]], axis=1)
    middle = (levels[:-1] + levels[1:]) / 2
    band = np.where((middle > boot)[:, None], dark, paint * np.interp(middle, [0, height], [1.04, 0.9])[:, None])
    around = np.concatenate([band, dark[None], band[::-1], paint[None] * 0.5])
    shade = rng.uniform(0.94, 1.06, (len(STATIONS) - 1, len(around), 1))
    body = loft(frames, around * shade, (False, True))
    return join([body, transom_mesh(sides[0][0], sides[1][0], band, opening, rng)])


def transom_mesh(
    port_m: NDArray[np.float64],
    starboard_m: NDArray[np.float64],
    band: NDArray[np.float64],
    opening: tuple[float, float] | None,
    rng: np.random.Generator,
) -> Mesh:
    """The stern plate, level by level, around an opening between two levels."""
    faces, colours, halls = [], [], []
    reach = rng.uniform(0.55, 0.92, 2)
    for k in range(len(port_m) - 1):
        p0, p1, s0, s1 = port_m[k], port_m[k + 1], starboard_m[k], starboard_m[k + 1]
        if opening and opening[0] <= (p0[2] + p1[2]) / 2 <= opening[1]:
            a, b = -reach[0] * min(-p0[1], -p1[1]), reach[1] * min(s0[1], s1[1])
            hole = np.array([[p0[0], a, p0[2]], [p0[0], b, p0[2]], [p1[0], b, p1[2]], [p1[0], a, p1[2]]])
            faces += [[p0, p1, hole[3], hole[0]], [hole[1], hole[2], s1, s0]]
            colours += [band[k], band[k]]
            halls.append(recess(hole, rng.uniform(4.0, 12.0), band[k] * rng.uniform(0.25, 0.6)))
        else:
            faces.append([p0, p1, s1, s0])
            colours.append(band[k])
    plate = quads(np.array(faces), np.array(colours) * rng.uniform(0.92, 1.05))
    return join([plate, *halls])


def recess(hole_m: NDArray[np.float64], depth_m: float, rgb: NDArray[np.float64]) -> Mesh:
    """Walls, floor, ceiling and back of a hall whose opening is `hole` (4, 3), seen from astern."""
    back = hole_m + np.array([depth_m, 0.0, 0.0])
    a, b, c, d = hole_m
    e, f, g, h = back
    faces = np.array([[e, h, g, f], [a, e, f, b], [d, c, g, h], [a, d, h, e], [b, f, g, c]])
    return quads(faces, rgb * np.array([[0.75], [0.4], [1.25], [0.8], [0.8]]))


def slab_mesh(layout: Layout, runway: bool, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """Edge and underside of the deck; the stern may be a round-down, painted or not."""
    edge = layout.outline_m
    n = len(layout.stations_m)
    walls = frustum(edge, SLAB_M, edge, 0.0, paint * rng.uniform(0.6, 1.1), cap=False)
    left, right = edge[:n], edge[n:][::-1]
    corners = np.stack([left[:-1], left[1:], right[1:], right[:-1]], 1)
    under = quads(np.concatenate([corners, np.full((n - 1, 4, 1), SLAB_M)], 2), paint * 0.45)
    parts = [walls, under]
    if rng.random() < 0.7:
        parts.append(round_down(layout, runway, paint, rng))
    return join(parts)


def round_down(layout: Layout, runway: bool, paint: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """The stern's edge, curved or cut down to what the hook may strike, as wide as the runway or the stern."""
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
    return loft(ends, colours[None])


def ski_jump(layout: Layout, runway: bool, hull: Hull, rgb: NDArray[np.float64]) -> Mesh:
    """The bow's ramp: a curved wedge that keeps off the runway, on one side only where the runway passes."""
    if hull.ramp_height_m <= 0 or hull.ramp_length_m <= 0:
        return join([])
    x = layout.length_m - hull.ramp_length_m * np.linspace(1.0, 0.0, 9)
    port, starboard = (np.interp(x, layout.stations_m, edge) for edge in (layout.port_m, layout.starboard_m))
    low, high = clear_span(layout, x, port, starboard) if runway else (port, starboard)
    if np.min(high - low) < 6.0:
        return join([])
    z = -hull.ramp_height_m * np.linspace(0.0, 1.0, 9) ** 1.7
    zero = np.zeros(9)
    corners = [(low, zero), (high, zero), (high, z), (low, z)]
    sections = np.stack([np.stack([x, y, up], -1) for y, up in corners], 1)
    return loft(sections, rgb * np.array([1.0, 1.1, 1.0, 1.1])[None, :, None])


def clear_span(
    layout: Layout, x_m: NDArray[np.float64], port_m: NDArray[np.float64], starboard_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The wider side of the deck (from y, to y) that no runway line comes near, at stations."""
    y = np.linspace(port_m, starboard_m, 60)
    points = np.stack([np.broadcast_to(x_m, y.shape), y], -1)
    taken = (runway_distance(layout, points) < CLEAR_M + 1.5) & before_end(layout, points, 15.0)
    if not taken.any():
        return port_m, starboard_m
    first = np.min(np.where(taken, y, np.inf), axis=0)
    last = np.max(np.where(taken, y, -np.inf), axis=0)
    high, low = np.minimum(starboard_m, first.min()), np.maximum(port_m, last.max())
    return (low, starboard_m) if np.min(starboard_m - low) >= np.min(high - port_m) else (port_m, high)
