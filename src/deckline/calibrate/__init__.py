"""Camera, mounting and delay of the poses, estimated from one recorded approach."""

from deckline.calibrate.files import describe, write_calibration
from deckline.calibrate.model import CAMERA_NAMES
from deckline.calibrate.observations import observe_approach
from deckline.calibrate.solve import Calibration, Outcome, solve

__all__ = [
    "CAMERA_NAMES",
    "Calibration",
    "Outcome",
    "describe",
    "observe_approach",
    "solve",
    "write_calibration",
]
