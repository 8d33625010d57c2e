"""Sees a ship's landing deck through haze and says where the aircraft is relative to its runway lines."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from deckline.config import Approach, Deck, RunConfig, Sensors
    from deckline.flight import Flight, FrameResult
    from deckline.geometry import Camera
    from deckline.recording import BadFrame, open_recording
    from deckline.types import Detection, Frame, Guidance, RunwayEstimate, Track

__version__ = "0.2.0"

__all__ = [
    "Approach",
    "BadFrame",
    "Camera",
    "Deck",
    "Detection",
    "Flight",
    "Frame",
    "FrameResult",
    "Guidance",
    "RunConfig",
    "RunwayEstimate",
    "Sensors",
    "Track",
    "open_recording",
]

_MODULES = {
    "deckline.config": ("Approach", "Deck", "RunConfig", "Sensors"),
    "deckline.flight": ("Flight", "FrameResult"),
    "deckline.geometry": ("Camera",),
    "deckline.recording": ("BadFrame", "open_recording"),
    "deckline.types": ("Detection", "Frame", "Guidance", "RunwayEstimate", "Track"),
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562): `deckline --version` needs none of them."""
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
