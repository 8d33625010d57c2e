"""One flight: the chain of stages frame by frame, and the track that joins the frames."""

import time
from dataclasses import replace

from deckline.detect.last_seen import LastSeen
from deckline.guide import NO_LINE, GuideConfig, guidance
from deckline.pipeline import FrameResult, Pipeline
from deckline.track import TrackConfig, Tracker
from deckline.types import Frame

AS_USUAL = TrackConfig()


class Flight:
    """Called with every frame of one flight in order: looks where the track expects the runway, or else where
    the last picture showed it, and guides by the track.

    Frames that are unrelated to each other are answered as the pipeline alone answers them.

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
        self.last_seen = LastSeen()

    def __call__(self, frame: Frame) -> FrameResult:
        """The frame's result, with its track and the guidance that follows from it."""
        if self.tracker is None:
            result = self.pipeline(frame)
        else:
            result = self.pipeline(frame, self.tracker.expected(frame), self.last_seen.image_box(frame))
        start = time.perf_counter()
        track = None if self.tracker is None else self.tracker.update(frame, result.estimate)
        self.last_seen.update(frame, result.detection, result.estimate)
        advice = guidance(frame, result.estimate, track, self.guide)
        seconds = result.seconds | {"track": time.perf_counter() - start}
        reasons = dict.fromkeys([*advice.reason.split("; "), *result.guidance.reason.split("; ")])
        unplaced = advice.lateral_deviation_m is None
        told = "; ".join(reason for reason in reasons if reason and (unplaced or reason != NO_LINE))
        return replace(result, track=track, guidance=replace(advice, reason=told), seconds=seconds)
