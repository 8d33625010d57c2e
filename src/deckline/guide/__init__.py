"""From runway lines to deviations of the aircraft."""

from deckline.guide.deviations import add_approach, guidance

__all__ = ["add_approach", "guidance"]
