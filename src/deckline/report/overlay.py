"""What one frame looks like to people: hazy and dehazed picture side by side, instrument below."""

import numpy as np

from deckline.report.draw import BACKGROUND, DIM, INK, Image, shortened, text, text_width
from deckline.report.instrument import BAND, instrument_band
from deckline.report.panels import PANEL_PX, Panels
from deckline.types import Frame, Guidance

HEADER_PX = 40
OVERLAY_PX = (2 * PANEL_PX[0], HEADER_PX + PANEL_PX[1] + BAND[1])  # width, height; both even, as H.264 wants


def overlay(frame: Frame, guidance: Guidance, pictures: Panels) -> Image:
    """The whole overlay picture, (648, 1280, 3)."""
    image = np.full((OVERLAY_PX[1], OVERLAY_PX[0], 3), BACKGROUND, dtype=np.uint8)
    for column, picture in enumerate((pictures.hazy, pictures.marked)):
        height, width = picture.shape[:2]
        left = column * PANEL_PX[0] + (PANEL_PX[0] - width) // 2
        top = HEADER_PX + (PANEL_PX[1] - height) // 2
        image[top : top + height, left : left + width] = picture
    image[HEADER_PX : HEADER_PX + PANEL_PX[1], PANEL_PX[0] - 1 : PANEL_PX[0] + 1] = BACKGROUND
    _header(image, frame)
    image[HEADER_PX + PANEL_PX[1] :] = instrument_band(guidance)
    return image


def _header(image: Image, frame: Frame) -> None:
    text(image, "HAZY", (16, 26), 15, INK, 600)
    text(image, "as the camera saw it", (68, 26), 14, DIM)
    text(image, "DEHAZED", (PANEL_PX[0] + 16, 26), 15, INK, 600)
    text(image, "with the lines found", (PANEL_PX[0] + 100, 26), 14, DIM)
    time = f"  ·  {frame.time_s:.6f} s"
    name = shortened(frame.file, 14, 380 - text_width(time, 14)) + time
    text(image, name, (OVERLAY_PX[0] - 16 - text_width(name, 14), 26), 14, DIM)
