"""Inference sessions and the weights that deckline ships."""

from deckline.runtime.session import Session, load_session
from deckline.runtime.weights import ShippedModel, sha256_of, shipped_models, shipped_weights

__all__ = ["Session", "ShippedModel", "load_session", "sha256_of", "shipped_models", "shipped_weights"]
