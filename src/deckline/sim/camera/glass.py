"""A frame as seen from a cockpit, past a drone's legs or under captions, and taken as phones take it."""

from dataclasses import replace

import numpy as np

from deckline.sim.camera.foreground import draw_foreground, lay_over
from deckline.sim.camera.phone import phone_picture
from deckline.sim.config import FLIGHTS, SimConfig
from deckline.types import Frame

FOREGROUND = 9  # random stream


def look_through(frame: Frame, config: SimConfig, index: int) -> Frame:
    """The frame behind a foreground; the same one in all frames of a flight. Depth and truth stay the scene's."""
    rng = np.random.default_rng([config.seed, FOREGROUND, 0 if config.trajectory in FLIGHTS else index])
    if rng.random() >= config.foreground_share:
        return frame
    height, width = frame.image_rgb.shape[:2]
    seen = phone_picture(lay_over(frame.image_rgb, draw_foreground(width, height, rng)), rng)
    return replace(frame, image_rgb=np.clip(np.rint(seen), 0, 255).astype(np.uint8))
