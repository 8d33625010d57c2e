"""A clear view and where its true runway lines are in it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.train.dehaze_data import ClearView, clear_view
from deckline.types import Frame, Segment

LINE_POINTS = 257  # along a line, evenly spaced in the image
NEAREST_M = 0.5  # depth at which a line that passes the camera is cut


@dataclass(frozen=True, eq=False)
class LineView:
    """A clear view and where its lines are in it."""

    file: str
    clear: ClearView
    lines_px: NDArray[np.float64] | None  # (2, N, 2) left and right, in order along the line; None: no runway
    ranges_m: NDArray[np.float64] | None  # (2, N) from the camera


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
    both = [_project(frame, segment) for segment in (truth.left, truth.right)]
    if any(line is None for line in both):
        return LineView(frame.file, clear, None, None)  # a line wholly behind the camera
    points, ranges = zip(*(line for line in both if line is not None), strict=True)
    return LineView(frame.file, clear, np.stack(points), np.stack(ranges))


def _project(frame: Frame, segment: Segment) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """A true line's points in the image (N, 2) and their ranges (N,), evenly spaced in the image."""
    world_from_camera = frame.true_world_from_camera
    if world_from_camera is None:
        return None
    ends = world_from_camera.inv().apply(np.stack([segment.p0_m, segment.p1_m]))
    depths = ends[:, 2]
    if depths.max() <= NEAREST_M:
        return None
    along = ends[1] - ends[0]
    if depths.min() < NEAREST_M:
        cut = ends[0] + along * (NEAREST_M - depths[0]) / along[2]
        ends[int(depths.argmin())] = cut
    inverse = np.linspace(1 / ends[0, 2], 1 / ends[1, 2], LINE_POINTS)  # even in 1/z is even in the image
    share = np.linspace(0, 1, LINE_POINTS)
    if abs(ends[1, 2] - ends[0, 2]) > 1e-6:
        share = (1 / inverse - ends[0, 2]) / (ends[1, 2] - ends[0, 2])
    points = ends[0] + share[:, None] * (ends[1] - ends[0])
    return frame.camera.project(points), np.linalg.norm(points, axis=1)
