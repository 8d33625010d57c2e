"""The runway over frames: filtered, bridged where nothing is seen, and monitored for contradictions."""

from deckline.track.tracker import Prediction, Tracker

__all__ = ["Prediction", "Tracker"]
