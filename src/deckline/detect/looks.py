"""Find the runway in the whole image, then look closely: one network, two or three looks.

At 800 m the runway of a ship is a dozen pixels wide in a 1280-pixel image, at 60 m it fills it. The first look says
where it is; the next ones magnify that part of the full image until the runway fills a good half of the network's view.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.detect.preprocess import Window, box_window, look, normalise, whole_window
from deckline.detect.region import decode_region
from deckline.detect.row_anchors import DecodeConfig, RowGrid, RowPoints, decode
from deckline.types import Detection, LinePoints

FLATTEST_SLOPE = 0.01  # dv / du below which a line's sigma of u is not stretched further
SAME_LINE_PX = 2.0  # median distance of one look's points from another look's line
NEAREST_COUNTS = 4.0  # times as much as the farthest point; chosen with FlightGear's nine frames in view
LINES_THROUGH = 24  # points of which any two are tried as a straight line's
MAX_SHIFT = 0.25  # of the view; training jitters a close look's centre by as much

Box = tuple[float, float, float, float]  # u0, v0, u1, v1, image px


class NetworkOutput(NamedTuple):
    """What the network says of one view."""

    rows: NDArray[np.float32]  # (lines, rows, cells + 1) class logits of left, right and, where it has three, centre
    region: NDArray[np.float32]  # (region cells + 1,) class logits
    box: NDArray[np.float32]  # (4, region rows, region columns) box offsets
    columns: NDArray[np.float32] | None = None  # (lines, cells, rows + 1) of column anchors, where it has them


Infer = Callable[[NDArray[np.float32]], NetworkOutput]  # (3, height, width) normalised view -> what is in it


@dataclass(frozen=True)
class DetectConfig:
    """How the looks are taken and what counts as seen."""

    grid: RowGrid = field(default_factory=RowGrid)
    decode: DecodeConfig = field(default_factory=DecodeConfig)
    # Thresholds of `hybrid`, chosen by scripts/choose_thresholds.py (docs/detection.md). They are compared with the
    # probability of a runway, in the first look times the least of the others, times the lines' mean confidence.
    min_probability: float = 0.55  # of both lines; below it: not seen
    min_lone_probability: float = 0.8  # of a line without the other one: any marking may look like one edge
    min_expected_probability: float = 0.25  # of both lines where a runway is expected
    fill: float = 0.6  # share of the close look's limiting dimension that the runway takes
    min_width_px: float = 48.0  # image px of a close look; chosen on approaches from 800 m (docs/detection.md)
    max_looks: int = 3  # the whole image included
    good_fill: tuple[float, float] = (0.42, 0.85)  # a close look whose runway fills this much is final
    min_rows: int = 3  # a line on fewer rows is not returned
    min_confidence: float = 0.5  # of a row
    # Runway edges are straight. Points this far from where most lie belong to another marking; a lens bends less.
    straight_cells: float = 2.0
    min_straight_share: float = 0.5  # of a line's points; a line that is split more evenly is not seen

    def __post_init__(self) -> None:
        if self.max_looks < 1 or self.min_rows < 1:
            raise ValueError(
                f"detection needs at least 1 look and 1 row, got max_looks={self.max_looks}, min_rows={self.min_rows}"
            )


def detect_lines(
    image_rgb: NDArray[np.uint8], infer: Infer, config: DetectConfig, look_at: Box | None = None
) -> Detection:
    """Both runway lines in an image (H, W, 3) uint8, in its own pixels; a line that is not seen has no points.

    The whole image is searched in any case, and what the search finds counts: an expectation that is wrong can hide
    nothing and holds nobody. Where the search misses a line, the place where the runway is expected is looked at
    closely; what is found there counts if it shows both lines, its middle lies in the expected box, and the line that
    the search saw, if it saw one, is one of them.

    Args:
        image_rgb: the image.
        infer: the network.
        config: thresholds and looks.
        look_at: u0, v0, u1, v1 of where the runway is expected, image px.

    Raises:
        ValueError: anything but such an image, or a box that is empty or not finite.
    """
    if image_rgb.ndim != 3 or image_rgb.shape[2] != 3 or image_rgb.dtype != np.uint8:
        raise ValueError(f"expected an image (H, W, 3) of uint8, got {image_rgb.shape} of {image_rgb.dtype}")
    image_size = (image_rgb.shape[1], image_rgb.shape[0])
    whole = whole_window(image_size, (config.grid.width, config.grid.height))
    found = _look_closer(image_rgb, infer, config, whole, config.min_probability)
    if look_at is None or _lines(found) == 2:
        return found
    window = _window(check_box(look_at), image_size, config)
    near = _look_closer(image_rgb, infer, config, window, config.min_expected_probability)
    return near if _lines(near) == 2 and _middle_inside(near, look_at) and _shows(near, found) else found


def check_box(box: Box) -> Box:
    """The box, if it is one.

    Raises:
        ValueError: it is not finite or has no width or height.
    """
    u0, v0, u1, v1 = box
    if not (np.isfinite(box).all() and u1 > u0 and v1 > v0):
        raise ValueError(f"a box to look at needs finite u0 < u1 and v0 < v1, px, got {box}")
    return box


def _look_closer(
    image_rgb: NDArray[np.uint8], infer: Infer, config: DetectConfig, window: Window, needed: float
) -> Detection:
    """From a window to the runway in it, ever closer; `needed` is the least probability of both lines."""
    image_size, network_size = (image_rgb.shape[1], image_rgb.shape[0]), (config.grid.width, config.grid.height)
    sure: list[float] = []  # of a runway, by look
    for number in range(1, config.max_looks + 1):
        output = infer(normalise(look(image_rgb, window, network_size)))
        region = decode_region(output.region, output.box)
        sure.append(region.probability)
        runway = runway_probability(sure)
        if runway < needed:
            break
        closer = _closer_window(region.box, window, image_size, config)
        if number == config.max_looks or _is_final(closer, window, config):
            return _probable(read_lines(output, window, config), runway, needed, config)
        window = closer
    return Detection(LinePoints.empty(), LinePoints.empty())


def runway_probability(looks: list[float]) -> float:
    """Of a runway, from its probability in each look: the first one's times the least of the others."""
    return looks[0] * min(looks[1:], default=1.0)


def lines_probability(found: Detection, runway: float) -> float:
    """Of the edge lines that were found, from a runway's: times their confidence; 0 without any."""
    confidence = [line.confidence.mean() for line in (found.left, found.right) if len(line)]
    return runway * float(np.mean(confidence)) if confidence else 0.0


def _probable(found: Detection, runway: float, needed: float, config: DetectConfig) -> Detection:
    """What was found, if both lines, or the only one, are probable enough."""
    least = needed if _lines(found) == 2 else config.min_lone_probability
    if lines_probability(found, runway) >= least:
        return found
    return Detection(LinePoints.empty(), LinePoints.empty(), found.region_px)


def _lines(detection: Detection) -> int:
    return sum(len(points) > 0 for points in (detection.left, detection.right))


def _middle_inside(detection: Detection, box: Box) -> bool:
    """Whether the middle of what was found lies in a box."""
    points = np.concatenate([detection.left.points_px, detection.right.points_px])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    return bool((middle >= box[:2]).all() and (middle <= box[2:]).all())


def _shows(near: Detection, found: Detection) -> bool:
    """Whether every line of `found` is in `near` as well."""
    pairs = ((found.left, near.left), (found.right, near.right))
    return all(_same_line(one.points_px, other.points_px) for one, other in pairs if len(one))


def _same_line(one_px: NDArray[np.float64], other_px: NDArray[np.float64]) -> bool:
    """Whether points (N, 2) lie on the straight line through others (M, 2); none lie on no line."""
    if len(other_px) < 2:
        return False
    middle = other_px.mean(axis=0)
    _, _, axes = np.linalg.svd(other_px - middle)
    return bool(np.median(np.abs((one_px - middle) @ axes[1])) <= SAME_LINE_PX)


def _closer_window(
    box: NDArray[np.float64], window: Window, image_size: tuple[int, int], config: DetectConfig
) -> Window:
    corners = window.to_image(box.reshape(2, 2)).ravel()
    corners[:2] = np.clip(corners[:2], -0.5, np.array(image_size) - 2.5)
    corners[2:] = np.clip(corners[2:], corners[:2] + 1.0, np.array(image_size) - 0.5)
    return _window(corners, image_size, config)


def _window(box: ArrayLike, image_size: tuple[int, int], config: DetectConfig) -> Window:
    return box_window(box, image_size, (config.grid.width, config.grid.height), config.fill, config.min_width_px)


def _is_final(closer: Window, window: Window, config: DetectConfig) -> bool:
    """Whether the closer window would show nearly the same as this one."""
    low, high = config.good_fill
    size = np.array([config.grid.width, config.grid.height])
    shift_px = np.array([closer.left - window.left, closer.top - window.top]) + (closer.step - window.step) * size / 2
    centred = bool(np.all(np.abs(shift_px) < MAX_SHIFT * window.step * size))
    return centred and low <= config.fill * closer.step / window.step <= high


def read_lines(output: NetworkOutput, window: Window, config: DetectConfig) -> Detection:
    """The lines that the network says it sees through a window, in image px; its region is the window's."""
    rows = [decode(line, config.grid, config.decode) for line in output.rows]
    region = window.bounds(config.grid.width, config.grid.height)
    if _is_right_of(rows[0], rows[1]):
        return Detection(LinePoints.empty(), LinePoints.empty(), region)  # left right of right: not a runway
    lines = [_line_points(line, window, config) for line in rows]
    if output.columns is not None:
        flat = [decode(line, config.grid.transposed, config.decode) for line in output.columns]
        lines = [_longer(line, _column_points(other, window, config)) for line, other in zip(lines, flat, strict=True)]
    left, right, *centre = lines
    if (
        not centre
        or not len(left)
        or not len(right)
        or _is_right_of(rows[0], rows[2])
        or _is_right_of(rows[2], rows[1])
    ):
        return Detection(left, right, region)  # a centre line lies between two edges
    return Detection(left, right, region, centre[0])


def _is_right_of(one: RowPoints, other: RowPoints) -> bool:
    """Whether a line passes right of another on most rows that have both."""
    both = np.isfinite(one.x_px) & np.isfinite(other.x_px)
    return bool(both.any() and np.median(other.x_px[both] - one.x_px[both]) <= 0)


def _line_points(rows: RowPoints, window: Window, config: DetectConfig) -> LinePoints:
    keep = _kept(rows, config.grid, config.grid.row_y, config)
    if keep is None:
        return LinePoints.empty()
    points = window.to_image(np.stack([rows.x_px, config.grid.row_y], axis=1)[keep])
    return LinePoints(points, rows.confidence[keep], rows.sigma_px[keep] * window.step)


def _column_points(columns: RowPoints, window: Window, config: DetectConfig) -> LinePoints:
    """Points on column anchors; their sigma of v becomes one of u along the line's own slope."""
    keep = _kept(columns, config.grid.transposed, columns.x_px, config)
    if keep is None:
        return LinePoints.empty()
    points = window.to_image(np.stack([config.grid.transposed.row_y, columns.x_px], axis=1)[keep])
    slope = abs(np.polyfit(points[:, 0], points[:, 1], 1)[0])  # dv / du
    sigma_u = columns.sigma_px[keep] * window.step / max(slope, FLATTEST_SLOPE)
    return LinePoints(points, columns.confidence[keep], sigma_u)


def _longer(upright: LinePoints, flat: LinePoints) -> LinePoints:
    """A line crosses more rows than columns when it is steep; where it has more anchors, its points are better."""
    return flat if len(flat) > len(upright) else upright


def _kept(
    points: RowPoints, grid: RowGrid, v_px: NDArray[np.float64], config: DetectConfig
) -> NDArray[np.bool_] | None:
    """Which anchors (N,) of a grid count, v_px (N,) being where they lie up and down; None for a line not seen."""
    sure = np.isfinite(points.x_px) & (points.confidence >= config.min_confidence)
    keep = sure.copy()
    v = v_px[sure]
    nearness = (v - v.min()) / max(float(np.ptp(v)), 1.0) if len(v) else v
    weights = points.confidence[sure] * (1 + (NEAREST_COUNTS - 1) * nearness)  # what is near is seen best
    keep[sure] = in_one_line(points.x_px[sure], grid.row_y[sure], weights, config.straight_cells * grid.cell_px)
    enough = keep.sum() >= max(config.min_rows, config.min_straight_share * sure.sum())
    return keep if enough else None


def in_one_line(
    x: NDArray[np.float64], y: NDArray[np.float64], weights: NDArray[np.float64], tolerance: float
) -> NDArray[np.bool_]:
    """The points (N,) of most weight whose x lies within `tolerance` of one straight line x(y); y differ, in order."""
    if len(x) < 3:
        return np.ones(len(x), dtype=bool)
    tried = np.unique(np.linspace(0, len(x) - 1, LINES_THROUGH).round().astype(int))
    first, second = (tried[ends] for ends in np.triu_indices(len(tried), 1))
    slope = (x[second] - x[first]) / (y[second] - y[first])
    away = np.abs(x - x[first, None] - slope[:, None] * (y - y[first, None]))
    near = away <= tolerance
    return np.asarray(near[np.argmax((near * weights * (1 - 0.1 * away / tolerance)).sum(axis=1))])
