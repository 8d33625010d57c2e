"""What lies around a ship at a distance: other ships, rocks, and a coast along part of the horizon, in the world."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.layout import Layout, world_points
from deckline.sim.ship.mesh import Mesh, at_height, boxes, disc, instances, join, loft, quads
from deckline.sim.ship.vessels import foam_mesh, vessel_mesh

Kind = Literal["none", "fair", "random", "ships", "coast"]
SHIP_RANGE_M = (300.0, 6000.0)  # between two ships' nearest ends
COAST_RANGE_M = (2500.0, 12000.0)  # of the shore, from the runway's beginning
ROCK_RANGE_M = (1200.0, 8000.0)
SECTOR_RAD = np.deg2rad(20.0)  # to both sides of the approach path that stay clear
APPROACH_M = 6000.0  # how far astern
CORRIDOR_M = 150.0  # to both sides of the extended centre line, astern, and ahead as far as `AHEAD_M`
AHEAD_M = 1500.0
SLOPES = np.array([[0.25, 0.31, 0.18], [0.36, 0.36, 0.22], [0.44, 0.38, 0.28], [0.4, 0.4, 0.38], [0.3, 0.26, 0.22]])
SHORES = np.array([[0.62, 0.56, 0.44], [0.42, 0.4, 0.37], [0.72, 0.7, 0.64], [0.34, 0.31, 0.28]])


def background_mesh(layout: Layout, rng: np.random.Generator, kind: Kind = "random") -> Mesh:
    """Things on the water around a ship, or around a runway on land hills alone; none in the way of an approach.

    Args:
        layout: the ship at rest.
        kind: "random": mostly nothing, else ships, rocks, a coast or all of them; "fair": seldom a ship;
            "ships" and "coast": those, always.

    Returns:
        A mesh in the world. Hills are open sheets: their normals point up and towards the sea.

    Raises:
        ValueError: an unknown kind.
    """
    if kind not in ("none", "fair", "random", "ships", "coast"):
        raise ValueError(f"kind must be one of none, fair, random, ships, coast, got {kind!r}")
    ships = kind == "ships" or rng.random() < {"random": 0.35, "fair": 0.15}.get(kind, 0.0)
    coast = kind == "coast" or rng.random() < {"random": 0.25}.get(kind, 0.0)
    parts = []
    if ships and not layout.on_land:
        parts += [placed_vessel(layout, rng) for _ in range(1 if kind == "fair" else rng.choice([1, 2, 3, 5]))]
    if coast:
        parts += [coast_mesh(layout, rng) for _ in range(rng.integers(1, 3))]
        if not layout.on_land:
            parts += [rock_mesh(layout, rng) for _ in range(rng.integers(0, 3))]
    return join(parts)


def approach_axis(layout: Layout) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The runway's beginning and the unit vector of an approach, north and east (2,)."""
    ramp, end = world_points(layout, layout.centre_m)[:, :2]
    return ramp, (end - ramp) / np.linalg.norm(end - ramp)


def in_the_way(layout: Layout, points_m: NDArray[np.float64], radius_m: float) -> bool:
    """Whether anything within `radius` of world points (N, 2) would stand in the way of an approach."""
    ramp, ahead = approach_axis(layout)
    delta = points_m - ramp
    astern = -delta @ ahead
    beside = np.abs(delta @ np.array([-ahead[1], ahead[0]]))
    distance = np.maximum(np.hypot(astern, beside), 1e-6)
    off_axis = np.arctan2(beside, astern)
    swept = np.arcsin(np.clip(radius_m / distance, 0.0, 1.0))
    in_sector = (off_axis - swept < SECTOR_RAD) & (distance - radius_m < APPROACH_M)
    in_corridor = (beside - radius_m < CORRIDOR_M) & (astern + radius_m > -AHEAD_M)
    return bool(np.any(in_sector | in_corridor))


def placed_vessel(layout: Layout, rng: np.random.Generator) -> Mesh:
    """A vessel with its wake somewhere around, on a course of its own or in formation; none where there is no room."""
    kind = str(rng.choice(["escort", "merchant", "boat", "carrier"], p=[0.45, 0.3, 0.2, 0.05]))
    mesh, length = vessel_mesh(kind, rng)
    moving = rng.random() < 0.7
    if moving:
        mesh = join([mesh, foam_mesh(length, 0.12 * length, rng)])
    reach = float(np.hypot(mesh[:, 0], mesh[:, 1]).max())
    middle = world_points(layout, np.array([[layout.length_m / 2, 0.0]]))[0, :2]
    own = float(np.hypot(*(layout.outline_m - [layout.length_m / 2, 0.0]).T).max())
    _, ahead = approach_axis(layout)
    course = float(np.arctan2(ahead[1], ahead[0]))
    near, far = np.log(SHIP_RANGE_M[0] * 1.01), np.log(SHIP_RANGE_M[1] if length > 40 else 2500.0)
    for _ in range(20):
        distance = float(np.exp(rng.uniform(near, far))) + own + reach
        bearing = course + rng.normal(0.0, 0.7) + (0.0 if rng.random() < 0.8 else np.pi)
        at = middle + distance * np.array([np.cos(bearing), np.sin(bearing)])
        if not in_the_way(layout, at[None], reach):
            yaw = course + rng.normal(0.0, 0.1) if rng.random() < 0.4 else rng.uniform(-np.pi, np.pi)
            return instances(mesh, [[*at, layout.sea_z_m]], yaw)
    return join([])


def profile_noise(angle: NDArray[np.float64], rng: np.random.Generator, octaves: int = 5) -> NDArray[np.float64]:
    """Smooth noise along an angle, about -1 to 1, rougher with every octave."""
    total = np.zeros_like(angle)
    for k in range(octaves):
        total += np.sin(angle * rng.uniform(6.0, 9.0) * 2.1**k + rng.uniform(0, 2 * np.pi)) / 1.8**k
    return total / 2.0


def coast_mesh(layout: Layout, rng: np.random.Generator) -> Mesh:
    """Hills behind a shore over some part of the horizon that no approach crosses."""
    ramp, ahead = approach_axis(layout)
    half = np.deg2rad(rng.uniform(5.0, 60.0))
    middle = rng.uniform(-1.0, 1.0) * (np.pi - SECTOR_RAD - half - 0.1)
    span = np.linspace(-half, half, int(24 + 80 * half))
    angle = np.arctan2(ahead[1], ahead[0]) + middle + span
    start = np.exp(rng.uniform(*np.log(COAST_RANGE_M)))
    shore = start * (1.0 + 0.12 * (1.0 + profile_noise(span, rng)))
    ends = np.sqrt(np.clip(1.0 - (span / half) ** 2, 0.0, 1.0))  # low towards both ends
    high = start * np.exp(rng.uniform(np.log(0.004), np.log(0.06)))
    ridge = high * ends * (0.15 + 0.85 * np.clip(0.6 + 0.5 * profile_noise(span, rng), 0.0, 1.5))
    cliff = rng.uniform(0.02, 0.5) * np.clip(1.0 + profile_noise(span, rng, 6), 0.1, 2.0)
    depth = start * rng.uniform(0.05, 0.25)
    shares = (0.0, 0.02, 0.4, 1.0, 1.6)  # of the depth: shore, cliff, slope, ridge, the far foot
    ups = [0.0 * ridge, cliff * ridge, ridge * (0.55 + 0.2 * profile_noise(span, rng, 6)), ridge, 0.0 * ridge]
    points = []
    for share, up in zip(shares, ups, strict=True):
        radius = shore + share * depth
        xy = ramp + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        points.append(np.column_stack([xy, layout.sea_z_m - np.clip(up, 0.0, None)]))
    return join([sheet_mesh(np.array(points), rng), *town_meshes(points[0], points[1], rng)])


def sheet_mesh(points_m: NDArray[np.float64], rng: np.random.Generator) -> Mesh:
    """Faces between rows of points (R, N, 3), shore first, coloured by height and slope."""
    a, b = points_m[:-1, :-1], points_m[:-1, 1:]
    c, d = points_m[1:, 1:], points_m[1:, :-1]
    faces = np.stack([a, b, c, d], 2)
    shore, slopes = SHORES[rng.integers(len(SHORES))], SLOPES[rng.integers(len(SLOPES), size=2)]
    patch = rng.random(faces.shape[:2])[..., None]
    colour = slopes[0] * patch + slopes[1] * (1 - patch)
    colour[0] = shore * (0.85 + 0.3 * patch[0])
    return quads(faces.reshape(-1, 4, 3), colour.reshape(-1, 3))


def town_meshes(shore_m: NDArray[np.float64], above_m: NDArray[np.float64], rng: np.random.Generator) -> list[Mesh]:
    """Light houses scattered above the shore, a jetty, or a lighthouse."""
    if rng.random() < 0.5:
        return []
    count = int(rng.integers(5, 60))
    place = np.clip(rng.normal(rng.uniform(0.2, 0.8), 0.08, count), 0.0, 1.0) * (len(shore_m) - 1.001)
    k, share = place.astype(int), (place % 1.0)[:, None]
    at = above_m[k] * (1 - share) + above_m[k + 1] * share
    size = rng.uniform([8.0, 8.0, 6.0], [40.0, 25.0, 25.0], (count, 3))
    tint = rng.uniform(0.55, 0.92, (count, 1)) * np.array([1.0, 0.97, 0.92])
    parts = [boxes(at + np.array([0.0, 0.0, 3.0]), size, rng.uniform(-np.pi, np.pi, count), tint)]
    if rng.random() < 0.4:
        foot = shore_m[rng.integers(1, len(shore_m) - 1)]
        parts.append(boxes([foot], (6.0, 6.0, rng.uniform(20.0, 45.0)), 0.0, (0.9, 0.88, 0.85)))
    return parts


def rock_mesh(layout: Layout, rng: np.random.Generator) -> Mesh:
    """A small island of rings that shrink towards its top."""
    ramp, ahead = approach_axis(layout)
    wide, tall = np.exp(rng.uniform(np.log(30.0), np.log(600.0))), rng.uniform(0.08, 0.4)
    rough = 1.0 + 0.2 * profile_noise(np.linspace(0.0, 1.0, 14), rng)
    rings = []
    for share, up in ((1.0, 0.0), (0.93, 0.25), (0.6, 0.75), (0.2, 1.0)):
        ring = disc(0.0, 0.0, share * wide, 14) * rough[:, None] * rng.uniform(0.9, 1.1, (14, 1))
        rings.append(at_height(ring * [1.0, rng.uniform(0.5, 0.9)], -up * tall * wide))
    base, slope = SHORES[rng.integers(len(SHORES))], SLOPES[rng.integers(len(SLOPES))]
    colours = np.array([base, slope, slope * 1.1])[:, None] * rng.uniform(0.8, 1.2, (3, 14, 1))
    mesh = loft(rings, colours, (False, True))
    reach = float(np.hypot(mesh[:, 0], mesh[:, 1]).max())
    for _ in range(20):
        bearing = np.arctan2(ahead[1], ahead[0]) + rng.uniform(-2.2, 2.2)
        distance = np.exp(rng.uniform(*np.log(ROCK_RANGE_M))) + reach
        at = ramp + distance * np.array([np.cos(bearing), np.sin(bearing)])
        if not in_the_way(layout, at[None], reach):
            return instances(mesh, [[*at, layout.sea_z_m]], rng.uniform(-np.pi, np.pi))
    return join([])
