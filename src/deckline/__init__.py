"""deckline: sees a ship's landing deck through haze and says where the aircraft is relative to its lines."""

__version__ = "0.1.0"
