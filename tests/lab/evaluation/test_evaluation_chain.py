"""The errors of the whole chain against truth, and of points against labels."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from level_deck import CAMERA, GREY, LEFT, RIGHT, frame_at, pixels_of, points, result_of

from approach_scene import STILL
from deckline.cli.main import main
from deckline.recording import RecordingWriter
from deckline.types import DepthMode, Detection, LineVisibility
from deckline_lab.evaluation import label_errors
from deckline_lab.evaluation.chain import score_frame, summarise
from deckline_lab.evaluation.label_errors import score_labels

LEFT_PX = np.array([[100.0, 300.0], [250.0, 150.0], [300.0, 100.0]])  # u + v = 400
RIGHT_PX = np.array([[500.0, 300.0], [400.0, 100.0]])


def test_perfect_points_have_no_error_and_none_leave_no_errors():
    frame = frame_at()
    score = score_frame(result_of(frame, pixels_of(frame, LEFT), pixels_of(frame, RIGHT)), STILL.approach)
    blind = score_frame(result_of(frame, [], []), STILL.approach)
    assert score.seen == LineVisibility.BOTH
    assert score.mode == DepthMode.COARSE
    assert score.range_m == pytest.approx(100.0)
    for name in ("direction_error_deg.left", "lateral_error_at_ramp_m.right", "height_error_m.centre"):
        assert score.errors[name] == pytest.approx(0.0, abs=1e-4)
    assert score.errors["point_error_px.left"] == pytest.approx(0.0, abs=1e-6)
    assert not [name for name in blind.errors if "error" in name]
    figures = summarise([blind, score])
    assert figures["found_rate"] == figures["not_seen_rate"] == figures["mode_rate.coarse"] == 0.5
    assert figures["coarse.direction_error_deg.left.median"] == pytest.approx(0.0, abs=1e-4)


def test_a_line_seen_half_a_metre_aside_is_half_a_metre_wrong():
    frame = frame_at()
    score = score_frame(result_of(frame, pixels_of(frame, LEFT, 0.5), pixels_of(frame, RIGHT)), STILL.approach)
    assert score.errors["lateral_error_at_ramp_m.left"] == pytest.approx(0.5, abs=0.01)
    assert score.errors["lateral_error_at_ramp_m.centre"] == pytest.approx(0.25, abs=0.15)


def test_lines_in_an_empty_scene_are_false_lines():
    empty = frame_at(left=None, right=None)
    lines = pixels_of(frame_at(), LEFT), pixels_of(frame_at(), RIGHT)
    figures = summarise([score_frame(result_of(empty, *lines), STILL.approach)])
    assert figures["false_line_rate"] == 1.0
    assert "found_rate" not in figures


def test_restoration_is_compared_with_the_clear_view():
    clear = np.full_like(GREY, 128 + 16)
    frame = frame_at(clear_rgb=clear)
    score = score_frame(result_of(frame, [], []), STILL.approach)
    assert score.errors["psnr_db"] == pytest.approx(20 * np.log10(255 / 16))
    assert score.errors["psnr_db_hazy"] == score.errors["psnr_db"]


def test_a_frame_without_truth_is_refused_by_name():
    frame = dataclasses.replace(frame_at(), truth=None)
    result = result_of(frame, [], [])
    with pytest.raises(ValueError, match=r"a\.png"):
        score_frame(result, STILL.approach)


@pytest.mark.parametrize("sum_up", [summarise, label_errors.summarise])
def test_no_frames_at_all_is_an_error(sum_up):
    with pytest.raises(ValueError):
        sum_up([])


def test_a_stopped_command_reports_what_it_wrote(tmp_path, capsys, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    with RecordingWriter(tmp_path / "recording", scene={}) as writer:
        writer.add(frame_at())
    monkeypatch.setattr("deckline_lab.evaluation.chain.score_frame", stop)
    command = ["eval", "recording", str(tmp_path / "recording"), "--dehazer", "none", "--detector", "classical"]
    assert main(command) == 130
    assert "nothing was written" in capsys.readouterr().err


def score_pixels(left, right, left_label=LEFT_PX, right_label=RIGHT_PX):
    frame, detection = SimpleNamespace(file="a.png", camera=CAMERA), Detection(points(left), points(right))
    result = SimpleNamespace(frame=frame, detection=detection, estimate=SimpleNamespace(seen=LineVisibility.BOTH))
    return score_labels(result, {"left": left_label, "right": right_label})


def test_figures_of_known_errors():
    exact = score_pixels(LEFT_PX, RIGHT_PX)
    shifted = score_pixels(LEFT_PX + 2.0, [])
    assert exact.found and not shifted.found
    figures = label_errors.summarise([exact, shifted])
    assert figures["found_rate"] == 0.5
    assert figures["ok_rate"] == 1.0
    assert figures["worst_line_median_px"] == pytest.approx(2.0 * np.sqrt(2))
    assert "false_line_rate" not in figures


def test_points_where_nothing_is_labelled_are_false():
    empty, wrong = (score_pixels(left, [], None, None) for left in ([], LEFT_PX))
    assert label_errors.summarise([empty, wrong]) == {"frames": 2.0, "false_line_rate": 0.5}
    assert np.all(np.isinf(wrong.errors_px["left"]))
