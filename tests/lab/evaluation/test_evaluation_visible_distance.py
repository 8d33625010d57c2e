import math
from dataclasses import replace

import numpy as np
import pytest

from approach_scene import chain, frame
from deckline_lab.evaluation.visible_distance import (
    CELLS,
    ApproachFrame,
    are_right,
    first_held_m,
    is_right,
    near_width_px,
    tolerance_px,
    visible_distance,
    visible_tables,
)


def approach(right_from_m, name="a", start_m=800.0, visibility_m=1000.0, rate_hz=10.0, wrong=(), speed_m_s=50.0):
    """Down to 50 m; right at `right_from_m` and nearer, but in the frames `wrong`."""
    count = round((start_m - 50.0) / speed_m_s * rate_hz) + 1
    ranges = start_m - speed_m_s / rate_hz * np.arange(count)
    return [
        ApproachFrame(name, k / rate_hz, r, visibility_m, r <= right_from_m and k not in wrong)
        for k, r in enumerate(ranges)
    ]


def test_lines_are_held_from_the_first_frame_on_that_is_right_with_the_second_after_it():
    assert first_held_m(approach(500.0)) == 500.0
    assert first_held_m(approach(500.0)[::-1]) == 500.0  # in order of time
    flown = approach(500.0)
    lucky = [each._replace(is_right=each.is_right or k == 5) for k, each in enumerate(flown)]
    assert first_held_m(lucky) == 500.0  # one right frame is not held


@pytest.mark.parametrize(("wrong", "held_m"), [((61, 62), 500.0), ((61, 62, 63), 480.0), ((60,), 495.0)])
def test_two_frames_in_ten_may_be_wrong_but_not_the_first(wrong, held_m):
    assert first_held_m(approach(500.0, wrong=wrong)) == held_m


def test_an_approach_that_is_never_held_counts_as_0_m():
    assert first_held_m(approach(0.0)) == 0.0
    assert first_held_m(approach(80.0)) == 0.0  # the recording ends within the second
    assert first_held_m(approach(95.0)) == 95.0


def test_what_is_no_approach_has_no_figure():
    assert first_held_m(approach(500.0, rate_hz=3.0)) > 0
    sparse = approach(500.0, rate_hz=2.5)
    flown = approach(500.0)
    views = [replace_range(each, 800.0 - 300.0 * (k % 2) - k) for k, each in enumerate(flown)]
    no_runway = [replace_range(each, math.nan) for each in flown]
    away = [replace_range(each, each.range_m - 2 * (each.range_m - 800.0)) for each in flown]
    for frames in (sparse, views, no_runway, away, flown[:5], flown[:1], []):
        assert math.isnan(first_held_m(frames))
    assert visible_distance(sparse) == {}


def replace_range(each, range_m):
    return each._replace(range_m=range_m)


def test_nine_of_ten_approaches_hold_the_lines_at_the_distance_of_90_percent():
    held = [100.0 * k for k in range(1, 11)]
    flown = [each for k, m in enumerate(held) for each in approach(m, str(k), start_m=1000.0, visibility_m=2000.0)]
    figures = visible_distance(flown)
    assert figures["approaches"] == 10
    assert (figures["first_held_m.50"], figures["first_held_m.90"]) == (600.0, 200.0)
    # begins at 1000 m, nearer than the visibility
    assert (figures["first_held_of_visibility.50"], figures["first_held_of_visibility.90"]) == (0.6, 0.2)
    assert sum(m >= figures["first_held_m.90"] for m in held) == 9


def test_the_share_is_of_the_visibility_where_the_approach_begins_beyond_it():
    figures = visible_distance(approach(400.0, visibility_m=500.0))
    assert figures["first_held_of_visibility.90"] == 0.8
    assert visible_distance(approach(400.0, visibility_m=math.inf))["first_held_of_visibility.90"] == 0.5
    unknown = visible_distance(approach(400.0, visibility_m=math.nan))
    assert unknown == {"approaches": 1.0, "first_held_m.50": 400.0, "first_held_m.90": 400.0}


def test_one_approach_in_ten_that_is_never_held_is_the_tenth_two_are_the_90_percent():
    def flown(never):
        return [each for k in range(10) for each in approach(0.0 if k < never else 600.0, str(k))]

    assert visible_distance(flown(1))["first_held_m.90"] == 600.0
    assert visible_distance(flown(2))["first_held_m.90"] == 0.0


def test_a_table_names_its_rows_and_there_is_none_without_an_approach():
    [table] = visible_tables([(("hybrid", "none"), visible_distance(approach(400.0))), (("x", "y"), {})], ("a", "b"))
    assert table.columns == ("a", "b", *CELLS)
    assert table.rows == [("hybrid", "none", "1", "400", "400", "50", "50"), ("x", "y", *["-"] * len(CELLS))]
    assert visible_tables([(("hybrid",), {})], ("a",)) == []


def test_a_wide_runway_allows_5_percent_of_its_width_and_a_narrow_one_3_px():
    left, right = np.array([[100.0, 400.0], [140.0, 200.0]]), np.array([[240.0, 380.0], [160.0, 200.0]])
    assert near_width_px(left, right) == pytest.approx(240.0 - 104.0)  # in row 380, the lowest that both reach
    assert math.isnan(near_width_px(left, None))
    assert math.isnan(near_width_px(left, right - [0.0, 300.0]))
    assert tolerance_px(1280) == tolerance_px(1280, 60.0) == tolerance_px(1280, math.nan) == 3.0
    assert tolerance_px(1280, 200.0) == 10.0
    assert tolerance_px(640, 40.0) == 2.0


def test_both_lines_are_right_when_half_of_their_points_are():
    assert are_right([[1.0, 2.0, 90.0], [3.0]], 3.0)
    assert not are_right([[1.0, 4.0, 90.0], [3.0]], 3.0)
    assert not are_right([[1.0], []], 3.0)


def test_a_detection_is_compared_with_the_projected_truth():
    at = frame(range_m=100.0)
    found = chain(at, ("left", "right")).detection
    assert is_right(at, found)
    assert not is_right(at, chain(at, ("left",)).detection)
    assert not is_right(replace(at, truth=None), found)
    aside = replace(found, left=replace(found.left, points_px=found.left.points_px + np.array([30.0, 0.0])))
    assert not is_right(at, aside)
