"""A deck's whole paint: plates and stains, the fixtures of its plan, the runway's markings, and their wear.

The middles of the edge markings are the true runway lines.
"""

from itertools import pairwise

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from deckline_sim.ship.layout import Layout
from deckline_sim.ship.mesh import Array, Rgb, place, rectangle
from deckline_sim.ship.paint_shapes import (
    Coat,
    axes,
    bars,
    blots,
    dashes,
    figures,
    layers,
    polygons,
    ring,
    streaks,
    stripe,
)
from deckline_sim.ship.ship_class import Catapult, DeckSurface, EdgeStyle, LineStyle, Plan

ASTERN = ((0.0, 0.0), (1.0, 0.0))  # a line along the ship's axis
DEFLECTOR_M = (-21.0, -12.0)  # a jet blast deflector along the catapult
SLOT_SHADE = 0.06
STEEL = (0.22, 0.21, 0.2)
WIRE_SHADE = 0.05  # bare steel, greased
RUST = np.array([0.36, 0.22, 0.13])
RUBBER_ELSEWHERE = 0.3  # part of the decks without a runway that bear tyre marks all the same
TOUCHDOWN = (0.12, 0.5)  # of the runway's length: where most rubber lies
BORDER_INSET_M = 0.8  # of the line along the deck's edge


def build_coat(layout: Layout, plan: Plan, surface: DeckSurface, runway: bool, worn: bool, rng: Generator) -> Coat:
    """Everything painted on a deck, in order; without a runway only the rest. `worn` decks may lose edge paint."""
    coats = [paint_plates(layout, surface, rng), paint_stains(layout, rng), paint_fixtures(layout, plan)]
    if runway:
        coats.append(paint_runway(layout, plan, paint_rubber(layout, rng), rng))
        if worn:
            coats.append(paint_damage(layout, plan.edge.width_m, surface.rgb, rng))
    elif rng.random() < RUBBER_ELSEWHERE:
        coats.append(paint_rubber(layout, rng))
    return layers(coats)


def paint_fixtures(layout: Layout, plan: Plan) -> Coat:
    """What a plan holds beside the runway."""
    coats = []
    for panel in plan.panels:
        corners = rectangle(*panel.middle_m, panel.length_m, panel.width_m, np.deg2rad(panel.yaw_deg))
        coats.append(polygons(corners, panel.rgb, panel.opacity))
        if panel.border is not None:
            coats += [paint_line(line, panel.border) for line in pairwise([*corners, corners[0]])]
    coats += [paint_catapult(catapult) for catapult in plan.catapults]
    coats += [paint_line((item.start_m, item.end_m), item.style) for item in plan.stripes]
    for spot in plan.spots:
        (x, y), style = spot.middle_m, (spot.width_m, spot.rgb)
        coats.append(ring(spot.middle_m, spot.radius_m, *style))
        if spot.lead_m > 0.0:
            coats.append(stripe(((x - spot.lead_m, y), (x, y)), *style))
        if spot.cross_m > 0.0:
            coats.append(stripe(((x, y - spot.cross_m), (x, y + spot.cross_m)), *style))
    for number in plan.numbers:
        head = [[number.height_m, 0.0], [number.height_m, 1.0]]  # the feet point astern
        line = place(head, *number.at_m, np.deg2rad(number.yaw_deg))
        coats.append(figures(number.text, line, number.height_m, number.rgb))
    if plan.stern_m > 0.0:
        coats.append(bars(ASTERN, (0.0, plan.stern_m), (layout.port_m[0], layout.starboard_m[0]), plan.paint_rgb))
    sides = ((layout.port_m, plan.port_border_m, 1.0), (layout.starboard_m, plan.starboard_border_m, -1.0))
    for edge, width, inward in sides:
        if width > 0.0:
            points = np.column_stack([layout.stations_m, edge + inward * (BORDER_INSET_M + width / 2)])[::2]
            coats += [stripe(line, width, plan.paint_rgb) for line in pairwise(points)]
    return layers(coats)


def paint_catapult(catapult: Catapult) -> Coat:
    """Band, slot, thin lines on both sides, deflector."""
    line = catapult.start_m, catapult.end_m
    coats = [stripe(line, catapult.width_m, catapult.rgb)]
    if catapult.slot_m > 0.0:
        coats.append(stripe(line, min(catapult.slot_m, catapult.width_m), (SLOT_SHADE,) * 3))
    if catapult.border_m > 0.0:
        coats += [stripe(line, 0.25, catapult.rgb, side * catapult.border_m) for side in (-1, 1)]
    half = catapult.deflector_m / 2
    return layers([*coats, bars(line, DEFLECTOR_M, (-half, half), STEEL, 0.9)] if half > 0.0 else coats)


def paint_line(line_m: ArrayLike, style: LineStyle) -> Coat:
    """A stripe along a line (2, 2) in its style."""
    if style.gap_m == 0.0 and len(style.rgbs) == 1:
        return stripe(line_m, style.width_m, style.rgbs[0])
    return dashes(line_m, style.width_m, style.rgbs, style.dash_m, style.gap_m)


def paint_edge(line_m: Array, style: EdgeStyle) -> Coat:
    """One edge marking; its middle is the line (2, 2), from its first end to its last."""
    if style.kind == "stripe":
        coat = stripe(line_m, style.width_m, style.rgb)
    elif style.kind == "dashed":
        coat = dashes(line_m, style.width_m, [style.rgb], style.bar_m, style.pitch_m - style.bar_m)
    else:
        offset, inner = (style.width_m - style.rail_m) / 2, style.width_m / 2 - style.rail_m
        coats = [stripe(line_m, style.rail_m, style.rgb, side * offset) for side in (-1, 1)]
        if style.kind == "ladder":
            first = np.arange(0.0, axes(*line_m)[2] - style.bar_m, style.pitch_m)
            coats.append(bars(line_m, np.column_stack([first, first + style.bar_m]), (-inner, inner), style.rgb))
        coat = layers(coats)
    coat[:, 5] *= style.opacity
    return coat


def paint_smear(line_m: Array, inward: float, style: EdgeStyle, rng: Generator) -> Coat:
    """Streaks from the marking's sharp outer edge inwards (+1: to the line's right), fading."""
    length = axes(*line_m)[2]
    cuts = np.cumsum(rng.uniform(0.5, 5.0, int(length / 2.0) + 10))
    cuts = np.concatenate([[0.0], cuts[cuts < length], [length]])
    spans = np.column_stack([cuts[:-1], cuts[1:]])
    strong = style.smear * rng.uniform(0.75, 1.0, (len(spans), 1))
    outer, middle = -inward * style.width_m / 2, inward * style.width_m / 2
    body = bars(line_m, spans, (outer, middle), style.rgb, strong)
    fringe = bars(line_m, spans, (middle, middle + inward * style.smear_m), style.rgb, strong * [1, 1, 0, 0])
    return layers([body, fringe])


def paint_runway(layout: Layout, plan: Plan, rubber: Coat, rng: Generator) -> Coat:
    """Everything that marks the runway, in order: the edge markings on top, tyre marks (`rubber`) under them."""
    centre, half = layout.centre_m, layout.spacing_m / 2
    coats = []
    inner = half - plan.edge.width_m / 2 - 0.3  # bare deck on both sides leaves the edge markings symmetric
    if plan.area_opacity > 0.0 and inner > 0.0:
        coats.append(bars(centre, (0.0, axes(*centre)[2]), (-inner, inner), plan.area_rgb, plan.area_opacity))
    for distance, style in plan.fouls:
        line = layout.left_m if distance < 0.0 else layout.right_m
        coats.append(paint_line(line + axes(*line)[1] * distance, style))
    if plan.centre is not None:
        coats.append(paint_line(centre, plan.centre))
    first, reach = np.asarray(plan.wires_m), half + plan.edge.width_m
    wires = np.column_stack([first, first + plan.wire_width_m])
    coats += [rubber, bars(centre, wires, (-reach, reach), (WIRE_SHADE,) * 3, wear=0.2)]
    if plan.ramp_m > 0.0:
        reach = half + plan.edge.width_m / 2
        coats.append(bars(centre, (0.0, plan.ramp_m), (-reach, reach), plan.paint_rgb))
    right_edge = plan.right_edge or plan.edge
    for line, edge, inward in ((layout.left_m, plan.edge, 1.0), (layout.right_m, right_edge, -1.0)):
        if edge.smear > 0:
            coats.append(paint_smear(line, inward, edge, rng))
        coats.append(paint_edge(line, edge))
    return layers(coats)


def paint_rubber(layout: Layout, rng: Generator) -> Coat:
    """Tyre marks about the middle, densest where aircraft touch down; on some decks they merge into one dark field."""
    start, end = layout.centre_m
    along, right, length = axes(start, end)
    half = 0.42 * layout.spacing_m
    count = rng.integers(0, 30)
    begin = rng.uniform(0.02, 0.6, count) * length
    reach = np.minimum(rng.uniform(15.0, max(0.6 * length, 16.0), count), length - begin)
    across = np.clip(rng.normal(0, 0.3, (2, count)), -0.9, 0.9) * half
    first = start + begin[:, None] * along + across[0, :, None] * right
    last = start + (begin + reach)[:, None] * along + (0.7 * across[0] + 0.3 * across[1])[:, None] * right
    widths, strong = rng.uniform(0.4, 3.0, count), rng.uniform(0.1, 0.7, count)
    if rng.random() < 0.4:
        fields = rng.integers(1, 4)
        s = rng.uniform(*TOUCHDOWN, (fields, 1)) * length
        middle = start + s * along + rng.normal(0.0, 0.15 * half, fields)[:, None] * right
        stretch = np.minimum(np.minimum(rng.uniform(0.15, 0.45, (fields, 1)) * length, 150.0) / 2, s) * along
        first, last = np.concatenate([middle - stretch, first]), np.concatenate([middle + stretch, last])
        widths = np.concatenate([rng.uniform(0.8, 1.9, fields) * half, widths])
        strong = np.concatenate([rng.uniform(0.2, 0.6, fields), strong])
    shade = np.repeat(rng.uniform(0.02, 0.12, (len(first), 1)), 3, axis=1)
    return streaks(first, last, widths, shade, strong)


def paint_stains(layout: Layout, rng: Generator) -> Coat:
    """Soft patches anywhere: dark and light streaks, oil, rust, wet deck."""
    long, drops = rng.integers(0, 26), rng.integers(0, 40)
    x = rng.uniform(0.0, 0.97, long + drops) * layout.length_m
    port, starboard = layout.edges_at(x)
    places = np.column_stack([x, port + rng.random(len(x)) * (starboard - port)])
    first = places[:long]
    last = first + np.column_stack([rng.uniform(4, 40, long), rng.normal(0, 4, long)])
    grey = np.repeat(rng.uniform(0.02, 0.5, (long, 1)), 3, axis=1)
    soft = streaks(first, last, rng.uniform(2, 14, long), grey, rng.uniform(0.05, 0.4, long))
    rusty = rng.random((drops, 1)) < rng.choice([0.05, 0.6])
    colours = np.where(rusty, RUST * rng.uniform(0.7, 1.2, (drops, 1)), rng.uniform(0.02, 0.15, (drops, 1)))
    radii = np.exp(rng.uniform(np.log(0.4), np.log(6.0), drops))
    return layers([soft, blots(places[long:], radii, colours, rng.uniform(0.1, 0.7, drops))])


def paint_plates(layout: Layout, surface: DeckSurface, rng: Generator) -> Coat:
    """Tones and seams of the deck's plates, and rectangles painted anew in another grey."""
    coats, bare = [], np.asarray(surface.rgb)
    low, high = layout.outline_m.min(axis=0), layout.outline_m.max(axis=0)
    if rng.random() < 0.3:
        count = np.ceil((high - low) / [rng.uniform(9.0, 25.0), (high[1] - low[1]) / rng.integers(3, 9)])
        cells = np.stack(np.meshgrid(*map(np.arange, count)), axis=-1).reshape(-1, 1, 2)
        corners = low + (cells + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])) * ((high - low) / count)
        tone = np.clip(bare * rng.uniform(0.75, 1.3, (len(cells), 1, 1)), 0.0, 1.0)
        coats.append(polygons(corners, tone, rng.uniform(0.2, 0.8), wear=0.0))
    if rng.random() < 0.3:
        pitch, shade, width = rng.uniform(4.0, 15.0), rng.uniform(0.0, 0.5), rng.uniform(0.08, 0.25)
        seams = np.arange(pitch, high[0], pitch)
        spans = np.column_stack([seams, seams + width])
        coats.append(bars(ASTERN, spans, (low[1], high[1]), (shade,) * 3, rng.uniform(0.1, 0.5)))
    patches = rng.integers(0, 9)
    middle = low + rng.random((patches, 1, 2)) * (high - low)
    half = np.exp(rng.uniform(np.log(1.5), np.log(18.0), (patches, 1, 2)))
    corners = middle + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    tone = np.clip(bare * rng.uniform(0.5, 1.8, (patches, 1, 1)), 0.0, 1.0)
    coats.append(polygons(corners, tone, rng.uniform(0.3, 1.0, (patches, 1)), wear=0.3))
    return layers(coats)


def paint_damage(layout: Layout, width_m: float, rgb: Rgb, rng: Generator) -> Coat:
    """Deck-coloured gaps in the edge markings: worn spots across them, and repaint that hides half of their width."""
    coats = []
    for line in (layout.left_m, layout.right_m):
        length = axes(*line)[2]
        count = rng.integers(0, 7)
        first = rng.uniform(0.0, 0.95, count) * length
        spans = np.column_stack([first, np.minimum(first + rng.uniform(0.5, 0.06 * length + 1.0, count), length)])
        reach = width_m / 2 + 0.1
        across = np.where(rng.random((count, 1)) < 0.6, (-reach, reach), np.sort(rng.choice([-reach, 0, reach], 2)))
        tone = np.clip(np.asarray(rgb) * rng.uniform(0.7, 1.4, (count, 1, 1)), 0.0, 1.0)
        coats.append(bars(line, spans, across, tone, rng.uniform(0.3, 1.0, (count, 1)), wear=0.0))
    return layers(coats)
