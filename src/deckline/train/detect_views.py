"""A clear view and where its true runway lines are in it: left, right and the centre line midway between them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.labels.truth import image_line
from deckline.train.dehaze_data import ClearView, clear_view
from deckline.types import Frame, Segment


@dataclass(frozen=True, eq=False)
class LineView:
    """A clear view and where its lines are in it."""

    file: str
    clear: ClearView
    lines_px: NDArray[np.float64] | None  # (3, N, 2) left, right, centre, in order along the line; None: no runway
    ranges_m: NDArray[np.float64] | None  # (3, N) from the camera
    centre_painted: bool | None = None  # None: not known

    @property
    def image_rgb(self) -> NDArray[np.uint8]:
        """(H, W, 3) without haze."""
        return self.clear.clear_rgb


def line_view(frame: Frame) -> LineView:
    """What training needs of a frame.

    Raises:
        ValueError: no depth, no clear image, or no truth and pose to know the lines from.
    """
    clear = clear_view(frame, long_side_px=max(frame.image_rgb.shape))  # at its own size
    truth = frame.truth
    if truth is None or truth.left is None or truth.right is None:
        return LineView(frame.file, clear, None, None)
    if frame.true_world_from_camera is None:
        raise ValueError(f"{frame.file}: no pose; true lines cannot be brought into the image")
    ends = [(a + b) / 2 for a, b in ((truth.left.p0_m, truth.right.p0_m), (truth.left.p1_m, truth.right.p1_m))]
    lines = [image_line(frame, segment) for segment in (truth.left, truth.right, Segment(*ends))]
    if any(line is None for line in lines):
        return LineView(frame.file, clear, None, None)  # a line wholly behind the camera
    points, ranges = zip(*(line for line in lines if line is not None), strict=True)
    return LineView(frame.file, clear, np.stack(points), np.stack(ranges), truth.centre_painted)
