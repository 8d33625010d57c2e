"""Figures of many frames' detection scores: rates, errors, lane scores, calibration; all of them and by group."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deckline.evaluation.chain import RANGE_BANDS_M
from deckline.evaluation.detection_lanes import CuLane
from deckline.evaluation.detection_measure import DetectionScore, Scene
from deckline.types import SIDES

VISIBILITY_BANDS_M = ((0.0, 200.0), (200.0, 500.0), (500.0, 1000.0), (1000.0, 2000.0), (2000.0, np.inf))
LIGHT_BANDS = ((0.0, 10.0), (10.0, 30.0), (30.0, 60.0), (60.0, np.inf))  # % of the ramp's
CONTRAST_BANDS = ((0.0, 1.0), (1.0, 2.0), (2.0, 5.0), (5.0, 15.0), (15.0, np.inf))  # grey levels
BINS = 10  # of confidence, evenly from 0 to 1

Figures = dict[str, float]


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


def summarise_detection(scores: Sequence[DetectionScore]) -> Figures:
    """Flat figures; what cannot be said is left out.

    Rates are shares of frames: `found_rate` points on both lines, `placed_rate` and half of each line's within 3 px of
    1280, `false_rate` any point where there is no line. Errors are pooled over all points of decks.

    Raises:
        ValueError: no scores.
    """
    if not scores:
        raise ValueError("no frame could be evaluated")
    decks = [score for score in scores if score.scene is Scene.DECK]
    empty = [score for score in scores if score.scene is Scene.EMPTY]
    figures = {"frames": float(len(scores)), "decks": float(len(decks)), "empty": float(len(empty))}
    if decks:
        figures |= {
            "found_rate": _share(decks, lambda score: score.found == 2),
            "placed_rate": _share(decks, lambda score: score.placed),
            "one_line_rate": _share(decks, lambda score: score.found == 1),
        }
        figures |= _errors(decks) | _lanes(decks)
    if empty:
        figures["false_rate"] = _share(empty, lambda score: score.found > 0)
    calibration = reliability(scores).expected_calibration_error
    return figures if np.isnan(calibration) else figures | {"expected_calibration_error": calibration}


def _share(scores: Sequence[DetectionScore], test: Callable[[DetectionScore], bool]) -> float:
    return sum(map(test, scores)) / len(scores)


def _errors(decks: Sequence[DetectionScore]) -> Figures:
    errors = np.array([error for score in decks for side in SIDES for error in score.errors_px[side]])
    if not len(errors):
        return {}
    medians = [float(np.median(score.errors_px[side])) for score in decks for side in SIDES if score.errors_px[side]]
    return {
        "error_px.median": float(np.median(errors)),
        "error_px.p95": float(np.percentile(errors, 95)),
        "worst_line_px": max(medians),
    }


def _lanes(decks: Sequence[DetectionScore]) -> Figures:
    shares = [score.tusimple for score in decks if score.tusimple is not None]
    figures = {
        f"tusimple.{name}": float(np.mean([getattr(share, name) for share in shares]))
        for name in ("accuracy", "false_positive", "false_negative")
    }
    lanes = sum((score.culane for score in decks if score.culane is not None), CuLane(0, 0, 0))
    return figures | {"culane.f1": lanes.f1}


def reliability(scores: Sequence[DetectionScore], bins: int = BINS) -> Reliability:
    """How often points of each confidence are right, on decks and on frames without one, where none is."""
    rated = [score for score in scores if score.scene is not Scene.UNRATED]
    confidence = [value for score in rated for side in SIDES for value in score.confidence[side]]
    right = [value <= score.right_px for score in rated for side in SIDES for value in score.errors_px[side]]
    return calibration(confidence, right, bins)


def calibration(confidence: ArrayLike, right: ArrayLike, bins: int = BINS) -> Reliability:
    """Confidences (N,) in 0..1 against whether each was right (N,).

    Raises:
        ValueError: different numbers of them, or confidences out of 0..1.
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
        mean, share = (float(x[inside].mean()) if count else float("nan") for x in (values, hits))
        rows.append(Bin(k / bins, (k + 1) / bins, count, mean, share))
        gaps += count * abs(mean - share) if count else 0.0
    return Reliability(tuple(rows), gaps / len(values) if len(values) else float("nan"))


def groups(scores: Sequence[DetectionScore]) -> dict[str, dict[str, list[DetectionScore]]]:
    """Scores by range, visibility, the ramp's light that arrives, the lines' contrast, and ship.

    Groups without frames are left out.
    """
    return {
        "range to the ramp": _banded(scores, lambda score: score.range_m, RANGE_BANDS_M),
        "visibility": _banded(scores, lambda score: score.visibility_m, VISIBILITY_BANDS_M),
        "light through the air": _banded(scores, lambda score: 100 * score.light, LIGHT_BANDS, "%"),
        "contrast of the fainter line": _banded(scores, lambda score: score.contrast, CONTRAST_BANDS, "grey levels"),
        "ship": {ship: [s for s in scores if s.ship == ship] for ship in sorted({s.ship for s in scores})},
    }


def _banded(
    scores: Sequence[DetectionScore],
    value: Callable[[DetectionScore], float],
    bands: Sequence[tuple[float, float]],
    unit: str = "m",
) -> dict[str, list[DetectionScore]]:
    named = {}
    for low, high in bands:
        members = [score for score in scores if low <= value(score) < high or value(score) == high == np.inf]
        if members:
            named[f"{low:g} {unit} and more" if np.isinf(high) else f"{low:g} to {high:g} {unit}"] = members
    return named


def badness(score: DetectionScore) -> tuple[float, float]:
    """What sorts the worst frames to the end: lines lost or invented, then errors; of equal ones the larger deck."""
    if score.scene is Scene.UNRATED:
        return (0.0, 0.0)
    if score.scene is Scene.EMPTY:
        return (100.0 * score.found, 0.0)
    far = max((float(np.percentile(errors, 95)) for errors in score.errors_px.values() if errors), default=0.0)
    return (100.0 * (2 - score.found) + min(far / score.right_px, 99.0), score.extent_px)
