"""From frame to guidance: the only module that joins the stages.

    detect    lines in the picture, searched where `Tracker.predict` expects the runway
    localize  the lines in the world, with covariance, from this frame alone
    monitors  flags that contradict lines or pose without the track
    track     the lines over frames: the filter's update, gate and fault tests
    picture_pose  without a pose: where the aircraft is by lines, horizon and width alone, over frames
    guide     lateral deviation, heading error, height, distance: `guide/deviations.py`

A detector that was trained on haze finds more in the hazy picture. The chain dehazes only for a detector that never saw
haze (`models.detect_in`), or to measure the visibility (`models.visibility`); views dehaze their own pictures.
"""

import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from deckline.config import CPU, Engine, RunConfig
from deckline.dehaze import DEHAZERS, Dehazer, DehazeResult, OnnxDehazer, dehaze_for_display, dehaze_frame
from deckline.detect import DETECTORS, Detector, OnnxDetector, SearchingDetector, SearchScheduler
from deckline.detect.joined import FrameStack, view_joined, view_place_joined
from deckline.detect.motion import DeckMotion, place_motion
from deckline.detect.prior import ImagePrior, prior_from_survey, project_prior
from deckline.guide import guidance
from deckline.localize import Localizer, localize
from deckline.monitors import Monitor, build_monitors
from deckline.picture_pose import PictureForecast, PictureTracker
from deckline.track import Forecast, Prediction, Tracker, ship_velocity
from deckline.types import (
    DepthMode,
    Detection,
    Diagnostics,
    Frame,
    Guidance,
    LinePoints,
    LineVisibility,
    RunwayEstimate,
    RunwayPrior,
    Track,
    TrackState,
)

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class FrameResult:
    """Everything that the chain found in one frame; final."""

    frame: Frame
    """The frame itself; one without a pose has the pose that its picture gives (`Frame.pose_source`)."""
    detection: Detection
    """Points of the lines in its picture."""
    estimate: RunwayEstimate
    """Lines in the world, from this frame alone."""
    guidance: Guidance
    """Where the aircraft is relative to them."""
    seconds: Mapping[str, float]
    """Wall time of `detect`, `localize`, `track`, `guide`, `picture` (its pose), `dehaze`, as far as it has them, s."""
    track: Track | None = None
    """Lines in the world, from the frames so far; None: every frame is for itself."""
    dehazed: DehazeResult | None = None
    """What the chain dehazed: the whole picture for `models.detect_in = "dehazed"`, a small one for
    `models.visibility`; None with neither."""


class Flight:
    """Called with every frame of one flight, in their order; returns where the aircraft is.

    The search starts where the track expects the runway, else at the surveyed place, else where the last picture showed
    it. Frames that are unrelated to each other get results of their own; for these `tracking.enabled = false` saves the
    filter. `reset` starts another flight with the same models. `close`, or leaving `with Flight(...) as flight`, ends
    the threads of its monitors.

    With tracking, `Tracker.predict` alone judges a frame's time. A time that is not a number, repeated, or a little
    earlier than the one before is refused: no stage sees that frame, and its answer has the reason BAD_TIME and no
    numbers. A time more than two seconds back starts another flight. All stages rely on times that increase.

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
        self.picture = PictureTracker(config)
        self._by_picture = False  # what answered last
        self._survey = prior_from_survey(config.survey, config.deck.width_m)
        self._image_prior = ImagePrior()
        self._stack = FrameStack(config.models.join_frames)
        self._scheduler: SearchScheduler | None = None
        self._monitors: tuple[Monitor, ...] = ()
        if self.tracker is not None:
            self._monitors = build_monitors(config.tracking)
            if isinstance(detector, SearchingDetector):  # stated by the detector's class, see there
                self._scheduler = SearchScheduler(detector, config.tracking.search_s, config.tracking.first_at_once)
                self._monitors = (self._scheduler, *self._monitors)

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
            detector or open_detector(config.models.detector, config.engine),
            localizer,
        )

    def reset(self) -> None:
        """Start another flight: forget all frames."""
        if self.tracker is not None:
            self.tracker.reset()
        self._reset_stages()

    def _reset_stages(self) -> None:
        """Forget all frames but the tracker's, which says itself why its track ends."""
        self._image_prior = ImagePrior()
        self._stack.reset()
        self.picture.reset()
        for monitor in self._monitors:
            monitor.reset()

    def close(self) -> None:
        """End the threads of the monitors and of the search for the horizon."""
        self.picture.close()
        for monitor in self._monitors:
            monitor.close()

    def forecast(self) -> Forecast | PictureForecast | None:
        """Predicts where the aircraft is after the last frame; None without a track."""
        if self._by_picture:
            return self.picture.forecast()
        return None if self.tracker is None else self.tracker.forecast()

    def search_on(self) -> None:
        """Search on while no frame is there; else the next frame does so first. The answers are the same."""
        if self._scheduler is not None:
            self._scheduler.search_on()

    def __enter__(self) -> "Flight":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

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
            frame: the next one of the flight, or the first one of another.
            prior: where the runway should be; None: where the track, the survey or the last picture has it.
            detection: points of the lines that are known already; the picture is then not searched.
            rng: RANSAC's draws; None: a generator of the frame's own, from `config.seed` and the file's name.
        """
        seconds: dict[str, float] = {}
        prediction = None if self.tracker is None else self.tracker.predict(frame)
        if prediction is not None and prediction.refused is not None:
            return self._refuse(prediction)
        if prediction is not None and prediction.step_s < 0:  # another flight
            self._reset_stages()
        is_given = detection is not None
        dehazed = self._dehaze(frame, not is_given, seconds)
        if detection is None:
            picture = dehazed.image_rgb if dehazed and self.config.models.detect_in == "dehazed" else frame.image_rgb
            detection = _timed(seconds, "detect", lambda: self._detect(frame, picture, prior, prediction))
        points = detection
        rng = rng or np.random.default_rng([self.config.seed, zlib.crc32(frame.file.encode())])
        estimate = _timed(seconds, "localize", lambda: self.localizer(frame, points, self.config, rng))
        monitored = (monitor.update(frame, estimate, None if is_given else points) for monitor in self._monitors)
        flags = tuple(chain.from_iterable(monitored))
        track = _timed(seconds, "track", lambda: self._update_track(prediction, points, estimate, flags))
        self._by_picture = False
        if frame.world_from_body is None:
            answer = _timed(seconds, "picture", lambda: self.picture.update(frame, points, estimate, flags))
            is_lost = track is None or track.state is TrackState.LOST
            self._by_picture = is_lost or (answer.track is not None and answer.track.state is not TrackState.LOST)
            if self._by_picture:
                frame, estimate, track = answer.frame, answer.estimate, answer.track
        advice = _timed(seconds, "guide", lambda: guidance(frame, estimate, track, self.config.approach))
        return FrameResult(frame, points, estimate, advice, seconds, track, dehazed)

    def _refuse(self, prediction: Prediction) -> FrameResult:
        """The answer to a frame whose time cannot be used."""
        frame, nothing = prediction.frame, Detection(LinePoints.empty(), LinePoints.empty())
        estimate = RunwayEstimate(LineVisibility.NONE, DepthMode.NONE, {}, {})
        track = self._update_track(prediction, nothing, estimate, ())
        return FrameResult(frame, nothing, estimate, guidance(frame, estimate, track, self.config.approach), {}, track)

    def _dehaze(self, frame: Frame, is_searched: bool, seconds: dict[str, float]) -> DehazeResult | None:
        models = self.config.models
        if is_searched and models.detect_in == "dehazed":
            return _timed(seconds, "dehaze", lambda: dehaze_frame(frame, self.dehazer, models))
        if models.visibility:
            return _timed(seconds, "dehaze", lambda: dehaze_for_display(frame, self.dehazer, models))
        return None

    def _detect(
        self, frame: Frame, picture: NDArray[np.uint8], prior: RunwayPrior | None, prediction: Prediction | None
    ) -> Detection:
        tracked = None if prediction is None else prediction.runway
        if self._scheduler is not None:
            self._stack.add(frame, picture)
        is_sure, joined, is_wide = True, None, False  # the frames before confirm the box
        velocity = ship_velocity(prediction, self.config)
        for known in (prior, tracked, self._survey):
            box = None if known is None else project_prior(frame, known)
            if known is not None and box is not None:
                is_sure = known is tracked and self.tracker is not None and not self.tracker.is_flagged
                joined = partial(view_joined, stack=self._stack, motion=DeckMotion(known, velocity))
                break
        else:
            box = None if self.tracker is None else self._image_prior.predict(frame)
            if box is not None:
                joined = partial(view_joined, stack=self._stack, motion=place_motion(frame, box, velocity))
                is_wide = True
        if self._scheduler is None:
            return self.detector(picture, box)
        at_place = partial(view_place_joined, stack=self._stack, frame=frame, velocity_m_s=velocity)
        return self._scheduler.detect(frame.time_s, picture, box, is_sure, joined, at_place, is_wide)

    def _update_track(
        self, prediction: Prediction | None, detection: Detection, estimate: RunwayEstimate, flags: Diagnostics
    ) -> Track | None:
        if self.tracker is None or prediction is None:
            return None
        self._image_prior.update(prediction.frame, detection, estimate)
        return self.tracker.update(prediction, estimate, flags, detection.frames)


def open_detector(name: str, engine: Engine = CPU) -> Detector:
    """The detector of a name in `DETECTORS`, or of the path of an .onnx file.

    Raises:
        ValueError: another name, or a file or an engine that cannot be used.
    """
    return _build(name, DETECTORS, OnnxDetector, "detector", engine)


def _build(
    name: str, builders: dict[str, Callable[..., T]], from_file: Callable[..., T], what: str, engine: Engine
) -> T:
    if name in builders:
        return builders[name](engine)
    if name.endswith(".onnx"):
        return from_file(Path(name), engine=engine)
    raise ValueError(
        f"unknown {what} {name!r}: use one of {', '.join(builders)}, or the path of an .onnx file; "
        "rivals to compare with belong to deckline eval"
    )


def _timed(seconds: dict[str, float], stage: str, call: Callable[[], T]) -> T:
    start = time.perf_counter()
    result = call()
    seconds[stage] = time.perf_counter() - start
    return result
