"""The focal length that a photograph's EXIF states.

The 35 mm equivalent gives the same field of view across the diagonal as a film of 36 x 24 mm. With the diagonal of a
picture in px, f_px = f_35 diagonal / 43.27 mm, in either orientation; of 3:2 pictures the horizontal field of view is
2 atan(18 mm / f_35).
Source: CIPA DC-008 (EXIF 2.32), tags FocalLengthIn35mmFilm, PixelXDimension, PixelYDimension; CIPA DCG-001.
"""

import io
import math
import warnings
from pathlib import Path

from PIL import Image

from deckline.geometry import Camera
from deckline.recording.images import DAMAGED, FORMATS, read_bytes

EXIF_IFD, FOCAL_35_MM, PIXEL_X, PIXEL_Y = 0x8769, 41989, 40962, 40963  # tags
FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
FOCAL_RANGE_MM = (10.0, 2000.0)  # shorter ones are fisheyes, which are no pinholes; longer ones do not exist
EXIF_FOCAL_SIGMA = 0.05  # share: whole millimetres (2 % at 26 mm), the lens's correction and focus breathing
MAX_CROP = 0.02  # by which the picture's shape may differ from the stated one


def camera_from_exif(path: Path, width: int, height: int) -> tuple[Camera | None, str]:
    """The pinhole that a picture's EXIF states, and what it states, for people.

    Args:
        width, height: of the upright picture, px.

    Returns:
        None with an empty text without a 35 mm equivalent, with the reason for one that is not used.
    """
    try:
        focal_mm, stated = _read_tags(path)
    except DAMAGED:
        return None, "EXIF is damaged and not used"
    if focal_mm is None:
        return None, ""
    if not FOCAL_RANGE_MM[0] <= focal_mm <= FOCAL_RANGE_MM[1]:  # 0: the standard's "unknown"
        return None, f"EXIF states a 35 mm equivalent of {focal_mm:g} mm, which is not used"
    if stated is not None and abs(_long_side(*stated) / _long_side(width, height) - 1.0) > MAX_CROP:
        return None, f"EXIF is of {stated[0]}x{stated[1]} px, the picture is cropped to {width}x{height} px: not used"
    focal_px = focal_mm * math.hypot(width, height) / FILM_DIAGONAL_MM
    middle = (width - 1) / 2.0, (height - 1) / 2.0
    camera = Camera(width, height, focal_px, focal_px, *middle, focal_sigma=EXIF_FOCAL_SIGMA)
    return camera, f"of EXIF, {focal_mm:g} mm equivalent"


def _read_tags(path: Path) -> tuple[float | None, tuple[int, int] | None]:
    """The 35 mm equivalent, mm, and the stated width and height, px."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", UserWarning)  # Pillow only warns of EXIF that is cut short
        try:
            tags = Image.open(io.BytesIO(read_bytes(path, "image")), formats=FORMATS).getexif().get_ifd(EXIF_IFD)
        except UserWarning as warning:
            raise ValueError(str(warning)) from None
    focal = tags.get(FOCAL_35_MM)
    sides = tags.get(PIXEL_X), tags.get(PIXEL_Y)
    size = tuple(int(side) for side in sides if side)
    return None if focal is None else float(focal), (size[0], size[1]) if len(size) == 2 else None


def _long_side(width: int, height: int) -> float:
    """Long over short side."""
    return max(width, height) / min(width, height)
