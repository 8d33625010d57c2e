"""The pose of the aircraft relative to the runway from the picture alone: one frame, and over frames."""

from deckline.picture_pose.forecast import PictureForecast
from deckline.picture_pose.tracker import PictureAnswer, PictureTracker

__all__ = ["PictureAnswer", "PictureForecast", "PictureTracker"]
