"""A frame as seen from a cockpit, past a drone's legs or under captions, and taken as phones take it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deckline.types import Frame
from deckline_sim.camera.foreground import draw_foreground, lay_over
from deckline_sim.camera.phone import phone_picture
from deckline_sim.config import FLIGHTS, SimConfig
from deckline_sim.visible_line import find_visible_line

FOREGROUND = 9  # random stream
OPEN_BOX = (0.25, 0.25, 0.75, 0.75)  # of the picture, which stays open in a flight: u0, v0, u1, v1


def add_foreground(frame: Frame, config: SimConfig, index: int) -> Frame:
    """The frame behind a foreground that leaves its runway open; the same foreground in all frames of a flight.

    Depth and truth stay the scene's. `keep_clear` keeps the scene as the clear view, also in clear air.
    """
    flight = config.trajectory in FLIGHTS
    rng = np.random.default_rng([config.seed, FOREGROUND, 0 if flight else index])
    if rng.random() >= config.foreground_share:
        return frame
    height, width = frame.image_rgb.shape[:2]
    keep = np.multiply(OPEN_BOX, [width, height] * 2) if flight else _box_lines(frame)
    foreground = draw_foreground(width, height, rng, keep)
    noise = np.random.default_rng([config.seed, FOREGROUND, 1, index])
    seen = phone_picture(lay_over(frame.image_rgb, foreground), noise)
    truth = frame.truth
    if truth is not None and truth.clear_rgb is None and config.keep_clear:
        truth = replace(truth, clear_rgb=frame.image_rgb)
    return replace(frame, image_rgb=np.clip(np.rint(seen), 0, 255).astype(np.uint8), truth=truth)


def _box_lines(frame: Frame) -> NDArray[np.float64] | None:
    """Box u0, v0, u1, v1 (4,) px of what the picture shows of the true lines; None: nothing."""
    truth = frame.truth
    segments = [] if truth is None else [line for line in (truth.left, truth.right) if line is not None]
    lines = [find_visible_line(frame, segment, within_visibility=False) for segment in segments]
    points = [line.points_px for line in lines if line is not None]
    if not points:
        return None
    return np.concatenate([np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)])
