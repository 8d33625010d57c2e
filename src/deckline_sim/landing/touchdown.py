"""How a pass ends: hook or wheels against the moving deck, or past it."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from deckline_sim.landing.deck import Deck

WIRE_HEIGHT_M = 0.14  # of an arresting wire above the deck, 5.5 in: public dimensions
OFF_CENTRE_M = 6.1  # 20 ft: the hook's most distance from the centre line that wires are made for

Float64 = NDArray[np.float64]


class Outcome(StrEnum):
    """How a pass ended."""

    WIRE = "wire"
    """The hook took a wire."""
    BOLTER = "bolter"
    """On the deck, past or over all wires."""
    WAVE_OFF = "wave_off"
    """Broken off, and clear of the ship."""
    RAMP_STRIKE = "ramp_strike"
    """Below the deck at its end or its side."""
    HARD_LANDING = "hard_landing"
    """More sink than the gear bears."""
    OFF_CENTRE = "off_centre"
    """On the deck, farther from the centre line than wires are made for."""
    WATER = "water"
    """In the water, or past the ship without having touched it."""
    DEPARTED = "departed"
    """Out of control: the flight model has diverged."""


@dataclass(frozen=True, eq=False)
class Touchdown:
    """The first contact with the deck."""

    time_s: float
    """Of the contact, s."""
    beyond_aim_m: float
    """Of the hook past the touchdown point, along the centre line, m."""
    right_m: float
    """Of the hook to the right of the centre line, m."""
    sink_m_s: float
    """Speed towards the deck, m/s."""
    wire: int | None
    """Which one the hook takes, from 1; None: none."""


def strikes_ramp(before: Float64, now: Float64, deck: Deck) -> bool:
    """Whether a point came into the hull below the deck's edge, between two places (3,) of the ship's frame.

    That is across the end of the deck, or from beside it: what touches the deck from above was above it.
    """
    if not now[2] > 0.0:
        return False
    if before[0] < 0.0 <= now[0]:
        port, starboard = deck.layout.edges_at(0.0)
        if port <= now[1] <= starboard:
            return True
    return bool(before[2] > 0.0) and deck.is_over_deck(now)


def touch(before: Float64, now: Float64, step_s: float, time_s: float, deck: Deck) -> Touchdown | None:
    """The contact of hook (row 0) or wheels with the deck between two steps; None: there is none.

    Args:
        before, now: (N, 3) in the ship's frame, at two times that are `step_s` apart.
        step_s: s.
        time_s: of `now`.
        deck: the ship.
    """
    touching = [k for k in range(len(now)) if now[k, 2] >= 0.0 and deck.is_over_deck(now[k])]
    if not touching:
        return None
    sink = max(float(now[k, 2] - before[k, 2]) / step_s for k in touching)
    along, right = deck.on_runway(now[0])
    hook_height = -float(now[0, 2])
    wire = None
    if hook_height <= WIRE_HEIGHT_M:
        wire = next((k + 1 for k, at in enumerate(deck.wires_m) if at >= along), None)
    return Touchdown(time_s, along - deck.touchdown_m, right, sink, wire)


def outcome_of(contact: Touchdown, sink_limit_m_s: float) -> Outcome:
    """What a contact is."""
    if contact.sink_m_s > sink_limit_m_s:
        return Outcome.HARD_LANDING
    if abs(contact.right_m) > OFF_CENTRE_M:
        return Outcome.OFF_CENTRE
    return Outcome.BOLTER if contact.wire is None else Outcome.WIRE
