"""From runway lines to deviations of the aircraft."""

from deckline.guide.config import GuideConfig
from deckline.guide.deviations import NO_LINE, guidance

__all__ = ["NO_LINE", "GuideConfig", "guidance"]
