"""The pipeline and the track joined, with a pipeline that sees exact lines."""

from dataclasses import replace

import numpy as np
import pytest

from approach_scene import chain, frame
from deckline.flight import Flight, open_flight
from deckline.pipeline import PipelineConfig
from deckline.types import TrackState


class Exact:
    """Stands for the pipeline: localizes exact detections, and remembers what it was told to expect."""

    def __init__(self, blind=()):
        self.expected, self.prior_box, self.blind = [], [], blind

    def __call__(self, at, expected=None, prior_box=None):
        self.expected.append(expected)
        self.prior_box.append(prior_box)
        return chain(at, () if at.file in self.blind else ("left", "right"))


def approach(count):
    return [frame(index, 150.0 - 15.0 * index) for index in range(count)]


def test_the_pipeline_is_told_where_the_runway_is_and_the_guidance_is_the_tracks():
    pipeline = Exact()
    results = [Flight(pipeline)(shown) for shown in approach(1)]
    assert pipeline.expected == [None]
    flight = Flight(pipeline)
    results = [flight(shown) for shown in approach(5)]
    told = pipeline.expected[-1]
    assert np.allclose(told.left_m[0], [0.0, -8.0, -20.0], atol=2.0)
    assert np.allclose(told.right_m[:, 1:], [[8.0, -20.0]] * 2, atol=0.1)
    assert results[0].guidance.protection is None
    assert results[-1].guidance.track is TrackState.TRACKING
    assert results[-1].guidance.lateral_deviation_m.value == pytest.approx(3.0, abs=1e-3)
    assert results[-1].guidance.lateral_deviation_m.sigma < results[0].guidance.lateral_deviation_m.sigma
    assert results[-1].guidance.protection.lateral_m > 3 * results[-1].guidance.lateral_deviation_m.sigma
    assert results[-1].seconds["track"] > 0


def test_a_frame_that_shows_nothing_is_guided_through():
    flight = Flight(Exact(blind=("frame_003.png",)))
    results = [flight(shown) for shown in approach(5)]
    assert results[3].guidance.track is TrackState.COASTING
    assert abs(results[3].guidance.lateral_deviation_m.value - 3.0) < 0.1
    assert results[3].guidance.reason == "no line in the image"
    assert results[4].guidance.track is TrackState.TRACKING


def test_unrelated_frames_are_answered_as_the_pipeline_answers_them():
    flight = Flight(Exact())
    for index, range_m in enumerate((150.0, 40.0, 190.0, 60.0)):
        shown = frame(index, range_m)
        result, single = flight(shown).guidance, chain(shown).guidance
        for name in ("lateral_deviation_m", "distance_to_ramp_m", "vertical_deviation_rad"):
            one, other = getattr(result, name), getattr(single, name)
            assert (one and (one.value, one.sigma)) == (other and (other.value, other.sigma))
        assert (result.reason, result.flags, result.protection) == (single.reason, (), None)


def test_without_a_pose_the_last_picture_says_where_to_look():
    pipeline = Exact()
    flight = Flight(pipeline)
    for index in range(2):
        shown = replace(frame(index, 150.0 - index), world_from_body=None)
        flight(shown)
    assert pipeline.expected == [None, None]
    before, box = pipeline.prior_box
    assert before is None
    assert 0 < box[2] - box[0] < 2 * shown.camera.width and box[0] < shown.camera.width / 2 < box[2]


def test_without_a_tracker_every_frame_is_for_itself():
    pipeline = Exact()
    flight = Flight(pipeline, None)
    for shown in approach(2):
        flight(shown)
    assert pipeline.expected == pipeline.prior_box == [None, None]


def test_tracker_and_localization_are_told_of_the_same_sea():
    still, usual = (
        open_flight(PipelineConfig("none", "classical"), sea_state=0.0),
        open_flight(PipelineConfig("none", "classical")),
    )
    for flight in (still, usual):
        lines, track = flight.pipeline.config.localize, flight.tracker.config
        assert (lines.noise.deck_z_m, lines.deck.tilt_rad) == (track.errors.deck_z_m, track.motion.tilt_rad)
    assert usual.tracker.config.motion.rise_m > 10 * still.tracker.config.motion.rise_m
    alone = open_flight(PipelineConfig("none", "classical"), track=None)
    assert alone.tracker is None
    assert alone.pipeline.config.localize == usual.pipeline.config.localize
    with pytest.raises(ValueError, match="sea_state must lie between 0 and 6, got 7"):
        open_flight(sea_state=7)
