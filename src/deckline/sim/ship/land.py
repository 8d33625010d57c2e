"""What stands beside a runway on land: trees, sheds, hangars, a tower, parked aircraft. The ground is flat."""

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.aircraft import KINDS, prototype
from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import Mesh, at_height, boxes, disc, frustum, instances, join, loft
from deckline.sim.ship.paint import axes

WALLS = np.array([[0.75, 0.72, 0.66], [0.6, 0.62, 0.64], [0.55, 0.35, 0.28], [0.85, 0.85, 0.83], [0.45, 0.5, 0.45]])
LEAVES = np.array([[0.2, 0.32, 0.14], [0.26, 0.36, 0.18], [0.32, 0.36, 0.16], [0.16, 0.27, 0.15]])
CLEAR_M = 45.0  # from a runway line to the nearest thing


def land_mesh(layout: Layout, rng: np.random.Generator) -> Mesh:
    """Woods, buildings and an apron on both sides of the strip, none of them astern of its beginning near the path."""
    parts = [woods(layout, rng)]
    if rng.random() < 0.8:
        parts.append(airfield(layout, rng))
    for _ in range(rng.integers(0, 12)):
        size = rng.uniform([8, 6, 3], [40, 25, 12])
        beyond = rng.uniform(CLEAR_M + 40.0, 700.0)
        at = beside(layout, rng.uniform(-0.3, 2.0), beyond, rng)
        parts.append(boxes([at], size, rng.uniform(-np.pi, np.pi), WALLS[rng.integers(len(WALLS))]))
    return join(parts)


def beside(layout: Layout, share: float, out_m: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """A point on the ground (3,): a share of the runway's length from its beginning, so far out on either side."""
    along, right, length = axes(*layout.centre_m)
    half = float(np.hypot(*(layout.right_m[0] - layout.left_m[0]))) / 2
    xy = layout.centre_m[0] + share * length * along + rng.choice([-1.0, 1.0]) * (half + out_m) * right
    return np.array([*xy, layout.deck_height_m])


def woods(layout: Layout, rng: np.random.Generator) -> Mesh:
    """Clumps and rows of trees: a cone or a ball on a trunk, far enough out."""
    along, right, length = axes(*layout.centre_m)
    half = float(np.hypot(*(layout.right_m[0] - layout.left_m[0]))) / 2
    spots = []
    for _ in range(rng.integers(0, 14)):
        middle = rng.uniform(-0.2, 2.2) * length, rng.choice([-1.0, 1.0]) * (half + rng.uniform(90.0, 900.0))
        spread = (rng.uniform(20.0, 250.0), rng.uniform(4.0, 40.0))
        spots.append(middle + rng.normal(size=(rng.integers(4, 45), 2)) * spread)
    if not spots:
        return join([])
    local = np.concatenate(spots)
    local = local[np.abs(local[:, 1]) > half + CLEAR_M + 20.0]
    xy = layout.centre_m[0] + local[:, :1] * along + local[:, 1:] * right
    tall = rng.uniform(4.0, 16.0, (len(xy), 1))
    size = np.concatenate([tall * rng.uniform(0.3, 0.6, (len(xy), 1))] * 2 + [tall], axis=1)
    tint = LEAVES[rng.integers(len(LEAVES), size=len(xy))] * rng.uniform(0.7, 1.2, (len(xy), 1))
    at = np.column_stack([xy, np.full(len(xy), layout.deck_height_m)])
    pointed = rng.random(len(xy)) < rng.random()
    return join([instances(tree(bool(kind)), at[pointed == kind], 0.0, size[pointed == kind], tint[pointed == kind])
                 for kind in (True, False)])  # fmt: skip


def tree(pointed: bool) -> Mesh:
    """A fir or a round tree of height 1 and width 1."""
    rings = ((0.1, 0.5), (0.55, 0.28), (1.0, 0.02)) if pointed else ((0.2, 0.2), (0.45, 0.5), (0.8, 0.42), (1.0, 0.1))
    crown = loft([at_height(disc(0, 0, radius, 6), -up) for up, radius in rings], (1.0, 1.0, 1.0))
    return join([crown, frustum(disc(0, 0, 0.06, 4), 0.0, disc(0, 0, 0.05, 4), -0.25, (1.2, 0.8, 0.8))])


def airfield(layout: Layout, rng: np.random.Generator) -> Mesh:
    """A row of hangars with round roofs, a control tower, and aircraft on the apron before them."""
    along, right, _ = axes(*layout.centre_m)
    yaw = float(np.arctan2(along[1], along[0]))
    first = beside(layout, rng.uniform(0.1, 0.7), rng.uniform(120.0, 350.0), rng)
    side = np.sign((first[:2] - layout.centre_m[0]) @ right)
    ahead, inwards = np.array([*along, 0.0]), np.array([*(-side * right), 0.0])
    wall = WALLS[rng.integers(len(WALLS))]
    size = rng.uniform([25, 20, 8], [50, 40, 15])
    parts = [shed(first + k * (size[0] + 12.0) * ahead, size, yaw, wall) for k in range(rng.integers(1, 5))]
    tower = first - 45.0 * ahead
    tall = rng.uniform(15.0, 35.0)
    parts.append(boxes([tower], (6.0, 6.0, tall), yaw, wall))
    parts.append(boxes([tower - [0, 0, tall]], (9.0, 9.0, 3.0), yaw, (0.1, 0.12, 0.14)))
    parts.append(boxes([tower - [0, 0, tall + 3.0]], (9.5, 9.5, 0.6), yaw, wall))
    kind = str(rng.choice(list(KINDS)))
    count = int(rng.integers(0, 9))
    at = np.array([first + (size[1] / 2 + 22.0) * inwards + k * 24.0 * ahead for k in range(count)]).reshape(-1, 3)
    heading = yaw + side * np.pi / -2
    return join([*parts, instances(prototype(kind), at, heading, 16.0, rng.uniform(0.4, 0.9) * np.ones(3))])


def shed(at_m: NDArray[np.float64], size_m: NDArray[np.float64], yaw_rad: float, rgb: NDArray[np.float64]) -> Mesh:
    """A hall of (length, width, height) whose roof is an arch."""
    length, width, height = size_m
    angle = np.linspace(0.0, np.pi, 7)
    arch = np.column_stack([width / 2 * np.cos(angle), -height * (0.5 + 0.5 * np.sin(angle))])
    profile = np.concatenate([[[width / 2, 0.0]], arch, [[-width / 2, 0.0]]])
    ends = [np.column_stack([np.full(len(profile), x), profile]) for x in (-length / 2, length / 2)]
    door = boxes([[0.0, side * width / 2, 0.0] for side in (-1, 1)], (0.7 * length, 0.3, 0.45 * height), 0.0, rgb * 0.5)
    return instances(join([loft(ends, rgb), door]), [at_m], yaw_rad)
