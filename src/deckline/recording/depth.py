"""Depth files (PFM) to metres along the optical axis.

PFM as AirSim writes it holds its rows from top to bottom; the format's own definition says bottom to top. Nothing in
the file tells them apart, so the reader says which (`pfm_rows`).
Source: Debevec, "PFM Portable FloatMap Image Format" (header and byte order); AirSim, "Image APIs" (depth types).
"""

import re
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import Camera
from deckline.recording.images import read_bytes

PfmRows = Literal["top-to-bottom", "bottom-to-top"]
FAR_DEPTH_M = 65504.0  # largest half-precision number: AirSim's depth where nothing is seen
DEPTH_PLANAR, DEPTH_PERSPECTIVE = 1, 2  # AirSim's image types: along the axis, along each pixel's ray
_PFM_HEADER = re.compile(rb"P([fF])\s+(\d{1,9})\s+(\d{1,9})\s+([-+0-9.eE]{1,40})\s")


def read_depth(
    path: Path,
    name: str,
    camera: Camera,
    depth_type: int = DEPTH_PLANAR,
    rows: PfmRows = "top-to-bottom",
    far_m: float = FAR_DEPTH_M,
) -> NDArray[np.float32]:
    """PFM depth file -> depth (H, W) along the optical axis, metres, NaN where nothing was seen.

    Args:
        name: of the file, in error messages.
        camera: of the image that it belongs to.
        depth_type, far_m: see `along_axis`.
        rows: order of the rows in the file.

    Raises:
        ValueError: missing, cut short, no one-channel PFM, or of another size than the image; says which.
    """
    stored = read_pfm(read_bytes(path, "depth map"), rows)
    check_depth_size(stored.shape, camera, name)
    return along_axis(stored, camera, depth_type, far_m)


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
    count, there = width * height, len(data) - header.end()
    if not 0 < 4 * count <= there:
        raise ValueError(f"PFM of {width}x{height} px cut short: {there} of {4 * count} bytes of pixels are there")
    values = np.frombuffer(data, "<f4" if scale < 0 else ">f4", count, header.end()).reshape(height, width)
    return np.array(values if rows == "top-to-bottom" else values[::-1], dtype=np.float32)


def write_pfm(values: NDArray[np.float32]) -> bytes:
    """float32 (H, W) -> bytes of a little-endian one-channel PFM in AirSim's row order, top to bottom."""
    height, width = values.shape
    return b"Pf\n%d %d\n-1\n" % (width, height) + np.ascontiguousarray(values, dtype="<f4").tobytes()


def along_axis(
    stored: NDArray[np.float32], camera: Camera, depth_type: int, far_m: float = FAR_DEPTH_M
) -> NDArray[np.float32]:
    """Stored depth (H, W) -> depth along the optical axis, metres, NaN where nothing was seen.

    Args:
        depth_type: DEPTH_PLANAR, or DEPTH_PERSPECTIVE for lengths along each pixel's ray.
        far_m: stored values from here on, and those that are not positive and finite, become NaN.
    """
    with np.errstate(invalid="ignore"):
        seen = (stored > 0) & (stored < far_m)
    depth: NDArray[np.float32] = np.where(seen, stored, np.float32(np.nan))
    if depth_type == DEPTH_PLANAR:
        return depth
    intrinsics = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    return depth / _ray_lengths(*intrinsics, tuple(camera.distortion))


@lru_cache(maxsize=4)
def _ray_lengths(*intrinsics) -> NDArray[np.float32]:
    """Cached by value: a recording makes a new Camera for each frame."""
    return Camera(*intrinsics).ray_lengths()


def check_depth_size(shape: tuple[int, ...], camera: Camera, name: str) -> None:
    """Raises ValueError when a depth map has another size than its image."""
    if tuple(shape) != (camera.height, camera.width):
        raise ValueError(
            f"depth {name} is {shape[1]}x{shape[0]} px but the image is {camera.width}x{camera.height} px; "
            f"record both at one size"
        )
