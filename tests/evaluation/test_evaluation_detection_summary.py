from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline.evaluation.detection_lanes import CuLane, TuSimple
from deckline.evaluation.detection_measure import DetectionScore, Scene
from deckline.evaluation.detection_summary import badness, calibration, groups, reliability, summarise_detection


def deck(left=(1.0,), right=(1.0,), confidence=0.9, **changes) -> DetectionScore:
    score = DetectionScore(
        "data",
        0,
        "a.png",
        "paper",
        Scene.DECK,
        150.0,
        800.0,
        1280,
        100.0,
        {"left": list(left), "right": list(right)},
        {"left": [confidence] * len(left), "right": [confidence] * len(right)},
        TuSimple(0.9, 0.0, 0.0),
        CuLane(2, 0, 0),
    )
    return replace(score, **changes)


def sea(points: int, confidence=0.9) -> DetectionScore:
    return deck([np.inf] * points, [], confidence, scene=Scene.EMPTY, tusimple=None, culane=CuLane(0, points > 0, 0))


def test_rates_and_errors_of_known_frames():
    missed = deck([], [4.0], tusimple=TuSimple(0.5, 0.0, 0.5), culane=CuLane(1, 0, 1))
    astray = deck([1.0, 2.0], [50.0])
    hidden = deck([7.0], [7.0], scene=Scene.UNRATED)
    figures = summarise_detection([deck(), missed, astray, hidden, sea(0), sea(2), sea(0), sea(0)])
    assert figures["frames"] == 8 and figures["decks"] == 3 and figures["empty"] == 4
    assert figures["found_rate"] == pytest.approx(2 / 3)
    assert figures["placed_rate"] == pytest.approx(1 / 3)
    assert figures["one_line_rate"] == pytest.approx(1 / 3)
    assert figures["error_px.median"] == np.median([1, 1, 4, 1, 2, 50])
    assert figures["error_px.p95"] == np.percentile([1, 1, 4, 1, 2, 50], 95)
    assert figures["worst_line_px"] == 50.0
    assert figures["tusimple.accuracy"] == pytest.approx((0.9 + 0.5 + 0.9) / 3)
    assert figures["tusimple.false_negative"] == pytest.approx(0.5 / 3)
    assert figures["culane.f1"] == pytest.approx(2 * 5 / (2 * 5 + 1))
    assert figures["false_rate"] == 0.25


def test_what_cannot_be_said_is_left_out():
    figures = summarise_detection([sea(0)])
    assert figures == {"frames": 1.0, "decks": 0.0, "empty": 1.0, "false_rate": 0.0}
    assert "error_px.median" not in summarise_detection([deck([], [])])
    with pytest.raises(ValueError, match="no frame could be evaluated"):
        summarise_detection([])


def test_calibration_error_in_closed_form():
    # Ten points at 0.95, nine right; ten at 0.55, five right: |0.95 - 0.9| and |0.55 - 0.5|, half of all each.
    confidence = [0.95] * 10 + [0.55] * 10
    result = calibration(confidence, [True] * 9 + [False] + [True] * 5 + [False] * 5)
    assert result.expected_calibration_error == pytest.approx(0.05)
    assert [b.points for b in result.bins] == [0, 0, 0, 0, 0, 10, 0, 0, 0, 10]
    assert result.bins[9].right == pytest.approx(0.9)
    assert result.bins[5].confidence == pytest.approx(0.55)
    assert np.isnan(result.bins[0].right)
    assert np.isnan(calibration([], []).expected_calibration_error)


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), min_size=1, max_size=50))
def test_calibration_error_is_between_the_overall_gap_and_one(pairs):
    confidence, right = zip(*pairs, strict=True)
    result = calibration(confidence, right)
    overall = abs(np.mean(confidence) - np.mean(right))
    assert overall - 1e-9 <= result.expected_calibration_error <= 1 + 1e-9
    assert sum(b.points for b in result.bins) == len(pairs)
    assert calibration(confidence, right, 1).expected_calibration_error == pytest.approx(overall)


def test_points_on_the_open_sea_count_as_wrong_and_unrated_frames_not_at_all():
    result = reliability([deck([1.0], [9.0], 0.75), sea(2, 0.75), deck([0.0], [0.0], scene=Scene.UNRATED)])
    assert result.bins[7].points == 4
    assert result.bins[7].right == 0.25


def test_confidences_that_are_none_are_refused():
    with pytest.raises(ValueError, match=r"confidence must lie in 0\.\.1, got 0\.5 to 1\.5"):
        calibration([0.5, 1.5], [True, True])
    with pytest.raises(ValueError, match=r"as many confidences as answers, got \(1,\) and \(2,\)"):
        calibration([0.5], [True, True])


def test_groups_hold_every_frame_that_has_the_value_once():
    scores = [
        deck(range_m=50.0, visibility_m=150.0, ship="cvn", light=0.25),
        deck(range_m=100.0, visibility_m=np.inf, light=1.0),
        deck(range_m=np.nan, visibility_m=np.nan),
    ]
    found = groups(scores)
    assert {name: len(members) for name, members in found["range to the ramp"].items()} == {
        "0 to 100 m": 1,
        "100 to 200 m": 1,
    }
    assert list(found["visibility"]) == ["0 to 200 m", "2000 m and more"]
    assert list(found["light through the air"]) == ["10 to 30 %", "60 % and more"]
    assert {name: len(members) for name, members in found["ship"].items()} == {"cvn": 1, "paper": 2}


def test_the_worst_frames_are_lost_and_invented_lines_then_errors_then_larger_decks():
    order = [
        deck(scene=Scene.UNRATED, left=[900.0]),
        sea(0),
        deck([1.0], [1.0]),
        deck([1.0], [30.0]),
        sea(3),
        deck([], [1.0], extent_px=200.0),
        deck([], [], extent_px=20.0),
        deck([], [], extent_px=200.0),
    ]
    ranks = [badness(score) for score in order]
    assert ranks == sorted(ranks)
