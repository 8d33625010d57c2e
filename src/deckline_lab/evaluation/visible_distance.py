"""Visible distance: how far away the lines are first held on an approach.

Both lines are right in a frame where half of each one's points or more lie within `tolerance_px` of the true line. They
are held from a frame on where they are right in it and in HELD_SHARE or more of the frames of HELD_S from it on.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deckline.truth import true_segments
from deckline.types import SIDES, Detection, Frame
from deckline_lab.evaluation.metrics import distance_px
from deckline_lab.evaluation.tables import Columns, Figures, Table, cells
from deckline_lab.labels.lines import Line, interpolate_rows
from deckline_sim.visible_line import find_visible_line

RIGHT_PX = 3.0  # a point this near to its line, in an image of 1280 px, is right: the marks' 95th percentile
FULL_WIDTH_PX = 1280
WIDTH_SHARE = 0.05  # of the runway's width at its near end: an error of this is right as well
HELD_S, HELD_SHARE = 1.0, 0.8
LEAST_FRAMES = 3  # in HELD_S; a recording with fewer says nothing about what is held
TIME_STEP_S = 1e-4  # times that are nearer to each other are one
FASTEST_M_S = 200.0  # that a range changes on a flight; faster: unrelated views
PERCENTS = (50, 90)  # of the approaches
TITLE = "where both lines are first held"
NOTE = """\
first held: the range from which on both lines are right in the frame and in 80 % of those of the next second, half of
each one's points within 3 px of 1280 or 5 % of the runway's width at its near end; 0 where they never are. of V: of the
visibility, or of the range where the recording begins if that is less. 90 %: nine of ten approaches hold the lines as
far away or farther."""


class ApproachFrame(NamedTuple):
    """One frame of an approach."""

    approach: str
    time_s: float
    range_m: float  # aircraft to the ramp, horizontal; NaN without a runway
    visibility_m: float  # 2 % contrast; infinite in clear air, NaN when unknown
    is_right: bool  # both lines


def near_width_px(left: Line | None, right: Line | None) -> float:
    """Width of a runway, px, in the lowest row that both its lines (N, 2), (M, 2) reach; NaN where they share none."""
    if left is None or right is None:
        return math.nan
    row = [min(left[:, 1].max(), right[:, 1].max())]
    return float(np.abs(interpolate_rows(right, row) - interpolate_rows(left, row))[0])


def tolerance_px(image_width_px: int, near_px: float = math.nan) -> float:
    """How far a right point may lie from its line: RIGHT_PX, or WIDTH_SHARE of a near end's width if that is more."""
    return max(RIGHT_PX * image_width_px / FULL_WIDTH_PX, WIDTH_SHARE * near_px if near_px > 0 else 0.0)


def are_right(errors_px: Iterable[Sequence[float] | NDArray[np.float64]], tolerance: float) -> bool:
    """Whether every line has points, half of them or more within a tolerance, px."""
    return all(len(errors) > 0 and float(np.median(errors)) <= tolerance for errors in errors_px)


def is_right(frame: Frame, detection: Detection) -> bool:
    """Whether both lines are found where the truth of the frame projects them; False where it shows not both."""
    segments = true_segments(frame.truth)
    seen = [find_visible_line(frame, segments[side], within_visibility=False) for side in SIDES if side in segments]
    lines = [line.points_px for line in seen if line is not None]
    points = [getattr(detection, side).points_px for side in SIDES]
    if len(lines) < len(SIDES) or not all(map(len, points)):
        return False
    errors = [distance_px(each, line, frame.camera) for each, line in zip(points, lines, strict=True)]
    return are_right(errors, tolerance_px(frame.camera.width, near_width_px(*lines)))


def first_held_m(frames: Sequence[ApproachFrame]) -> float:
    """Range at which the lines of one approach are first held, m; 0: never.

    NaN for what is no approach: fewer than LEAST_FRAMES frames in HELD_S, unrelated views, views without a runway, a
    recording that ends within HELD_S.
    """
    ordered = sorted(frames, key=lambda frame: frame.time_s)
    times, ranges = (np.array([getattr(frame, name) for frame in ordered]) for name in ("time_s", "range_m"))
    right = np.array([frame.is_right for frame in ordered], dtype=bool)
    steps = np.diff(times)
    if not len(steps) or not np.isfinite(ranges).all() or not ranges[-1] < ranges[0]:
        return math.nan
    step_s = float(np.median(steps))
    whole = times + HELD_S <= times[-1] + 1.5 * step_s
    is_flight = bool(np.all(np.abs(np.diff(ranges)) <= FASTEST_M_S * steps))
    if not is_flight or step_s * LEAST_FRAMES > HELD_S + TIME_STEP_S or not whole.any():
        return math.nan
    for k in np.flatnonzero(right & whole):
        inside = (times >= times[k]) & (times < times[k] + HELD_S - TIME_STEP_S)
        if right[inside].mean() >= HELD_SHARE:
            return float(ranges[k])
    return 0.0


def visible_distance(frames: Iterable[ApproachFrame]) -> Figures:
    """`first_held_m.50`, `first_held_m.90` and the same `first_held_of_visibility`, over `approaches`.

    At `.90` nine of ten approaches hold the lines as far away or farther. Of the visibility or, if that is less, the
    range of the first frame. Recordings that are no approach are left out; empty without any.
    """
    runs: dict[str, list[ApproachFrame]] = {}
    for frame in frames:
        runs.setdefault(frame.approach, []).append(frame)
    held = {name: first_held_m(run) for name, run in runs.items()}
    flown = {name: value for name, value in held.items() if math.isfinite(value)}
    if not flown:
        return {}
    shares = [value / _reach_m(runs[name]) for name, value in flown.items()]
    figures = {"approaches": float(len(flown))}
    for name, values in {"first_held_m": [*flown.values()], "first_held_of_visibility": shares}.items():
        known = sorted((value for value in values if math.isfinite(value)), reverse=True)
        if known:
            figures |= {f"{name}.{percent}": known[math.ceil(percent * len(known) / 100) - 1] for percent in PERCENTS}
    return figures


def _reach_m(frames: Sequence[ApproachFrame]) -> float:
    """The visibility, or the range of the first frame if that is less; NaN when the visibility is unknown."""
    first = min(frames, key=lambda frame: frame.time_s)
    return float(np.minimum(first.visibility_m, first.range_m))


CELLS: Columns = {
    "approaches": ("approaches", 1.0, ".0f"),
    "first held, 50 %, m": ("first_held_m.50", 1.0, ".0f"),
    "90 %, m": ("first_held_m.90", 1.0, ".0f"),
    "of V, 50 %, %": ("first_held_of_visibility.50", 100.0, ".0f"),
    "90 %, %": ("first_held_of_visibility.90", 100.0, ".0f"),
}


def visible_tables(rows: Iterable[tuple[tuple[str, ...], Figures]], columns: Sequence[str]) -> list[Table]:
    """One table, a row a method, named in `columns`, with its `visible_distance`; none where nothing is an approach."""
    known = [(key, figures) for key, figures in rows]
    if not any(figures for _, figures in known):
        return []
    return [Table(TITLE, (*columns, *CELLS), [(*key, *cells(figures, CELLS)) for key, figures in known], [NOTE])]
