import numpy as np
import pytest

from deckline.labels.lines import LabelledImage, at_rows, left_and_right, resampled


def line(*points):
    return np.array(points, dtype=float)


def test_rows_are_crossed_where_the_line_is_and_nowhere_else():
    bent = line((100, 300), (200, 200), (200, 100))
    np.testing.assert_allclose(at_rows(bent, [301, 300, 250, 200, 150, 99]), [np.nan, 100, 150, 200, 200, np.nan])
    np.testing.assert_allclose(at_rows(bent[::-1], [250, 150]), [150, 200])


def test_a_level_line_has_no_rows_but_its_own_and_no_position_on_it():
    assert np.isnan(at_rows(line((10, 50), (90, 50)), [49, 50, 51])).all()


def test_resampling_is_even_and_keeps_the_ends():
    corner = resampled(line((0, 0), (30, 0), (30, 10)), 5)
    np.testing.assert_allclose(corner, [[0, 0], [10, 0], [20, 0], [30, 0], [30, 10]])


def test_left_is_left_on_the_rows_that_both_lines_have():
    # Seen from far right: on shared rows the first is left, though its middle lies right of the other's.
    long, short = line((600, 300), (200, 100)), line((260, 120), (240, 100))
    assert left_and_right([long, short], "x")[0] is long
    assert left_and_right([short, long], "x")[0] is long
    apart = line((50, 90), (60, 10)), line((10, 300), (20, 200))
    assert left_and_right(apart, "x")[0] is apart[1]


def test_lines_that_cannot_be_told_apart_are_refused_by_name():
    one = line((0, 0), (1, 1))
    assert left_and_right([], "f") == (None, None)
    with pytest.raises(ValueError, match="f: line 3: one line alone"):
        left_and_right([one], "f: line 3")
    with pytest.raises(ValueError, match="f: 3 lines; a runway has two"):
        left_and_right([one] * 3, "f")


def test_a_line_needs_two_finite_points():
    with pytest.raises(ValueError, match=r"a\.png: right_px must be two or more"):
        LabelledImage("a.png", None, line((1, 2)))
    with pytest.raises(ValueError, match=r"a\.png: left_px must be two or more"):
        LabelledImage("a.png", line((1, 2), (np.nan, 3)), None)
