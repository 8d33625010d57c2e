"""Coarse-to-fine inference: from the network's output for one view to the closer view, and to lines in the image.

At 800 m the runway of a ship is a dozen pixels wide in a 1280-pixel image, at 60 m it fills it. Crops of the full image
become smaller until the runway fills a good half of the network's view.
"""

from dataclasses import dataclass, field
from statistics import median

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_numbers
from deckline.detect.anchors import EDGES, DecodeConfig, NetworkOutput, RowGrid, RowPoints, decode
from deckline.detect.crop import Crop, crop_around
from deckline.detect.runway_shape import fit_straight
from deckline.types import Detection, LinePoints

MIN_SLOPE = 0.01  # dv / du; a flatter line's sigma of u is not stretched further
NEAR_WEIGHT = 4.0  # of the nearest point over the farthest; chosen with FlightGear's nine frames in view
LINE_CANDIDATES = 24  # points of which any two are tried as a straight line's
CANDIDATE_PAIRS = np.array(np.triu_indices(LINE_CANDIDATES, 1))
MAX_SHIFT = 0.25  # of the view; training jitters a crop's centre by as much

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class DetectConfig:
    """How crops are chosen and what counts as seen."""

    grid: RowGrid = field(default_factory=RowGrid)
    decode: DecodeConfig = field(default_factory=DecodeConfig)
    # Thresholds of `hybrid`, chosen by scripts/choose_thresholds.py: docs/experiments/2026-11-detection-thresholds.md.
    # The probability of lines is the runway's in the closest view times their mean confidence. The first two thresholds
    # are compared with its product with the runway's probability in the whole image.
    min_probability: float = 0.6  # of both lines; below it: not seen
    min_lone_probability: float = 0.8  # of one line alone: any marking resembles one edge
    min_prior_probability: float = 0.25  # of both lines in a prior's box
    # The rest is chosen with 17 labelled photographs in view: docs/experiments/2026-11-search-on-photographs.md.
    min_close_probability: float = 0.85  # of both lines, however faint the runway is in the whole image
    # Chosen on frames of strangers' videos: docs/experiments/2026-11-search-over-time.md.
    # Of both lines with the shape of a runway ahead, `RunwayShape.is_ahead`: product of two views, or of one alone.
    min_ahead_probability: float = 0.5
    min_ahead_alone_probability: float = 0.8
    sure_probability: float = 0.87  # of both lines; with it the search ends
    sure_clear_probability: float = 0.75  # the same, times the runway's probability in the whole image
    agreeing_probability: float = 0.75  # of each of two views with the same lines; with them the search ends
    min_view_probability: float = 0.5  # of a runway in a closer view; below it the place is given up
    places: int = 2  # in the whole image that are viewed closer
    min_place_probability: float = 0.02  # of such a place, in the whole image
    # Overlapping parts of the image, searched where nothing better is found: so many along each side, their size of the
    # image's.
    tilings: tuple[tuple[int, float], ...] = ((2, 0.6), (5, 1 / 3))
    min_tile_probability: float = 0.15  # of a runway in a tile whose place is viewed closer
    fill: float = 0.6  # share of a crop's limiting dimension that the runway takes
    min_width_px: float = 48.0  # image px of a crop; chosen on approaches from 800 m (the same page)
    max_passes: int = 3  # to the final view of a place, the coarse one included
    good_fill: tuple[float, float] = (0.42, 0.85)  # a crop whose runway fills this much is final
    min_rows: int = 3  # a line on fewer rows is not returned
    min_confidence: float = 0.5  # of a row
    # Runway edges are straight. Points this far from where most lie belong to another marking; a lens bends less.
    straight_cells: float = 2.0
    min_straight_share: float = 0.5  # of a line's points; a line that is split more evenly is not seen

    def __post_init__(self) -> None:
        check_numbers(self, "", "max_passes", "min_rows", "places", least=1)
        object.__setattr__(self, "tilings", tuple((int(count), float(share)) for count, share in self.tilings))
        if any(count < 1 or not 0 < share <= 1 for count, share in self.tilings):
            raise ValueError(f"tilings needs pairs of a count of 1 or more and a share up to 1, got {self.tilings}")


def closer_crop(box: Float64, crop: Crop, image_size: tuple[int, int], config: DetectConfig) -> Crop:
    """The crop around a box of the network's image, cut to what of it lies in the image."""
    corners = crop.to_image(box.reshape(2, 2)).ravel()
    corners[:2] = np.clip(corners[:2], -0.5, np.array(image_size) - 2.5)
    corners[2:] = np.clip(corners[2:], corners[:2] + 1.0, np.array(image_size) - 0.5)
    return crop_around(corners, image_size, config.grid.size, config.fill, config.min_width_px)


def is_final(closer: Crop, crop: Crop, config: DetectConfig) -> bool:
    """Whether the closer crop would show nearly the same as this one."""
    low, high = config.good_fill
    size = np.array(config.grid.size)
    shift_px = np.array([closer.left - crop.left, closer.top - crop.top]) + (closer.step - crop.step) * size / 2
    centred = bool(np.all(np.abs(shift_px) < MAX_SHIFT * crop.step * size))
    return centred and low <= config.fill * closer.step / crop.step <= high


def decode_lines(output: NetworkOutput, crop: Crop, config: DetectConfig) -> Detection:
    """The lines that the network sees in a crop, in image px; the detection's region is the crop's."""
    rows = list(decode(output.rows, config.grid, config.decode))
    region = crop.bounds(config.grid.width, config.grid.height)
    if _is_right_of(rows[0], rows[1]):
        return Detection(LinePoints.empty(), LinePoints.empty(), region)  # left right of right: not a runway
    lines = [_row_points(line, crop, config) for line in rows]
    if output.columns is not None:
        columns = decode(output.columns, config.grid.transposed, config.decode)
        by_column = [_column_points(line, crop, config) for line in columns]
        # A steep line crosses more rows than columns; where it has more anchors, its points are better.
        lines = [flat if len(flat) > len(steep) else steep for steep, flat in zip(lines, by_column, strict=True)]
    left, right, *centre = lines
    between = centre and not (_is_right_of(rows[0], rows[2]) or _is_right_of(rows[2], rows[1]))
    if not (between and len(left) and len(right)):
        centre = [LinePoints.empty()]  # a centre line lies between two edges
    edge = None if output.edge is None else EDGES[int(np.argmax(output.edge))]
    return Detection(left, right, region, centre[0], edge)


def _is_right_of(one: RowPoints, other: RowPoints) -> bool:
    both = np.isfinite(one.x_px) & np.isfinite(other.x_px)
    return bool(both.any()) and median((other.x_px[both] - one.x_px[both]).tolist()) <= 0


def _row_points(rows: RowPoints, crop: Crop, config: DetectConfig) -> LinePoints:
    chosen = _select_anchors(rows, config.grid, config.grid.row_y, config)
    points = crop.to_image(np.stack([rows.x_px, config.grid.row_y], axis=1)[chosen])
    return LinePoints(points, rows.confidence[chosen], rows.sigma_px[chosen] * crop.step)


def _column_points(columns: RowPoints, crop: Crop, config: DetectConfig) -> LinePoints:
    """Points on column anchors; their sigma of v becomes one of u along the line's own slope."""
    chosen = _select_anchors(columns, config.grid.transposed, columns.x_px, config)
    if not chosen.any():
        return LinePoints.empty()
    points = crop.to_image(np.stack([config.grid.transposed.row_y, columns.x_px], axis=1)[chosen])
    slope = abs(fit_straight(points[:, 0], points[:, 1])[0])  # dv / du
    return LinePoints(points, columns.confidence[chosen], columns.sigma_px[chosen] * crop.step / max(slope, MIN_SLOPE))


def _select_anchors(points: RowPoints, grid: RowGrid, v_px: Float64, config: DetectConfig) -> NDArray[np.bool_]:
    """Which anchors (N,) of a grid are a line's, v_px (N,) being their v; none for a line that is not seen."""
    confident = np.isfinite(points.x_px) & (points.confidence >= config.min_confidence)
    chosen = confident.copy()
    v = v_px[confident]
    nearness = (v - v.min()) / max(float(np.ptp(v)), 1.0) if len(v) else v
    weights = points.confidence[confident] * (1 + (NEAR_WEIGHT - 1) * nearness)  # what is near is seen best
    tolerance_px = config.straight_cells * grid.cell_px
    chosen[confident] = largest_collinear_subset(points.x_px[confident], grid.row_y[confident], weights, tolerance_px)
    if chosen.sum() < max(config.min_rows, config.min_straight_share * confident.sum()):
        chosen[:] = False
    return chosen


def largest_collinear_subset(x: Float64, y: Float64, weights: Float64, tolerance: float) -> NDArray[np.bool_]:
    """The points (N,) of most weight whose x lies within `tolerance` of one straight line x(y); y differ, in order."""
    if len(x) < 3:
        return np.ones(len(x), dtype=bool)
    count = min(len(x), LINE_CANDIDATES)
    tried = np.linspace(0, len(x) - 1, count).round().astype(int)
    first, second = tried[CANDIDATE_PAIRS[:, CANDIDATE_PAIRS[1] < count]]
    slope = (x[second] - x[first]) / (y[second] - y[first])
    distance = np.abs(x - slope[:, None] * y - (x[first] - slope * y[first])[:, None])
    near = distance <= tolerance
    support = np.where(near, 1 - 0.1 / tolerance * distance, 0.0) @ weights
    return np.asarray(near[support.argmax()])
