"""The runway's markings: edges whose middles are the true lines, centre line, landing area, ramp stripe, wires."""

from typing import get_args

import numpy as np
from numpy.typing import NDArray

from deckline.sim.ship.layout import Layout
from deckline.sim.ship.mesh import Rgb
from deckline.sim.ship.paint import Coat, axes, bars, dashes, ladder, layers, stripe
from deckline.sim.ship.plan import EdgeKind, EdgeStyle, LineStyle, Plan

EDGE_KINDS: tuple[EdgeKind, ...] = get_args(EdgeKind)
EDGE_ODDS = (0.55, 0.23, 0.11, 0.11)  # of the kinds on random ships
YELLOW = (0.78, 0.62, 0.10)
SMEARED = 0.35  # part of the random edges whose paint has run together
WIDENED = 0.2  # of how far it bleeds inwards, a marking whose paint has run together is wider
FADED = 0.25  # part of the others whose paint is worn thin
WIRE_SHADE = 0.05  # bare steel, greased


def random_edge(rng: np.random.Generator) -> EdgeStyle:
    """Ladders mostly; single, double and dashed lines too."""
    kind = EDGE_KINDS[rng.choice(len(EDGE_KINDS), p=EDGE_ODDS)]
    rail = rng.uniform(0.3, 0.9)
    width = rng.uniform(max(1.5, 3 * rail), 3.5)
    if kind in ("stripe", "dashed"):
        width = rng.uniform(0.5, 1.6)
    elif kind == "double":
        width = rng.uniform(3 * rail, 3 * rail + 1.0)
    bar = rng.uniform(0.3, 1.0) if kind == "ladder" else rng.uniform(3.0, 12.0)
    pitch = bar + rng.uniform(0.8, 6.0)
    rgb = paint_colour(rng)
    if rng.random() >= SMEARED:
        opacity = rng.uniform(0.35, 0.9) if rng.random() < FADED else 1.0
        return EdgeStyle(kind, width, rail, bar, pitch, rgb, opacity)
    smear, reach = rng.uniform(0.25, 0.8), rng.uniform(0.5, 9.0)
    width += WIDENED * reach
    return EdgeStyle(kind, width, rail, bar, pitch, rgb, rng.uniform(0.0, 0.7), smear, reach)


def paint_colour(rng: np.random.Generator) -> Rgb:
    """White, off-white or yellowish paint, fresh or dull."""
    tint = np.array([1.0, 1.0, 1.0]) if rng.random() < 0.8 else np.array([1.0, rng.uniform(0.85, 1.0), 0.7])
    red, green, blue = np.clip(rng.uniform(0.6, 1.0) * tint * rng.uniform(0.97, 1.03, 3), 0.0, 1.0)
    return float(red), float(green), float(blue)


def edge_coat(line_m: NDArray[np.float64], style: EdgeStyle) -> Coat:
    """One edge marking; its middle is the line (2, 2), from its first end to its last."""
    coat = crisp_edge(line_m, style)
    coat[:, 5] *= style.opacity
    return coat


def crisp_edge(line_m: NDArray[np.float64], style: EdgeStyle) -> Coat:
    """The marking as it was painted."""
    start, end = line_m
    if style.kind == "ladder":
        return ladder(start, end, style.width_m, style.rail_m, style.bar_m, style.pitch_m, style.rgb)
    if style.kind == "double":
        offset = (style.width_m - style.rail_m) / 2
        return layers([stripe(start, end, style.rail_m, style.rgb, side * offset) for side in (-1, 1)])
    if style.kind == "dashed":
        return dashes(start, end, style.width_m, [style.rgb], style.bar_m, style.pitch_m - style.bar_m)
    return stripe(start, end, style.width_m, style.rgb)


def smear_coat(line_m: NDArray[np.float64], inward: float, style: EdgeStyle, rng: np.random.Generator) -> Coat:
    """Streaks from the marking's sharp outer edge inwards (+1: to the line's right), fading."""
    start, end = line_m
    length = axes(start, end)[2]
    cuts = np.cumsum(rng.uniform(0.5, 5.0, int(length / 2.0) + 10))
    cuts = np.concatenate([[0.0], cuts[cuts < length], [length]])
    spans = np.column_stack([cuts[:-1], cuts[1:]])
    strong = style.smear * rng.uniform(0.75, 1.0, (len(spans), 1))
    outer, middle = -inward * style.width_m / 2, inward * style.width_m / 2
    body = bars(start, end, spans, (outer, middle), style.rgb, strong)
    fringe = bars(start, end, spans, (middle, middle + inward * style.smear_m), style.rgb, strong * [1, 1, 0, 0])
    return layers([body, fringe])


def area_coat(layout: Layout, plan: Plan) -> Coat:
    """The landing area's own tone; bare deck is left beside the edge markings, so that they stay symmetric."""
    start, end = layout.centre_m
    inner = layout.spacing_m / 2 - plan.edge.width_m / 2 - 0.3
    if plan.area_opacity == 0.0 or inner <= 0.0:
        return layers([])
    return bars(start, end, (0.0, axes(start, end)[2]), (-inner, inner), plan.area_rgb, plan.area_opacity)


def line_coat(start_m: NDArray[np.float64], end_m: NDArray[np.float64], style: LineStyle) -> Coat:
    """A stripe in its style."""
    if style.gap_m == 0.0 and len(style.rgbs) == 1:
        return stripe(start_m, end_m, style.width_m, style.rgbs[0])
    return dashes(start_m, end_m, style.width_m, style.rgbs, style.dash_m, style.gap_m)


def foul_coat(layout: Layout, plan: Plan) -> Coat:
    """Foul lines outside the edge markings."""
    coats = []
    for distance, style in plan.fouls:
        line = layout.left_m if distance < 0.0 else layout.right_m
        shift = axes(*line)[1] * distance
        coats.append(line_coat(line[0] + shift, line[1] + shift, style))
    return layers(coats)


def wire_coat(layout: Layout, plan: Plan) -> Coat:
    """Arresting wires across the landing area, a little beyond its edges."""
    start, end = layout.centre_m
    first = np.asarray(plan.wires_m)
    reach = layout.spacing_m / 2 + plan.edge.width_m
    spans = np.column_stack([first, first + plan.wire_width_m])
    return bars(start, end, spans, (-reach, reach), (WIRE_SHADE,) * 3, wear=0.2)


def runway_coat(layout: Layout, plan: Plan, rubber: Coat, rng: np.random.Generator) -> Coat:
    """Everything that marks the runway, in order: the edge markings on top, tyre marks (`rubber`) under them."""
    start, end = layout.centre_m
    coats = [area_coat(layout, plan), foul_coat(layout, plan)]
    if plan.centre is not None:
        coats.append(line_coat(start, end, plan.centre))
    coats += [rubber, wire_coat(layout, plan)]
    if plan.ramp_m > 0.0:
        reach = layout.spacing_m / 2 + plan.edge.width_m / 2
        coats.append(bars(start, end, (0.0, plan.ramp_m), (-reach, reach), plan.paint_rgb))
    for line, style, inward in zip((layout.left_m, layout.right_m), plan.edges, (1.0, -1.0), strict=True):
        if style.smear > 0:
            coats.append(smear_coat(line, inward, style, rng))
        coats.append(edge_coat(line, style))
    return layers(coats)
