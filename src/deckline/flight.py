"""From frame to guidance: the only module that joins the stages.

detect -> localize -> track -> guide. A detector that was trained on haze finds more in the hazy picture. The chain
dehazes only for a detector that never saw haze (`models.detect_in`), or to measure the visibility
(`models.visibility`); views dehaze their own pictures for people.
"""

import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from deckline.attitude import AttitudeCheck
from deckline.config import Engine, RunConfig
from deckline.dehaze import DEHAZERS, Dehazer, DehazeResult, OnnxDehazer, dehaze_for_display, dehaze_frame
from deckline.detect import DETECTORS, Detector, OnnxDetector, SearchingDetector, SearchScheduler
from deckline.detect.crop import Box
from deckline.detect.prior import ImagePrior, prior_from_survey, project_prior
from deckline.guide import guidance
from deckline.localize import Localizer, localize
from deckline.paint import PaintCheck
from deckline.track import Tracker
from deckline.types import Detection, Diagnostic, Frame, Guidance, Reason, RunwayEstimate, RunwayPrior, Track

T = TypeVar("T")
OTHER_LINES = Diagnostic(Reason.OTHER_LINES, "a search of the whole picture sees other lines than the track")


@dataclass(frozen=True, eq=False)
class FrameResult:
    """Everything that the chain found in one frame; final."""

    frame: Frame
    """The frame itself."""
    detection: Detection
    """Points of the lines in its picture."""
    estimate: RunwayEstimate
    """Lines in the world, from this frame alone."""
    guidance: Guidance
    """Where the aircraft is relative to them."""
    seconds: Mapping[str, float]
    """Wall time of `detect`, `localize`, `track` and `guide`, of `dehaze` where the chain dehazes, s."""
    track: Track | None = None
    """Lines in the world, from the frames so far; None: every frame is for itself."""
    dehazed: DehazeResult | None = None
    """What the chain dehazed: the whole picture for `models.detect_in = "dehazed"`, a small one for
    `models.visibility`; None with neither."""


class Flight:
    """Called with every frame of one flight, in their order; answers where the aircraft is.

    The search starts where the track expects the runway, else where the survey has it, else where the last picture
    showed it. Frames that are unrelated to each other are answered one by one; for these `tracking.enabled = false`
    saves the filter.

    Args:
        config: everything that decides the answers.
        dehazer: of the pictures for people, and of those for the detector where the configuration asks for them.
        detector: finds the points of the lines.
        localizer: places the lines in the world.
    """

    def __init__(
        self, config: RunConfig, dehazer: Dehazer, detector: Detector, localizer: Localizer = localize
    ) -> None:
        self.config = config
        self.dehazer = dehazer
        self.detector = detector
        self.localizer = localizer
        self.tracker = Tracker(config) if config.tracking.enabled else None
        self._survey = prior_from_survey(config.survey)
        self._image_prior = ImagePrior()
        self._scheduler = (
            SearchScheduler(detector, config.tracking.search_s) if isinstance(detector, SearchingDetector) else None
        )
        self._attitude = AttitudeCheck(config.tracking.horizon_s)
        self._paint = PaintCheck(config.tracking.paint_s)
        self._track: Track | None = None

    @classmethod
    def from_config(
        cls,
        config: RunConfig | None = None,
        *,
        dehazer: Dehazer | None = None,
        detector: Detector | None = None,
        localizer: Localizer = localize,
    ) -> "Flight":
        """A flight with its models loaded.

        Args:
            config: everything that decides the answers; None: the defaults.
            dehazer, detector: used instead of those that the config names, to share loaded models.
            localizer: another estimator of the lines in the world, to compare with.

        Raises:
            ValueError: an unknown dehazer or detector, or a model file or an engine that cannot be used.
        """
        config = config or RunConfig()
        return cls(
            config,
            dehazer or _build(config.models.dehazer, DEHAZERS, OnnxDehazer, "dehazer", config.engine),
            detector or _build(config.models.detector, DETECTORS, OnnxDetector, "detector", config.engine),
            localizer,
        )

    def __call__(
        self,
        frame: Frame,
        *,
        prior: RunwayPrior | None = None,
        detection: Detection | None = None,
        rng: np.random.Generator | None = None,
    ) -> FrameResult:
        """One frame through all stages.

        Args:
            frame: the next one of the flight.
            prior: where the runway should be; None: where the track, the survey or the last picture has it.
            detection: points of the lines that are known already; the picture is then not searched.
            rng: RANSAC's draws; None: a generator of the frame's own, from `config.seed` and the file's name.
        """
        seconds: dict[str, float] = {}
        is_searched = detection is None and self.tracker is not None
        dehazed = self._dehaze(frame, detection is None, seconds)
        if detection is None:
            picture = dehazed.image_rgb if dehazed and self.config.models.detect_in == "dehazed" else frame.image_rgb
            detection = _timed(seconds, "detect", lambda: self._detect(frame, picture, prior))
        points = detection
        rng = rng or np.random.default_rng([self.config.seed, zlib.crc32(frame.file.encode())])
        estimate = _timed(seconds, "localize", lambda: self.localizer(frame, points, self.config, rng))
        if is_searched:
            self._attitude(frame)
            self._paint(frame, estimate, points.edge)
        track = _timed(seconds, "track", lambda: self._follow(frame, points, estimate))
        advice = _timed(seconds, "guide", lambda: guidance(frame, estimate, track, self.config.approach))
        return FrameResult(frame, points, estimate, advice, seconds, track, dehazed)

    def _dehaze(self, frame: Frame, is_searched: bool, seconds: dict[str, float]) -> DehazeResult | None:
        models = self.config.models
        if is_searched and models.detect_in == "dehazed":
            return _timed(seconds, "dehaze", lambda: dehaze_frame(frame, self.dehazer, models))
        if models.visibility:
            return _timed(seconds, "dehaze", lambda: dehaze_for_display(frame, self.dehazer, models))
        return None

    def _detect(self, frame: Frame, picture: NDArray[np.uint8], prior: RunwayPrior | None) -> Detection:
        tracked = None if self.tracker is None else self.tracker.runway_prior(frame)
        for known in (prior, tracked, self._survey):
            box = None if known is None else project_prior(frame, known)
            if box is not None:
                is_sure = known is tracked and self._track is not None and not self._track.flags
                return self._look(frame, picture, box, is_sure)
        box = None if self.tracker is None else self._image_prior.predict(frame)
        return self._look(frame, picture, box, is_sure=True)

    def _look(self, frame: Frame, picture: NDArray[np.uint8], box: Box | None, is_sure: bool) -> Detection:
        """Lines of the picture, where they should be (`box`) if the track is sure of that."""
        if self._scheduler is None or self.tracker is None:
            return self.detector(picture, box)
        return self._scheduler(frame.time_s, picture, box, is_sure)

    def _follow(self, frame: Frame, detection: Detection, estimate: RunwayEstimate) -> Track | None:
        if self.tracker is None:
            return None
        self._image_prior.update(frame, detection, estimate)
        track = self.tracker.update(frame, estimate)
        others = OTHER_LINES if self._scheduler is not None and self._scheduler.is_contradicted else None
        self._track = replace(
            track, flags=(*track.flags, *filter(None, (others, self._attitude.flag, self._paint.flag)))
        )
        return self._track


def _build(
    name: str, builders: dict[str, Callable[..., T]], from_file: Callable[..., T], what: str, engine: Engine
) -> T:
    if name in builders:
        return builders[name](engine)
    if name.endswith(".onnx"):
        return from_file(Path(name), engine=engine)
    raise ValueError(f"unknown {what} {name!r}: use one of {', '.join(builders)}, or the path of an .onnx file")


def _timed(seconds: dict[str, float], stage: str, call: Callable[[], T]) -> T:
    start = time.perf_counter()
    result = call()
    seconds[stage] = time.perf_counter() - start
    return result
