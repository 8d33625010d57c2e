"""From frame to guidance: the stages joined, one seeded simulated approach through all of them."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import deckline
from approach_scene import CAMERA, LEFT, RIGHT, STILL, frame, points
from deckline.cli.main import main
from deckline.config import Localization, Models, RunConfig, RunwaySurvey, Tracking
from deckline.dehaze import DehazeResult
from deckline.dehaze.base import IdentityDehazer
from deckline.detect.prior import prior_from_survey
from deckline.flight import Dehazing, Flight
from deckline.recording import open_recording
from deckline.report.records import guidance_record
from deckline.types import DepthMode, Detection, LinePoints, LineVisibility, Reason, Status, TrackState, Value
from deckline_lab.evaluation.chain import score_frame
from deckline_sim import SimConfig, frames

# Seeds from 1000 on are never trained on. 300 m to 40 m through 1200 m of visibility.
APPROACH = SimConfig(
    preset="paper", trajectory="approach", frames=6, visibility_m=(1200.0, 1200.0), seed=1001, start_m=300.0, end_m=40.0
)
SINGLE = replace(STILL, tracking=Tracking(enabled=False))


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight.from_config(SINGLE)


@pytest.fixture(scope="module")
def results(flight):
    return [flight(shown) for shown in frames(APPROACH)]


def test_an_approach_is_found_and_measured_from_coarse_to_fine(results):
    """Three times what is measured: direction errors 0.03 degrees, lateral errors 0.04 m, in the median."""
    scores = [score_frame(result, SINGLE.approach) for result in results]
    assert [score.seen for score in scores] == [LineVisibility.BOTH] * len(scores)
    for side in ("left", "right"):
        assert np.median([s.errors[f"direction_error_deg.{side}"] for s in scores]) < 0.09
        assert np.median([s.errors[f"lateral_error_at_ramp_m.{side}"] for s in scores]) < 0.12

    modes = [result.estimate.mode for result in results]
    assert (modes[0], modes[-1]) == (DepthMode.COARSE, DepthMode.FINE)
    for result in results:
        if result.estimate.mode is DepthMode.FINE:
            true_m = result.frame.deck_z_m - result.frame.world_from_body.translation[2]
            assert result.guidance.height_above_deck_m.value == pytest.approx(true_m, abs=0.1)


def test_truth_changes_nothing_and_a_grey_image_is_not_seen(flight, results):
    blind = flight(replace(results[-1].frame, truth=None))
    assert blind.guidance.lateral_deviation_m.value == results[-1].guidance.lateral_deviation_m.value
    result = flight(replace(results[0].frame, image_rgb=np.full((720, 1280, 3), 170, np.uint8)))
    assert result.guidance.status is Status.NOT_SEEN
    assert result.guidance.lateral_deviation_m is None


def test_fine_mode_without_a_depth_camera_says_so_and_gives_nothing(results):
    config = replace(SINGLE, localization=Localization(mode="fine"))
    result = Flight.from_config(config)(replace(results[-1].frame, depth_m=None))
    assert result.estimate.mode is DepthMode.NONE
    assert Reason.NO_DEPTH in [diagnostic.reason for diagnostic in result.guidance.diagnostics]
    assert result.guidance.lateral_deviation_m is None


def test_a_dehazer_that_needs_the_pose_says_when_there_is_none(results):
    chain = Flight.from_config(replace(SINGLE, models=Models(dehazer="geometry")))
    hazy = results[0].frame
    blind, seeing = chain(replace(hazy, world_from_body=None)), chain(hazy)
    assert blind.dehazing.note is None  # nobody has looked yet
    np.testing.assert_array_equal(blind.dehazed_rgb, hazy.image_rgb)
    assert (seeing.dehazed_rgb != hazy.image_rgb).any()
    assert "no pose" in blind.dehazing.note and seeing.dehazing.note is None


def test_no_strength_leaves_the_picture(results):
    frame = results[0].frame
    chain = Flight.from_config(replace(SINGLE, models=Models(dehazer="geometry", strength=0.0)))
    np.testing.assert_array_equal(chain(frame).dehazed_rgb, frame.image_rgb)


@pytest.mark.parametrize("field", ["dehazer", "detector"])
def test_an_unknown_model_is_refused_by_name(field):
    with pytest.raises(ValueError, match=f"{field}.*magic"):
        Flight.from_config(RunConfig(models=Models(**{field: "magic"})))


def test_a_known_camera_height_gives_the_visibility_in_metres(results):
    class ByHorizon(IdentityDehazer):
        def restore(self, frame):
            return DehazeResult(frame.image_rgb.copy(), visibility_heights=Value(20.0, 2.0))

    def told(height_m):
        return Dehazing(results[0].frame, ByHorizon(), {}, Models(camera_height_m=height_m))().visibility_m

    assert told(None) is None
    assert (told(15.0).value, told(15.0).sigma) == (300.0, 30.0)


def test_the_shipped_sample_is_whole_and_its_lines_are_found(flight, tmp_path):
    with zipfile.ZipFile(Path(deckline.__file__).parent / "sample" / "approach.zip") as archive:
        archive.extractall(tmp_path)
    sample = open_recording(tmp_path)
    assert len(sample) == 24
    result = flight(sample.load(22))
    assert (result.guidance.status, result.estimate.mode) == (Status.OK, DepthMode.FINE)
    plain = flight(open_recording(tmp_path / "images").load(22))  # the pictures alone: no camera
    assert (plain.estimate.seen, plain.estimate.mode) == (LineVisibility.BOTH, DepthMode.NONE)
    assert [diagnostic.reason for diagnostic in plain.guidance.diagnostics] == [Reason.NO_CAMERA]
    for side, line in result.estimate.pixel_lines.items():
        np.testing.assert_allclose(plain.estimate.pixel_lines[side].ends_px, line.ends_px, atol=0.5)


def test_demo_run_and_evaluation_give_the_same_guidance(tmp_path, monkeypatch):
    scored = []

    def record(result, approach):
        scored.append(guidance_record(result.guidance))
        return score_frame(result, approach)

    monkeypatch.setattr("deckline_lab.evaluation.chain.score_frame", record)
    assert main(["demo", "--out", str(tmp_path / "demo")]) == 0
    recording = str(tmp_path / "demo" / "approach")
    assert main(["run", recording, "--out", str(tmp_path / "run")]) == 0
    assert main(["eval", "recording", recording]) == 0
    written = ((tmp_path / at / "guidance.jsonl").read_text().splitlines() for at in ("demo", "run"))
    demo, run = ([json.loads(line) for line in lines] for lines in written)
    assert len(scored) == 24
    for one, other, evaluated in zip(demo, run, scored, strict=True):
        assert one["guidance"] == other["guidance"] == evaluated
        for key in ("status", "protection", "reason", "flags"):
            assert one[key] == other[key]


class Detector:
    """Sees both lines exactly, but for blind frames, and remembers the boxes it is given."""

    name = "recorder"

    def __init__(self, shown=(), blind=()):
        self.seen = {id(one.image_rgb): one for one in shown}
        self.blind = blind
        self.boxes = []
        self.images = []

    def __call__(self, image_rgb, prior_box=None):
        self.boxes.append(prior_box)
        self.images.append(image_rgb)
        at = self.seen.get(id(image_rgb))
        if at is None or at.file in self.blind:
            return Detection(LinePoints.empty(), LinePoints.empty())
        return Detection(points(at, LEFT), points(at, RIGHT))


def none_dehazer():
    return Flight.from_config(RunConfig(models=Models("none", "ufld"))).dehazer


def fly(shown, config=STILL, blind=()):
    detector = Detector(shown, blind)
    chain = Flight(config, none_dehazer(), detector)
    return [chain(one) for one in shown], detector


def approach(count):
    return [frame(index, 150.0 - 15.0 * index) for index in range(count)]


def test_the_search_is_told_where_the_track_expects_the_runway_and_the_guidance_is_the_tracks():
    results, detector = fly(approach(5))
    assert detector.boxes[0] is None
    u0, v0, u1, v1 = detector.boxes[-1]
    last = results[-1].frame
    ends = np.concatenate([[LEFT.p0_m, LEFT.p1_m], [RIGHT.p0_m, RIGHT.p1_m]])
    pixels = CAMERA.project(last.world_from_camera.inv().apply(ends))
    assert np.all((pixels > [u0 - 1, v0 - 1]) & (pixels < [u1 + 1, v1 + 1]) | ((pixels < 0) | (pixels > [320, 180])))
    assert results[0].guidance.protection is None
    assert results[-1].guidance.track is TrackState.TRACKING
    assert results[-1].guidance.lateral_deviation_m.value == pytest.approx(3.0, abs=1e-3)
    assert results[-1].guidance.lateral_deviation_m.sigma < results[0].guidance.lateral_deviation_m.sigma
    assert results[-1].guidance.protection.lateral_m > 3 * results[-1].guidance.lateral_deviation_m.sigma
    assert set(results[-1].seconds) == {"detect", "localize", "track", "guide"}


def test_a_frame_that_shows_nothing_is_bridged():
    results, _ = fly(approach(5), blind=("frame_003.png",))
    assert results[3].guidance.track is TrackState.COASTING
    assert abs(results[3].guidance.lateral_deviation_m.value - 3.0) < 0.1
    assert [diagnostic.reason for diagnostic in results[3].guidance.diagnostics] == [Reason.NO_LINE]
    assert results[4].guidance.track is TrackState.TRACKING


def test_unrelated_frames_are_answered_one_by_one():
    shown = [frame(index, range_m) for index, range_m in enumerate((150.0, 40.0, 190.0, 60.0))]
    tracked, single = fly(shown)[0], fly(shown, SINGLE)[0]
    for result, alone in zip(tracked, single, strict=True):
        for name in ("lateral_deviation_m", "distance_to_ramp_m", "vertical_deviation_rad"):
            one, other = getattr(result.guidance, name), getattr(alone.guidance, name)
            assert (one and (one.value, one.sigma)) == (other and (other.value, other.sigma))
        assert (result.guidance.flags, result.guidance.protection) == ((), None)


def test_without_a_pose_the_last_picture_says_where_to_search_unless_there_is_no_track():
    shown = [replace(frame(index, 150.0 - index), world_from_body=None) for index in range(2)]
    _, detector = fly(shown)
    before, box = detector.boxes
    assert before is None
    assert 0 < box[2] - box[0] < 2 * CAMERA.width and box[0] < CAMERA.width / 2 < box[2]
    _, detector = fly(approach(2), SINGLE)
    assert detector.boxes == [None, None]


SURVEY = RunwaySurvey((0.0, 0.0, -20.0), width_m=16.0, length_m=200.0, sigma_m=1.0, heading_sigma_deg=0.1)


def test_a_given_prior_comes_before_the_survey_and_that_before_the_last_picture():
    right = prior_from_survey(replace(SURVEY, ramp_m=(0.0, 60.0, -20.0)))
    behind = prior_from_survey(RunwaySurvey((-900.0, 0.0, -20.0)))
    broken = replace(right, sigma_m=np.nan)
    detector = Detector()
    chain = Flight(replace(SINGLE, survey=replace(SURVEY, ramp_m=(0.0, -60.0, -20.0))), none_dehazer(), detector)
    at = replace(frame(), world_from_body=RigidTransform.from_translation([-300.0, 0.0, -50.0]))
    for prior in (right, None, behind, broken):
        chain(at, prior=prior)
    middles = [(box[0] + box[2]) / 2 for box in detector.boxes]
    assert middles[0] > CAMERA.width / 2 > middles[1]
    assert detector.boxes[1] == detector.boxes[2] == detector.boxes[3]


@pytest.mark.parametrize(("detect_in", "grey"), [("hazy", 120), ("dehazed", 99)])
def test_lines_are_searched_in_the_picture_that_is_asked_for(detect_in, grey):
    class Grey:
        name = "grey"

        def __call__(self, image_rgb):
            return np.full_like(image_rgb, 99)

    detector = Detector()
    result = Flight(replace(SINGLE, models=Models(detect_in=detect_in)), Grey(), detector)(frame())
    assert np.unique(detector.images[0]).tolist() == [grey]
    assert np.all(result.dehazed_rgb == 99)


def test_a_known_detection_is_taken_without_a_look_at_the_picture():
    at, detector = frame(), Detector()
    result = Flight(STILL, none_dehazer(), detector)(at, detection=Detection(points(at, LEFT), points(at, RIGHT)))
    assert detector.boxes == []
    assert result.guidance.lateral_deviation_m.value == pytest.approx(3.0, abs=1e-3)


def test_track_and_guidance_share_one_touchdown_point():
    far = replace(STILL, approach=replace(STILL.approach, touchdown_m=120.0))
    near, beyond = (fly(approach(5), config)[0][-1] for config in (STILL, far))
    lines = (beyond.track.lines["centre"], near.track.lines["centre"])
    assert lines[0].point_m[0] - lines[1].point_m[0] == pytest.approx(50.0, abs=1e-6)
    ahead = (beyond.guidance.distance_to_touchdown_m, near.guidance.distance_to_touchdown_m)
    assert ahead[0].value - ahead[1].value == pytest.approx(50.0, abs=1e-6)
