"""Two lines as one runway: consistency, near ends and ramp."""

from dataclasses import replace

import numpy as np
import pytest

from deckline.localize import line_fit
from deckline.types import Detection, LinePoints, LineVisibility, Reason, Segment
from runway_scene import (
    ANY_ANGLE,
    LATERAL,
    LEFT,
    PARALLEL_RIGHT,
    RIGHT,
    approach,
    azimuth,
    detection,
    keep,
    line_points,
    locate,
    nearest,
    reasons,
    still_deck,
)

NEAR = approach(60.0, 8.0)
EMPTY = LinePoints.empty()


def shift_left_line(metres, turn_rad=0.0):
    """The left line shifted to its right and turned about its ramp end."""
    angle = azimuth(LEFT) + turn_rad
    start = LEFT.p0_m + metres * LATERAL
    return Segment(start, start + 217 * np.array([np.cos(angle), np.sin(angle), 0.0]))


def test_ramp_is_found_within_its_sigma_only_when_in_view():
    for left, right in ((50, 60), (60, 50)):
        estimate = locate(NEAR, Detection(detection(NEAR, count=left).left, detection(NEAR, count=right).right))
        assert 0.1 < estimate.ramp_sigma_m < 3
        assert np.linalg.norm(estimate.ramp_m - (LEFT.p0_m + RIGHT.p0_m) / 2) < 2 * estimate.ramp_sigma_m
    over_deck = approach(-40.0, 4.0)  # the lines leave the image through its lower border
    found = detection(NEAR)
    bottom = float(found.left.points_px[:, 1].max()) + 1.0
    cropped = Detection(found.left, found.right, (0.0, 0.0, 1279.0, bottom))
    for estimate in (locate(over_deck, detection(over_deck)), locate(NEAR, cropped)):
        assert (estimate.seen, estimate.ramp_m, reasons(estimate)) == (LineVisibility.BOTH, None, [Reason.NO_RAMP])


def test_lines_that_begin_far_apart_are_rejected(monkeypatch):
    found = detection(NEAR)
    rows = found.left.points_px[:, 1]
    found = Detection(keep(found.left, rows < np.percentile(rows, 40)), found.right)
    estimate = locate(NEAR, found)
    assert (estimate.seen, estimate.lines, reasons(estimate)) == (LineVisibility.NONE, {}, [Reason.LINE_ENDS])
    monkeypatch.setattr(line_fit, "MAX_END_STEP_M", 1000.0)
    assert locate(NEAR, found).seen is LineVisibility.BOTH


def test_slope_sigma_allows_the_near_ends_of_a_banked_deck_to_differ():
    """5 degrees of bank, projected onto a level deck from 6 m above it, put 16 m between the near ends."""
    frame = approach(60.0, 6.0, right=PARALLEL_RIGHT)
    rise = np.array([0.0, 0.0, 7.45 * np.sin(np.deg2rad(5.0))])
    lines = [Segment(line.p0_m + up, line.p1_m + up) for line, up in ((LEFT, -rise), (PARALLEL_RIGHT, rise))]
    banked = Detection(*(line_points(frame, line) for line in lines))
    level = locate(frame, banked)
    assert (level.seen, reasons(level)) == (LineVisibility.NONE, [Reason.LINE_ENDS])
    assert " 16 m" in level.reason
    assert locate(frame, banked, still_deck(slope_deg=3.0)).seen is LineVisibility.BOTH


LEFT_POINTS, RIGHT_POINTS = detection(NEAR).left, detection(NEAR).right
SAME_MARKING = replace(LEFT_POINTS, points_px=LEFT_POINTS.points_px + np.array([1.0, 0.0]))
TURNED = shift_left_line(14.0, np.deg2rad(12))


@pytest.mark.parametrize(
    ("left", "right", "reason", "kept"),
    [
        (EMPTY, EMPTY, Reason.NO_LINE, set()),
        (RIGHT_POINTS, LEFT_POINTS, Reason.CROSSED, set()),
        (LEFT_POINTS, SAME_MARKING, Reason.LINE_SPACING, set()),
        (LEFT_POINTS, line_points(NEAR, TURNED), Reason.LINE_ANGLE, set()),
        # Of two lines in different directions, the clearly surer one stays.
        (detection(NEAR, sigma_px=0.3).left, line_points(NEAR, TURNED, sigma_px=4.0), Reason.LINE_ANGLE, {"left"}),
        # The direction of 8 points is not known.
        (nearest(LEFT_POINTS, 8, 8.0), RIGHT_POINTS, Reason.UNSURE, {"right"}),
    ],
    ids=["nothing", "swapped", "same marking", "directions", "one surer", "too short"],
)
def test_contradicting_lines_are_dropped_with_the_reason(left, right, reason, kept):
    estimate = locate(NEAR, Detection(left, right), still_deck(**ANY_ANGLE))
    assert estimate.seen is (LineVisibility.ONE if kept else LineVisibility.NONE)
    assert (set(estimate.pixel_lines), set(estimate.lines)) == (kept, kept)
    assert reasons(estimate)[0] is reason
