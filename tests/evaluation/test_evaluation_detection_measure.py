import dataclasses
import json

import numpy as np
import pytest

from deckline.evaluation.detection_lanes import CuLane, TuSimple
from deckline.evaluation.detection_measure import (
    Scene,
    expected_from_labels,
    expected_from_truth,
    score_detection,
    score_from_mapping,
    score_to_mapping,
)
from deckline.geometry import Camera, attitude, pose
from deckline.labels.lines import resampled
from deckline.types import Detection, Frame, LinePoints, Segment, Truth

CAMERA = Camera.from_fov(640, 360, np.pi / 2)
LEFT = Segment(np.array([0.0, -10.0, 0.0]), np.array([200.0, -10.0, 0.0]))
RIGHT = Segment(np.array([0.0, 10.0, 0.0]), np.array([200.0, 10.0, 0.0]))


def frame_at(x_m: float, yaw_rad: float = 0.0, camera: Camera = CAMERA, **truth) -> Frame:
    """20 m above the lines' plane, `-x_m` before the ramp."""
    image = np.zeros((camera.height, camera.width, 3), np.uint8)
    turned = attitude(0.0, 0.0, yaw_rad).as_quat(scalar_first=True)
    known = Truth(**({"left": LEFT, "right": RIGHT, "visibility_m": 800.0} | truth))
    return Frame("a.png", 0.0, image, camera, world_from_body=pose([x_m, 0.0, -20.0], turned), truth=known)


def points(pixels, confidence=0.9) -> LinePoints:
    pixels = np.asarray(pixels, dtype=float).reshape(-1, 2)
    return LinePoints(pixels, np.full(len(pixels), confidence), np.ones(len(pixels)))


def test_what_there_is_to_find():
    both = expected_from_truth(frame_at(-100.0))
    assert both.scene is Scene.DECK
    assert both.range_m == pytest.approx(100.0)
    assert both.visibility_m == 800.0
    assert expected_from_truth(frame_at(-100.0, left=None, right=None)).scene is Scene.EMPTY
    assert expected_from_truth(frame_at(-100.0, yaw_rad=np.pi)).scene is Scene.EMPTY  # looking away
    assert expected_from_truth(frame_at(-100.0, visibility_m=50.0)).scene is Scene.UNRATED  # hidden in haze
    assert expected_from_truth(frame_at(300.0, yaw_rad=np.pi)).scene is Scene.UNRATED  # from ahead: left is right
    assert expected_from_truth(frame_at(-9000.0, visibility_m=np.inf)).scene is Scene.UNRATED  # a pixel or two
    # Turned so far that the left line alone is in the image.
    assert expected_from_truth(frame_at(-30.0, yaw_rad=np.deg2rad(53.0))).scene is Scene.UNRATED


def test_labels_say_it_too():
    line = np.array([[1.0, 2.0], [3.0, 4.0]])
    for left, right, scene in ((line, line, Scene.DECK), (line, None, Scene.UNRATED), (None, None, Scene.EMPTY)):
        assert expected_from_labels({"left": left, "right": right}, frame_at(-100.0).image_rgb).scene is scene


def test_contrast_is_the_fainter_lines_however_many_points_say_where_it_is():
    image = np.full((360, 640, 3), 40, np.uint8)
    image[:, 192:209] = 140  # a twelfth of the way to the other line
    image[:, 392:409] = 60
    frame = dataclasses.replace(frame_at(-100.0), image_rgb=image)
    left, right = (np.array([[u, 300.0], [u, 100.0]]) for u in (200.0, 400.0))
    nothing = Detection(points([]), points([]))
    for lines in ((left, right), (resampled(left, 40), resampled(right, 300))):
        expected = expected_from_labels(dict(zip(("left", "right"), lines, strict=True)), image)
        assert score_detection(frame, nothing, expected).contrast == pytest.approx(20.0, rel=0.2)
    alone = expected_from_labels({"left": left, "right": None}, image)
    assert np.isnan(score_detection(frame, nothing, alone).contrast)


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.05, 0.01, 0.0, 0.0, 0.0)])
def test_errors_are_normal_distances_to_the_true_line(distortion):
    camera = Camera(640, 360, 320.0, 320.0, 319.5, 179.5, distortion)
    frame = frame_at(-100.0, camera=camera)
    expected = expected_from_truth(frame)
    exact = score_detection(frame, Detection(*(points(expected.lines_px[s][::8]) for s in ("left", "right"))), expected)
    assert max(exact.errors_px["left"] + exact.errors_px["right"]) < 1e-3
    assert exact.found == 2 and exact.placed
    assert exact.tusimple.accuracy > 0.95
    assert exact.culane == CuLane(2, 0, 0)
    if not any(distortion):
        # The left line runs 10 m aside and 20 m below: its image has the slope du/dv = -1/2.
        normal = np.array([2.0, 1.0]) / np.sqrt(5)
        moved = points(expected.lines_px["left"][::8] + 1.4 * normal)
        score = score_detection(frame, Detection(moved, points([])), expected)
        np.testing.assert_allclose(score.errors_px["left"], 1.4, atol=1e-3)
        assert score.right_px == 1.5  # 3 px of 1280
        assert score.found == 1 and not score.placed
        assert score.tusimple == TuSimple(pytest.approx(0.5, abs=0.03), 0.0, 0.5)
        assert score.culane == CuLane(1, 0, 1)


def test_half_the_points_far_off_are_found_but_not_placed():
    frame = frame_at(-100.0)
    expected = expected_from_truth(frame)
    left, right = (expected.lines_px[side][::8] for side in ("left", "right"))
    score = score_detection(frame, Detection(points(left + np.array([9.0, 0.0])), points(right)), expected)
    assert score.found == 2 and not score.placed


def test_points_where_there_is_nothing_are_infinitely_wrong():
    frame = frame_at(-100.0, left=None, right=None)
    seen = Detection(points([[10, 10], [20, 50], [30, 90]]), points([]))
    score = score_detection(frame, seen, expected_from_truth(frame))
    assert score.errors_px == {"left": [np.inf] * 3, "right": []}
    assert score.found == 1
    assert score.tusimple is None
    assert score.culane == CuLane(0, 1, 0)
    assert score.extent_px == 0.0


def test_a_score_survives_a_line_of_json():
    empty = frame_at(-100.0, left=None, right=None, visibility_m=np.inf)
    for frame in (frame_at(-100.0), empty):
        seen = Detection(points([[10, 10], [20, 50]]), points([[1.0, 2.0]], 0.123456789))
        score = score_detection(frame, seen, expected_from_truth(frame), "data", 7, "paper")
        line = json.dumps(score_to_mapping(score), allow_nan=False)
        again = score_from_mapping(json.loads(line))
        for item in dataclasses.fields(score):
            ours, theirs = getattr(score, item.name), getattr(again, item.name)
            assert ours == theirs or (ours != ours and theirs != theirs), item.name
        assert type(again.scene) is Scene


def test_frames_without_truth_or_pose_are_named():
    with pytest.raises(ValueError, match=r"a\.png has no truth"):
        expected_from_truth(dataclasses.replace(frame_at(-100.0), truth=None))
    with pytest.raises(ValueError, match=r"a\.png: no pose"):
        expected_from_truth(dataclasses.replace(frame_at(-100.0), world_from_body=None))
