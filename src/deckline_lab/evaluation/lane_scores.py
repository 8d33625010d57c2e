"""The published lane scores of one image: TuSimple's accuracy and CULane's counts.

Sources: the TuSimple lane detection challenge, 2017; CULane, Pan et al., "Spatial As Deep", 2018.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from deckline_lab.labels.lines import Line

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
