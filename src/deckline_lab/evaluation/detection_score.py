"""Detected points against the lines in an image: one frame's score, figures of many frames."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.report.bands import RANGE_M, by_band, share
from deckline.types import SIDES, Detection
from deckline_lab.evaluation.detection_truth import SceneKind
from deckline_lab.evaluation.frames import FrameSample
from deckline_lab.evaluation.lane_scores import CuLane, TuSimple, culane, f1, tusimple
from deckline_lab.evaluation.metrics import distance_px
from deckline_lab.evaluation.tables import Figures
from deckline_lab.evaluation.visible_distance import (
    ApproachFrame,
    are_right,
    near_width_px,
    tolerance_px,
    visible_distance,
)
from deckline_lab.labels.lines import Line, interpolate_rows
from deckline_lab.statistics import CONTRAST, DETECTION_VISIBILITY_M, LIGHT_PERCENT, median_and_p95

LANE_ROWS = 56  # rows that a line is compared on in TuSimple's score; as many as its own files have
UNPROJECTABLE_PX = 1e4  # error of a point that no ray of the lens reaches
DIGITS = 5  # significant digits stored of a point's error and confidence
BINS = 10  # of confidence, evenly from 0 to 1


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
    time_s: float = math.nan
    near_width_px: float = math.nan  # of the runway where both true lines begin; NaN without both

    @property
    def found(self) -> int:
        """Lines with points, 0 to 2."""
        return sum(bool(self.errors_px[side]) for side in SIDES)

    @property
    def right_px(self) -> float:
        """Distance up to which a point is right, in this image."""
        return tolerance_px(self.width_px)

    @property
    def placed(self) -> bool:
        """Both lines are found, half of each one's points or more within `right_px`."""
        return are_right([self.errors_px[side] for side in SIDES], self.right_px)

    @property
    def is_right(self) -> bool:
        """The same within what `visible_distance` allows."""
        allowed = tolerance_px(self.width_px, self.near_width_px)
        return are_right([self.errors_px[side] for side in SIDES], allowed)

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
        frame.time_s,
        near_width_px(*(expected.lines_px[side] for side in SIDES)),
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


def visible_figures(scores: Sequence[DetectionScore]) -> Figures:
    """Where both lines are first held, of the recordings that are approaches; see `visible_distance`."""
    return visible_distance(ApproachFrame(s.source, s.time_s, s.range_m, s.visibility_m, s.is_right) for s in scores)


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
