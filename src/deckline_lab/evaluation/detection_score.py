"""Detected points against the lines in an image: one frame's score, the published lane scores, figures of many frames.

Sources: the TuSimple lane detection challenge, 2017; CULane, Pan et al., "Spatial As Deep", 2018.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from deckline.statistics import (
    CONTRAST,
    DETECTION_VISIBILITY_M,
    LIGHT_PERCENT,
    RANGE_M,
    by_band,
    median_and_p95,
    share,
)
from deckline.types import SIDES, Detection
from deckline_lab.evaluation.detection_truth import SceneKind
from deckline_lab.evaluation.frames import FrameSample
from deckline_lab.evaluation.metrics import distance_px
from deckline_lab.evaluation.tables import Figures
from deckline_lab.labels.lines import Line, interpolate_rows

RIGHT_PX = 3.0  # a point this near to its line, in an image of 1280 px, is right: the marks' 95th percentile
FULL_WIDTH_PX = 1280
LANE_ROWS = 56  # rows that a line is compared on in TuSimple's score; as many as its own files have
UNPROJECTABLE_PX = 1e4  # error of a point that no ray of the lens reaches
DIGITS = 5  # significant digits stored of a point's error and confidence
BINS = 10  # of confidence, evenly from 0 to 1
TUSIMPLE_PX = 20.0  # a point is right when it is nearer than that along its row, on an upright lane in a 1280 px image
TUSIMPLE_WIDTH = 1280
TUSIMPLE_MATCH = 0.85  # share of right points from which a lane counts as found
TUSIMPLE_ABSENT = -100.0  # where a lane is not; two of them agree
TUSIMPLE_MOST = 4  # lanes that count
CULANE_PX = 30.0  # width that lines are drawn with in an image of 1640 px
CULANE_WIDTH = 1640
CULANE_IOU = 0.5  # from above which two drawn lines match

Rows = NDArray[np.float64]  # (rows,) u of a line on every row, NaN where it is not


class TuSimple(NamedTuple):
    """Shares of one image: points that are right, predicted lines that match none, true lines that none matches."""

    accuracy: float
    false_positive: float
    false_negative: float


class CuLane(NamedTuple):
    """Lines of one image: matched, predicted without a match, missed."""

    tp: int
    fp: int
    fn: int


@dataclass(frozen=True)
class DetectionScore:
    """How one frame went. Plain values: a score is a line of JSON."""

    source: str
    index: int  # of the frame in its source
    file: str
    ship: str
    scene: str  # a SceneKind
    range_m: float
    visibility_m: float
    width_px: int  # of the image
    extent_px: float  # diagonal of the box around the true lines; 0 without any
    errors_px: Mapping[str, Sequence[float]]  # by side: of every detected point, normal to the line; inf without a line
    confidence: Mapping[str, Sequence[float]]  # by side: of the same points
    tusimple: TuSimple | None  # of a deck
    culane: CuLane | None
    light: float  # share of the ramp's light that comes through the air
    contrast: float  # of the fainter line in the image, grey levels; NaN without both

    @property
    def found(self) -> int:
        """Lines with points, 0 to 2."""
        return sum(bool(self.errors_px[side]) for side in SIDES)

    @property
    def right_px(self) -> float:
        """Distance up to which a point is right, in this image."""
        return RIGHT_PX * self.width_px / FULL_WIDTH_PX

    @property
    def placed(self) -> bool:
        """Both lines are found, half of each one's points or more within `right_px`."""
        return self.found == 2 and all(float(np.median(self.errors_px[side])) <= self.right_px for side in SIDES)

    @property
    def badness(self) -> tuple[float, float]:
        """Sorts the worst frames last: lines lost or invented, then errors; of equal ones the larger deck."""
        if self.scene == SceneKind.UNRATED:
            return 0.0, 0.0
        if self.scene == SceneKind.EMPTY:
            return 100.0 * self.found, 0.0
        worst = max((float(np.percentile(errors, 95)) for errors in self.errors_px.values() if errors), default=0.0)
        return 100.0 * (2 - self.found) + min(worst / self.right_px, 99.0), self.extent_px


def score_detection(sample: FrameSample, detection: Detection) -> DetectionScore:
    """Compare one frame's detected points with what should be found in it."""
    frame, expected = sample.frame, sample.expected
    size = (frame.camera.width, frame.camera.height)
    errors, confidence, predicted = {}, {}, []
    for side in SIDES:
        points, line = getattr(detection, side), expected.lines_px[side]
        distances = np.full(len(points), np.inf)
        if len(points) and line is not None:
            distances = np.nan_to_num(distance_px(points.points_px, line, frame.camera), nan=UNPROJECTABLE_PX)
        errors[side], confidence[side] = _rounded(distances), _rounded(points.confidence)
        if len(points) >= 2:
            predicted.append(points.points_px[np.argsort(points.points_px[:, 1], kind="stable")])
    true = [line for line in expected.lines_px.values() if line is not None]
    deck = expected.scene is SceneKind.DECK
    return DetectionScore(
        sample.source,
        sample.index,
        frame.file,
        sample.ship,
        expected.scene,
        expected.range_m,
        expected.visibility_m,
        size[0],
        float(np.linalg.norm(np.ptp(np.concatenate(true), axis=0))) if true else 0.0,
        errors,
        confidence,
        _score_tusimple(predicted, true, size[0]) if deck else None,
        None if expected.scene is SceneKind.UNRATED else culane(predicted, true if deck else [], size),
        expected.light,
        expected.contrast,
    )


def _score_tusimple(predicted: list[Line], true: list[Line], width_px: int) -> TuSimple:
    """On rows evenly spread over those that the true lines have: rows without any line would all count as right."""
    v = np.concatenate([line[:, 1] for line in true])
    rows = np.linspace(v.min(), v.max(), LANE_ROWS)
    found, there = ([interpolate_rows(line, rows) for line in lines] for lines in (predicted, true))
    return tusimple(found, there, rows, width_px)


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]


def with_scene(scores: Sequence[DetectionScore], scene: SceneKind) -> list[DetectionScore]:
    """Scores of frames that show this."""
    return [score for score in scores if score.scene == scene]


def summarise(scores: Sequence[DetectionScore]) -> Figures:
    """Flat figures; figures that do not exist are left out.

    Rates are shares of frames: `found_rate` points on both lines, `placed_rate` and half of each line's within 3 px of
    1280, `false_rate` any point where there is no line, `false_pair_rate` points on both. Errors are pooled over all
    points of decks.

    Raises:
        ValueError: no scores.
    """
    if not scores:
        raise ValueError("no frame could be evaluated")
    decks, empty = with_scene(scores, SceneKind.DECK), with_scene(scores, SceneKind.EMPTY)
    figures = {"frames": float(len(scores)), "decks": float(len(decks)), "empty": float(len(empty))}
    if decks:
        figures |= {
            "found_rate": share(decks, lambda score: score.found == 2),
            "placed_rate": share(decks, lambda score: score.placed),
            "one_line_rate": share(decks, lambda score: score.found == 1),
        }
        lines = [score.errors_px[side] for score in decks for side in SIDES if score.errors_px[side]]
        if lines:
            figures |= median_and_p95(np.concatenate(lines), "error_px")
            figures["worst_line_px"] = max(float(np.median(line)) for line in lines)
        figures |= _lane_figures(decks)
    if empty:
        figures["false_rate"] = share(empty, lambda score: score.found > 0)
        figures["false_pair_rate"] = share(empty, lambda score: score.found == 2)
    error = reliability(scores).expected_calibration_error
    return figures if np.isnan(error) else figures | {"expected_calibration_error": error}


def _lane_figures(decks: Sequence[DetectionScore]) -> Figures:
    shares = zip(*(score.tusimple for score in decks if score.tusimple is not None), strict=True)
    figures = {f"tusimple.{name}": float(np.mean(each)) for name, each in zip(TuSimple._fields, shares, strict=True)}
    counts = np.sum([score.culane for score in decks if score.culane is not None], axis=0)
    return figures | {"culane.f1": f1(*counts.tolist())}


@dataclass(frozen=True)
class Bin:
    """The points of one range of confidence."""

    low: float
    high: float
    points: int
    confidence: float  # their mean; NaN without points
    right: float  # share of them that is right; NaN without points


@dataclass(frozen=True)
class Reliability:
    """What a detector's confidence is worth."""

    bins: tuple[Bin, ...]
    expected_calibration_error: float  # mean of |confidence - right| over the bins, by points; NaN without points


def reliability(scores: Sequence[DetectionScore]) -> Reliability:
    """How often points of each confidence are right, on decks and on frames without one, where none is."""
    rated = [score for score in scores if score.scene != SceneKind.UNRATED]
    confidence = [value for score in rated for side in SIDES for value in score.confidence[side]]
    right = [value <= score.right_px for score in rated for side in SIDES for value in score.errors_px[side]]
    return calibration(confidence, right)


def calibration(confidence: ArrayLike, right: ArrayLike, bins: int = BINS) -> Reliability:
    """Confidences (N,) in 0..1 against whether each was right (N,).

    Source: Guo et al., "On calibration of modern neural networks", 2017, equation 3.
    """
    values, hits = np.asarray(confidence, dtype=np.float64), np.asarray(right, dtype=np.float64)
    if values.shape != hits.shape or values.ndim != 1:
        raise ValueError(f"expected as many confidences as answers, got {values.shape} and {hits.shape}")
    if np.any((values < 0) | (values > 1 + 1e-6)):
        raise ValueError(f"confidence must lie in 0..1, got {values.min()} to {values.max()}")
    place = np.minimum((values * bins).astype(int), bins - 1)
    rows, gaps = [], 0.0
    for k in range(bins):
        inside = place == k
        count = int(inside.sum())
        mean, correct = (float(x[inside].mean()) if count else float("nan") for x in (values, hits))
        rows.append(Bin(k / bins, (k + 1) / bins, count, mean, correct))
        gaps += count * abs(mean - correct) if count else 0.0
    return Reliability(tuple(rows), gaps / len(values) if len(values) else float("nan"))


def groups(scores: Sequence[DetectionScore]) -> dict[str, dict[str, list[DetectionScore]]]:
    """Scores by range, visibility, the ramp's light that arrives, the lines' contrast, and ship.

    Groups without frames are left out.
    """
    return {
        "range to the ramp": by_band(scores, lambda score: score.range_m, RANGE_M),
        "visibility": by_band(scores, lambda score: score.visibility_m, DETECTION_VISIBILITY_M),
        "light through the air": by_band(scores, lambda score: 100 * score.light, LIGHT_PERCENT, "%"),
        "contrast of the fainter line": by_band(scores, lambda score: score.contrast, CONTRAST, "grey levels"),
        "ship": {ship: [s for s in scores if s.ship == ship] for ship in sorted({s.ship for s in scores})},
    }


def f1(tp: int, fp: int, fn: int) -> float:
    """2 TP / (2 TP + FP + FN); NaN where there is nothing to find and nothing was found."""
    lines = 2 * tp + fp + fn
    return 2 * tp / lines if lines else float("nan")


def tusimple(predicted: Sequence[Rows], true: Sequence[Rows], rows_v: Rows, width_px: int) -> TuSimple:
    """TuSimple's scores of one image; lines are u on each of `rows_v`, NaN where they are not."""
    if len(true) + 2 < len(predicted):
        return TuSimple(0.0, 0.0, 1.0)  # as published: guessing many lanes scores nothing
    best = []
    for line in true:
        tolerance = TUSIMPLE_PX * width_px / TUSIMPLE_WIDTH * np.hypot(1.0, _slope(line, rows_v))
        best.append(max((_agreement(other, line, tolerance) for other in predicted), default=0.0))
    matched = sum(share >= TUSIMPLE_MATCH for share in best)
    missed, total, counted = len(true) - matched, sum(best), max(min(len(true), TUSIMPLE_MOST), 1)
    if len(true) > TUSIMPLE_MOST:  # the worst of too many lanes is left out
        missed, total = max(missed - 1, 0), total - min(best)
    # One predicted line may match two true ones that lie close together; the benchmark's own count is then below 0.
    unmatched = max(len(predicted) - matched, 0) / len(predicted) if predicted else 0.0
    return TuSimple(total / counted, unmatched, missed / counted)


def _slope(line: Rows, rows_v: Rows) -> float:
    """du/dv of the straight line that fits best; a row's tolerance grows with it as a lane turns level."""
    there = np.isfinite(line)
    if there.sum() < 2:
        return 0.0
    v = rows_v[there] - rows_v[there].mean()
    return float(v @ (line[there] - line[there].mean()) / max(v @ v, 1e-12))


def _agreement(predicted: Rows, true: Rows, tolerance_px: float) -> float:
    one, other = (np.nan_to_num(line, nan=TUSIMPLE_ABSENT) for line in (predicted, true))
    return float(np.mean(np.abs(one - other) < tolerance_px))


def culane(predicted: Sequence[Line], true: Sequence[Line], size: tuple[int, int]) -> CuLane:
    """CULane's counts of one image (width, height): lines drawn 30 px wide at 1640 px match where IoU is over 0.5.

    Pairs are chosen so that their IoU together is largest. Points are joined by straight lines; CULane's own bends
    splines through them, which is the same for the runway's straight edges.
    """
    if not predicted or not true:
        return CuLane(0, len(predicted), len(true))
    masks = [[_draw(line, size) for line in lines] for lines in (predicted, true)]
    iou = np.array([[_iou(one, other) for other in masks[1]] for one in masks[0]])
    pairs = linear_sum_assignment(-iou)
    matched = int((iou[pairs] > CULANE_IOU).sum())
    return CuLane(matched, len(predicted) - matched, len(true) - matched)


def _draw(line: Line, size: tuple[int, int]) -> NDArray[np.bool_]:
    width_px = max(round(CULANE_PX * size[0] / CULANE_WIDTH), 1)
    picture = np.zeros((size[1], size[0]), dtype=np.uint8)
    corners = np.rint(np.clip(line, -4 * max(size), 5 * max(size))).astype(np.int32)
    cv2.polylines(picture, [corners], False, 1, width_px)
    return picture > 0


def _iou(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    union = np.count_nonzero(one | other)
    return np.count_nonzero(one & other) / union if union else 0.0
