"""Pavement, paint and lights of a land runway, as polygons on the ground.

Ground frame: x along the landing direction from the landing threshold, y to its right, metres.
Sources: ICAO Annex 14, volume I, 5.2 (markings) and 5.3 (lights); FAA AC 150/5340-1M (chevrons, arrows).
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from deckline.types import EdgeKind
from deckline_sim.ship.mesh import Array, strip
from deckline_sim.ship.paint_shapes import Coat, bars, dashes, figures, layers, polygons, stripe

WIDTHS_M = (18.0, 23.0, 30.0, 45.0, 60.0)
WIDTH_SHARES = (0.1, 0.12, 0.28, 0.4, 0.1)
BARS = {18.0: 4, 23.0: 6, 30.0: 8, 45.0: 12, 60.0: 16}  # threshold stripes, ICAO Annex 14, 5.2.4.5
NO_STRIPE = 0.2  # of the runways have no side stripes: their edge is the pavement's
AT_NIGHT = 0.06
OVERRUN_M = 6.0  # of the pavement at either end
LIGHT_SPACING_M = 60.0  # of edge lights, ICAO Annex 14, 5.3.9
WHITE, YELLOW = np.array([0.92, 0.92, 0.9]), np.array([0.85, 0.7, 0.12])


@dataclass(frozen=True, eq=False)
class LandRunway:
    """What is drawn of a runway, and where its edge lines are."""

    width_m: float  # of the pavement between the shoulders
    length_m: float  # from threshold to end
    span_m: tuple[float, float]  # x where the edge lines begin and end
    half_m: float  # from the centre line to the edge line: the middle of its stripe, the pavement's edge or the lights
    edge: EdgeKind
    centre_painted: bool
    night: bool
    pavement: Coat
    paint: Coat
    lights_m: NDArray[np.float64]  # (N, 3) x, y and height
    lights_rgb: NDArray[np.float64]  # (N, 3), 1 is white


def random_runway(rng: Generator) -> LandRunway:
    """A runway with its shoulders, its ends, paint and lights."""
    width = float(rng.choice(WIDTHS_M, p=WIDTH_SHARES))
    length = float(rng.uniform(20, 34) * width + rng.uniform(200, 1800))
    night = bool(rng.random() < AT_NIGHT)
    striped = bool(rng.random() >= NO_STRIPE)
    stripe_m = float(rng.uniform(0.75, 1.1) if width >= 30 else rng.uniform(0.3, 0.9))
    inset = float(rng.choice([0.0, rng.uniform(0.2, 1.8)]))
    stripe_y = width / 2 - stripe_m / 2 - inset
    half = stripe_y if striped else width / 2
    edge = EdgeKind.PAINT if striped else EdgeKind.PAVEMENT
    before = float(rng.choice([0.0, rng.uniform(30, 120), rng.uniform(100, 500)]))  # paved, ahead of the threshold
    start = float(rng.choice([0.0, -rng.uniform(0, OVERRUN_M), min(5.0 - before, 0.0)]))  # of the side stripes
    paved = max(before, OVERRUN_M)
    span = (start, length) if striped else (-paved, length + paved)
    outside = rng.uniform(0.5, 3.0)
    if night and rng.random() < 0.8:
        edge, half, span = EdgeKind.LIGHTS, width / 2 + outside, (0.0, length // LIGHT_SPACING_M * LIGHT_SPACING_M)
    places, colours = _lights(width / 2 + outside, length, rng)
    if rng.random() >= (1.0 if night else 0.45):
        places, colours = places[:0], colours[:0]
    plain, centre = night and rng.random() < 0.3, rng.random() < 0.9
    paint = [] if plain else _paint(width, length, before, bool(centre), rng)
    if striped:
        paint += [stripe([[start, y], [length, y]], stripe_m, WHITE) for y in (-stripe_y, stripe_y)]
    pavement = _pavement(width, length, before, rng)
    painted = bool(centre and not plain)
    return LandRunway(width, length, span, half, edge, painted, night, pavement, layers(paint), places, colours)


def _box(x0: float, x1: float, y0: float, y1: float, rgb: ArrayLike) -> Coat:
    return polygons([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], rgb)


def _pavement(width: float, length: float, before: float, rng: Generator) -> Coat:
    """Shoulders, blast pads, taxiways, the runway itself with its patches, and the rubber on it."""
    grey = rng.uniform(0.12, 0.55) * (1 + rng.normal(0, 0.05, 3))
    half, coats = width / 2, []
    if rng.random() < 0.35:  # brighter or darker than the runway
        shoulder = rng.uniform(2.0, 9.0)
        coats.append(_box(-5, length + 5, -half - shoulder, half + shoulder, grey * rng.choice([0.6, 0.8, 1.25, 1.6])))
    coats.append(_box(-before, length + before, -half, half, grey * rng.choice([0.85, 1.0, 1.0, 1.3])))
    coats += _taxiways(half, length, grey * rng.uniform(0.8, 1.3), rng)
    coats.append(_box(-OVERRUN_M, length + OVERRUN_M, -half, half, grey))
    for _ in range(rng.integers(0, 7)):  # other asphalt, other concrete
        x, y = rng.uniform(0, length), rng.uniform(-half, half * 0.6)
        tall, wide = rng.uniform(10, 400), rng.uniform(0.15, 1.2) * width
        coats.append(_box(x, min(x + tall, length), y, min(y + wide, half), grey * rng.uniform(0.75, 1.3)))
    if rng.random() < 0.5:  # slabs' or lanes' joints
        joints = [[[0, y], [length, y]] for y in np.arange(-half, half, rng.uniform(3.5, 7.5))[1:]]
        coats += [stripe(joint, 0.3, grey * rng.uniform(0.6, 1.3)) for joint in joints]
    darkness = float(rng.uniform(0, 0.75))
    for y, spread in ((0.0, 0.3 * half), (-3.2, 1.6), (3.2, 1.6)):
        for _ in range(3):
            x0, x1, w = rng.uniform(60, 350), rng.uniform(450, 1100), spread * rng.uniform(0.6, 1.4)
            rows = np.array([[[x0, y], [x0, y]], [[(x0 + x1) / 2, y - w], [(x0 + x1) / 2, y + w]], [[x1, y], [x1, y]]])
            coats.append(polygons(strip(rows[:, 0], rows[:, 1]), [0.05, 0.05, 0.06], darkness / 3))
    return layers(coats)


def _taxiways(half: float, length: float, grey: Array, rng: Generator) -> list[Coat]:
    """Exits, a parallel taxiway with its yellow line, an apron; mostly on one side."""
    coats: list[Coat] = []
    for side in (-1.0, 1.0):
        if rng.random() < 0.45:
            continue
        taxiway_y, wide = side * rng.uniform(60, 190), rng.uniform(7.5, 25)
        coats.append(_box(rng.uniform(-60, 100), length, taxiway_y - wide / 2, taxiway_y + wide / 2, grey))
        for x in rng.uniform(0, length, rng.integers(1, 6)):
            skew = rng.choice([0.0, 0.0, 80.0, -80.0])
            corners = [[x, side * half * 0.9], [x + wide * 1.4, side * half * 0.9]]
            coats.append(polygons([*corners, [x + wide * 1.4 + skew, taxiway_y], [x + skew, taxiway_y]], grey))
        if rng.random() < 0.8:
            coats.append(stripe([[0, taxiway_y], [length, taxiway_y]], rng.uniform(0.15, 0.5), YELLOW))
        if rng.random() < 0.5:
            x = rng.uniform(0, length)
            coats.append(
                _box(x, x + rng.uniform(80, 600), taxiway_y, taxiway_y + side * rng.uniform(60, 250), grey * 1.15)
            )
    return coats


def _paint(width: float, length: float, before: float, centred: bool, rng: Generator) -> list[Coat]:
    """Threshold, designator, touchdown zone, aiming point, centre line, what lies before the threshold."""
    half, coats, full = width / 2, [], rng.random() < 0.8
    centre = float(rng.uniform(0.3, 0.9))
    colour = WHITE if rng.random() < 0.93 else YELLOW
    start = 12.0
    if rng.random() < 0.85:
        count, wide = BARS[width] // 2, 1.8 if width > 18 else 1.4
        pitch = 2 * wide * float(rng.choice([1.0, 1.0, 0.93]))
        y = wide * 1.5 + pitch * np.arange(count)
        y = y[y < half - 1.5]
        across = np.concatenate([y, -y])[:, None] + [-wide / 2, wide / 2]
        coats.append(bars([[6, 0], [6 + 30, 0]], np.tile([0.0, 30.0], (len(across), 1)), across, WHITE))
        start = 48.0
    if rng.random() < 0.3:
        coats.append(_box(-rng.uniform(0.5, 2.0), 0.0, -half, half, WHITE))
    if rng.random() < 0.85:
        number = f"{rng.integers(1, 37):02d}"
        height = min(float(rng.uniform(9, 18)), 0.6 * width)
        foot, side = start + height, 0.7 * height  # read by those who land: feet nearest
        coats.append(figures(number, [[foot, -side], [foot, side]], height, WHITE))
        start += height + 12
    if centred:
        spacing = rng.choice([1.0, 0.6])
        coats.append(dashes([[start, 0], [length - 60, 0]], centre, [colour], 30.0 * spacing, 20.0 * spacing))
    if full:
        coats += _touchdown(half, length, rng)
    rise = half * 0.9
    if before > 0 and rng.random() < 0.5:
        for x in np.arange(-15.0, -before + rise, -30.0):  # chevrons that point at the threshold
            for side in (-1.0, 1.0):
                ends = np.array([[x, 0], [x - rise, side * rise], [x - rise - 1.5, side * rise], [x - 1.5, 0]])
                coats.append(polygons(ends, YELLOW if rng.random() < 0.8 else WHITE))
    elif before > 60 and rng.random() < 0.6:
        coats.append(dashes([[5.0 - before, 0.0], [-8.0, 0.0]], 0.9, [WHITE], 30.0, 30.0))
    return coats


def _touchdown(half: float, length: float, rng: Generator) -> list[Coat]:
    """Pairs of bars every 150 m and the aiming point."""
    coats, inner = [], float(rng.uniform(0.3, 0.48)) * half
    aim = float(rng.choice([150.0, 250.0, 300.0, 400.0]))
    wide = min(float(rng.uniform(4, 10)), half - inner - 2)
    across = [[inner, inner + wide], [-inner - wide, -inner]]
    coats.append(bars([[aim, 0], [aim + 1, 0]], [[0.0, float(rng.uniform(30, 60))]] * 2, across, WHITE))
    if rng.random() < 0.75 and half > 10:
        pattern = [3, 3, 2, 2, 1, 1] if rng.random() < 0.6 else [1] * 6
        for number, count in enumerate(pattern):
            x = 150.0 * (number + 1)
            if abs(x - aim) < 40 or x > length / 2:
                continue
            y = inner + np.arange(count) * 3.0
            y = y[y + 1.8 < half - 1.5]
            spans = np.concatenate([np.stack([y, y + 1.8], 1), np.stack([-y - 1.8, -y], 1)])
            coats.append(bars([[x, 0], [x + 22.5, 0]], np.tile([0.0, 22.5], (len(spans), 1)), spans, WHITE))
    return coats


def _lights(half: float, length: float, rng: Generator) -> tuple[Array, Array]:
    """Edge, threshold, approach and PAPI lights: x, y, height (N, 3) and their colours (N, 3)."""
    x = np.arange(0.0, length, LIGHT_SPACING_M)
    rows = [(np.stack([x, np.full_like(x, y), np.full_like(x, 0.3)], 1), (1.0, 0.95, 0.8)) for y in (-half, half)]
    y = np.linspace(-half, half, int(rng.integers(6, 20)))
    rows.append((np.stack([np.full_like(y, -2.0), y, np.full_like(y, 0.3)], 1), (0.2, 1.0, 0.4)))
    if rng.random() < 0.6:  # approach lights: a centre line of barrettes and one or more crossbars
        for back in np.arange(30.0, rng.choice([420.0, 900.0]), 30.0):
            reach = half * 0.9 if round(back) % 150 == 0 else 2.0
            across = np.linspace(-reach, reach, 5 if reach < 3 else 15)
            rows.append((np.stack([np.full_like(across, -back), across, np.full_like(across, 2.0)], 1), (1, 0.97, 0.9)))
    if rng.random() < 0.6:
        side = rng.choice([-1.0, 1.0])
        at = side * (half + 15 + 9 * np.arange(4))
        for k, place in enumerate(at):
            rows.append((np.array([[300.0, place, 1.0]]), (1.0, 0.2, 0.15) if k < 2 else (1.0, 1.0, 1.0)))
    points = np.concatenate([p for p, _ in rows])
    return points, np.concatenate([np.tile(np.asarray(rgb, dtype=float), (len(p), 1)) for p, rgb in rows])
