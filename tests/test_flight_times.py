"""Frames whose time cannot be used cost nothing and change nothing; a time far back is another flight."""

from dataclasses import replace

import numpy as np
import pytest

from deckline.cli.run import unpack_sample
from deckline.config import Models, RunConfig
from deckline.dehaze.base import IdentityDehazer
from deckline.detect import DETECTORS, SearchingDetector
from deckline.flight import Flight
from deckline.report.records import guidance_record
from deckline.track.tracker import NEW_FLIGHT_S
from deckline.types import Reason, Status, TrackState

FRAMES = 8  # of the shipped approach, the last ones
REFUSED_AT = 5


class CountingDetector(SearchingDetector):
    """The shipped detector; counts the searches that it starts."""

    name = "counting"

    def __init__(self):
        self.network, self.searches = DETECTORS["hybrid"](), 0

    def start_search(self, image_rgb):
        self.searches += 1
        return self.network.start_search(image_rgb)


class CountingDehazer(IdentityDehazer):
    """Counts the pictures that it dehazes."""

    pictures = 0

    def __call__(self, image_rgb):
        self.pictures += 1
        return super().__call__(image_rgb)


@pytest.fixture(scope="module")
def detector():
    return CountingDetector()


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """The shipped approach's config and its last frames, 10 a second."""
    recording = unpack_sample(tmp_path_factory.mktemp("sample") / "approach")
    shown = [recording.load(len(recording) - FRAMES + k) for k in range(FRAMES)]
    return recording.base_config or RunConfig(), [replace(one, time_s=10.0 + 0.1 * k) for k, one in enumerate(shown)]


@pytest.fixture(params=["pose", "pictures alone"])
def flown(request, sample):
    """A config that has every stage work, and frames with or without their poses."""
    config, shown = sample
    if request.param != "pose":
        shown = [replace(one, world_from_body=None, depth_m=None) for one in shown]
    return replace(config, models=Models(visibility=True), deck=replace(config.deck, width_m=20.0)), shown


def numbers(result):
    return guidance_record(result.guidance), result.guidance.status, result.detection.frames


@pytest.mark.parametrize("time_s", [np.nan, np.inf, 10.4, 9.0])
def test_a_refused_frame_is_seen_by_no_stage_and_changes_no_later_answer(flown, detector, time_s):
    config, shown = flown
    odd = replace(shown[0], time_s=time_s, file="odd")
    dehazer = CountingDehazer()
    with Flight(config, dehazer, detector) as flight, Flight(config, IdentityDehazer(), detector) as plain:
        for one in shown[:REFUSED_AT]:
            assert numbers(flight(one)) == numbers(plain(one))
        searches, pictures, forecast = detector.searches, dehazer.pictures, flight.forecast()
        for _ in range(3):
            refused = flight(odd)
            assert (detector.searches, dehazer.pictures, dict(refused.seconds)) == (searches, pictures, {})
            assert [one.reason for one in refused.guidance.diagnostics] == [Reason.BAD_TIME]
            assert (refused.guidance.status, refused.track.state) == (Status.NOT_SEEN, TrackState.LOST)
            assert not any(guidance_record(refused.guidance).values()) and refused.guidance.protection is None
        assert searches > 0 and pictures == REFUSED_AT
        later_s = shown[REFUSED_AT - 1].time_s + 0.05
        assert forecast.at(later_s) is not None and flight.forecast().at(later_s) is not None
        for one in shown[REFUSED_AT:]:
            assert numbers(flight(one)) == numbers(plain(one))


def test_a_time_far_back_begins_another_flight_for_all_stages(flown, detector):
    config, shown = flown
    with Flight(config, IdentityDehazer(), detector) as flight, Flight(config, IdentityDehazer(), detector) as fresh:
        for one in shown:
            flight(replace(one, time_s=one.time_s + NEW_FLIGHT_S + 1.0))
        for number, one in enumerate(shown):
            again = flight(one)
            assert numbers(again) == numbers(fresh(one))
            assert again.track.age_s == pytest.approx(0.1 * number)
