"""Sees a ship's landing deck through haze and says where the aircraft is relative to its runway lines."""

__version__ = "0.1.0"

from deckline.config import Approach, Deck, RunConfig, Sensors
from deckline.flight import Flight, FrameResult
from deckline.geometry import Camera
from deckline.recording import BadFrame, open_recording
from deckline.types import Detection, Frame, Guidance, RunwayEstimate, Track

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
