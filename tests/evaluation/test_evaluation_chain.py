import dataclasses

import numpy as np
import pytest

from approach_scene import STILL
from deckline.cli.main import main
from deckline.evaluation.chain import score_frame, summarise
from deckline.flight import FrameResult
from deckline.geometry import Camera, pose
from deckline.guide import guidance
from deckline.localize import localize
from deckline.recording import RecordingWriter
from deckline.types import DepthMode, Detection, Frame, LinePoints, Segment, Status, Truth

LEFT = Segment(np.array([0.0, -10.0, 0.0]), np.array([200.0, -10.0, 0.0]))
RIGHT = Segment(np.array([0.0, 10.0, 0.0]), np.array([200.0, 10.0, 0.0]))
CAMERA = Camera.from_fov(640, 360, np.pi / 2)
GREY = np.full((360, 640, 3), 128, np.uint8)


def frame_at(x_m: float = -100.0, **truth) -> Frame:
    return Frame(
        file="a.png",
        time_s=0.0,
        image_rgb=GREY,
        camera=CAMERA,
        world_from_body=pose([x_m, 0.0, -20.0], [1.0, 0.0, 0.0, 0.0]),
        deck_z_m=0.0,
        truth=Truth(**({"left": LEFT, "right": RIGHT, "visibility_m": 800.0} | truth)),
    )


def seen(frame: Frame, segment: Segment, shift_m: float = 0.0) -> LinePoints:
    steps = np.linspace(0.05, 0.95, 30)[:, None]
    world = segment.p0_m + steps * (segment.p1_m - segment.p0_m) + [0.0, shift_m, 0.0]
    points = frame.camera.project(frame.world_from_camera.inv().apply(world))
    return LinePoints(points, np.ones(len(points)), np.full(len(points), 0.3))


def result_of(frame: Frame, left: LinePoints, right: LinePoints) -> FrameResult:
    detection = Detection(left, right)
    estimate = localize(frame, detection, STILL, np.random.default_rng(0))
    return FrameResult(
        frame, GREY, detection, estimate, guidance(frame, estimate, None, STILL.approach), {"detect": 0.5}
    )


def test_perfect_points_have_no_error():
    frame = frame_at()
    score = score_frame(result_of(frame, seen(frame, LEFT), seen(frame, RIGHT)), STILL.approach)
    assert score.status == Status.OK
    assert score.mode == DepthMode.COARSE
    assert score.range_m == pytest.approx(100.0)
    for name in ("direction_error_deg.left", "lateral_error_at_ramp_m.right", "height_error_m.centre"):
        assert score.errors[name] == pytest.approx(0.0, abs=1e-4)
    assert score.errors["point_error_px.left"] == pytest.approx(0.0, abs=1e-6)


def test_a_line_seen_half_a_metre_aside_is_half_a_metre_wrong():
    frame = frame_at()
    score = score_frame(result_of(frame, seen(frame, LEFT, 0.5), seen(frame, RIGHT)), STILL.approach)
    assert score.errors["lateral_error_at_ramp_m.left"] == pytest.approx(0.5, abs=0.01)
    assert score.errors["lateral_error_at_ramp_m.centre"] == pytest.approx(0.25, abs=0.15)


def test_nothing_seen_counts_as_not_found_and_leaves_no_errors():
    frame = frame_at()
    blind = score_frame(result_of(frame, LinePoints.empty(), LinePoints.empty()), STILL.approach)
    found = score_frame(result_of(frame, seen(frame, LEFT), seen(frame, RIGHT)), STILL.approach)
    figures = summarise([blind, found])
    assert not [name for name in blind.errors if "error" in name]
    assert figures["found_rate"] == 0.5
    assert figures["not_seen_rate"] == 0.5
    assert figures["mode_rate.coarse"] == 0.5
    assert figures["coarse.direction_error_deg.left.median"] == pytest.approx(0.0, abs=1e-4)


def test_lines_in_an_empty_scene_are_false_lines():
    empty = frame_at(left=None, right=None)
    points = seen(frame_at(), LEFT), seen(frame_at(), RIGHT)
    figures = summarise([score_frame(result_of(empty, *points), STILL.approach)])
    assert figures["false_line_rate"] == 1.0
    assert "found_rate" not in figures


def test_restoration_is_compared_with_the_clear_view():
    clear = np.full_like(GREY, 128 + 16)
    frame = frame_at(clear_rgb=clear)
    score = score_frame(result_of(frame, LinePoints.empty(), LinePoints.empty()), STILL.approach)
    assert score.errors["psnr_db"] == pytest.approx(20 * np.log10(255 / 16))
    assert score.errors["psnr_db_hazy"] == score.errors["psnr_db"]


def test_a_frame_without_truth_is_refused_by_name():
    frame = dataclasses.replace(frame_at(), truth=None)
    result = result_of(frame, LinePoints.empty(), LinePoints.empty())
    with pytest.raises(ValueError, match=r"a\.png"):
        score_frame(result, STILL.approach)


def test_no_frames_at_all_is_an_error():
    with pytest.raises(ValueError, match="no frame"):
        summarise([])


def test_a_stopped_command_says_what_it_wrote(tmp_path, capsys, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    with RecordingWriter(tmp_path / "recording", scene={}) as writer:
        writer.add(frame_at())
    monkeypatch.setattr("deckline.evaluation.chain.score_frame", stop)
    command = ["eval", "recording", str(tmp_path / "recording"), "--dehazer", "none", "--detector", "classical"]
    assert main(command) == 130
    assert "nothing was written" in capsys.readouterr().err
