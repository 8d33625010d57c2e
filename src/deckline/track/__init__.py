"""The runway over frames: filtered, bridged where nothing is seen, and monitored for contradictions."""

from deckline.track.forecast import Forecast
from deckline.track.tracker import Prediction, Tracker, ship_velocity

__all__ = ["Forecast", "Prediction", "Tracker", "ship_velocity"]
