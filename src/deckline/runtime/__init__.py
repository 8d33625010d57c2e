"""Inference sessions and the weights that deckline ships."""

import os

from deckline.runtime.engines import describe_engines, describe_processor, usable_cores
from deckline.runtime.session import ModelSession, load_session
from deckline.runtime.weights import ShippedModel, sha256_of, shipped_models, shipped_weights

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # ONNX Runtime decides for good when it is imported

__all__ = [
    "ModelSession",
    "ShippedModel",
    "describe_engines",
    "describe_processor",
    "load_session",
    "sha256_of",
    "shipped_models",
    "shipped_weights",
    "usable_cores",
]
