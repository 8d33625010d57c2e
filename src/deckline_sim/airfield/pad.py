"""A small ship's landing pad from astern, with short thick edge lines, drawn as upright boxes on a plane sea.

Frame: x forward from the pad's after edge, y to starboard, heights above the water, metres.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from deckline.types import EdgeKind
from deckline_sim.airfield.ground import Float32, GroundCamera
from deckline_sim.airfield.picture import AirfieldPicture, draw_face, draw_surroundings, lay_coat, look_at
from deckline_sim.ship.mesh import Array
from deckline_sim.ship.paint_shapes import Coat, figures, layers, polygons, ring, stripe

WHITE, YELLOW = np.array([0.9, 0.9, 0.88]), np.array([0.85, 0.7, 0.15])
WAKE = np.array([0.67, 0.7, 0.71])
DECKS = np.array([[50, 52, 54], [70, 74, 78], [48, 60, 52], [88, 60, 50], [100, 100, 98], [34, 36, 38]]) / 255


def draw_pad(width: int, height: int, textures: Sequence[Float32], rng: Generator) -> AirfieldPicture:
    """A random ship's pad from a random approach.

    Args:
        textures: of `make_textures`.
    """
    long, wide, above = rng.uniform(9, 34), rng.uniform(7, 22), rng.uniform(1.5, 9)
    distance = np.exp(rng.uniform(np.log(6), np.log(260)))
    rise = np.tan(np.deg2rad(rng.uniform(2, 32)))
    position = np.array([-distance, distance * rng.normal(0, 0.16), above + max(distance * rise, 1.2)])
    viewer = look_at(width, height, position, np.array([long / 2, 0.0, above]), rng)
    image, points, range_m = draw_surroundings(viewer, textures, rng, at_sea=True)
    wear = textures[int(rng.integers(len(textures)))]
    if rng.random() < 0.7:
        wake = polygons(np.array([[-300, -9], [-300, 9], [0, wide / 2], [0, -wide / 2]]), rng.uniform(0.6, 1.0) * WAKE)
        lay_coat(image, viewer, wake, points, wear, rng.uniform(0.1, 0.5), rng)
    before = image.copy()
    paint = rng.uniform(0.25, 0.85) * (1 + rng.normal(0, 0.03, 3))
    _draw_hull(image, viewer, long, wide, above, 255 * paint, rng)
    on_deck = replace(viewer, position_m=viewer.position_m - [0.0, 0.0, above])
    deck = DECKS[rng.integers(len(DECKS))] * rng.uniform(0.7, 1.5)
    half = wide / 2 - rng.uniform(0.2, 1.6)
    near, far = rng.uniform(0.0, 0.15) * long, rng.uniform(0.7, 1.0) * long
    centred = bool(rng.random() < 0.5)
    surface = polygons([[0, -wide / 2], [long, -wide / 2], [long, wide / 2], [0, wide / 2]], deck)
    lay_coat(image, on_deck, surface, points, wear, 0.08, rng)
    lay_coat(
        image, on_deck, _markings(long, half, near, far, bool(centred), rng), points, wear, rng.uniform(0.05, 0.4), rng
    )
    _draw_superstructure(image, viewer, long, wide, above, 255 * paint, rng)
    ship = np.any(image != before, axis=2)
    range_m = np.where(ship, _ship_ranges(viewer, long, above), range_m)
    ends = np.array([[[near, y, above], [far, y, above]] for y in (-half, half)])
    picture = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return AirfieldPicture(picture, range_m, viewer, ends, EdgeKind.PAINT, above, centred)


def _ship_ranges(viewer: GroundCamera, long: float, above: float) -> Float32:
    """Ray lengths (H, W), m, to a ship: its stern, its pad, the front of its hangar."""
    rays, (back, _, high) = viewer.rays(), viewer.position_m
    ahead, down = np.maximum(rays[..., 0], 1e-6), np.maximum(-rays[..., 2], 1e-6)
    deck = np.where(rays[..., 2] < 0, (high - above) / down, np.inf)
    along = np.clip(deck, -back / ahead, (long - back) / ahead)
    return np.asarray(along * np.linalg.norm(rays, axis=2), dtype=np.float32)


def _markings(long: float, half: float, near: float, far: float, centred: bool, rng: Generator) -> Coat:
    """Edge lines, cross lines, a circle, a cross or an H, a number."""
    colour = WHITE if rng.random() < 0.75 else YELLOW
    thick = float(rng.uniform(0.12, 0.5))
    coats = [stripe([[near, y], [far, y]], thick, colour) for y in (-half, half)]
    for x in (near, far):
        if rng.random() < 0.6:
            coats.append(stripe([[x, -half], [x, half]], thick, colour))
    middle, radius = [rng.uniform(0.4, 0.6) * long, 0.0], min(long, 2 * half) * rng.uniform(0.2, 0.42)
    if rng.random() < 0.75:
        coats.append(ring(middle, radius, float(rng.uniform(0.15, 0.6)), colour if rng.random() < 0.6 else YELLOW))
    if centred:
        coats.append(stripe([[near, 0], [far, 0]], thick * rng.uniform(0.5, 1), colour))
    if rng.random() < 0.4:
        coats.append(stripe([[middle[0], -half], [middle[0], half]], thick * rng.uniform(0.5, 1), colour))
    if rng.random() < 0.3:
        tall = radius * 0.9
        for y in (-0.4 * tall, 0.4 * tall):
            coats.append(stripe([[middle[0] - tall / 2, y], [middle[0] + tall / 2, y]], 0.4, WHITE))
        coats.append(stripe([[middle[0], -0.4 * tall], [middle[0], 0.4 * tall]], 0.4, WHITE))
    if rng.random() < 0.3:
        tall = float(rng.uniform(1, 3))
        foot = rng.uniform(0.1, 0.5) * long
        coats.append(figures(f"{rng.integers(1, 99):02d}", [[foot, -tall], [foot, tall]], tall, WHITE))
    return layers(coats)


def _draw_box(
    image: Float32,
    viewer: GroundCamera,
    x: tuple[float, float],
    y: tuple[float, float],
    z: tuple[float, float],
    rgb: Array,
) -> None:
    """An upright box: the side that is seen, its after face, its top."""
    seen = y[0] if viewer.position_m[1] < (y[0] + y[1]) / 2 else y[1]
    side = [[x[0], seen, z[0]], [x[1], seen, z[0]], [x[1], seen, z[1]], [x[0], seen, z[1]]]
    after = [[x[0], y[0], z[0]], [x[0], y[1], z[0]], [x[0], y[1], z[1]], [x[0], y[0], z[1]]]
    top = [[x[0], y[0], z[1]], [x[0], y[1], z[1]], [x[1], y[1], z[1]], [x[1], y[0], z[1]]]
    draw_face(image, viewer, side, 0.75 * rgb)
    if viewer.position_m[2] > z[1]:
        draw_face(image, viewer, top, 1.1 * rgb)
    draw_face(image, viewer, after, rgb)


def _draw_hull(
    image: Float32, viewer: GroundCamera, long: float, wide: float, above: float, rgb: Array, rng: Generator
) -> None:
    half, length = wide / 2, long + rng.uniform(15, 110)
    _draw_box(image, viewer, (0.0, length), (-half, half), (0.0, above), rgb * rng.uniform(0.6, 1.0))
    if rng.random() < 0.5:  # nets and rails beside the pad
        for side in (-1.0, 1.0):
            inner, outer = side * half, side * (half + rng.uniform(0.5, 1.8))
            across = min(inner, outer), max(inner, outer)
            _draw_box(image, viewer, (0.0, long), across, (above - 0.4, above), rgb * rng.uniform(0.3, 0.9))


def _draw_superstructure(
    image: Float32, viewer: GroundCamera, long: float, wide: float, above: float, rgb: Array, rng: Generator
) -> None:
    """Hangar, upper decks, funnel, mast, from the farthest to the nearest; people and gear beside the pad."""
    boxes: list[tuple[float, NDArray[np.float64], tuple[float, float]]] = []
    tall = rng.uniform(3, 7)
    broad = wide * rng.uniform(0.5, 1.0)
    boxes.append((long, np.array([-broad / 2, broad / 2]), (above, above + tall)))
    for _ in range(rng.integers(1, 7)):
        x, y, w = long + rng.uniform(2, 40), rng.normal(0, 0.2) * wide, rng.uniform(0.5, 0.8 * wide)
        boxes.append((x, np.array([y - w / 2, y + w / 2]), (above, above + tall * rng.uniform(1.0, 3.2))))
    for at, across, z in sorted(boxes, key=lambda box: -box[0]):
        _draw_box(image, viewer, (at, at + rng.uniform(2, 9)), (across[0], across[1]), z, rgb * rng.uniform(0.7, 1.15))
    door = broad * rng.uniform(0.2, 0.45)
    if rng.random() < 0.7:
        _draw_box(image, viewer, (long, long), (-door, door), (above, above + 0.8 * tall), rgb * rng.uniform(0.2, 0.8))
    for _ in range(rng.integers(0, 9)):  # masts, aerials, stays
        x, y = long + rng.uniform(1, 30), rng.normal(0, 0.25) * wide
        ends = np.array([[x, y, above + tall], [x, y + rng.normal(0, 2), above + tall * rng.uniform(1.5, 5)]])
        corners = np.concatenate([ends, ends[::-1] + np.array([0.0, rng.uniform(0.05, 0.6), 0.0])])
        draw_face(image, viewer, corners, rgb * rng.uniform(0.1, 1.0))
    for _ in range(rng.integers(0, 5)):  # crew, crates
        x, y = rng.uniform(0.1, 1.0) * long, rng.choice([-1, 1]) * rng.uniform(0.8, 1.0) * wide / 2
        w, h = rng.uniform(0.4, 1.5), rng.uniform(0.6, 1.9)
        colour = rng.uniform(10, 220) * (1 + rng.normal(0, 0.2, 3))
        _draw_box(image, viewer, (x, x + w), (y - w / 2, y + w / 2), (above, above + h), colour)
