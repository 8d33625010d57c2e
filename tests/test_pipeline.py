import dataclasses
import zipfile
from pathlib import Path

import numpy as np
import pytest

import deckline
from deckline.evaluate.chain import score_frame
from deckline.localize import LocalizeConfig
from deckline.pipeline import Pipeline, PipelineConfig
from deckline.recording import open_source
from deckline.sim import SimConfig, frames
from deckline.types import DepthMode, Status

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
    sample = open_source(tmp_path)
    assert len(sample) == 24
    result = pipeline(sample.load(22))
    assert result.guidance.status is Status.OK
    assert result.estimate.mode is DepthMode.FINE
