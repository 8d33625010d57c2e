from types import SimpleNamespace

import numpy as np
import pytest

from deckline.evaluation.labels import score_labels, summarise_labels
from deckline.geometry import Camera
from deckline.types import Detection, LinePoints, Status

CAMERA = Camera.from_fov(640, 360, np.deg2rad(60.0))
LEFT = np.array([[100.0, 300.0], [250.0, 150.0], [300.0, 100.0]])  # u + v = 400
RIGHT = np.array([[500.0, 300.0], [400.0, 100.0]])


def points(pixels):
    pixels = np.asarray(pixels, dtype=float).reshape(-1, 2)
    return LinePoints(pixels, np.ones(len(pixels)), np.ones(len(pixels)))


def result(left, right, status=Status.OK):
    frame = SimpleNamespace(file="a.png", camera=CAMERA)
    return SimpleNamespace(
        frame=frame, detection=Detection(points(left), points(right)), estimate=SimpleNamespace(status=status)
    )


def labels_of(left=LEFT, right=RIGHT):
    return {"left": left, "right": right}


def test_figures_of_known_errors():
    exact = score_labels(result(LEFT, RIGHT), labels_of())
    shifted = score_labels(result(LEFT + 2.0, []), labels_of())
    assert exact.found and not shifted.found
    figures = summarise_labels([exact, shifted])
    assert figures["found_rate"] == 0.5
    assert figures["ok_rate"] == 1.0
    assert figures["worst_line_median_px"] == pytest.approx(2.0 * np.sqrt(2))
    assert "false_line_rate" not in figures


def test_points_where_nothing_is_labelled_are_false():
    empty, wrong = (score_labels(result(left, []), labels_of(None, None)) for left in ([], LEFT))
    assert summarise_labels([empty, wrong]) == {"frames": 2.0, "false_line_rate": 0.5}
    assert np.all(np.isinf(wrong.errors_px["left"]))


def test_no_frames_are_no_figures():
    with pytest.raises(ValueError, match="no labelled frame"):
        summarise_labels([])
