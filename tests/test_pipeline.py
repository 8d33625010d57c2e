import dataclasses
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import deckline
from deckline.detect.prior import RunwaySurvey, prior_from_survey
from deckline.evaluation.chain import score_frame
from deckline.geometry import Camera
from deckline.localize import LocalizeConfig
from deckline.pipeline import Pipeline, PipelineConfig
from deckline.recording import open_recording
from deckline.sim import SimConfig, frames
from deckline.types import DepthMode, Detection, Frame, LinePoints, Status

# Seeds from 1000 on are never trained on. 300 m to 40 m through 1200 m of visibility.
APPROACH = SimConfig(
    preset="paper", trajectory="approach", frames=6, visibility_m=(1200.0, 1200.0), seed=1001, start_m=300.0, end_m=40.0
)


@pytest.fixture(scope="module")
def pipeline() -> Pipeline:
    return Pipeline()


@pytest.fixture(scope="module")
def results(pipeline):
    return [pipeline(frame) for frame in frames(APPROACH)]


def test_an_approach_is_found_and_measured(results):
    scores = [score_frame(result) for result in results]
    found = [score for score in scores if score.status is Status.OK]
    assert len(found) >= 5
    for side in ("left", "right"):
        assert np.median([s.errors[f"direction_error_deg.{side}"] for s in found]) < 1.0
        assert np.median([s.errors[f"lateral_error_at_ramp_m.{side}"] for s in found]) < 1.0


def test_far_frames_are_coarse_and_near_ones_fine(results):
    modes = [result.estimate.mode for result in results if result.estimate.status is Status.OK]
    assert modes[0] is DepthMode.COARSE
    assert modes[-1] is DepthMode.FINE


def test_guidance_agrees_with_the_simulators_pose(results):
    for result in results:
        if result.guidance.status is Status.OK and result.estimate.mode is DepthMode.FINE:
            height = result.guidance.height_above_deck_m
            true_height = result.frame.deck_z_m - result.frame.world_from_body.translation[2]
            assert height.value == pytest.approx(true_height, abs=1.0)


def test_the_truth_changes_nothing(pipeline, results):
    blind = pipeline(dataclasses.replace(results[-1].frame, truth=None))
    assert blind.guidance.lateral_deviation_m.value == results[-1].guidance.lateral_deviation_m.value


def test_a_grey_image_is_not_seen(pipeline, results):
    grey = dataclasses.replace(results[0].frame, image_rgb=np.full((720, 1280, 3), 170, np.uint8))
    result = pipeline(grey)
    assert result.guidance.status is Status.NOT_SEEN
    assert result.guidance.lateral_deviation_m is None


def test_fine_mode_without_a_depth_camera_says_so_and_gives_nothing(results):
    config = PipelineConfig(localize=dataclasses.replace(LocalizeConfig(), mode="fine"))
    result = Pipeline(config)(dataclasses.replace(results[-1].frame, depth_m=None))
    assert result.estimate.mode is DepthMode.NONE
    assert "depth" in result.guidance.reason
    assert result.guidance.lateral_deviation_m is None


def test_a_dehazer_that_needs_the_pose_says_when_there_is_none(results):
    chain = Pipeline(PipelineConfig(dehazer="geometry"))
    frame = dataclasses.replace(results[0].frame, world_from_body=None)
    blind = chain(frame)
    assert blind.guidance.reason.startswith("not dehazed: the frame has no pose")
    np.testing.assert_array_equal(blind.dehazed_rgb, frame.image_rgb)
    seeing = chain(results[0].frame)
    assert "not dehazed" not in seeing.guidance.reason
    assert (seeing.dehazed_rgb != results[0].frame.image_rgb).any()


@pytest.mark.parametrize("field", ["dehazer", "detector"])
def test_an_unknown_method_is_answered_with_the_known_ones(field):
    with pytest.raises(ValueError, match=f"unknown {field} 'magic': use one of "):
        Pipeline(PipelineConfig(**{field: "magic"}))


def test_the_shipped_sample_is_whole_and_its_lines_are_found(pipeline, tmp_path):
    with zipfile.ZipFile(Path(deckline.__file__).parent / "sample" / "approach.zip") as archive:
        archive.extractall(tmp_path)
    sample = open_recording(tmp_path)
    assert len(sample) == 24
    result = pipeline(sample.load(22))
    assert result.guidance.status is Status.OK
    assert result.estimate.mode is DepthMode.FINE


class Recorder:
    """A detector that sees both lines exactly and remembers where it was told to look."""

    name = "recorder"

    def __init__(self, detection: Detection) -> None:
        self.detection = detection
        self.boxes: list[tuple[float, float, float, float] | None] = []

    def __call__(self, image_rgb, prior_box=None) -> Detection:
        self.boxes.append(prior_box)
        return self.detection


RUNWAY = RunwaySurvey((0.0, 0.0, -20.0), sigma_m=1.0, heading_sigma_deg=0.1)


def level_frame(x_m: float, time_s: float, file: str = "f") -> Frame:
    """`x_m` along the runway's direction from its ramp, 30 m above deck, looking ahead."""
    camera = Camera.from_fov(320, 180, np.deg2rad(90))
    pose = RigidTransform.from_translation([x_m, 0.0, -50.0])
    image = np.zeros((180, 320, 3), np.uint8)
    return Frame(file, time_s, image, camera, world_from_body=pose, deck_z_m=-20.0)


def told(runway: RunwaySurvey | None = None) -> tuple[Pipeline, Recorder]:
    expected, frame = prior_from_survey(RUNWAY), level_frame(-300.0, 0.0)
    lines = []
    for near, far in (expected.left_m, expected.right_m):
        points = frame.world_from_camera.inv().apply(np.linspace(near, far, 30))
        lines.append(LinePoints(frame.camera.project(points), np.ones(30), np.full(30, 0.2)))
    pipeline = Pipeline(PipelineConfig("none", "classical", runway=runway or RunwaySurvey()))
    pipeline.detect = Recorder(Detection(*lines))
    return pipeline, pipeline.detect


def test_frames_carry_nothing_over():
    pipeline, recorder = told()
    for time_s in (0.0, 0.2):
        assert pipeline(level_frame(-300.0, time_s)).estimate.status is Status.OK
    assert recorder.boxes == [None, None]


def test_what_the_caller_expects_comes_before_the_survey_and_that_before_the_last_picture():
    aside = prior_from_survey(dataclasses.replace(RUNWAY, ramp_m=(0.0, 100.0, -20.0)))
    frame, last = level_frame(-300.0, 0.0), (1.0, 2.0, 3.0, 4.0)
    pipeline, recorder = told(RunwaySurvey((0.0, -100.0, -20.0), sigma_m=1.0))
    pipeline(frame, aside, last)
    pipeline(frame, None, last)
    middles = [(box[0] + box[2]) / 2 for box in recorder.boxes]
    assert middles[1] < 140 and middles[0] > 180
    unsurveyed, other = told()
    unsurveyed(frame, None, last)
    assert other.boxes == [last]


@pytest.mark.parametrize(("detect_in", "grey"), [("hazy", 0), ("dehazed", 99)])
def test_lines_are_looked_for_in_the_picture_that_is_asked_for(detect_in, grey):
    pipeline = Pipeline(PipelineConfig("none", "classical", detect_in=detect_in))
    pipeline.dehaze = lambda image_rgb: np.full_like(image_rgb, 99)
    seen = []

    def detect(image_rgb, prior_box=None):
        seen.append(np.unique(image_rgb))
        return Detection(LinePoints.empty(), LinePoints.empty())

    pipeline.detect = detect
    result = pipeline(level_frame(-300.0, 0.0))
    assert seen == [[grey]]
    assert np.all(result.dehazed_rgb == 99)


def test_an_expectation_that_says_nothing_leaves_the_next_one_to_say():
    pipeline, recorder = told(RUNWAY)
    frame = level_frame(-300.0, 0.0)
    pipeline(frame)
    for broken in (
        dataclasses.replace(prior_from_survey(RUNWAY), sigma_m=np.nan),
        prior_from_survey(RunwaySurvey((-900.0, 0.0, -20.0))),
    ):
        pipeline(frame, broken)  # not a number; behind the camera
    assert recorder.boxes[0] is not None
    assert recorder.boxes == [recorder.boxes[0]] * 3
