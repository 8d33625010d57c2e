"""PPM, PGM and PFM files with numpy alone.

PFM as AirSim writes it holds its rows from top to bottom; the format's own definition says bottom to top.
Nothing in the file tells them apart, so the reader is told (`pfm_rows`).
"""

import re
from typing import Literal

import numpy as np
from numpy.typing import NDArray

PfmRows = Literal["top-to-bottom", "bottom-to-top"]
FAR_DEPTH_M = 65504.0  # largest half-precision number: AirSim's depth where nothing is seen (SPEC section 5)

_SPACE = rb"(?:\s|#[^\n]*\n)+"  # white space and comments between header fields
_PNM_HEADER = re.compile(rb"P([56])" + _SPACE + rb"(\d{1,9})" + _SPACE + rb"(\d{1,9})" + _SPACE + rb"(\d{1,9})\s")
_PFM_HEADER = re.compile(rb"P([fF])\s+(\d{1,9})\s+(\d{1,9})\s+([-+0-9.eE]{1,40})\s")


def read_ppm(data: bytes) -> NDArray[np.uint8]:
    """Binary PPM (P6) or PGM (P5), 8 or 16 bits -> RGB uint8 (H, W, 3), rescaled to 0..255.

    Raises:
        ValueError: not such a file, or cut short.
    """
    header = _PNM_HEADER.match(data)
    if header is None:
        raise ValueError("not a binary PPM or PGM file (P6 or P5)")
    channels = 3 if header[1] == b"6" else 1
    width, height, maximum = (int(number) for number in header.groups()[1:])
    if not 0 < maximum < 65536:
        raise ValueError(f"PPM maximum must be 1 to 65535, got {maximum}")
    dtype = np.dtype(np.uint8 if maximum < 256 else ">u2")
    values = _pixels(data, header.end(), dtype, (height, width, channels))
    if maximum != 255:
        scaled = np.rint(np.minimum(values, maximum) * (255.0 / maximum))
        values = scaled.astype(np.uint8)
    return np.array(np.broadcast_to(values, (height, width, 3)), dtype=np.uint8)


def write_ppm(image_rgb: NDArray[np.uint8]) -> bytes:
    """RGB uint8 (H, W, 3) -> bytes of a binary PPM."""
    height, width = image_rgb.shape[:2]
    return b"P6\n%d %d\n255\n" % (width, height) + np.ascontiguousarray(image_rgb).tobytes()


def read_pfm(data: bytes, rows: PfmRows = "top-to-bottom") -> NDArray[np.float32]:
    """One-channel PFM -> float32 (H, W), first row on top.

    Args:
        rows: order of the rows in the file; AirSim's is top to bottom.

    Raises:
        ValueError: not such a file, cut short, or scaled.
    """
    header = _PFM_HEADER.match(data)
    if header is None:
        raise ValueError("not a PFM file (Pf)")
    if header[1] == b"F":
        raise ValueError("a colour PFM (PF), expected one channel (Pf)")
    width, height = int(header[2]), int(header[3])
    try:
        scale = float(header[4])
    except ValueError:
        raise ValueError(f"PFM scale is no number: {header[4].decode()!r}") from None
    if abs(scale) != 1.0:
        raise ValueError(f"PFM scale must be -1 (little endian) or 1 (big endian), got {scale:g}")
    values = _pixels(data, header.end(), np.dtype("<f4" if scale < 0 else ">f4"), (height, width))
    return np.array(values if rows == "top-to-bottom" else values[::-1], dtype=np.float32)


def write_pfm(values: NDArray[np.float32], rows: PfmRows = "top-to-bottom") -> bytes:
    """float32 (H, W) -> bytes of a little-endian one-channel PFM, by default in AirSim's row order."""
    height, width = values.shape
    ordered = values if rows == "top-to-bottom" else values[::-1]
    return b"Pf\n%d %d\n-1\n" % (width, height) + np.ascontiguousarray(ordered, dtype="<f4").tobytes()


def _pixels(data: bytes, start: int, dtype: np.dtype, shape: tuple[int, ...]) -> NDArray:
    expected = int(np.prod([int(size) for size in shape], dtype=object)) * dtype.itemsize
    if expected == 0:
        raise ValueError(f"image of {shape[1]}x{shape[0]} px has no pixels")
    if len(data) - start < expected:
        raise ValueError(f"cut short: {len(data) - start} of {expected} bytes of pixels are there")
    return np.frombuffer(data, dtype, count=expected // dtype.itemsize, offset=start).reshape(shape)
