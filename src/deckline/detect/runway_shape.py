"""Whether two lines of a picture can be a runway's edges, and how far beside the runway the camera is.

On flat ground both edges run to one vanishing point at the horizon. The height of the horizon above the near end, over
the width there, is the camera's height in runway widths; how far the middle of the near end lies sideways of the
vanishing point, over the same height, is the camera's sideways offset in heights. Roll is not corrected.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deckline.types import Detection

# Chosen on frames of strangers' approaches: docs/experiments/2026-11-search-over-time.md.
MIN_SHARED_ROWS = 0.7  # of the rows of both lines together
MIN_ROWS_OF_WIDTH = 0.4  # rows of the lines, in widths at the near end
MAX_OFFSET_HEIGHTS = 0.25  # of the camera sideways of the runway's middle, in heights above it
HEIGHT_OF_IMAGE = (0.015, 0.22)  # from the vanishing point down to the near end, in image widths
HEIGHT_OF_WIDTH = (0.25, 15.0)  # the same in runway widths: the camera's height
# 25 approaches to random ships lie up to 1.2 heights beside the runway where tracks begin, false pairs over ships
# without one mostly from 2 on: docs/experiments/2026-11-approaches-flown.md.
MAX_APPROACH_OFFSET_HEIGHTS = 1.5
BEYOND_OF_LENGTH = (0.03, 15.0)  # from the vanishing point down to the far end, in lengths of the lines

Float64 = NDArray[np.float64]


class RunwayShape(NamedTuple):
    """Straight lines through both edges; v grows downwards."""

    vanishing_px: tuple[float, float]
    """u, v where the lines meet."""
    rows_px: tuple[float, float]
    """v of the far and of the near end."""
    widths_px: tuple[float, float]
    """Between the lines at the far and at the near end."""
    shared_rows: float
    """Share of all rows that both lines have."""
    offset_heights: float
    """The camera's distance sideways of the runway's middle, in heights above it."""

    @property
    def is_approached(self) -> bool:
        """Whether the camera is no farther beside the runway than on an approach, however it points."""
        return self.offset_heights <= MAX_APPROACH_OFFSET_HEIGHTS

    def is_ahead(self, image_width: int) -> bool:
        """Whether a runway on flat ground ahead of and below the camera looks so in an image so many px wide.

        Of pairs that a network takes for a runway, most wrong ones lie far beside the camera, are wider than long, or
        end on different rows: edges of two strips or roads.
        """
        (_, horizon), (far, near), (far_width, near_width) = self.vanishing_px, self.rows_px, self.widths_px
        if not (horizon < far < near and near_width > far_width > 0):
            return False
        height = near - horizon
        ratios = (height / image_width, height / near_width, (far - horizon) / (near - far))
        bounds = (HEIGHT_OF_IMAGE, HEIGHT_OF_WIDTH, BEYOND_OF_LENGTH)
        return (
            self.shared_rows >= MIN_SHARED_ROWS
            and near - far >= MIN_ROWS_OF_WIDTH * near_width
            and self.offset_heights <= MAX_OFFSET_HEIGHTS
            and all(low <= ratio <= high for ratio, (low, high) in zip(ratios, bounds, strict=True))
        )


def runway_shape(lines: Detection) -> RunwayShape | None:
    """The shape of a pair of lines; None for level or parallel lines, and where a line is missing."""
    left, right = lines.left.points_px, lines.right.points_px
    if min(len(left), len(right)) < 2 or min(np.ptp(left[:, 1]), np.ptp(right[:, 1])) <= 0:
        return None
    (slope, start), (other_slope, other_start) = (fit_straight(points[:, 1], points[:, 0]) for points in (left, right))
    opening = other_slope - slope  # px of width a row
    if opening == 0:
        return None
    ends = np.array([(points[:, 1].min(), points[:, 1].max()) for points in (left, right)])
    far, near = float(ends[:, 0].min()), float(ends[:, 1].max())
    shared = float(ends[:, 1].min() - ends[:, 0].max()) / (near - far)
    horizon = (start - other_start) / opening
    at_horizon = slope * horizon + start
    widths = tuple(opening * v + other_start - start for v in (far, near))
    middle = ((slope + other_slope) * near + start + other_start) / 2
    offset = abs(middle - at_horizon) / (near - horizon) if near > horizon else float("inf")
    return RunwayShape((at_horizon, horizon), (far, near), (widths[0], widths[1]), shared, offset)


def fit_straight(x: Float64, y: Float64) -> tuple[float, float]:
    """Slope and intercept of the straight line y(x) through points (N,) that differ in x, by least squares."""
    middle = float(x.mean())
    offsets = x - middle
    slope = float(offsets @ y) / float(offsets @ offsets)
    return slope, float(y.mean()) - slope * middle
