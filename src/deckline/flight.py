"""One flight: the chain of stages frame by frame, and the track that joins the frames."""

import time
from dataclasses import replace

from deckline.detect.prior import ImagePrior
from deckline.guide import NO_LINE, GuideConfig, guidance
from deckline.localize import LocalizeConfig
from deckline.pipeline import FrameResult, Pipeline, PipelineConfig
from deckline.track import TrackConfig, Tracker
from deckline.types import Frame

AS_USUAL = TrackConfig()
USUAL_SEA_STATE = 4.0  # to believe too much in a still deck misleads; too little costs some precision


class Flight:
    """Called with every frame of one flight in order: looks where the track expects the runway, or else where
    the last picture showed it, and guides by the track.

    Frames that are unrelated to each other are answered as the pipeline alone answers them. For a ship's deck
    `open_flight` tells localization and tracker how it moves; as they are they take it to lie still.

    Args:
        pipeline: the chain.
        track: what the tracker assumes; None: every frame is for itself.
        guide: the wanted approach.
    """

    def __init__(
        self, pipeline: Pipeline, track: TrackConfig | None = AS_USUAL, guide: GuideConfig | None = None
    ) -> None:
        self.pipeline = pipeline
        self.guide = guide or GuideConfig()
        self.tracker = None if track is None else Tracker(track)
        self.image_prior = ImagePrior()

    def __call__(self, frame: Frame) -> FrameResult:
        """The frame's result, with its track and the guidance that follows from it."""
        if self.tracker is None:
            result, track, start = self.pipeline(frame), None, time.perf_counter()
        else:
            result = self.pipeline(frame, self.tracker.runway_prior(frame), self.image_prior.predict(frame))
            start = time.perf_counter()
            track = self.tracker.update(frame, result.estimate)
            self.image_prior.update(frame, result.detection, result.estimate)
        advice = guidance(frame, result.estimate, track, self.guide)
        seconds = result.seconds | {"track": time.perf_counter() - start}
        reasons = dict.fromkeys([*advice.reason.split("; "), *result.guidance.reason.split("; ")])
        unplaced = advice.lateral_deviation_m is None
        told = "; ".join(reason for reason in reasons if reason and (unplaced or reason != NO_LINE))
        return replace(result, track=track, guidance=replace(advice, reason=told), seconds=seconds)


def open_flight(
    config: PipelineConfig | None = None,
    track: TrackConfig | None = AS_USUAL,
    guide: GuideConfig | None = None,
    sea_state: float = USUAL_SEA_STATE,
) -> Flight:
    """A flight to a deck that moves as in a sea state, of which the ship reports only how it lies at rest.

    Args:
        config: the chain.
        track: what the tracker assumes beside the sea; None: every frame is for itself.
        guide: the wanted approach.
        sea_state: 0 to 6; 0 for a runway on land.

    Raises:
        ValueError: a sea state out of range, or a chain that cannot be built.
    """
    config, assumed = config or PipelineConfig(), (track or AS_USUAL).at_sea_state(sea_state)
    pipeline = Pipeline(replace(config, localize=on_moving_deck(config.localize, assumed)))
    return Flight(pipeline, None if track is None else assumed, guide)


def on_moving_deck(lines: LocalizeConfig, track: TrackConfig) -> LocalizeConfig:
    """Localization that believes the deck's reported height and its level no more than a tracker does."""
    noise = replace(lines.noise, deck_z_m=track.errors.deck_z_m)
    return replace(lines, noise=noise, deck=replace(lines.deck, tilt_rad=track.motion.tilt_rad))
