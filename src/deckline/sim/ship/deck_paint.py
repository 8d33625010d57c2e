"""A deck's whole paint: plates, fixtures of its plan, the runway, and the wear of all of it."""

from itertools import pairwise

import numpy as np

from deckline.sim.ship.layout import Layout
from deckline.sim.ship.markings import line_coat, runway_coat
from deckline.sim.ship.mesh import place, rectangle
from deckline.sim.ship.paint import Coat, bars, figures, fill, layers, ring, stripe
from deckline.sim.ship.plan import Catapult, DeckSurface, Number, Panel, Plan, Spot
from deckline.sim.ship.weathering import damage_coat, plate_coat, rubber_coat, stain_coat

DEFLECTOR_M = 9.0  # a jet blast deflector along the catapult
SLOT_SHADE = 0.06
STEEL = (0.22, 0.21, 0.2)
RUBBER_ELSEWHERE = 0.3  # part of the decks without a runway that bear tyre marks all the same
BORDER_INSET_M = 0.8  # of the line along the deck's edge


def deck_coat(
    layout: Layout, plan: Plan, surface: DeckSurface, runway: bool, worn: bool, rng: np.random.Generator
) -> Coat:
    """Everything painted on a deck, in order; without a runway only the rest. `worn` decks may lose edge paint."""
    coats = [plate_coat(layout, surface, rng), stain_coat(layout, rng), fixture_coat(layout, plan)]
    if runway:
        coats.append(runway_coat(layout, plan, rubber_coat(layout, rng), rng))
        if worn:
            coats.append(damage_coat(layout, plan.edge.width_m, surface.rgb, rng))
    elif rng.random() < RUBBER_ELSEWHERE:
        coats.append(rubber_coat(layout, rng))
    return layers(coats)


def fixture_coat(layout: Layout, plan: Plan) -> Coat:
    """What a plan holds beside the runway."""
    coats = [panel_coat(panel) for panel in plan.panels]
    coats += [catapult_coat(catapult) for catapult in plan.catapults]
    coats += [line_coat(np.array(item.start_m), np.array(item.end_m), item.style) for item in plan.stripes]
    coats += [spot_coat(spot) for spot in plan.spots]
    coats += [number_coat(number) for number in plan.numbers]
    if plan.stern_m > 0.0:
        reach = (layout.port_m[0], layout.starboard_m[0])
        coats.append(bars((0.0, 0.0), (1.0, 0.0), (0.0, plan.stern_m), reach, plan.paint_rgb))
    sides = ((layout.port_m, plan.port_border_m, 1.0), (layout.starboard_m, plan.starboard_border_m, -1.0))
    for edge, width, inward in sides:
        if width > 0.0:
            points = np.column_stack([layout.stations_m, edge + inward * (BORDER_INSET_M + width / 2)])[::2]
            coats += [stripe(a, b, width, plan.paint_rgb) for a, b in pairwise(points)]
    return layers(coats)


def catapult_coat(catapult: Catapult) -> Coat:
    """Band, slot, thin lines on both sides, deflector."""
    start, end = np.array(catapult.start_m), np.array(catapult.end_m)
    coats = [stripe(start, end, catapult.width_m, catapult.rgb)]
    if catapult.slot_m > 0.0:
        coats.append(stripe(start, end, min(catapult.slot_m, catapult.width_m), (SLOT_SHADE,) * 3))
    if catapult.border_m > 0.0:
        coats += [stripe(start, end, 0.25, catapult.rgb, side * catapult.border_m) for side in (-1, 1)]
    if catapult.deflector_m > 0.0:
        span, half = (-DEFLECTOR_M - 12.0, -12.0), catapult.deflector_m / 2
        coats.append(bars(start, end, span, (-half, half), STEEL, 0.9))
    return layers(coats)


def panel_coat(panel: Panel) -> Coat:
    """A rectangle and its outline."""
    corners = rectangle(*panel.middle_m, panel.length_m, panel.width_m, np.deg2rad(panel.yaw_deg))
    coats = [fill(corners, panel.rgb, panel.opacity)]
    if panel.border is not None:
        coats += [line_coat(a, b, panel.border) for a, b in pairwise([*corners, corners[0]])]
    return layers(coats)


def spot_coat(spot: Spot) -> Coat:
    """Circle, lead-in line, bar."""
    x, y = spot.middle_m
    coats = [ring(spot.middle_m, spot.radius_m, spot.width_m, spot.rgb)]
    if spot.lead_m > 0.0:
        coats.append(stripe((x - spot.lead_m, y), (x, y), spot.width_m, spot.rgb))
    if spot.cross_m > 0.0:
        coats.append(stripe((x, y - spot.cross_m), (x, y + spot.cross_m), spot.width_m, spot.rgb))
    return layers(coats)


def number_coat(number: Number) -> Coat:
    """Digits whose feet point astern."""
    head, reading = place([[number.height_m, 0.0], [number.height_m, 1.0]], *number.at_m, np.deg2rad(number.yaw_deg))
    return figures(number.text, head, reading, number.height_m, number.rgb)
