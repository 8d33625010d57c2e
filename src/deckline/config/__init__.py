"""One configuration: what is known of sensors, deck and approach, and which models run.

Each quantity exists once, here, and is passed on to fit, tracker, integrity, guidance, simulator and evaluations.
A TOML file may hold everything in a `RunConfig`; angles are degrees there, as people read them. A number out of
range raises a `ValueError` that names field and value.
"""

from deckline.config.deck import USUAL_WIDTH_M, WIDEST_USUAL_M, Approach, Deck, RunwaySurvey
from deckline.config.run_config import FrameNoise, RunConfig
from deckline.config.sensors import GRADES, Grade, Navigation, Sensors, with_grade
from deckline.config.stages import (
    CPU,
    Device,
    Engine,
    Integrity,
    Localization,
    Mode,
    Models,
    Picture,
    PicturePose,
    Precision,
    Tracking,
)

__all__ = [
    "CPU",
    "GRADES",
    "USUAL_WIDTH_M",
    "WIDEST_USUAL_M",
    "Approach",
    "Deck",
    "Device",
    "Engine",
    "FrameNoise",
    "Grade",
    "Integrity",
    "Localization",
    "Mode",
    "Models",
    "Navigation",
    "Picture",
    "PicturePose",
    "Precision",
    "RunConfig",
    "RunwaySurvey",
    "Sensors",
    "Tracking",
    "with_grade",
]
