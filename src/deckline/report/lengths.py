"""Lateral deviation, height and distance of a guidance in the unit that it has them in."""

from dataclasses import dataclass

from deckline.types import Guidance, Value

METRES, WIDTHS = "m", "widths"


@dataclass(frozen=True, eq=False)
class Lengths:
    """The lengths that people see."""

    lateral: Value | None
    """Positive: right of the centre line."""
    height: Value | None
    """Above the deck."""
    distance: Value | None
    """To the ramp, along the centre line; positive: ahead."""
    unit: str
    """METRES, or WIDTHS of the runway where its width is not stated."""


def lengths_of(guidance: Guidance) -> Lengths:
    """The lengths of a guidance, in metres unless it has runway widths alone."""
    widths = guidance.in_widths
    if widths is not None:
        return Lengths(widths.lateral_deviation, widths.height_above_deck, widths.distance_to_ramp, WIDTHS)
    return Lengths(guidance.lateral_deviation_m, guidance.height_above_deck_m, guidance.distance_to_ramp_m, METRES)
