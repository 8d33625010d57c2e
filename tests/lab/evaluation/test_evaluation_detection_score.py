"""Scores of detections, and the published lane scores."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from level_deck import CAMERA, deck, frame_at, points

from deckline.geometry import Camera
from deckline.types import Detection
from deckline_lab.evaluation.detection_score import (
    DetectionScore,
    calibration,
    groups,
    reliability,
    score_detection,
    summarise,
)
from deckline_lab.evaluation.detection_truth import SceneKind
from deckline_lab.evaluation.frames import FrameSample
from deckline_lab.evaluation.lane_scores import CuLane, TuSimple, culane, f1, tusimple
from deckline_lab.labels.lines import resample

ROWS = np.arange(0.0, 100.0, 10.0)
UPRIGHT = np.full(10, 100.0)


def sample_at(x_m: float, camera: Camera = CAMERA, **truth) -> FrameSample:
    return FrameSample(frame_at(x_m, camera=camera, **truth), "data", 7, "paper")


def sea(points: int, confidence=0.9, right=0) -> DetectionScore:
    lines = CuLane(0, (points > 0) + (right > 0), 0)
    return deck([np.inf] * points, [np.inf] * right, confidence, scene=SceneKind.EMPTY, tusimple=None, culane=lines)


def test_rates_and_errors_of_known_frames():
    missed = deck([], [4.0], tusimple=TuSimple(0.5, 0.0, 0.5), culane=CuLane(1, 0, 1))
    astray = deck([1.0, 2.0], [50.0])
    hidden = deck([7.0], [7.0], scene=SceneKind.UNRATED)
    figures = summarise([deck(), missed, astray, hidden, sea(0), sea(2), sea(1, right=1), sea(0)])
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
    assert figures["false_rate"] == 0.5 and figures["false_pair_rate"] == 0.25


def test_figures_that_do_not_exist_are_left_out():
    figures = summarise([sea(0)])
    assert figures == {"frames": 1.0, "decks": 0.0, "empty": 1.0, "false_rate": 0.0, "false_pair_rate": 0.0}
    assert "error_px.median" not in summarise([deck([], [])])
    with pytest.raises(ValueError):
        summarise([])


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
    result = reliability([deck([1.0], [9.0], 0.75), sea(2, 0.75), deck([0.0], [0.0], scene=SceneKind.UNRATED)])
    assert result.bins[7].points == 4
    assert result.bins[7].right == 0.25


def test_confidences_that_are_none_are_refused():
    with pytest.raises(ValueError, match=r"confidence.*1\.5"):
        calibration([0.5, 1.5], [True, True])
    with pytest.raises(ValueError, match=r"\(1,\) and \(2,\)"):
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
        deck(scene=SceneKind.UNRATED, left=[900.0]),
        sea(0),
        deck([1.0], [1.0]),
        deck([1.0], [30.0]),
        sea(3),
        deck([], [1.0], extent_px=200.0),
        deck([], [], extent_px=20.0),
        deck([], [], extent_px=200.0),
    ]
    ranks = [score.badness for score in order]
    assert ranks == sorted(ranks)


def test_contrast_is_the_fainter_lines_however_many_points_it_has():
    image = np.full((360, 640, 3), 40, np.uint8)
    image[:, 192:209] = 140  # a twelfth of the way to the other line
    image[:, 392:409] = 60
    frame = dataclasses.replace(sample_at(-100.0).frame, image_rgb=image)
    left, right = (np.array([[u, 300.0], [u, 100.0]]) for u in (200.0, 400.0))
    nothing = Detection(points([]), points([]))
    for lines in ((left, right), (resample(left, 40), resample(right, 300))):
        sample = FrameSample(frame, "data", 0, "labelled", dict(zip(("left", "right"), lines, strict=True)))
        assert score_detection(sample, nothing).contrast == pytest.approx(20.0, rel=0.2)
    alone = FrameSample(frame, "data", 0, "labelled", {"left": left, "right": None})
    assert np.isnan(score_detection(alone, nothing).contrast)


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.05, 0.01, 0.0, 0.0, 0.0)])
def test_errors_are_normal_distances_to_the_true_line(distortion):
    camera = Camera(640, 360, 320.0, 320.0, 319.5, 179.5, distortion)
    sample = sample_at(-100.0, camera=camera)
    expected = sample.expected
    exact = score_detection(sample, Detection(*(points(expected.lines_px[s][::8]) for s in ("left", "right"))))
    assert max(exact.errors_px["left"] + exact.errors_px["right"]) < 1e-3
    assert exact.found == 2 and exact.placed
    assert exact.tusimple.accuracy > 0.95
    assert exact.culane == CuLane(2, 0, 0)
    left, right = (expected.lines_px[side][::8] for side in ("left", "right"))
    off = score_detection(sample, Detection(points(left + np.array([9.0, 0.0])), points(right)))
    assert off.found == 2 and not off.placed
    if not any(distortion):
        # The left line runs 10 m aside and 20 m below: its image has the slope du/dv = -1/2.
        normal = np.array([2.0, 1.0]) / np.sqrt(5)
        moved = points(expected.lines_px["left"][::8] + 1.4 * normal)
        score = score_detection(sample, Detection(moved, points([])))
        np.testing.assert_allclose(score.errors_px["left"], 1.4, atol=1e-3)
        assert score.right_px == 1.5  # 3 px of 1280
        assert score.found == 1 and not score.placed
        assert score.tusimple == TuSimple(pytest.approx(0.5, abs=0.03), 0.0, 0.5)
        assert score.culane == CuLane(1, 0, 1)


def test_points_where_there_is_nothing_are_infinitely_wrong():
    sample = sample_at(-100.0, left=None, right=None)
    seen = Detection(points([[10, 10], [20, 50], [30, 90]]), points([]))
    score = score_detection(sample, seen)
    assert score.errors_px == {"left": [np.inf] * 3, "right": []}
    assert score.found == 1
    assert score.tusimple is None
    assert score.culane == CuLane(0, 1, 0)
    assert score.extent_px == 0.0


def test_a_score_survives_a_line_of_json():
    for sample in (sample_at(-100.0), sample_at(-100.0, left=None, right=None, visibility_m=np.inf)):
        seen = Detection(points([[10, 10], [20, 50]]), points([[1.0, 2.0]], 0.123456789))
        score = score_detection(sample, seen)
        again = DetectionScore(**json.loads(json.dumps(dataclasses.asdict(score))))
        assert json.dumps(dataclasses.asdict(again)) == json.dumps(dataclasses.asdict(score))
        assert summarise([again]) == summarise([score])


def on_rows(line, without=()) -> np.ndarray:
    line = np.array(line, dtype=float)
    line[list(without)] = np.nan
    return line


NINE, EIGHT = on_rows(UPRIGHT, [0]), on_rows(UPRIGHT, [0, 1])
SLANTED = 100.0 + ROWS  # 45 degrees: 20 px normal to the lane are 28.28 px along a row
LANES = [UPRIGHT + 100 * k for k in range(5)]


@pytest.mark.parametrize(
    ("predicted", "true", "expected"),
    [
        # A point is right within 20 px of 1280; the tolerance grows as a lane turns level.
        ([UPRIGHT], [UPRIGHT], (1.0, 0.0, 0.0)),
        ([UPRIGHT + 19.9], [UPRIGHT], (1.0, 0.0, 0.0)),
        ([UPRIGHT + 20.1], [UPRIGHT], (0.0, 1.0, 1.0)),
        ([SLANTED + 28.2], [SLANTED], (1.0, 0.0, 0.0)),
        ([SLANTED + 28.4], [SLANTED], (0.0, 1.0, 1.0)),
        # A lane matches from 85 % on. Rows on which neither has a lane are right, those of one alone are wrong.
        ([NINE], [UPRIGHT], (0.9, 0.0, 0.0)),
        ([EIGHT], [UPRIGHT], (0.8, 1.0, 1.0)),
        ([EIGHT], [EIGHT], (1.0, 0.0, 0.0)),
        ([UPRIGHT], [NINE], (0.9, 0.0, 0.0)),
        # Missed and invented lanes are shares; more than two too many score nothing.
        (LANES[:1], LANES[:2], (0.5, 0.0, 0.5)),
        (LANES[:3], LANES[:2], (1.0, 1 / 3, 0.0)),
        ([], LANES[:2], (0.0, 0.0, 1.0)),
        ([UPRIGHT] * 4, [UPRIGHT], (0.0, 0.0, 1.0)),
        # One line that matches two close ones is not invented less than never; the worst of five lanes is forgiven.
        ([UPRIGHT], [UPRIGHT - 5, UPRIGHT + 5], (1.0, 0.0, 0.0)),
        (LANES[:4], LANES, (1.0, 0.0, 0.0)),
        (LANES[:3], LANES, (0.75, 0.0, 0.25)),
    ],
)
def test_tusimple_of_known_lanes(predicted, true, expected):
    assert tusimple(predicted, true, ROWS, 1280) == pytest.approx(expected)
    halved = [[line / 2 for line in lines] for lines in (predicted, true)]  # the tolerance scales with the width
    assert tusimple(*halved, ROWS / 2, 640) == pytest.approx(expected)


def upright(u, top=100.0, bottom=500.0) -> np.ndarray:
    return np.array([[u, top], [u, bottom]])


@pytest.mark.parametrize(("width", "height", "near", "far"), [(1640, 590, 8, 12), (820, 590, 4, 6)])
def test_drawn_lines_match_up_to_a_third_of_their_width(width, height, near, far):
    # Two upright strips w wide, d apart, have an IoU of (w - d) / (w + d), one half at d = w / 3: 10 px of 30.
    true = upright(300.0)
    for d, expected in ((0, CuLane(1, 0, 0)), (near, CuLane(1, 0, 0)), (far, CuLane(0, 1, 1))):
        assert culane([upright(300.0 + d)], [true], (width, height)) == expected
    # Of strips of one width the IoU is the ratio of their lengths: of half a line, and of two thirds.
    assert culane([upright(300.0, 100, 280)], [true], SIZE) == CuLane(0, 1, 1)
    assert culane([upright(300.0, 100, 370)], [true], SIZE) == CuLane(1, 0, 0)


SIZE = (1640, 590)


@pytest.mark.parametrize(
    ("predicted", "true", "expected"),
    [
        # Every line matches at most one other one.
        ([300.0, 302.0], [300.0, 800.0], (1, 1, 1)),
        ([800.0, 300.0], [300.0, 800.0], (2, 0, 0)),
        ([300.0], [], (0, 1, 0)),
        ([], [300.0, 800.0], (0, 0, 2)),
        # Pairs are chosen together: 305 is nearer to 300, which 297 needs.
        ([305.0, 297.0], [300.0, 312.0], (2, 0, 0)),
    ],
)
def test_culane_of_known_upright_lines(predicted, true, expected):
    assert culane([upright(u) for u in predicted], [upright(u) for u in true], SIZE) == CuLane(*expected)


@pytest.mark.parametrize(("counts", "expected"), [((3, 1, 2), 6 / 9), ((0, 0, 4), 0.0), ((0, 0, 0), np.nan)])
def test_f1_of_all_lines(counts, expected):
    assert f1(*counts) == pytest.approx(expected, nan_ok=True)
