"""The runway over frames: filtered, bridged where nothing is seen, and watched for contradictions."""

from deckline.track.config import ErrorConfig, MotionConfig, TrackConfig
from deckline.track.tracker import Tracker

__all__ = ["ErrorConfig", "MotionConfig", "TrackConfig", "Tracker"]
