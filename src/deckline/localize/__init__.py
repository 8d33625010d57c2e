"""From points in the image to lines in the world."""

from deckline.localize.localizer import Localizer, localize

__all__ = ["Localizer", "localize"]
