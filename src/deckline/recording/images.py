"""Image files to RGB uint8 and back. A file that is cut short is an error, never a half-grey image.

Image files hold R, G, B; only the raw bytes of AirSim's RPC are B, G, R, and OpenCV's arrays are: both orders are
turned at the edge. OpenCV is imported only for formats other than PPM, so that recordings in PPM need numpy alone.
"""

import re
import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline.recording.netpbm import PfmRows, read_pfm, read_ppm, write_ppm

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".bmp", ".tif", ".tiff")
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# In JPEG's compressed data 0xff is followed by 0 (a data byte) or 0xd0..0xd7 (restart); anything else is a marker.
_JPEG_MARKER = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")


def read_image(path: Path) -> NDArray[np.uint8]:
    """Any supported image file -> RGB uint8 (H, W, 3).

    Grey images are repeated over the channels, 16-bit ones scaled from 0..65535 to 0..255, transparency is dropped,
    and an orientation tag is ignored: intrinsics belong to the pixels as the camera stored them.

    Raises:
        ValueError: missing, cut short, damaged, or no image; says which.
    """
    data = read_bytes(path, "image")
    if data[:2] in (b"P5", b"P6"):
        return read_ppm(data)
    _check_whole(data)
    return _decode(data)


def read_depth_pfm(path: Path, rows: PfmRows) -> NDArray[np.float32]:
    """PFM depth file -> float32 (H, W), as stored.

    Raises:
        ValueError: missing, cut short, or no one-channel PFM; says which.
    """
    return read_pfm(read_bytes(path, "depth map"), rows)


def encode_image(image_rgb: NDArray[np.uint8], image_format: str) -> bytes:
    """RGB uint8 (H, W, 3) -> bytes of a "png" or "ppm" file."""
    if image_format == "ppm":
        return write_ppm(image_rgb)
    import cv2

    done, buffer = cv2.imencode(".png", image_rgb[:, :, ::-1])
    if not done:
        raise ValueError(f"OpenCV could not encode an image of shape {image_rgb.shape}")
    return buffer.tobytes()


def read_bytes(path: Path, what: str) -> bytes:
    """All of a file.

    Raises:
        ValueError: missing, unreadable or empty.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise ValueError(f"{what} is missing: {path}") from None
    except OSError as error:
        raise ValueError(f"{what} cannot be read: {path}: {error.strerror or error}") from None
    if not data:
        raise ValueError(f"{what} is an empty file: {path}")
    return data


def _check_whole(data: bytes) -> None:
    """Raises ValueError unless the file ends where its format says."""
    if data.startswith(PNG_SIGNATURE):
        _check_png(data)
    elif data.startswith(b"\xff\xd8"):
        _check_jpeg(data)
    elif data.startswith(b"BM"):
        size = struct.unpack_from("<I", data, 2)[0] if len(data) >= 6 else 6
        if len(data) < size:
            raise ValueError(f"BMP cut short: {len(data)} of {size} bytes are there")
    elif not data.startswith((b"II*\x00", b"MM\x00*")):
        raise ValueError("not an image of a known format (PNG, JPEG, PPM, PGM, BMP, TIFF)")


def _check_png(data: bytes) -> None:
    position = len(PNG_SIGNATURE)
    while position + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, position)
        end = position + 12 + length
        if end > len(data):
            break
        stored = struct.unpack_from(">I", data, end - 4)[0]
        if zlib.crc32(memoryview(data)[position + 4 : end - 4]) != stored:
            raise ValueError(f"damaged PNG: wrong checksum in its {kind.decode('latin-1')!r} chunk at byte {position}")
        if kind == b"IEND":
            return
        position = end
    raise ValueError(f"PNG cut short: it ends after {len(data)} bytes without its closing IEND chunk")


def _check_jpeg(data: bytes) -> None:
    position = 2
    while position + 4 <= len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker == 0xD9:
            return
        if marker == 0xFF:  # fill byte
            position += 1
            continue
        position += 2 + struct.unpack_from(">H", data, position + 2)[0]
        if marker == 0xDA:  # start of scan: compressed data follows
            found = _JPEG_MARKER.search(data, position)
            if found is None:
                break
            position = found.start()
    if data[position : position + 2] == b"\xff\xd9":
        return
    raise ValueError(f"JPEG cut short: it ends after {len(data)} bytes without its end marker")


def _decode(data: bytes) -> NDArray[np.uint8]:
    import cv2

    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError(f"image cannot be decoded: {error.err}") from None
    if image is None:
        raise ValueError("image cannot be decoded: its data are damaged or of an unsupported kind")
    if image.dtype == np.uint16:
        image = np.rint(image / 257.0).astype(np.uint8)
    if image.dtype != np.uint8:
        raise ValueError(f"image must have 8 or 16 bits a channel, got {image.dtype}")
    if image.ndim == 2 or image.shape[2] < 3:  # grey, or grey with transparency
        grey = image.reshape(*image.shape[:2], -1)[:, :, :1]
        return np.repeat(grey, 3, axis=2)
    return np.ascontiguousarray(image[:, :, 2::-1])
