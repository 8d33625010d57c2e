"""Decoded pictures as a player shows them: pixels made square, turned upright as the file's metadata state.

Phones store pictures as the sensor reads them, with a matrix that turns them; analogue and anamorphic video has pixels
that are wider than high. The chain takes a picture's rows for horizontal and its pixels for square.
Source: ISO/IEC 14496-12, 8.5.2 (matrix of a track); ITU-T H.264, E.2.1 (sample aspect ratio).
"""

from typing import Any

import numpy as np
from av.sidedata.sidedata import Type
from numpy.typing import NDArray

from deckline.files import check_size

ONE = 1 << 16  # of the matrix's fixed-point numbers
TILT = 0.01  # rad, from a quarter turn; fixed-point numbers round
Turn = tuple[bool, bool, bool]  # whether rows become columns; then, whether the order of rows, of columns is reversed
UPRIGHT: Turn = (False, False, False)


def read_pixel_aspect(stream: Any) -> float:
    """Width over height of a video stream's pixels; 1 where it states none."""
    stated = stream.sample_aspect_ratio or stream.codec_context.sample_aspect_ratio
    return float(stated) if stated else 1.0


def square_size(width: int, height: int, pixel_aspect: float) -> tuple[int, int]:
    """Width and height, px, of a picture whose pixels are made square; neither becomes smaller.

    Raises:
        ValueError: more pixels than a picture may have.
    """
    size = round(width * max(pixel_aspect, 1.0)), round(height / min(pixel_aspect, 1.0))
    check_size(*size)
    return size


def read_upright(picture: Any, pixel_aspect: float) -> NDArray[np.uint8]:
    """RGB (H, W, 3) of a decoded picture (av.VideoFrame) with square pixels, turned upright.

    Raises:
        ValueError: metadata that turn it by no quarter turns, or too many pixels.
    """
    width, height = square_size(picture.width, picture.height, pixel_aspect)
    image = picture.to_ndarray(format="rgb24", width=width, height=height)
    transposed, rows_reversed, columns_reversed = read_turn(picture)
    turned = image.swapaxes(0, 1) if transposed else image
    return np.ascontiguousarray(turned[:: -1 if rows_reversed else 1, :: -1 if columns_reversed else 1])


def upright_size(picture: Any, pixel_aspect: float) -> tuple[int, int]:
    """Width and height of `read_upright`'s picture, px; raises as it does."""
    width, height = square_size(picture.width, picture.height, pixel_aspect)
    return (height, width) if read_turn(picture)[0] else (width, height)


def read_turn(picture: Any) -> Turn:
    """How a decoded picture's metadata turn it upright.

    Raises:
        ValueError: by no quarter turns.
    """
    matrix = picture.side_data.get(Type.DISPLAYMATRIX)
    # u' = a u + c v, v' = b u + d v; a matrix of zeros turns nothing
    a, b, _, c, d = np.zeros(5) if matrix is None else np.frombuffer(bytes(matrix), np.int32)[:5] / ONE
    if not np.any([a, b, c, d]):
        return UPRIGHT
    if np.abs([b, c]).max() < TILT * np.abs([a, d]).min():
        return False, bool(d < 0), bool(a < 0)
    if np.abs([a, d]).max() < TILT * np.abs([b, c]).min():
        return True, bool(b < 0), bool(c < 0)
    turn_deg = np.degrees(np.arctan2(c, a))
    raise ValueError(f"its metadata turn it by {turn_deg:.0f} degrees; quarter turns alone are read")
