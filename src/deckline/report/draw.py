"""Drawing on RGB images: a few shapes with clean edges. Colours tell left from right to colour-blind eyes as well."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.atomic import write_atomic

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

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
SHIFT = 3  # coordinates are passed in 1/8 px
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
    done, data = cv2.imencode(path.suffix.lower(), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    if not done:
        raise ValueError(f"{path}: a picture of shape {image.shape} could not be encoded")
    write_atomic(path, data.tobytes())


def text(image: Image, words: str, at: tuple[float, float], size: int, colour: Colour = INK, weight: int = 400) -> int:
    """Write a line of text whose baseline starts at `at`; returns its width, px."""
    origin = (round(at[0]), round(at[1]))
    face = _face()
    if face is None:
        plain, scale = _ascii(words), size / HERSHEY_PX
        thickness = 2 if weight > 500 else 1
        cv2.putText(image, plain, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, thickness, cv2.LINE_AA)
    else:
        cv2.putText(image, words, origin, colour, face, size, weight)
    return text_width(words, size, weight)


def text_width(words: str, size: int, weight: int = 400) -> int:
    """Width of a line of text, px."""
    face = _face()
    if face is None:
        thickness = 2 if weight > 500 else 1
        return int(cv2.getTextSize(_ascii(words), cv2.FONT_HERSHEY_SIMPLEX, size / HERSHEY_PX, thickness)[0][0])
    return int(cv2.getTextSize((0, 0), words, (0, 0), face, size, weight)[2])


def centred(image: Image, words: str, at: tuple[float, float], size: int, colour: Colour, weight: int = 400) -> None:
    """Write a line of text whose baseline's middle is `at`."""
    text(image, words, (at[0] - text_width(words, size, weight) / 2, at[1]), size, colour, weight)


def shortened(words: str, size: int, width: int, weight: int = 400) -> str:
    """The text, its end replaced by an ellipsis where it is wider than `width` px."""
    if text_width(words, size, weight) <= width:
        return words
    while words and text_width(f"{words}…", size, weight) > width:
        words = words[:-1]
    return f"{words.rstrip()}…"


def wrapped(words: str, size: int, width: int, lines: int) -> list[str]:
    """The text broken between words into at most `lines` lines of `width` px; what does not fit ends in an ellipsis."""
    rows = [""]
    for word in words.split():
        longer = f"{rows[-1]} {word}".strip()
        if not rows[-1] or text_width(longer, size) <= width or len(rows) == lines:
            rows[-1] = longer
        else:
            rows.append(word)
    return [shortened(row, size, width) for row in rows]


def segment(image: Image, ends: ArrayLike, colour: Colour, width: int, halo: int = 2) -> None:
    """A line between two points (2, 2) px, on a dark halo that keeps it visible on bright haze."""
    start, end = _fixed(ends)
    if halo:
        cv2.line(image, start, end, (0, 0, 0), width + halo, cv2.LINE_AA, SHIFT)
    cv2.line(image, start, end, colour, width, cv2.LINE_AA, SHIFT)


def dashed(image: Image, ends: ArrayLike, colour: Colour, width: int, dash_px: float = 12.0) -> None:
    """A dashed line between two points (2, 2) px; the gaps are two thirds of a dash."""
    start, end = np.asarray(ends, dtype=np.float64)
    length = float(np.linalg.norm(end - start))
    for from_px in np.arange(0.0, length, dash_px * 5 / 3):
        to_px = min(from_px + dash_px, length)
        segment(image, [start + (end - start) * s / length for s in (from_px, to_px)], colour, width)


def dot(image: Image, at: ArrayLike, radius: float, colour: Colour, filled: bool = True, rim: bool = True) -> None:
    """A round point, with a dark rim that keeps it visible on bright haze; or a thin ring."""
    (centre,) = _fixed(np.asarray(at)[None])
    scaled = round(radius * (1 << SHIFT))
    if filled and rim:
        cv2.circle(image, centre, scaled + (1 << SHIFT), (0, 0, 0), -1, cv2.LINE_AA, SHIFT)
    cv2.circle(image, centre, scaled, colour, -1 if filled else 1, cv2.LINE_AA, SHIFT)


def box(image: Image, corner: tuple[int, int], size: tuple[int, int], colour: Colour, radius: int = 6) -> None:
    """A filled rectangle with round corners."""
    (x0, y0), (x1, y1) = corner, (corner[0] + size[0] - 1, corner[1] + size[1] - 1)
    cv2.rectangle(image, (x0 + radius, y0), (x1 - radius, y1), colour, -1)
    cv2.rectangle(image, (x0, y0 + radius), (x1, y1 - radius), colour, -1)
    for x in (x0 + radius, x1 - radius):
        for y in (y0 + radius, y1 - radius):
            cv2.circle(image, (x, y), radius, colour, -1, cv2.LINE_AA)


def tag(image: Image, words: str, corner: tuple[int, int], size: int, colour: Colour, ink: Colour) -> int:
    """A small label: text on a filled box whose top left corner is given; returns its width, px."""
    width = text_width(words, size, 600) + size
    box(image, corner, (width, round(size * 1.7)), colour, 4)
    text(image, words, (corner[0] + size / 2, corner[1] + size * 1.2), size, ink, 600)
    return width


def _fixed(points: ArrayLike) -> list[tuple[int, int]]:
    """Pixels as OpenCV's fixed-point numbers, kept far inside its 16-bit drawing range."""
    scaled = np.clip(np.asarray(points, dtype=np.float64), -3000, 6000) * (1 << SHIFT)
    return [(int(u), int(v)) for u, v in np.rint(scaled)]


def _face() -> Any:
    """OpenCV 5's outline font; None with OpenCV 4, which has stroke fonts only."""
    return cv2.FontFace("sans") if hasattr(cv2, "FontFace") else None


def _ascii(words: str) -> str:
    for sign, plain in ASCII.items():
        words = words.replace(sign, plain)
    return words.encode("ascii", "replace").decode()
