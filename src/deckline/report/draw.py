"""Drawing on RGB images: a few shapes with clean edges. Colour-blind eyes distinguish the colours of left and right."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.atomic import write_atomic
from deckline.recording.images import encode_image

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]
Point = tuple[float, float]

# Okabe & Ito's colour-blind safe palette, red for flags alone.
LEFT: Colour = (86, 180, 233)
RIGHT: Colour = (240, 160, 20)
CENTRE: Colour = (255, 255, 255)
NEEDLE: Colour = (255, 120, 220)
GOOD: Colour = (40, 190, 140)
CAUTION: Colour = (240, 228, 66)
FLAG: Colour = (205, 40, 40)
INK: Colour = (236, 240, 244)
DIM: Colour = (142, 154, 168)
BACKGROUND: Colour = (18, 23, 30)
PANEL: Colour = (29, 36, 46)
EDGE: Colour = (62, 74, 90)

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
JPEG_QUALITY = 95  # of `write_picture`
SHIFT = 3  # coordinates are passed in 1/8 px
# OpenCV 5 has an outline font, OpenCV 4 stroke fonts only.
OUTLINE_FONT: Any = cv2.FontFace("sans") if hasattr(cv2, "FontFace") else None
HERSHEY_PX = 30.0  # height that OpenCV's stroke font has at scale 1, about
ASCII = {"±": "+/-", "°": " deg", "·": "-", "–": "-", "…": "..."}


def check_picture_name(path: Path, what: str) -> None:
    """Raise ValueError unless `write_picture` can write `what` there."""
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        raise ValueError(f"{what} is {', '.join(PICTURE_SUFFIXES)}, got {path.name!r}")


def write_picture(path: Path, image: Image) -> None:
    """Write an RGB image (H, W, 3) as the file's suffix says, whole or not at all.

    Raises:
        ValueError: another suffix, or an image that cannot be encoded.
        OSError: the disk refuses.
    """
    check_picture_name(path, "a picture")
    write_atomic(path, encode_image(image, path.suffix.lower().removeprefix("."), JPEG_QUALITY))


def blank(width: int, height: int) -> Image:
    """A picture (height, width, 3) of the background's colour."""
    image = np.empty((height, width, 3), dtype=np.uint8)
    cv2.rectangle(image, (0, 0), (width, height), BACKGROUND, -1)  # a tenth of the time of numpy's full
    return image


def draw_text(image: Image, words: str, at: Point, size: int, colour: Colour = INK, weight: int = 400) -> int:
    """Write a line of text whose baseline starts at `at`; returns its width, px."""
    origin = (round(at[0]), round(at[1]))
    if OUTLINE_FONT is not None:
        cv2.putText(image, words, origin, colour, OUTLINE_FONT, size, weight)
    else:
        stroke = (size / HERSHEY_PX, colour, 2 if weight > 500 else 1, cv2.LINE_AA)
        cv2.putText(image, _to_ascii(words), origin, cv2.FONT_HERSHEY_SIMPLEX, *stroke)
    return measure_text(words, size, weight)


def measure_text(words: str, size: int, weight: int = 400) -> int:
    """Width of a line of text, px."""
    if OUTLINE_FONT is not None:
        return int(cv2.getTextSize((0, 0), words, (0, 0), OUTLINE_FONT, size, weight)[2])
    stroke = (size / HERSHEY_PX, 2 if weight > 500 else 1)
    return int(cv2.getTextSize(_to_ascii(words), cv2.FONT_HERSHEY_SIMPLEX, *stroke)[0][0])


def shorten(words: str, size: int, width: int) -> str:
    """The text, its end replaced by an ellipsis where it is wider than `width` px."""
    if measure_text(words, size) <= width:
        return words
    while words and measure_text(f"{words}…", size) > width:
        words = words[:-1]
    return f"{words.rstrip()}…"


def wrap(words: str, size: int, width: int, lines: int) -> list[str]:
    """The text broken between words into at most `lines` lines of `width` px; what does not fit ends in an ellipsis."""
    rows = [""]
    for word in words.split():
        longer = f"{rows[-1]} {word}".strip()
        if not rows[-1] or measure_text(longer, size) <= width or len(rows) == lines:
            rows[-1] = longer
        else:
            rows.append(word)
    return [shorten(row, size, width) for row in rows]


def draw_segment(image: Image, ends: ArrayLike, colour: Colour, width: int, halo: int = 2) -> None:
    """A line between two points (2, 2) px, on a dark halo, to be seen on bright haze."""
    start, end = _fixed(ends)
    if halo:
        cv2.line(image, start, end, (0, 0, 0), width + halo, cv2.LINE_AA, SHIFT)
    cv2.line(image, start, end, colour, width, cv2.LINE_AA, SHIFT)


def draw_dashes(image: Image, ends: ArrayLike, colour: Colour, width: int, dash_px: float = 12.0) -> None:
    """A dashed line between two points (2, 2) px; the gaps are two thirds of a dash."""
    start, end = np.asarray(ends, dtype=np.float64)
    length = float(np.linalg.norm(end - start))
    for from_px in np.arange(0.0, length, dash_px * 5 / 3):
        to_px = min(from_px + dash_px, length)
        draw_segment(image, [start + (end - start) * s / length for s in (from_px, to_px)], colour, width)


def draw_dot(image: Image, at: ArrayLike, radius: float, colour: Colour, filled: bool = True, rim: bool = True) -> None:
    """A round point, with a dark rim, to be seen on bright haze; or a thin ring."""
    (centre,) = _fixed(np.asarray(at)[None])
    scaled = round(radius * (1 << SHIFT))
    if filled and rim:
        cv2.circle(image, centre, scaled + (1 << SHIFT), (0, 0, 0), -1, cv2.LINE_AA, SHIFT)
    cv2.circle(image, centre, scaled, colour, -1 if filled else 1, cv2.LINE_AA, SHIFT)


def draw_box(image: Image, corner: tuple[int, int], size: tuple[int, int], colour: Colour, radius: int = 6) -> None:
    """A filled rectangle with round corners."""
    (x0, y0), (x1, y1) = corner, (corner[0] + size[0] - 1, corner[1] + size[1] - 1)
    cv2.rectangle(image, (x0 + radius, y0), (x1 - radius, y1), colour, -1)
    cv2.rectangle(image, (x0, y0 + radius), (x1, y1 - radius), colour, -1)
    for x in (x0 + radius, x1 - radius):
        for y in (y0 + radius, y1 - radius):
            cv2.circle(image, (x, y), radius, colour, -1, cv2.LINE_AA)


def draw_tag(image: Image, words: str, corner: tuple[int, int], size: int, colour: Colour, ink: Colour) -> int:
    """A small label: text on a filled box whose top left corner is given; returns its width, px."""
    width = measure_text(words, size, 600) + size
    draw_box(image, corner, (width, round(size * 1.7)), colour, 4)
    draw_text(image, words, (corner[0] + size / 2, corner[1] + size * 1.2), size, ink, 600)
    return width


def _fixed(points: ArrayLike) -> list[tuple[int, int]]:
    """Pixels as OpenCV's fixed-point numbers, limited to far inside its 16-bit drawing range."""
    return [(_fix(u), _fix(v)) for u, v in np.asarray(points, dtype=np.float64).tolist()]


def _fix(place_px: float) -> int:
    return round(min(max(place_px, -3000.0), 6000.0) * (1 << SHIFT))


def _to_ascii(words: str) -> str:
    for sign, plain in ASCII.items():
        words = words.replace(sign, plain)
    return words.encode("ascii", "replace").decode()
