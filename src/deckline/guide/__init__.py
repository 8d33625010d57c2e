"""From runway lines to deviations of the aircraft."""

from deckline.guide.deviations import guidance

__all__ = ["guidance"]
