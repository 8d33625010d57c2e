"""From runway lines to deviations of the aircraft."""

from deckline.guide.config import GuideConfig
from deckline.guide.deviations import guidance

__all__ = ["GuideConfig", "guidance"]
