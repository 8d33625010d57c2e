"""Image files to RGB uint8, depth files to metres, and back. A file that is cut short is an error, never half an image.

PFM as AirSim writes it holds its rows from top to bottom; the format's own definition is bottom to top. Nothing in
the file distinguishes them, so the caller states the order (`pfm_rows`).
Source: Debevec, "PFM Portable FloatMap Image Format" (header and byte order); AirSim, "Image APIs" (depth types).
"""

import io
import re
import struct
import warnings
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Literal

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from deckline.files import check_size, read_regular
from deckline.geometry import Camera

FORMATS = ("PNG", "JPEG", "PPM", "BMP", "TIFF", "WEBP")
JPEG_QUALITY = 90  # of written pictures
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".bmp", ".tif", ".tiff", ".webp")
LOW_BITS = 12  # of camera pixels that a 16-bit file holds unscaled, when the file does not state their number
# What Pillow raises for damaged files
DAMAGED = (OSError, SyntaxError, ValueError, TypeError, LookupError, EOFError, OverflowError, struct.error)
PfmRows = Literal["top-to-bottom", "bottom-to-top"]
FAR_DEPTH_M = 65504.0  # largest half-precision number: AirSim's depth where nothing is seen
DEPTH_PLANAR, DEPTH_PERSPECTIVE = 1, 2  # AirSim's image types: along the axis, along each pixel's ray
_PFM_HEADER = re.compile(rb"P([fF])\s+(\d{1,9})\s+(\d{1,9})\s+([-+0-9.eE]{1,40})\s")


def read_image(path: Path) -> NDArray[np.uint8]:
    """Any supported image file -> RGB uint8 (H, W, 3).

    An EXIF orientation is applied, so intrinsics belong to the upright image. Grey images are repeated over the
    channels, transparency is dropped. 16-bit PNG and TIFF files are scaled from 0..65535 to 0..255. Many cameras store
    12-bit pixels without scaling them: a file whose largest value is below 4096 is scaled from 0..4095 instead. A PNG
    may state another number of significant bits in its sBIT chunk; sBIT 16 always means 0..65535.

    Raises:
        ValueError: missing, cut short, damaged, or no image; states which.
    """
    return decode_image(read_bytes(path, "image"))


def decode_image(data: bytes) -> NDArray[np.uint8]:
    """The bytes of an image file as `read_image` reads them; errors as there."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # odd metadata do not harm the pixels
            return _decode(data)
    except Image.UnidentifiedImageError:
        raise ValueError(f"not an image of a known format ({', '.join(FORMATS)}), or cut short") from None
    except (*DAMAGED, Image.DecompressionBombError, cv2.error) as error:
        raise ValueError(f"damaged or cut short: {' '.join(str(error).split())}") from None


def _decode(data: bytes) -> NDArray[np.uint8]:
    image = Image.open(io.BytesIO(data), formats=FORMATS)
    check_size(*image.size)  # only its header is read
    if image.format == "PNG":
        image.verify()  # checksums of all chunks; the image must be opened again after it
        image = Image.open(io.BytesIO(data), formats=FORMATS)
    if image.format in ("JPEG", "MPO"):
        _check_jpeg(data)
    sixteen_bits = image.format in ("PNG", "TIFF") and ";16" in str(image.tile[0].args)  # such as "RGB;16B"
    image.load()
    if sixteen_bits:
        return _scale_16_bits(data)
    if image.mode == "F":
        raise ValueError("an image must have 8 or 16 bits a channel, got 32-bit numbers")
    if image.mode.startswith("I"):  # a PGM with more than 8 bits, scaled by Pillow to 0..65535
        grey = np.rint(np.asarray(image) / 257.0).astype(np.uint8)
        return np.repeat(grey[:, :, None], 3, axis=2)
    ImageOps.exif_transpose(image, in_place=True)
    return np.array(image.convert("RGB"))


def _check_jpeg(data: bytes) -> None:
    """Raise ValueError for damaged data: Pillow fills with grey what it cannot decode, without an error."""
    decoder = av.CodecContext.create("mjpeg", "r")
    decoder.options = {"err_detect": "explode"}
    with suppress(av.error.PatchWelcomeError):  # a kind of JPEG that FFmpeg does not know
        decoder.decode(av.Packet(data))


def _scale_16_bits(data: bytes) -> NDArray[np.uint8]:
    """Pillow reads only the upper 8 bits of 16-bit colours, so OpenCV decodes them; it applies the orientation too."""
    values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if values is None:
        raise ValueError("OpenCV cannot decode it")
    chunk = data.find(b"sBIT", 0, max(data.find(b"IDAT"), 0))
    bits = LOW_BITS if chunk < 0 else max(data[chunk + 4 : chunk + 4 + int.from_bytes(data[chunk - 4 : chunk])])
    largest = (1 << bits) - 1
    scale = 65535.0 if values.max() > largest else float(largest)
    return np.rint(values[:, :, ::-1] * (255.0 / scale)).astype(np.uint8)


def encode_image(image_rgb: NDArray[np.uint8], image_format: str, jpeg_quality: int = JPEG_QUALITY) -> bytes:
    """RGB uint8 (H, W, 3) -> bytes of a "png", "ppm" or "jpg" file; a ValueError for an image that has none."""
    if image_format == "ppm":
        height, width = image_rgb.shape[:2]
        return b"P6\n%d %d\n255\n" % (width, height) + np.ascontiguousarray(image_rgb).tobytes()
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if image_format in ("jpg", "jpeg") else []
    done, buffer = cv2.imencode(f".{image_format}", image_rgb[:, :, ::-1], options)
    if not done:
        raise ValueError(f"OpenCV could not encode an image of shape {image_rgb.shape}")
    return buffer.tobytes()


def read_bytes(path: Path, what: str) -> bytes:
    """All of a file; a ValueError for a missing, unreadable or empty one begins with `what`."""
    try:
        data = read_regular(path)
    except FileNotFoundError:
        raise ValueError(f"{what} is missing: {path}") from None
    except OSError as error:
        raise ValueError(f"{what} cannot be read: {path}: {error.strerror or error}") from None
    if not data:
        raise ValueError(f"{what} is an empty file: {path}")
    return data


def read_depth(
    path: Path, name: str, camera: Camera, depth_type: int, rows: PfmRows, far_m: float
) -> NDArray[np.float32]:
    """PFM depth file -> depth (H, W) along the optical axis, metres, NaN where nothing was seen.

    Args:
        name: of the file, in error messages.
        camera: of the image that it belongs to.
        depth_type, far_m: see `convert_to_axial_depth`.
        rows: order of the rows in the file.

    Raises:
        ValueError: missing, cut short, no one-channel PFM, or of another size than the image; states which.
    """
    data = read_bytes(path, "depth map")
    try:
        stored = read_pfm(data, rows)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    check_depth_size(stored.shape, camera, name)
    return convert_to_axial_depth(stored, camera, depth_type, far_m)


def read_pfm(data: bytes, rows: PfmRows = "top-to-bottom") -> NDArray[np.float32]:
    """One-channel PFM -> float32 (H, W), first row on top; a ValueError for other files, cut short or scaled ones."""
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


def encode_depth(depth_m: NDArray[np.float32]) -> bytes:
    """Depth (H, W), metres, NaN where nothing was seen -> bytes of a little-endian one-channel PFM, as AirSim's."""
    height, width = depth_m.shape
    stored = np.nan_to_num(depth_m, nan=FAR_DEPTH_M, posinf=FAR_DEPTH_M)
    return b"Pf\n%d %d\n-1\n" % (width, height) + np.ascontiguousarray(stored, dtype="<f4").tobytes()


def convert_to_axial_depth(
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
    return depth / _ray_lengths(camera)


_ray_lengths = lru_cache(maxsize=4)(Camera.ray_lengths)


def check_depth_size(shape: tuple[int, ...], camera: Camera, name: str) -> None:
    """Raises ValueError when a depth map has another size than its image."""
    if tuple(shape) != (camera.height, camera.width):
        raise ValueError(
            f"depth {name} is {shape[1]}x{shape[0]} px but the image is {camera.width}x{camera.height} px; "
            f"record both at one size"
        )
