"""Many frames in one picture, to look at."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deckline.types import Frame


def contact_sheet(frames: Sequence[Frame], columns: int, with_truth: bool = False) -> NDArray[np.uint8]:
    """Frames of one size side by side, (rows * H, columns * W, 3); with the true lines dotted red and green.

    Raises:
        ValueError: no frames, fewer than one column, or frames of different sizes.
    """
    if not frames or columns < 1:
        raise ValueError(f"a sheet needs frames and columns, got {len(frames)} frames and {columns} columns")
    shapes = {frame.image_rgb.shape for frame in frames}
    if len(shapes) > 1:
        raise ValueError(f"frames of a sheet must be of one size, got {sorted(shapes)}")
    height, width, _ = frames[0].image_rgb.shape
    rows = -(-len(frames) // columns)
    sheet = np.zeros((rows * height, columns * width, 3), dtype=np.uint8)
    for k, frame in enumerate(frames):
        tile = _with_truth(frame) if with_truth else frame.image_rgb
        top, left = (k // columns) * height, (k % columns) * width
        sheet[top : top + height, left : left + width] = tile
    return sheet


def _with_truth(frame: Frame) -> NDArray[np.uint8]:
    image = frame.image_rgb.copy()
    if frame.truth is None or frame.world_from_camera is None:
        return image
    camera_from_world = frame.world_from_camera.inv()
    steps = np.linspace(0.0, 1.0, 60)[:, None]
    for segment, colour in ((frame.truth.left, (255, 0, 0)), (frame.truth.right, (0, 255, 0))):
        if segment is None:
            continue
        points = segment.p0_m + steps * (segment.p1_m - segment.p0_m)
        pixels = frame.camera.project(camera_from_world.apply(points))
        pixels = pixels[np.all(np.isfinite(pixels), axis=1)]
        inside = np.all((pixels >= 0) & (pixels < [frame.camera.width - 0.5, frame.camera.height - 0.5]), axis=1)
        u, v = np.rint(pixels[inside]).astype(int).T
        image[v, u] = colour
    return image
