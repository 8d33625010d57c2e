"""Cases worked out by hand from the published definitions."""

import numpy as np
import pytest

from deckline.evaluation.lane_scores import CuLane, TuSimple, culane, f1, tusimple

ROWS = np.arange(0.0, 100.0, 10.0)
UPRIGHT = np.full(10, 100.0)


def on_rows(line, without=()) -> np.ndarray:
    line = np.array(line, dtype=float)
    line[list(without)] = np.nan
    return line


def test_a_point_is_right_within_20_px_of_1280():
    for offset, right in ((0.0, 1.0), (19.9, 1.0), (20.1, 0.0)):
        expected = TuSimple(right, 1.0 - right, 1.0 - right)
        assert tusimple([UPRIGHT + offset], [UPRIGHT], ROWS, 1280) == expected
        assert tusimple([UPRIGHT + offset / 2], [UPRIGHT], ROWS, 640) == expected


def test_the_tolerance_grows_as_a_lane_turns_level():
    slanted = 100.0 + ROWS  # 45 degrees: 20 px normal to the lane are 28.28 px along a row
    assert tusimple([slanted + 28.2], [slanted], ROWS, 1280).accuracy == 1.0
    assert tusimple([slanted + 28.4], [slanted], ROWS, 1280).accuracy == 0.0


def test_a_lane_matches_from_85_percent_on():
    nine, eight = on_rows(UPRIGHT, [0]), on_rows(UPRIGHT, [0, 1])
    assert tusimple([nine], [UPRIGHT], ROWS, 1280) == TuSimple(0.9, 0.0, 0.0)
    assert tusimple([eight], [UPRIGHT], ROWS, 1280) == TuSimple(0.8, 1.0, 1.0)
    # Rows on which neither has a lane are right; one on which only the prediction has one is wrong.
    assert tusimple([eight], [eight], ROWS, 1280).accuracy == 1.0
    assert tusimple([UPRIGHT], [nine], ROWS, 1280).accuracy == 0.9


def test_missed_and_invented_lanes_are_shares():
    left, right, other = UPRIGHT, UPRIGHT + 300, UPRIGHT + 600
    assert tusimple([left], [left, right], ROWS, 1280) == TuSimple(0.5, 0.0, 0.5)
    assert tusimple([left, right, other], [left, right], ROWS, 1280) == TuSimple(1.0, pytest.approx(1 / 3), 0.0)
    assert tusimple([], [left, right], ROWS, 1280) == TuSimple(0.0, 0.0, 1.0)
    assert tusimple([left] * 4, [left], ROWS, 1280) == TuSimple(0.0, 0.0, 1.0)


def test_one_line_that_matches_two_close_ones_is_not_invented_less_than_never():
    assert tusimple([UPRIGHT], [UPRIGHT - 5, UPRIGHT + 5], ROWS, 1280) == TuSimple(1.0, 0.0, 0.0)


def test_the_worst_of_five_lanes_is_forgiven():
    lanes = [UPRIGHT + 100 * k for k in range(5)]
    assert tusimple(lanes[:4], lanes, ROWS, 1280) == TuSimple(1.0, 0.0, 0.0)
    assert tusimple(lanes[:3], lanes, ROWS, 1280) == TuSimple(0.75, 0.0, 0.25)


def upright(u, top=100.0, bottom=500.0) -> np.ndarray:
    return np.array([[u, top], [u, bottom]])


@pytest.mark.parametrize(("width", "height", "near", "far"), [(1640, 590, 8, 12), (820, 590, 4, 6)])
def test_drawn_lines_match_up_to_a_third_of_their_width(width, height, near, far):
    # Two upright strips w wide, d apart, have an IoU of (w - d) / (w + d), one half at d = w / 3: 10 px of 30.
    true = upright(300.0)
    for d, expected in ((0, CuLane(1, 0, 0)), (near, CuLane(1, 0, 0)), (far, CuLane(0, 1, 1))):
        assert culane([upright(300.0 + d)], [true], (width, height)) == expected


def test_half_a_line_matches_no_whole_one_and_two_thirds_do():
    # Strips of one width: IoU is the ratio of their lengths, 200 and 270 of 400 px (round ends add about 30 to each).
    assert culane([upright(300.0, 100, 280)], [upright(300.0)], (1640, 590)) == CuLane(0, 1, 1)
    assert culane([upright(300.0, 100, 370)], [upright(300.0)], (1640, 590)) == CuLane(1, 0, 0)


def test_every_line_matches_at_most_one_other():
    left, right = upright(300.0), upright(800.0)
    size = (1640, 590)
    assert culane([left, upright(302.0)], [left, right], size) == CuLane(1, 1, 1)
    assert culane([right, left], [left, right], size) == CuLane(2, 0, 0)
    assert culane([left], [], size) == CuLane(0, 1, 0)
    assert culane([], [left, right], size) == CuLane(0, 0, 2)


def test_pairs_are_chosen_together():
    # The prediction between two true lines is nearer to the first, which the other prediction needs.
    first, second = upright(300.0), upright(312.0)
    between, before = upright(305.0), upright(297.0)
    assert culane([between, before], [first, second], (1640, 590)) == CuLane(2, 0, 0)


@pytest.mark.parametrize(("counts", "expected"), [((3, 1, 2), 6 / 9), ((0, 0, 4), 0.0), ((0, 0, 0), np.nan)])
def test_f1_of_all_lines(counts, expected):
    assert f1(*counts) == pytest.approx(expected, nan_ok=True)
