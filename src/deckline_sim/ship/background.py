"""What lies around a ship at a distance: other ships, rocks, and a coast along part of the horizon.

Vessel frame: x forward, y to starboard, z down, z = 0 at the water. Backgrounds are placed in the world.
"""

from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from deckline_sim.ship import mesh as m
from deckline_sim.ship.clutter import prototype
from deckline_sim.ship.hull import DRAUGHT_M
from deckline_sim.ship.layout import Layout, random_layout, world_points
from deckline_sim.ship.mesh import Array, Mesh
from deckline_sim.ship.structure import build_mast, build_structure

BackgroundKind = Literal["none", "fair", "random", "ships", "coast"]
VESSELS = {"escort": 0.45, "merchant": 0.3, "boat": 0.2, "carrier": 0.05}  # how often each is met
SHIP_RANGE_M = (300.0, 6000.0)  # between two ships' nearest ends
COAST_RANGE_M = (2500.0, 12000.0)  # of the shore, from the runway's beginning
ROCK_RANGE_M = (1200.0, 8000.0)
SECTOR_RAD = np.deg2rad(20.0)  # to both sides of the approach path that stay clear
APPROACH_M = 6000.0  # how far astern
CORRIDOR_M = 150.0  # to both sides of the extended centre line, astern, and ahead as far as `AHEAD_M`
AHEAD_M = 1500.0
SLOPES = np.array([[25, 31, 18], [36, 36, 22], [44, 38, 28], [40, 40, 38], [30, 26, 22]]) / 100
SHORES = np.array([[62, 56, 44], [42, 40, 37], [72, 70, 64], [34, 31, 28]]) / 100
HULLS = np.array([[12, 14, 20], [45, 14, 10], [10, 10, 10], [16, 30, 22], [20, 35, 55], [80, 80, 78]]) / 100
CARGO = np.array([[55, 20, 14], [18, 30, 50], [70, 70, 68], [20, 40, 30], [75, 55, 15], [40, 40, 42]]) / 100
DARK = np.array([0.08, 0.09, 0.11])


def background_mesh(layout: Layout, rng: Generator, kind: BackgroundKind = "random") -> Mesh:
    """Things on the water around a ship, or around a runway on land hills alone; none in the way of an approach.

    Args:
        layout: the ship at rest.
        rng: of all that is random.
        kind: "random": mostly nothing, else ships, rocks, a coast or all of them; "fair": seldom a ship;
            "ships" and "coast": those, always.

    Returns:
        A mesh in the world. Hills are open surfaces: their normals point up and towards the sea.
    """
    ships = kind == "ships" or rng.random() < {"random": 0.35, "fair": 0.15}.get(kind, 0.0)
    coast = kind == "coast" or rng.random() < {"random": 0.25}.get(kind, 0.0)
    parts = []
    if ships and not layout.on_land:
        parts += [place_vessel(layout, rng) for _ in range(1 if kind == "fair" else rng.choice([1, 2, 3, 5]))]
    if coast:
        parts += [build_coast(layout, rng) for _ in range(rng.integers(1, 3))]
        if not layout.on_land:
            parts += [place_rock(layout, rng) for _ in range(rng.integers(0, 3))]
    return m.join(parts)


def approach_axis(layout: Layout) -> tuple[Array, Array, float]:
    """The runway's beginning and the unit vector of an approach, north and east (2,), and its course, rad."""
    ramp, end = world_points(layout, layout.centre_m)[:, :2]
    ahead = (end - ramp) / np.linalg.norm(end - ramp)
    return ramp, ahead, float(np.arctan2(ahead[1], ahead[0]))


def blocks_approach(layout: Layout, point_m: Array, radius_m: float) -> bool:
    """Whether anything within `radius` of a world point (2,) would block an approach."""
    ramp, ahead, _ = approach_axis(layout)
    delta = point_m - ramp
    astern, beside = -delta @ ahead, np.abs(delta @ np.array([-ahead[1], ahead[0]]))
    distance = np.maximum(np.hypot(astern, beside), 1e-6)
    swept = np.arcsin(np.clip(radius_m / distance, 0.0, 1.0))
    in_sector = np.arctan2(beside, astern) - swept < SECTOR_RAD and distance - radius_m < APPROACH_M
    return bool(in_sector or (beside - radius_m < CORRIDOR_M and astern + radius_m > -AHEAD_M))


def place_vessel(layout: Layout, rng: Generator) -> Mesh:
    """A vessel with its wake somewhere around, on a course of its own or in formation; none where there is no room."""
    mesh, length = vessel_mesh(str(rng.choice(list(VESSELS), p=list(VESSELS.values()))), rng)
    if rng.random() < 0.7:  # under way
        mesh = m.join([mesh, build_foam(length, 0.12 * length, rng)])
    reach = float(np.hypot(mesh[:, 0], mesh[:, 1]).max())
    middle = world_points(layout, np.array([[layout.length_m / 2, 0.0]]))[0, :2]
    own = float(np.hypot(*(layout.outline_m - [layout.length_m / 2, 0.0]).T).max())
    course = approach_axis(layout)[2]
    near, far = np.log(SHIP_RANGE_M[0] * 1.01), np.log(SHIP_RANGE_M[1] if length > 40 else 2500.0)
    for _ in range(20):
        distance = float(np.exp(rng.uniform(near, far))) + own + reach
        bearing = course + rng.normal(0.0, 0.7) + (0.0 if rng.random() < 0.8 else np.pi)
        at = middle + distance * np.array([np.cos(bearing), np.sin(bearing)])
        if not blocks_approach(layout, at, reach):
            yaw = course + rng.normal(0.0, 0.1) if rng.random() < 0.4 else rng.uniform(-np.pi, np.pi)
            return m.instances(mesh, (*at, layout.sea_z_m), yaw)
    return m.join([])


def profile_noise(angle: Array, rng: Generator, octaves: int = 5) -> Array:
    """Smooth noise along an angle, about -1 to 1, rougher with every octave."""
    total = np.zeros_like(angle)
    for k in range(octaves):
        total += np.sin(angle * rng.uniform(6.0, 9.0) * 2.1**k + rng.uniform(0, 2 * np.pi)) / 1.8**k
    return total / 2.0


def build_coast(layout: Layout, rng: Generator) -> Mesh:
    """Hills behind a shore over some part of the horizon that no approach crosses, coloured by height and slope."""
    ramp, _, course = approach_axis(layout)
    half = np.deg2rad(rng.uniform(5.0, 60.0))
    middle = rng.uniform(-1.0, 1.0) * (np.pi - SECTOR_RAD - half - 0.1)
    span = np.linspace(-half, half, int(24 + 80 * half))
    angle = course + middle + span
    start = np.exp(rng.uniform(*np.log(COAST_RANGE_M)))
    shore = start * (1.0 + 0.12 * (1.0 + profile_noise(span, rng)))
    ends = np.sqrt(np.clip(1.0 - (span / half) ** 2, 0.0, 1.0))  # low towards both ends
    high = start * np.exp(rng.uniform(np.log(0.004), np.log(0.06)))
    ridge = high * ends * (0.15 + 0.85 * np.clip(0.6 + 0.5 * profile_noise(span, rng), 0.0, 1.5))
    cliff = rng.uniform(0.02, 0.5) * np.clip(1.0 + profile_noise(span, rng, 6), 0.1, 2.0)
    depth = start * rng.uniform(0.05, 0.25)
    shares = (0.0, 0.02, 0.4, 1.0, 1.6)  # of the depth: shore, cliff, slope, ridge, the far foot
    ups = [0.0 * ridge, cliff * ridge, ridge * (0.55 + 0.2 * profile_noise(span, rng, 6)), ridge, 0.0 * ridge]
    directions, rows = np.column_stack([np.cos(angle), np.sin(angle)]), []
    for share, up in zip(shares, ups, strict=True):
        xy = ramp + (shore + share * depth)[:, None] * directions
        rows.append(m.at_height(xy, layout.sea_z_m - np.clip(up, 0.0, None)))
    faces = np.stack([m.strip(low, top) for low, top in pairwise(rows)])
    sand, slopes = SHORES[rng.integers(len(SHORES))], SLOPES[rng.integers(len(SLOPES), size=2)]
    patch = rng.random(faces.shape[:2])[..., None]
    colour = slopes[0] * patch + slopes[1] * (1 - patch)
    colour[0] = sand * (0.85 + 0.3 * patch[0])
    hills = m.quads(faces.reshape(-1, 4, 3), colour.reshape(-1, 3))
    return m.join([hills, *build_town(rows[0], rows[1], rng)])


def build_town(shore_m: Array, above_m: Array, rng: Generator) -> list[Mesh]:
    """Light houses scattered above the shore, and a lighthouse, at times."""
    if rng.random() < 0.5:
        return []
    count = int(rng.integers(5, 60))
    place = np.clip(rng.normal(rng.uniform(0.2, 0.8), 0.08, count), 0.0, 1.0) * (len(shore_m) - 1.001)
    k, share = place.astype(int), (place % 1.0)[:, None]
    at = above_m[k] * (1 - share) + above_m[k + 1] * share
    size = rng.uniform([8.0, 8.0, 6.0], [40.0, 25.0, 25.0], (count, 3))
    tint = rng.uniform(0.55, 0.92, (count, 1)) * np.array([1.0, 0.97, 0.92])
    parts = [m.boxes(at + np.array([0.0, 0.0, 3.0]), size, tint, rng.uniform(-np.pi, np.pi, count))]
    if rng.random() < 0.4:
        foot = shore_m[rng.integers(1, len(shore_m) - 1)]
        parts.append(m.boxes(foot, (6.0, 6.0, rng.uniform(20.0, 45.0)), (0.9, 0.88, 0.85)))
    return parts


def place_rock(layout: Layout, rng: Generator) -> Mesh:
    """A small island of rings that shrink towards its top."""
    ramp, _, course = approach_axis(layout)
    wide, tall = np.exp(rng.uniform(np.log(30.0), np.log(600.0))), rng.uniform(0.08, 0.4)
    rough = 1.0 + 0.2 * profile_noise(np.linspace(0.0, 1.0, 14), rng)
    rings = []
    for share, up in ((1.0, 0.0), (0.93, 0.25), (0.6, 0.75), (0.2, 1.0)):
        ring = m.disc(0.0, 0.0, share * wide, 14) * rough[:, None] * rng.uniform(0.9, 1.1, (14, 1))
        rings.append(m.at_height(ring * [1.0, rng.uniform(0.5, 0.9)], -up * tall * wide))
    base, slope = SHORES[rng.integers(len(SHORES))], SLOPES[rng.integers(len(SLOPES))]
    colours = np.array([base, slope, slope * 1.1])[:, None] * rng.uniform(0.8, 1.2, (3, 14, 1))
    mesh = m.loft(rings, colours, (False, True))
    reach = float(np.hypot(mesh[:, 0], mesh[:, 1]).max())
    for _ in range(20):
        bearing = course + rng.uniform(-2.2, 2.2)
        distance = np.exp(rng.uniform(*np.log(ROCK_RANGE_M))) + reach
        at = ramp + distance * np.array([np.cos(bearing), np.sin(bearing)])
        if not blocks_approach(layout, at, reach):
            return m.instances(mesh, (*at, layout.sea_z_m), rng.uniform(-np.pi, np.pi))
    return m.join([])


def vessel_mesh(kind: str, rng: Generator) -> tuple[Mesh, float]:
    """A vessel of a kind, floating around the origin, and its length, m."""
    builders = {"escort": build_escort, "merchant": build_merchant, "boat": build_boat, "carrier": build_carrier}
    parts, length = builders[kind](rng)
    mesh = m.join(parts)
    mesh[:, 6:] = np.clip(mesh[:, 6:], 0.0, 1.0)
    return mesh, length


def build_body(length_m: float, beam_m: float, free_m: float, rgb: ArrayLike, boot: ArrayLike, sheer_m: float) -> Mesh:
    """A ship's hull: full amidships, raked and raised at the bow, with a boot stripe and a flat deck."""
    s = np.array([0.0, 0.08, 0.3, 0.6, 0.8, 0.92, 1.0])
    top = beam_m / 2 * np.array([0.85, 0.95, 1.0, 1.0, 0.85, 0.5, 0.03])
    water = beam_m / 2 * np.array([0.75, 0.9, 0.97, 0.95, 0.62, 0.25, 0.01])
    up = -free_m - sheer_m * np.clip((s - 0.5) / 0.5, 0.0, 1.0) ** 2
    x = (s - 0.5) * length_m
    rake = np.where(s > 0.7, (s - 0.7) / 0.3 * 0.06 * length_m, 0.0)
    levels = [(x, top, up), (x - 0.8 * rake, water + 0.15 * (top - water), np.full(7, -0.12 * free_m))]
    levels.append((x - rake, water, np.full(7, DRAUGHT_M)))
    sides = [np.stack([np.stack([a, side * half, z], -1) for a, half, z in levels], 1) for side in (-1.0, 1.0)]
    frames = np.concatenate([sides[0], sides[1][:, ::-1]], axis=1)
    paint, low = np.asarray(rgb, dtype=np.float64), np.asarray(boot, dtype=np.float64)
    return m.loft(frames, np.array([paint, low, low, low, paint, 0.8 * paint])[None])


def build_escort(rng: Generator) -> tuple[list[Mesh], float]:
    """A frigate or destroyer: gun, bridge, masts, funnels, hangar and a flight deck aft."""
    length = rng.uniform(80.0, 175.0)
    beam, free = length * rng.uniform(0.1, 0.14), length * rng.uniform(0.035, 0.055)
    grey, white = rng.uniform(0.42, 0.72) * np.array([0.96, 1.0, 1.04]), (0.85, 0.85, 0.85)
    parts = [build_body(length, beam, free, grey, DARK, 0.02 * length)]
    houses = [(-0.2, 0.16, 0.8, 0.05), (0.02, 0.2, 0.6, 0.04), (0.17, 0.16, 0.9, 0.075), (0.17, 0.09, 0.75, 0.11)]
    for s, span, wide, tall in houses:
        base = m.rectangle(s * length, 0.0, span * length * rng.uniform(0.8, 1.2), wide * beam)
        lean = (base - [s * length, 0.0]) * [0.92, 0.82] + [s * length, 0.0]
        rise = tall * length * rng.uniform(0.8, 1.15)
        parts.append(m.frustum(base, -free + 0.5, lean, -free - rise, grey * rng.uniform(0.92, 1.08)))
    parts.append(m.boxes((0.17 * length, 0.0, -free - 0.085 * length), (0.11 * length, 0.86 * beam, 1.1), DARK))
    for s in rng.choice([[0.08], [0.08, -0.08], [-0.04]][rng.integers(3)], 1):
        foot = m.rectangle(s * length, 0.0, 0.06 * length, 0.4 * beam)
        parts.append(m.frustum(foot, -free, foot * [1, 0.8], -free - 0.1 * length, grey))
        parts.append(m.boxes((s * length, 0.0, -free - 0.1 * length), (0.05 * length, 0.3 * beam, 1.0), DARK))
    parts += build_mast(0.13 * length, 0.0, free + 0.1 * length, length * rng.uniform(0.08, 0.16), grey, rng)
    gun = np.array([0.33 * length, 0.0, -free - 0.006 * length])
    parts += [
        m.boxes(gun, (4.5, 3.2, 2.6), grey),
        m.rods(np.add(gun, (0, 0, -1.8)), np.add(gun, (7, 0, -2.6)), 0.35, grey),
    ]
    parts.append(m.dome(-0.2 * length, 0.0, -free - 0.065 * length, 1.3, white, 6))
    deck = np.array([-0.41 * length, 0.0, -free - 0.06])
    parts.append(m.boxes(deck, (0.16 * length, 0.84 * beam, 0.05), grey * 0.45))
    parts += [m.boxes(np.add(deck, (0, y * beam, -0.06)), (0.15 * length, 0.3, 0.02), white) for y in (-0.3, 0.0, 0.3)]
    if rng.random() < 0.3:
        parts.append(m.instances(prototype("helicopter"), deck - [0, 0, 0.1], 0.0, 14.0, grey))
    return parts, length


def build_merchant(rng: Generator) -> tuple[list[Mesh], float]:
    """A tanker, a bulk carrier or a container ship: a white house aft, pipes, hatches or boxes before it."""
    length = rng.uniform(90.0, 330.0)
    beam, free = length * rng.uniform(0.13, 0.17), length * rng.uniform(0.025, 0.055)
    hull, deck = HULLS[rng.integers(len(HULLS))], np.array([0.42, 0.2, 0.15]) * rng.uniform(0.7, 1.4)
    tall, white = rng.uniform(12.0, 24.0), np.full(3, rng.uniform(0.75, 0.92))
    parts = [
        build_body(length, beam, free, hull, (0.42, 0.12, 0.1), 0.01 * length),
        m.boxes((-0.05 * length, 0.0, -free), (0.7 * length, 0.8 * beam, 0.1), deck),
        m.boxes((-0.4 * length, 0.0, -free + 0.3), (0.07 * length, 0.8 * beam, tall), white),
        m.boxes((-0.39 * length, 0.0, -free - tall), (0.04 * length, 1.05 * beam, 3.0), white),
        m.boxes((-0.368 * length, 0.0, -free - tall - 0.9), (0.3, 1.0 * beam, 1.2), DARK),
    ]
    rows = np.arange(4.0, tall - 1.0, 3.0)
    panes = m.at_height(np.full((len(rows), 2), [-0.4 * length, 0.0]), -free - rows)
    parts.append(m.boxes(panes, (0.0705 * length, 0.7 * beam, 0.9), DARK * 2))
    funnel = (0.03 * length, 0.25 * beam, tall + 5.0)
    parts.append(m.boxes((-0.45 * length, 0.0, -free), funnel, CARGO[rng.integers(6)]))
    kind = rng.integers(3)
    if kind == 0:
        starts = np.array([[-0.35 * length, y * beam, -free - 1.5] for y in (-0.08, 0.0, 0.08)])
        parts.append(m.rods(starts, starts + np.array([0.75 * length, 0, 0]), 0.7, deck * 1.3))
        posts = np.array([[x * length, side * 3.0, -free] for x in (-0.1, 0.1, 0.3) for side in (-1, 1)])
        parts.append(m.rods(posts, posts - [0, 0, 10.0], 0.6, white))
    elif kind == 1:
        hatches = np.array([[x * length, 0.0, -free] for x in np.arange(-0.28, 0.36, 0.1)])
        parts.append(m.boxes(hatches, (0.07 * length, 0.6 * beam, 2.0), deck * 1.2))
        cranes = hatches[::2] + np.array([0.05 * length, 0.0, 0.0])
        parts.append(m.rods(cranes, cranes - [0, 0, 16.0], 1.5, white))
    else:
        x, y = np.meshgrid(np.arange(-0.33, 0.38, 13.5 / length) * length, np.arange(-0.42, 0.43, 5.2 / beam) * beam)
        stacks = m.at_height(np.column_stack([x.ravel(), y.ravel()]), -free)
        size = m.at_height(np.full((x.size, 2), [12.3, 5.0]), 2.6 * rng.integers(1, 7, x.size))
        parts.append(m.boxes(stacks, size, CARGO[rng.integers(6, size=x.size)]))
    return parts, length


def build_boat(rng: Generator) -> tuple[list[Mesh], float]:
    """A fishing or motor boat, or a sailing one."""
    length = rng.uniform(8.0, 32.0)
    hull, white = HULLS[rng.integers(len(HULLS))], np.full(3, rng.uniform(0.75, 0.95))
    beam, free = length * rng.uniform(0.22, 0.32), length * rng.uniform(0.06, 0.1)
    parts = [build_body(length, beam, free, hull, hull * 0.5, 0.05 * length)]
    if rng.random() < 0.25:
        sail = np.array([[0.28, 0.0, -0.1], [-0.3, 0.0, -0.12], [0.05, 0.0, -1.15]]) * length
        parts += [m.triangles(sail[None], white), m.triangles(sail[None, ::-1], white)]
        mast = ((0.05 * length, 0, -free), (0.05 * length, 0, -1.2 * length))
        return [*parts, m.rods(*mast, 0.15, white * 0.7)], length
    at = rng.uniform(-0.25, 0.15) * length
    parts.append(m.boxes((at, 0.0, -free), (0.28 * length, 0.65 * beam, 0.14 * length), white))
    parts.append(m.boxes((at, 0.0, -free - 0.08 * length), (0.285 * length, 0.67 * beam, 0.035 * length), DARK))
    return [*parts, m.rods((at, 0, -free), (at, 0, -free - 0.4 * length), 0.02 * length, white * 0.8)], length


def build_carrier(rng: Generator) -> tuple[list[Mesh], float]:
    """Another flight deck, bare of any marking."""
    layout = random_layout(rng)
    while layout.on_land:
        layout = random_layout(rng)
    solids = build_structure(layout, False, rng)[0]
    edges = [m.at_height(np.column_stack([layout.stations_m, y]), 0.0) for y in (layout.port_m, layout.starboard_m)]
    deck = m.quads(m.strip(*edges)[:, ::-1], rng.uniform(0.2, 0.38) * np.ones(3))  # looking up
    whole = m.join([solids, deck])
    whole[:, :3] -= np.array([layout.length_m / 2, 0.0, layout.deck_height_m], dtype=np.float32)
    return [whole], layout.length_m


def build_foam(length_m: float, beam_m: float, rng: Generator) -> Mesh:
    """The wake on the water astern of a vessel under way, wider and weaker with distance."""
    stretch = length_m * rng.uniform(1.0, 4.0)
    x = -length_m / 2 - stretch * np.linspace(0.0, 1.0, 7)
    half = beam_m * (0.4 + 0.6 * np.linspace(0.0, 1.0, 7)) * rng.uniform(0.8, 1.2, 7)
    left, right = (m.at_height(np.column_stack([x, side * half]), -0.03) for side in (-1.0, 1.0))
    return m.quads(m.strip(left, right), np.linspace(0.75, 0.3, 6)[:, None] * np.array([0.9, 1.0, 1.02]))
