"""Many frames in one picture, to look at."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deckline.types import Frame

LEFT_RGB, RIGHT_RGB = (255, 0, 0), (0, 255, 0)
DOTS = 240  # of each true line: close views show a tenth of it


def contact_sheet(frames: Sequence[Frame], columns: int, with_truth: bool = False) -> NDArray[np.uint8]:
    """Frames of one size side by side, (rows * H, columns * W, 3); with the true lines dotted red and green.

    Raises:
        ValueError: no frames, fewer than one column, or frames of different sizes.
    """
    return join_tiles([sheet_tile(frame, with_truth=with_truth) for frame in frames], columns)


def join_tiles(tiles: Sequence[NDArray[np.uint8]], columns: int) -> NDArray[np.uint8]:
    """Pictures of one size (H, W, 3) row by row, (rows * H, columns * W, 3); what is left over stays black.

    Raises:
        ValueError: no pictures, fewer than one column, or pictures of different sizes.
    """
    if not tiles or columns < 1:
        raise ValueError(f"a sheet needs frames and columns, got {len(tiles)} frames and {columns} columns")
    shapes = {tile.shape for tile in tiles}
    if len(shapes) > 1:
        raise ValueError(f"frames of a sheet must be of one size, got {sorted(shapes)}")
    height, width, _ = tiles[0].shape
    rows = -(-len(tiles) // columns)
    sheet = np.zeros((rows * height, columns * width, 3), dtype=np.uint8)
    for k, tile in enumerate(tiles):
        top, left = (k // columns) * height, (k % columns) * width
        sheet[top : top + height, left : left + width] = tile
    return sheet


def sheet_tile(frame: Frame, width_px: int | None = None, with_truth: bool = False) -> NDArray[np.uint8]:
    """A frame's image, shrunk to a width when it is wider, with its true lines dotted if asked for.

    Raises:
        ValueError: a width below 1.
        ImportError: shrinking needs OpenCV.
    """
    if width_px is not None and width_px < 1:
        raise ValueError(f"the width of a tile must be at least 1 px, got {width_px}")
    image = frame.image_rgb.copy()
    if width_px is not None and width_px < frame.camera.width:
        import cv2

        height_px = max(1, round(frame.camera.height * width_px / frame.camera.width))
        image = np.asarray(cv2.resize(image, (width_px, height_px), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if with_truth:
        _dot_lines(frame, image)
    return image


def _dot_lines(frame: Frame, image: NDArray[np.uint8]) -> None:
    """Draw the true lines into an image of the frame, whatever its size."""
    if frame.truth is None or frame.true_world_from_camera is None:
        return
    camera_from_world = frame.true_world_from_camera.inv()
    height, width, _ = image.shape
    scale = [width / frame.camera.width, height / frame.camera.height]
    steps = np.linspace(0.0, 1.0, DOTS)[:, None]
    for segment, colour in ((frame.truth.left, LEFT_RGB), (frame.truth.right, RIGHT_RGB)):
        if segment is None:
            continue
        points = segment.p0_m + steps * (segment.p1_m - segment.p0_m)
        pixels = (frame.camera.project(camera_from_world.apply(points)) + 0.5) * scale - 0.5
        pixels = pixels[np.all(np.isfinite(pixels), axis=1)]
        inside = np.all((pixels >= 0) & (pixels < [width - 0.5, height - 0.5]), axis=1)
        u, v = np.rint(pixels[inside]).astype(int).T
        image[v, u] = colour
