"""Paint of decks that nobody built: what may lie beside a runway, across it, and where there is none."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.random import Generator

from deckline.haze import triple
from deckline_sim.ship.layout import Layout
from deckline_sim.ship.mesh import Rgb
from deckline_sim.ship.paint_shapes import axes
from deckline_sim.ship.ship_class import Catapult, DeckSurface, EdgeStyle, LineStyle, Number, Panel, Plan, Spot, Stripe

YELLOW, RED, ORANGE = (0.78, 0.62, 0.10), (0.6, 0.12, 0.1), (0.85, 0.35, 0.08)
EDGE_ODDS = {"ladder": 0.55, "stripe": 0.23, "double": 0.11, "dashed": 0.11}  # of the kinds on random ships
SMEARED = 0.35  # part of the random edges whose paint has run together
WIDENED = 0.2  # of how far it bleeds inwards, a marking whose paint has run together is wider
FADED = 0.25  # part of the others whose paint is worn thin
UNEVEN = 0.06  # part of the runways whose right edge is painted in a style of its own
# Deck coats seen on photographs: grey, warm and cold grey, green, brown, red oxide; relative to their grey.
TINTS = np.array([[100, 100, 100], [100, 98, 95], [94, 100, 95], [105, 98, 89], [95, 98, 104], [89, 102, 93]]) / 100
RED_OXIDE = np.array([1.2, 0.92, 0.85])


def random_edge(rng: Generator) -> EdgeStyle:
    """Ladders mostly; single, double and dashed lines too."""
    kind: Any = list(EDGE_ODDS)[rng.choice(4, p=list(EDGE_ODDS.values()))]
    rail = rng.uniform(0.3, 0.9)
    width = rng.uniform(max(1.5, 3 * rail), 3.5)
    if kind in ("stripe", "dashed"):
        width = rng.uniform(0.5, 1.6)
    elif kind == "double":
        width = rng.uniform(3 * rail, 3 * rail + 1.0)
    bar = rng.uniform(0.3, 1.0) if kind == "ladder" else rng.uniform(3.0, 12.0)
    pitch = bar + rng.uniform(0.8, 6.0)
    rgb = random_paint(rng)
    if rng.random() >= SMEARED:
        opacity = rng.uniform(0.35, 0.9) if rng.random() < FADED else 1.0
        return EdgeStyle(kind, width, rail, bar, pitch, rgb, opacity)
    smear, reach = rng.uniform(0.25, 0.8), rng.uniform(0.5, 9.0)
    return EdgeStyle(kind, width + WIDENED * reach, rail, bar, pitch, rgb, rng.uniform(0.0, 0.7), smear, reach)


def random_paint(rng: Generator) -> Rgb:
    """White, off-white or yellowish paint, fresh or dull."""
    tint = np.array([1.0, 1.0, 1.0]) if rng.random() < 0.8 else np.array([1.0, rng.uniform(0.85, 1.0), 0.7])
    return triple(np.clip(rng.uniform(0.6, 1.0) * tint * rng.uniform(0.97, 1.03, 3), 0.0, 1.0))


def random_surface(rng: Generator) -> DeckSurface:
    """Deck from nearly black to light grey; greenish, brownish, bluish or red oxide."""
    grey = rng.uniform(0.12, 0.42) if rng.random() < 0.85 else rng.uniform(0.42, 0.58)
    tint = RED_OXIDE if rng.random() < 0.07 else TINTS[rng.choice(6, p=[0.3, 0.2, 0.15, 0.12, 0.15, 0.08])]
    rgb = triple(np.clip(grey * tint * rng.uniform(0.96, 1.04, 3), 0.0, 1.0))
    offset = rng.uniform(0, 100, 2)
    return DeckSurface(rgb, rng.uniform(0.05, 0.6), rng.beta(1.1, 3.0), (float(offset[0]), float(offset[1])))


def random_plan(layout: Layout, runway: bool, rng: Generator) -> Plan:
    """What is painted on a random deck."""
    edge = random_edge(rng)
    if layout.on_land:
        return _land_plan(layout, edge, rng)
    plain = not runway and rng.random() < 0.2  # bare deck
    stripes = [] if plain else _stripes(layout, edge.rgb, runway, rng)
    border = np.where(rng.random(2) < (0.3 if runway else 0.45), rng.uniform(0.2, 0.7, 2), 0.0)
    if not runway and border.all():  # two lines that follow the deck would be a runway's
        border[rng.integers(2)] = 0.0
    stripes += [] if plain else _rows(layout, edge.rgb, rng)
    if not runway and border.any():
        stripes = stripes[1:]  # the first one is the long one
    return Plan(
        edge=edge,
        right_edge=replace(random_edge(rng), rgb=edge.rgb, opacity=1.0, smear=0.0) if rng.random() < UNEVEN else None,
        centre=random_centre(edge.rgb, rng),
        area_rgb=_grey(rng.uniform(0.05, 0.5)),
        area_opacity=rng.uniform(0.1, 0.7) if rng.random() < 0.5 else 0.0,
        ramp_m=rng.uniform(0.8, 4.0) if rng.random() < 0.45 else 0.0,
        wires_m=_wires(layout, rng),
        wire_width_m=rng.uniform(0.1, 0.35),
        fouls=_fouls(edge, rng),
        stern_m=rng.uniform(0.8, 4.0) if rng.random() < (0.4 if runway else 0.25) else 0.0,
        paint_rgb=edge.rgb,
        port_border_m=float(border[0]),
        starboard_border_m=float(border[1]),
        catapults=() if plain else _catapults(layout, edge.rgb, rng),
        panels=_panels(layout, edge.rgb, rng),
        spots=() if plain else _spots(layout, edge.rgb, runway, rng),
        stripes=tuple(stripes),
        numbers=_numbers(layout, edge.rgb, rng),
    )


def random_centre(rgb: Rgb, rng: Generator) -> LineStyle | None:
    """Solid, dashed, two-coloured or no centre line."""
    kind, width = rng.random(), rng.uniform(0.3, 1.1)
    rgbs = (rgb, YELLOW) if rng.random() < 0.4 else ((YELLOW if rng.random() < 0.45 else rgb),)
    if kind < 0.15:
        return None
    if kind < 0.4:
        return LineStyle(width, rgbs[-1:])
    gap = 0.0 if len(rgbs) == 2 and rng.random() < 0.5 else rng.uniform(1.0, 10.0)
    return LineStyle(width, rgbs, rng.uniform(2.0, 10.0), gap)


def _wires(layout: Layout, rng: Generator) -> tuple[float, ...]:
    count, first, pitch = rng.integers(0, 5), rng.uniform(25.0, 60.0), rng.uniform(9.0, 15.0)
    length = axes(*layout.centre_m)[2]
    return tuple(float(s) for s in first + pitch * np.arange(count) if s < length - 5.0)


def _fouls(edge: EdgeStyle, rng: Generator) -> tuple[tuple[float, LineStyle], ...]:
    """Safety lines of the landing area, outside its edge markings."""
    fouls = []
    styles: list[tuple[Rgb, ...]] = [(RED, edge.rgb), (YELLOW, edge.rgb), (YELLOW,), (edge.rgb,), (RED,)]
    for side in (-1.0, 1.0):
        if rng.random() >= 0.5:
            width, rgbs = rng.uniform(0.15, 0.6), styles[rng.integers(5)]
            style = LineStyle(width, rgbs, rng.uniform(0.8, 4.0), max(0.0, rng.uniform(-1, 2)))
            fouls.append((side * (edge.width_m / 2 + rng.uniform(0.6, 6.0)), style))
    return tuple(fouls)


def _stripes(layout: Layout, rgb: Rgb, runway: bool, rng: Generator) -> list[Stripe]:
    """Single lines anywhere: take-off runs, safety lines, lines that cross the runway or run beside it.

    Without a runway only the first is long: two long ones would resemble one.
    """
    stripes: list[Stripe] = []
    styles: list[tuple[Rgb, ...]] = [(rgb,), (YELLOW,), (rgb, YELLOW), (RED, rgb), (RED,), (ORANGE,)]
    for _ in range(rng.integers(0, 5 if runway else 9)):
        length = rng.uniform(0.15, 0.75 if runway or not stripes else 0.25) * layout.length_m
        x = rng.uniform(0.0, 0.95 * layout.length_m - length)
        y, yaw = rng.uniform(*layout.edges_at(x)), rng.normal(0.0, 0.05)
        rgbs = styles[rng.choice(6, p=[0.4, 0.3, 0.1, 0.1, 0.05, 0.05])]
        gap = rng.uniform(0.5, 6.0) if rng.random() < 0.3 else 0.0
        style = LineStyle(rng.uniform(0.2, 0.9), rgbs, rng.uniform(1.0, 6.0), gap)
        stripes.append(Stripe((x, y), (x + length, y + length * np.tan(yaw)), style))
    return stripes


def _rows(layout: Layout, rgb: Rgb, rng: Generator) -> list[Stripe]:
    """Rows of short bars: hatched safety areas, parking lines along the deck's edge."""
    rows = []
    for _ in range(rng.choice([0, 1, 2, 3], p=[0.5, 0.25, 0.15, 0.1])):
        count, pitch = rng.integers(4, 18), rng.uniform(1.2, 9.0)
        x = rng.uniform(0.03, 0.9) * layout.length_m
        y, yaw = rng.uniform(*layout.edges_at(x)), rng.uniform(0.4, 2.7)
        reach = rng.uniform(1.5, 10.0) * np.array([np.cos(yaw), np.sin(yaw)])
        style = LineStyle(rng.uniform(0.15, 0.7), ((rgb, YELLOW, RED)[rng.choice(3, p=[0.55, 0.3, 0.15])],))
        rows += [Stripe((a, y), (a + reach[0], y + reach[1]), style) for a in x + pitch * np.arange(count)]
    return rows


def _catapults(layout: Layout, rgb: Rgb, rng: Generator) -> tuple[Catapult, ...]:
    """Bow catapults far ahead, waist catapults that begin inside the landing area and cross its left edge."""
    ends = []
    length = layout.length_m
    if rng.random() < 0.45:
        x0, x1 = rng.uniform(0.55, 0.7) * length, rng.uniform(0.9, 0.97) * length
        middle, apart = sum(layout.edges_at(x1)) / 2, rng.uniform(5.0, 11.0)
        for side in (-1.0, 1.0)[: rng.integers(1, 3)]:
            ends.append(((x0, middle + side * (apart + rng.uniform(0, 6))), (x1, middle + side * apart * 0.7)))
    if rng.random() < 0.75:
        start, end = layout.centre_m
        along, right, reach = axes(start, end)
        turn = rng.uniform(-0.1, 0.1)  # to the left of the runway's direction
        first, across = rng.uniform(0.25, 0.6) * reach, (rng.uniform(-0.6, 0.3) - 2.0 * turn) * layout.spacing_m
        across -= 0.5 * layout.spacing_m * (turn < 0.0)  # begins beyond the left edge and comes in
        run = min(rng.uniform(0.3, 0.6), 0.97 - first / reach) * reach
        for k in range(rng.integers(1, 3)):
            a = start + first * along + (across - 9.0 * k) * right
            b = a + run * along - run * np.tan(turn + 0.02 * k) * right
            ends.append(((a[0], a[1]), (b[0], b[1])))
    width, border = rng.uniform(0.4, 1.9), rng.uniform(1.2, 4.0) if rng.random() < 0.3 else 0.0
    tone = rgb if rng.random() < 0.7 else _grey(rng.uniform(0.05, 0.65))
    slot = 0.0 if rng.random() < 0.3 else rng.uniform(0.15, 0.5)
    deflector = rng.uniform(7.0, 12.0) if rng.random() < 0.6 else 0.0
    return tuple(Catapult(a, b, width, tone, slot, border, deflector) for a, b in ends)


def _panels(layout: Layout, rgb: Rgb, rng: Generator) -> tuple[Panel, ...]:
    """Elevators at the deck's edge and hatches inboard."""
    panels = []
    styles: list[tuple[Rgb, ...]] = [(YELLOW,), (rgb,), (RED, rgb), (YELLOW, _grey(0.1))]
    for _ in range(rng.integers(0, 6)):
        x = rng.uniform(0.08, 0.85) * layout.length_m
        port, starboard = layout.edges_at(x)
        size = rng.uniform(0.2, 0.45, 2) * min(starboard - port, 48.0)
        inboard = rng.random() < 0.3
        inset = size[1] / 2 + rng.uniform(-1.0, 2.0)
        y = rng.uniform(port, starboard) if inboard else (port + inset if rng.random() < 0.3 else starboard - inset)
        style = LineStyle(rng.uniform(0.2, 0.6), styles[rng.integers(4)], 1.5)
        border = style if rng.random() < 0.7 else None
        opacity = 0.0 if border and rng.random() < 0.3 else rng.uniform(0.2, 0.9)
        tone = _grey(rng.uniform(0.05, 0.5))
        panels.append(Panel((x, y), size[0], size[1], tone, opacity, rng.normal(0.0, 2.0), border))
    return tuple(panels)


def _spots(layout: Layout, rgb: Rgb, runway: bool, rng: Generator) -> tuple[Spot, ...]:
    """Helicopter circles: a row along the deck, or a few."""
    count = rng.integers(0, 4) if runway else rng.integers(0, 9)
    radius, width, colour = rng.uniform(2.5, 8.0), rng.uniform(0.25, 0.8), rgb if rng.random() < 0.65 else YELLOW
    x = np.sort(rng.uniform(0.05, 0.92, count)) if runway else np.linspace(0.1, 0.88, count)
    across = rng.uniform(0.2, 0.8, count) if rng.random() < 0.5 else np.full(count, rng.uniform(0.25, 0.5))
    lead, cross = rng.choice([0.0, 1.0, 2.5]) * radius, rng.choice([0.0, 0.6]) * radius
    x = x * layout.length_m
    port, starboard = layout.edges_at(x)
    y = port + across * (starboard - port)
    return tuple(Spot(middle, radius, width, colour, lead, cross) for middle in zip(x, y, strict=True))


def _numbers(layout: Layout, rgb: Rgb, rng: Generator) -> tuple[Number, ...]:
    """The ship's number near the bow, sometimes another at the runway's beginning."""
    numbers = []
    text = str(rng.integers(1, 100))
    if rng.random() < 0.55:
        x = rng.uniform(0.7, 0.92) * layout.length_m
        port, starboard = layout.edges_at(x)
        height = rng.uniform(0.2, 0.5) * (starboard - port)
        numbers.append(Number(text, (x, (port + starboard) / 2 - 0.7 * height), height, rgb))
    if rng.random() < 0.25:
        start, end = layout.centre_m
        along, right, _ = axes(start, end)
        at = start + along * rng.uniform(6, 25) + right * rng.uniform(-0.35, 0.1) * layout.spacing_m
        yaw = float(np.rad2deg(np.arctan2(along[1], along[0])))
        numbers.append(Number(text, (at[0], at[1]), rng.uniform(3, 9), rgb, yaw))
    return tuple(numbers)


def _land_plan(layout: Layout, edge: EdgeStyle, rng: Generator) -> Plan:
    """A land runway: solid edges mostly, threshold bars, number, aiming points, centre dashes."""
    width = rng.uniform(0.5, 1.5)
    solid = rng.random() < 0.85
    kind: Any = "stripe" if solid else "double"
    edge = EdgeStyle(kind, width if solid else 1.5, 0.4, edge.bar_m, edge.pitch_m, edge.rgb)
    half, first = layout.spacing_m / 2, float(layout.left_m[0, 0])
    bar = rng.uniform(1.2, 2.4)
    stripes = []
    if rng.random() < 0.75:
        for y in np.arange(1.5 * bar, half - edge.width_m - bar, 1.8 * bar):
            style = LineStyle(bar, (edge.rgb,))
            stripes += [Stripe((first + 6.0, side * y), (first + 36.0, side * y), style) for side in (-1, 1)]
    if rng.random() < 0.7:
        x, size = first + rng.uniform(150.0, 300.0), rng.uniform(30.0, 60.0)
        for y in (-half * 0.5, half * 0.5):
            stripes.append(Stripe((x, y), (x + size, y), LineStyle(rng.uniform(3.0, 7.0), (edge.rgb,))))
    dash = rng.uniform(8.0, 36.0)
    centre = LineStyle(rng.uniform(0.3, 0.9), (edge.rgb,), dash, dash * rng.uniform(0.5, 1.2))
    text, height = f"{rng.integers(1, 37):02d}", rng.uniform(8.0, 16.0)
    numbers = (Number(text, (first + 40.0, -0.7 * height), height, edge.rgb),) if rng.random() < 0.75 else ()
    return Plan(edge, None, centre, paint_rgb=random_paint(rng), stripes=tuple(stripes), numbers=numbers)


def _grey(level: float) -> Rgb:
    return (level, level, level)
