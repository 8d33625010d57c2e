"""Coarse-to-fine inference: one network on the whole image, then on crops around the runway.

At 800 m the runway of a ship is a dozen pixels wide in a 1280-pixel image, at 60 m it fills it. The coarse pass says
where it is; refinement passes crop the full image until the runway fills a good half of the network's view.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_image, check_numbers
from deckline.detect.anchors import DecodeConfig, NetworkOutput, RowGrid, RowPoints, decode, decode_region
from deckline.detect.crop import Box, Crop, box_around, crop_around, full_crop, normalise, sample_crop
from deckline.types import Detection, LinePoints

MIN_SLOPE = 0.01  # dv / du; a flatter line's sigma of u is not stretched further
SAME_LINE_PX = 2.0  # median distance of one detection's points from another detection's line
NEAR_WEIGHT = 4.0  # of the nearest point over the farthest; chosen with FlightGear's nine frames in view
LINE_CANDIDATES = 24  # points of which any two are tried as a straight line's
MAX_SHIFT = 0.25  # of the view; training jitters a crop's centre by as much

Float64 = NDArray[np.float64]
Infer = Callable[[NDArray[np.float32]], NetworkOutput]  # (3, height, width) normalised view -> what is in it


@dataclass(frozen=True)
class DetectConfig:
    """How crops are chosen and what counts as seen."""

    grid: RowGrid = field(default_factory=RowGrid)
    decode: DecodeConfig = field(default_factory=DecodeConfig)
    # Thresholds of `hybrid`, chosen by scripts/choose_thresholds.py: docs/experiments/2026-11-detection-thresholds.md.
    # They are compared with the runway's probability (coarse pass times least other pass) times the mean confidence.
    min_probability: float = 0.55  # of both lines; below it: not seen
    min_lone_probability: float = 0.8  # of one line alone: any marking may look like one edge
    min_prior_probability: float = 0.25  # of both lines in a prior's box
    fill: float = 0.6  # share of a crop's limiting dimension that the runway takes
    min_width_px: float = 48.0  # image px of a crop; chosen on approaches from 800 m (the same page)
    max_passes: int = 3  # the coarse pass included
    good_fill: tuple[float, float] = (0.42, 0.85)  # a crop whose runway fills this much is final
    min_rows: int = 3  # a line on fewer rows is not returned
    min_confidence: float = 0.5  # of a row
    # Runway edges are straight. Points this far from where most lie belong to another marking; a lens bends less.
    straight_cells: float = 2.0
    min_straight_share: float = 0.5  # of a line's points; a line that is split more evenly is not seen

    def __post_init__(self) -> None:
        check_numbers(self, "", "max_passes", "min_rows", least=1)


def detect_lines(
    image_rgb: NDArray[np.uint8], infer: Infer, config: DetectConfig, prior_box: Box | None = None
) -> Detection:
    """Both runway lines in an image (H, W, 3) uint8, in its own pixels; a line that is not seen has no points.

    The whole image is always searched, and a search that sees both lines is final: a wrong prior can hide nothing.
    Where the search misses a line, the prior's box is searched. Its result replaces the first one if it has both
    lines, its middle lies in the box, and it agrees with any line of the first search.

    Raises:
        ValueError: anything but such an image, or a box that is empty or not finite.
    """
    check_image(image_rgb)
    image_size = (image_rgb.shape[1], image_rgb.shape[0])
    coarse = full_crop(image_size, config.grid.size)
    found = _refine(image_rgb, infer, config, coarse, config.min_probability)
    if prior_box is None or _count_lines(found) == 2:
        return found
    crop = crop_around(prior_box, image_size, config.grid.size, config.fill, config.min_width_px)
    refined = _refine(image_rgb, infer, config, crop, config.min_prior_probability)
    accepted = _count_lines(refined) == 2 and _is_centred_in(refined, prior_box) and _agrees(refined, found)
    return refined if accepted else found


def _refine(
    image_rgb: NDArray[np.uint8], infer: Infer, config: DetectConfig, crop: Crop, min_probability: float
) -> Detection:
    """From a crop to the runway in it, in ever smaller crops; `min_probability` is that of both lines."""
    probabilities: list[float] = []  # of a runway, by pass
    for number in range(1, config.max_passes + 1):
        output = infer(normalise(sample_crop(image_rgb, crop, config.grid.size)))
        region = decode_region(output.region, output.box)
        probabilities.append(region.probability)
        runway = runway_probability(probabilities)
        if runway < min_probability:
            break
        closer = _closer_crop(region.box, crop, (image_rgb.shape[1], image_rgb.shape[0]), config)
        if number == config.max_passes or _is_final(closer, crop, config):
            found = decode_lines(output, crop, config)
            least = min_probability if _count_lines(found) == 2 else config.min_lone_probability
            if lines_probability(found, runway) >= least:
                return found
            return Detection(LinePoints.empty(), LinePoints.empty(), found.region_px)
        crop = closer
    return Detection(LinePoints.empty(), LinePoints.empty())


def runway_probability(passes: list[float]) -> float:
    """Of a runway, from its probability in each pass: the coarse pass's times the least of the others."""
    return passes[0] * min(passes[1:], default=1.0)


def lines_probability(found: Detection, runway: float) -> float:
    """Of the edge lines that were found, from a runway's: times their confidence; 0 without any."""
    confidence = [line.confidence.mean() for line in (found.left, found.right) if len(line)]
    return runway * float(np.mean(confidence)) if confidence else 0.0


def _count_lines(detection: Detection) -> int:
    return sum(len(points) > 0 for points in (detection.left, detection.right))


def _is_centred_in(detection: Detection, box: Box) -> bool:
    u0, v0, u1, v1 = box_around(detection.left, detection.right)
    return box[0] <= (u0 + u1) / 2 <= box[2] and box[1] <= (v0 + v1) / 2 <= box[3]


def _agrees(refined: Detection, found: Detection) -> bool:
    """Whether every line of `found` is in `refined` too."""
    pairs = ((found.left, refined.left), (found.right, refined.right))
    return all(_lies_on(one.points_px, other.points_px) for one, other in pairs if len(one))


def _lies_on(points_px: Float64, line_px: Float64) -> bool:
    """Whether points (N, 2) lie on the straight line through others (M, 2)."""
    if len(line_px) < 2:
        return False
    middle = line_px.mean(axis=0)
    _, _, axes = np.linalg.svd(line_px - middle)
    return bool(np.median(np.abs((points_px - middle) @ axes[1])) <= SAME_LINE_PX)


def _closer_crop(box: Float64, crop: Crop, image_size: tuple[int, int], config: DetectConfig) -> Crop:
    """The crop around a box of the network's image, cut to what of it lies in the image."""
    corners = crop.to_image(box.reshape(2, 2)).ravel()
    corners[:2] = np.clip(corners[:2], -0.5, np.array(image_size) - 2.5)
    corners[2:] = np.clip(corners[2:], corners[:2] + 1.0, np.array(image_size) - 0.5)
    return crop_around(corners, image_size, config.grid.size, config.fill, config.min_width_px)


def _is_final(closer: Crop, crop: Crop, config: DetectConfig) -> bool:
    """Whether the closer crop would show nearly the same as this one."""
    low, high = config.good_fill
    size = np.array(config.grid.size)
    shift_px = np.array([closer.left - crop.left, closer.top - crop.top]) + (closer.step - crop.step) * size / 2
    centred = bool(np.all(np.abs(shift_px) < MAX_SHIFT * crop.step * size))
    return centred and low <= config.fill * closer.step / crop.step <= high


def decode_lines(output: NetworkOutput, crop: Crop, config: DetectConfig) -> Detection:
    """The lines that the network sees in a crop, in image px; the detection's region is the crop's."""
    rows = [decode(line, config.grid, config.decode) for line in output.rows]
    region = crop.bounds(config.grid.width, config.grid.height)
    if _is_right_of(rows[0], rows[1]):
        return Detection(LinePoints.empty(), LinePoints.empty(), region)  # left right of right: not a runway
    lines = [_row_points(line, crop, config) for line in rows]
    if output.columns is not None:
        columns = [decode(line, config.grid.transposed, config.decode) for line in output.columns]
        by_column = [_column_points(line, crop, config) for line in columns]
        # A steep line crosses more rows than columns; where it has more anchors, its points are better.
        lines = [flat if len(flat) > len(steep) else steep for steep, flat in zip(lines, by_column, strict=True)]
    left, right, *centre = lines
    between = centre and not (_is_right_of(rows[0], rows[2]) or _is_right_of(rows[2], rows[1]))
    if between and len(left) and len(right):
        return Detection(left, right, region, centre[0])
    return Detection(left, right, region)  # a centre line lies between two edges


def _is_right_of(one: RowPoints, other: RowPoints) -> bool:
    both = np.isfinite(one.x_px) & np.isfinite(other.x_px)
    return bool(both.any() and np.median(other.x_px[both] - one.x_px[both]) <= 0)


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
    slope = abs(np.polyfit(points[:, 0], points[:, 1], 1)[0])  # dv / du
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
    tried = np.unique(np.linspace(0, len(x) - 1, LINE_CANDIDATES).round().astype(int))
    first, second = (tried[ends] for ends in np.triu_indices(len(tried), 1))
    slope = (x[second] - x[first]) / (y[second] - y[first])
    distance = np.abs(x - x[first, None] - slope[:, None] * (y - y[first, None]))
    near = distance <= tolerance
    return np.asarray(near[np.argmax((near * weights * (1 - 0.1 * distance / tolerance)).sum(axis=1))])
