"""From frame to guidance: the stages joined, one seeded simulated approach through all of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from approach_scene import CAMERA, LEFT, RIGHT, STILL, frame, points
from deckline.cli.main import main
from deckline.cli.run import unpack_sample
from deckline.config import Models, RunConfig, RunwaySurvey, Tracking
from deckline.dehaze.base import IdentityDehazer
from deckline.detect import SearchingDetector
from deckline.detect.prior import prior_from_survey
from deckline.flight import Flight
from deckline.recording import open_recording
from deckline.report.records import guidance_record
from deckline.types import DepthMode, Detection, LinePoints, LineVisibility, Reason, Status, TrackState
from deckline_lab.evaluation.chain import score_frame
from deckline_sim import SimConfig, frames

# Seeds from 1000 on are never trained on. 300 m to 40 m through 1200 m of visibility.
APPROACH = SimConfig(
    preset="paper", trajectory="approach", frames=6, visibility_m=(1200.0, 1200.0), seed=1001, start_m=300.0, end_m=40.0
)
BEGINNING = 8  # frames of the shipped approach, of 91
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


@pytest.mark.parametrize("field", ["dehazer", "detector"])
def test_an_unknown_model_is_refused_by_name(field):
    with pytest.raises(ValueError, match=f"{field}.*magic"):
        Flight.from_config(RunConfig(models=Models(**{field: "magic"})))


def test_the_shipped_sample_is_whole_and_its_lines_are_found(flight, tmp_path):
    sample = unpack_sample(tmp_path / "sample")
    assert len(sample) == 91
    result = flight(sample.load(90))
    assert (result.guidance.status, result.estimate.mode) == (Status.UNVERIFIED, DepthMode.FINE)  # one frame
    plain = flight(open_recording(tmp_path / "sample" / "images").load(90))  # the pictures alone: no camera
    assert (plain.estimate.seen, plain.estimate.mode) == (LineVisibility.BOTH, DepthMode.WIDTH)
    assert plain.guidance.status is Status.UNVERIFIED
    assert {Reason.NO_WIDTH, Reason.ASSUMED_CAMERA} <= {one.reason for one in plain.guidance.diagnostics}
    assert plain.guidance.lateral_deviation_m is None
    assert plain.guidance.in_widths is not None
    for side, line in result.estimate.pixel_lines.items():
        np.testing.assert_allclose(plain.estimate.pixel_lines[side].ends_px, line.ends_px, atol=0.5)


def test_demo_run_and_evaluation_give_the_same_guidance(tmp_path, monkeypatch):
    scored = []

    def record(result, approach):
        scored.append(guidance_record(result.guidance))
        return score_frame(result, approach)

    def unpack_beginning(folder):
        unpack_sample(folder)
        log = folder / "airsim_rec.txt"
        log.write_text("".join(log.read_text().splitlines(keepends=True)[: 1 + BEGINNING]))
        return open_recording(folder)

    monkeypatch.setattr("deckline_lab.evaluation.chain.score_frame", record)
    monkeypatch.setattr("deckline.cli.run.unpack_sample", unpack_beginning)
    assert main(["demo", "--out", str(tmp_path / "demo")]) == 0
    recording = str(tmp_path / "demo" / "approach")
    assert main(["run", recording, "--out", str(tmp_path / "run")]) == 0
    assert main(["eval", "recording", recording]) == 0
    written = ((tmp_path / at / "guidance.jsonl").read_text().splitlines() for at in ("demo", "run"))
    demo, run = ([json.loads(line) for line in lines] for lines in written)
    assert len(scored) == BEGINNING
    for one, other, evaluated in zip(demo, run, scored, strict=True):
        assert one["guidance"] == other["guidance"] == evaluated
        for key in ("status", "protection", "reason", "flags"):
            assert one[key] == other[key]


class RecordingDetector:
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


def fly(shown, config=STILL, blind=()):
    detector = RecordingDetector(shown, blind)
    chain = Flight(config, IdentityDehazer(), detector)
    return [chain(one) for one in shown], detector


def approach(count):
    return [frame(index, 150.0 - 15.0 * index) for index in range(count)]


def test_the_search_gets_the_tracks_box_and_the_guidance_is_the_tracks():
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


def test_a_reset_starts_another_flight_with_the_same_models():
    detector = RecordingDetector(shown := approach(5))
    flight = Flight(STILL, IdentityDehazer(), detector)
    first = [flight(one).guidance for one in shown]
    flight.reset()
    second = [flight(one).guidance for one in shown]
    assert detector.boxes[:5] == detector.boxes[5:] and detector.boxes[5] is None
    for one, other in zip(first, second, strict=True):
        assert guidance_record(one) == guidance_record(other) and one.track is other.track


class SearchStartedError(Exception):
    """Raised where a search is started."""


def start_search(self, image_rgb):
    raise SearchStartedError


def test_a_detector_is_searched_view_by_view_where_its_class_states_it():
    plain = type("Plain", (RecordingDetector,), {"start_search": start_search})
    stated = type("Stated", (RecordingDetector, SearchingDetector), {"start_search": start_search})
    shown = approach(2)
    Flight(STILL, IdentityDehazer(), plain(shown))(shown[0])  # a method of that name alone states nothing
    Flight(SINGLE, IdentityDehazer(), stated(shown))(shown[0])  # without a track every picture is searched whole
    with pytest.raises(SearchStartedError):
        Flight(STILL, IdentityDehazer(), stated(shown))(shown[0])


def test_unrelated_frames_get_results_of_their_own():
    shown = [frame(index, range_m) for index, range_m in enumerate((150.0, 40.0, 190.0, 60.0))]
    tracked, single = fly(shown)[0], fly(shown, SINGLE)[0]
    for result, alone in zip(tracked, single, strict=True):
        for name in ("lateral_deviation_m", "distance_to_ramp_m", "vertical_deviation_rad"):
            one, other = getattr(result.guidance, name), getattr(alone.guidance, name)
            assert (one and (one.value, one.sigma)) == (other and (other.value, other.sigma))
        assert (result.guidance.flags, result.guidance.protection) == ((), None)


def test_without_a_pose_the_last_picture_gives_the_box_unless_there_is_no_track():
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
    detector = RecordingDetector()
    chain = Flight(replace(SINGLE, survey=replace(SURVEY, ramp_m=(0.0, -60.0, -20.0))), IdentityDehazer(), detector)
    at = replace(frame(), world_from_body=RigidTransform.from_translation([-300.0, 0.0, -50.0]))
    for prior in (right, None, behind, broken):
        chain(at, prior=prior)
    middles = [(box[0] + box[2]) / 2 for box in detector.boxes]
    assert middles[0] > CAMERA.width / 2 > middles[1]
    assert detector.boxes[1] == detector.boxes[2] == detector.boxes[3]


class Grey:
    """A dehazer that paints everything grey."""

    name = "grey"

    def __call__(self, image_rgb):
        return np.full_like(image_rgb, 99)


@pytest.mark.parametrize(
    ("models", "searched", "dehazed"),
    [(Models(), 120, None), (Models(visibility=True), 120, 99), (Models(detect_in="dehazed"), 99, 99)],
)
def test_the_chain_dehazes_only_what_the_configuration_asks_for(models, searched, dehazed):
    detector = RecordingDetector()
    result = Flight(replace(SINGLE, models=models), Grey(), detector)(frame())
    assert np.unique(detector.images[0]).tolist() == [searched]
    assert (result.dehazed is None) == (dehazed is None) == ("dehaze" not in result.seconds)
    assert dehazed is None or np.all(result.dehazed.image_rgb == dehazed)


@pytest.mark.parametrize(
    ("models", "is_flown"), [(Models(visibility=True), True), (Models(detect_in="dehazed"), False)]
)
def test_only_a_detector_that_needs_the_dehazed_picture_is_stopped_by_a_dehazer_that_refuses(models, is_flown):
    class Refusing(Grey):
        def __call__(self, image_rgb):
            raise ValueError("too dark")

    flight = Flight(replace(SINGLE, models=models), Refusing(), RecordingDetector())
    if is_flown:
        assert flight(frame()).dehazed.note == "not dehazed: too dark"
    else:
        with pytest.raises(ValueError, match="too dark"):
            flight(frame())


def test_track_and_guidance_share_one_touchdown_point():
    far = replace(STILL, approach=replace(STILL.approach, touchdown_m=120.0))
    near, beyond = (fly(approach(5), config)[0][-1] for config in (STILL, far))
    lines = (beyond.track.lines["centre"], near.track.lines["centre"])
    assert lines[0].point_m[0] - lines[1].point_m[0] == pytest.approx(50.0, abs=1e-6)
    ahead = (beyond.guidance.distance_to_touchdown_m, near.guidance.distance_to_touchdown_m)
    assert ahead[0].value - ahead[1].value == pytest.approx(50.0, abs=1e-6)
