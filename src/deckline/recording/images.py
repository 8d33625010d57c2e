"""Image files to RGB uint8 and back. A file that is cut short is an error, never a half-grey image."""

import io
import struct
import warnings
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

FORMATS = ("PNG", "JPEG", "PPM", "BMP", "TIFF", "WEBP")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".bmp", ".tif", ".tiff", ".webp")
LOW_BITS = 12  # of camera pixels that a 16-bit file holds unscaled, when the file does not say how many there are
# What Pillow raises for damaged files
_DAMAGED = (OSError, SyntaxError, ValueError, TypeError, LookupError, EOFError, OverflowError, struct.error)


def read_image(path: Path) -> NDArray[np.uint8]:
    """Any supported image file -> RGB uint8 (H, W, 3).

    An EXIF orientation is applied, so intrinsics belong to the upright image. Grey images are repeated over the
    channels, transparency is dropped. 16-bit PNG and TIFF files are scaled from 0..65535 to 0..255. Many cameras store
    12-bit pixels without scaling them: a file whose largest value is below 4096 is scaled from 0..4095 instead. A PNG
    may state another number of significant bits in its sBIT chunk; sBIT 16 always means 0..65535.

    Raises:
        ValueError: missing, cut short, damaged, or no image; says which.
    """
    data = read_bytes(path, "image")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # odd metadata do not harm the pixels
            return _decode(data)
    except Image.UnidentifiedImageError:
        raise ValueError(f"not an image of a known format ({', '.join(FORMATS)}), or cut short") from None
    except (*_DAMAGED, Image.DecompressionBombError, cv2.error) as error:
        raise ValueError(f"damaged or cut short: {' '.join(str(error).split())}") from None


def _decode(data: bytes) -> NDArray[np.uint8]:
    image = Image.open(io.BytesIO(data), formats=FORMATS)
    if image.format == "PNG":
        image.verify()  # checksums of all chunks; the image must be opened again after it
        image = Image.open(io.BytesIO(data), formats=FORMATS)
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


def _scale_16_bits(data: bytes) -> NDArray[np.uint8]:
    """Pillow keeps only the upper 8 bits of 16-bit colours, so OpenCV decodes them; it applies the orientation too."""
    values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if values is None:
        raise ValueError("OpenCV cannot decode it")
    chunk = data.find(b"sBIT", 0, max(data.find(b"IDAT"), 0))
    bits = LOW_BITS if chunk < 0 else max(data[chunk + 4 : chunk + 4 + int.from_bytes(data[chunk - 4 : chunk])])
    largest = (1 << bits) - 1
    scale = 65535.0 if values.max() > largest else float(largest)
    return np.rint(values[:, :, ::-1] * (255.0 / scale)).astype(np.uint8)


def encode_image(image_rgb: NDArray[np.uint8], image_format: str) -> bytes:
    """RGB uint8 (H, W, 3) -> bytes of a "png" or "ppm" file."""
    if image_format == "ppm":
        height, width = image_rgb.shape[:2]
        return b"P6\n%d %d\n255\n" % (width, height) + np.ascontiguousarray(image_rgb).tobytes()
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
