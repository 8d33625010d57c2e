"""How a landing went, in words."""

from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.landing import Landing
from deckline_sim.landing.touchdown import Outcome

NAMES = {
    Outcome.WIRE: "wire",
    Outcome.BOLTER: "bolter",
    Outcome.WAVE_OFF: "wave-off",
    Outcome.RAMP_STRIKE: "ramp strike",
    Outcome.HARD_LANDING: "hard landing",
    Outcome.OFF_CENTRE: "off centre",
    Outcome.WATER: "no landing",
    Outcome.DEPARTED: "out of control",
}


def name_outcome(landing: Landing) -> str:
    """The outcome, with the number of the wire, or why the pass was broken off."""
    contact = landing.touchdown
    if landing.outcome is Outcome.WIRE and contact is not None:
        return f"wire {contact.wire}"
    if landing.wave_off is None:
        return NAMES[landing.outcome]
    after = "" if landing.outcome is Outcome.WAVE_OFF else f"{NAMES[landing.outcome]} after "
    return f"{after}wave-off, {landing.wave_off}"


def describe_touchdown(landing: Landing) -> str:
    """Where and how hard the aircraft touched down; empty: it did not."""
    contact = landing.touchdown
    if contact is None:
        return ""
    along = f"{abs(contact.beyond_aim_m):.1f} m {'beyond' if contact.beyond_aim_m >= 0 else 'short of'} the aim point"
    across = f"{abs(contact.right_m):.1f} m {'right' if contact.right_m >= 0 else 'left'} of the centre line"
    return f"{along}, {across}, sink {contact.sink_m_s:.1f} m/s"


def describe_outcome(landing: Landing) -> str:
    """The outcome and the touchdown."""
    return ", ".join(filter(None, (name_outcome(landing), describe_touchdown(landing))))


def summarise_landing(config: LandingConfig, seed: int, landing: Landing) -> str:
    """One line: which landing, its outcome and its touchdown."""
    flown = f"landing {seed}, visibility {config.visibility_m:g} m, sea state {config.sea_state:g}"
    return f"{flown}: {describe_outcome(landing)}"
