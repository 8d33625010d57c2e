"""What people see of a frame: hazy and dehazed picture side by side, a far deck magnified, the instrument below."""

from dataclasses import dataclass

from deckline.dehaze import DISPLAY_PX, DehazeResult
from deckline.flight import FrameResult
from deckline.report import draw
from deckline.report.annotators import CLOSE_UP, LineAnnotator, MagnifierAnnotator, ViewportAnnotator, resize
from deckline.report.draw import Image, draw_text, measure_text, shorten
from deckline.report.instrument import BAND, draw_instrument
from deckline.types import Frame, Guidance

PANEL_PX = (DISPLAY_PX, 360)  # width, height of each picture at most
HEADER_PX = 40
OVERLAY_PX = (2 * PANEL_PX[0], HEADER_PX + PANEL_PX[1] + BAND[1])  # width, height; both even, as H.264 wants
FAR: tuple[ViewportAnnotator, ...] = (LineAnnotator(),)


@dataclass(frozen=True, eq=False)
class Panels:
    """The two pictures of a frame, each at most 640x360 px, in the image's proportions."""

    hazy: Image
    """(h, w, 3) as the camera saw it."""
    marked: Image
    """(h, w, 3) dehazed, with what was found."""
    not_dehazed: str = ""
    """Why `marked` is not dehazed; empty: it is."""


def draw_panels(result: FrameResult, dehazed: DehazeResult) -> Panels:
    """The small pictures of one result and of its frame dehazed."""
    camera = result.frame.camera
    scale = min(PANEL_PX[0] / camera.width, PANEL_PX[1] / camera.height)
    size = max(round(camera.width * scale), 2), max(round(camera.height * scale), 2)
    hazy, marked = (resize(image, size) for image in (result.frame.image_rgb, dehazed.image_rgb))
    magnifier = MagnifierAnnotator()
    marked = magnifier.annotate(marked, result)
    for mark in CLOSE_UP if magnifier.find_place(hazy, result) is None else FAR:
        marked = mark.annotate(marked, result)
    return Panels(MagnifierAnnotator(marks=()).annotate(hazy, result), marked, dehazed.note)


def draw_overlay(frame: Frame, guidance: Guidance, pictures: Panels) -> Image:
    """The whole overlay picture, (648, 1280, 3)."""
    image = draw.blank(*OVERLAY_PX)
    right = (PANEL_PX[0], 0)
    draw_panel(image, pictures.hazy, (0, 0), "HAZY", "as the camera saw it")
    draw_panel(
        image, pictures.marked, right, "NOT DEHAZED" if pictures.not_dehazed else "DEHAZED", "with the lines found"
    )
    image[HEADER_PX + PANEL_PX[1] :] = draw_instrument(guidance)
    time = f"  ·  {frame.time_s:.6f} s"
    name = shorten(frame.file, 14, 380 - measure_text(time, 14)) + time
    draw_text(image, name, (OVERLAY_PX[0] - 16 - measure_text(name, 14), 26), 14, draw.DIM)
    return image


def draw_panel(image: Image, picture: Image, corner: tuple[int, int], title: str, words: str) -> None:
    """Place a picture of at most `PANEL_PX` below its title, in a panel whose left and top are given."""
    (left, top), (height, width) = corner, picture.shape[:2]
    x, y = left + (PANEL_PX[0] - width) // 2, top + HEADER_PX + (PANEL_PX[1] - height) // 2
    image[y : y + height, x : x + width] = picture
    edges = [edge for edge in (left, left + PANEL_PX[0] - 1) if 0 < edge < image.shape[1] - 1]
    image[top + HEADER_PX : top + HEADER_PX + PANEL_PX[1], edges] = draw.BACKGROUND
    draw_text(image, title, (left + 16, top + 26), 15, draw.INK, 600)
    draw_text(image, words, (left + 28 + measure_text(title, 15, 600), top + 26), 14, draw.DIM)
