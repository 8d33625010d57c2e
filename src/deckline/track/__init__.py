"""The runway over frames: filtered, bridged where nothing is seen, and watched for contradictions."""

from deckline.track.config import ErrorConfig, IntegrityConfig, MotionConfig, TrackConfig
from deckline.track.tracker import Tracker

__all__ = ["ErrorConfig", "IntegrityConfig", "MotionConfig", "TrackConfig", "Tracker"]
