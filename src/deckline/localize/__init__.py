"""From points in the image to lines in the world."""

from deckline.localize.config import AgreementConfig, DeckConfig, LocalizeConfig, NoiseConfig, RansacConfig
from deckline.localize.line_fit import fit_sgd
from deckline.localize.localize import localize

__all__ = ["AgreementConfig", "DeckConfig", "LocalizeConfig", "NoiseConfig", "RansacConfig", "fit_sgd", "localize"]
