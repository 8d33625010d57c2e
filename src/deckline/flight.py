"""One flight: the chain of stages frame by frame, and the track that joins the frames."""

import time
from dataclasses import replace

from deckline.guide import GuideConfig, guidance
from deckline.pipeline import FrameResult, Pipeline
from deckline.track import TrackConfig, Tracker
from deckline.types import Frame


class Flight:
    """Called with every frame of one flight in order: looks where the track expects the runway, guides by the track.

    Frames that are unrelated to each other are answered as the pipeline alone answers them.

    Args:
        pipeline: the chain.
        track: what the tracker assumes.
        guide: the wanted approach.
    """

    def __init__(self, pipeline: Pipeline, track: TrackConfig | None = None, guide: GuideConfig | None = None) -> None:
        self.pipeline = pipeline
        self.guide = guide or GuideConfig()
        self.tracker = Tracker(track)

    def __call__(self, frame: Frame) -> FrameResult:
        """The frame's result, with its track and the guidance that follows from it."""
        result = self.pipeline(frame, self.tracker.expected(frame))
        start = time.perf_counter()
        track = self.tracker.update(frame, result.estimate)
        advice = guidance(frame, result.estimate, track, self.guide)
        seconds = result.seconds | {"track": time.perf_counter() - start}
        reasons = dict.fromkeys([*advice.reason.split("; "), *result.guidance.reason.split("; ")])
        told = "; ".join(reason for reason in reasons if reason)
        if advice.lateral_deviation_m is not None:
            told = told.replace("no line was localized", "").strip("; ")
        return replace(result, track=track, guidance=replace(advice, reason=told), seconds=seconds)
