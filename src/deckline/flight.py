"""From frame to guidance: the only module that joins the stages.

    detect    lines in the picture, searched where `Tracker.predict` expects the runway
    localize  the lines in the world, with covariance, from this frame alone
    monitors  flags that contradict lines or pose without the track
    track     the lines over frames: the filter's update, gate and fault tests
    guide     lateral deviation, heading error, height, distance: `guide/deviations.py`

 A detector that was trained on haze finds more in the hazy picture; the
dehazed one is for people, and for detectors that never saw haze (`models.detect_in`).
"""

import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from deckline.config import Engine, Models, RunConfig
from deckline.dehaze import DEHAZERS, Dehazer, DehazeResult, OnnxDehazer, downscale_frame, restore
from deckline.detect import DETECTORS, Detector, OnnxDetector, SearchingDetector, SearchScheduler
from deckline.detect.crop import Box
from deckline.detect.prior import ImagePrior, prior_from_survey, project_prior
from deckline.guide import guidance
from deckline.localize import Localizer, localize
from deckline.monitors import Monitor, build_monitors
from deckline.track import Prediction, Tracker
from deckline.types import Detection, Diagnostics, Frame, Guidance, RunwayEstimate, RunwayPrior, Track, Value

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class FrameResult:
    """Everything that came out of one frame."""

    frame: Frame
    dehazing: "Dehazing"  # made when somebody looks
    detection: Detection
    estimate: RunwayEstimate  # from this frame alone
    guidance: Guidance
    seconds: dict[str, float]  # wall time of "detect", "localize", "track" and "guide", of "dehaze" when it was made
    track: Track | None = None  # of the frames so far; None: every frame is for itself

    @property
    def dehazed_rgb(self) -> NDArray[np.uint8]:
        """The dehazed picture (H, W, 3), made by the first who asks for it."""
        return self.dehazing().image_rgb


@dataclass(frozen=True, eq=False)
class Dehazing:
    """A frame's dehazed picture, made on demand and kept."""

    frame: Frame
    dehazer: Dehazer
    seconds: dict[str, float]  # of the frame's stages; gets "dehaze"
    models: Models = field(default_factory=Models)
    made: dict[tuple[int, int], DehazeResult] = field(default_factory=dict)

    def __call__(self, long_side_px: int | None = None) -> DehazeResult:
        """The picture with this longer side at most; None: as large as the frame."""
        frame = self.frame if long_side_px is None else downscale_frame(self.frame, long_side_px)
        size = frame.camera.width, frame.camera.height
        if size not in self.made:
            self.made[size] = _timed(self.seconds, "dehaze", lambda: self._restore(frame))
        return self.made[size]

    def _restore(self, frame: Frame) -> DehazeResult:
        restored, height_m = restore(self.dehazer, frame, self.models.strength), self.models.camera_height_m
        heights = restored.visibility_heights
        if heights is None or height_m is None or restored.visibility_m is not None:
            return restored
        return replace(restored, visibility_m=Value(heights.value * height_m, heights.sigma * height_m))

    def shown(self, long_side_px: int) -> DehazeResult:
        """The same for people, of any size that was made before.

        A frame that the dehazer refuses is shown as it is, with the reason, and stays flown.
        """
        try:
            return self.restored or self(long_side_px)
        except ValueError as error:
            frame = downscale_frame(self.frame, long_side_px)
            left = DehazeResult(frame.image_rgb.copy(), f"not dehazed: {' '.join(str(error).split())}")
            return self.made.setdefault((frame.camera.width, frame.camera.height), left)

    @property
    def restored(self) -> DehazeResult | None:
        """What was made first; None when nobody asked."""
        return next(iter(self.made.values()), None)

    @property
    def note(self) -> str | None:
        """Why the picture that was made is left as it is; None for one that is dehazed, or that nobody asked for."""
        return next((made.note for made in self.made.values() if made.note), None)


class Flight:
    """Called with every frame of one flight, in their order; returns where the aircraft is.

    The search starts where the track expects the runway, else at the surveyed place, else where the last picture showed
    it. Frames that are unrelated to each other get results of their own; for these `tracking.enabled = false` saves the
    filter. `reset` starts another flight with the same models. `close`, or leaving `with Flight(...) as flight`, ends
    the threads of its monitors.

    Args:
        config: everything that decides the answers.
        dehazer: makes the picture for people.
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
        self._scheduler: SearchScheduler | None = None
        self._monitors: tuple[Monitor, ...] = ()
        if self.tracker is not None:
            self._monitors = build_monitors(config.tracking)
            if isinstance(detector, SearchingDetector):  # stated by the detector's class, see there
                self._scheduler = SearchScheduler(detector, config.tracking.search_s)
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
            detector or _build(config.models.detector, DETECTORS, OnnxDetector, "detector", config.engine),
            localizer,
        )

    def reset(self) -> None:
        """Start another flight: forget all frames."""
        self._image_prior = ImagePrior()
        if self.tracker is not None:
            self.tracker.reset()
        for monitor in self._monitors:
            monitor.reset()

    def close(self) -> None:
        """End the threads of the monitors."""
        for monitor in self._monitors:
            monitor.close()

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
            frame: the next one of the flight.
            prior: where the runway should be; None: where the track, the survey or the last picture has it.
            detection: points of the lines that are known already; the picture is then neither dehazed nor searched.
            rng: RANSAC's draws; None: a generator of the frame's own, from `config.seed` and the file's name.
        """
        seconds: dict[str, float] = {}
        prediction = None if self.tracker is None else self.tracker.predict(frame)
        is_given = detection is not None
        dehazing = Dehazing(frame, self.dehazer, seconds, self.config.models)
        if detection is None:
            picture = frame.image_rgb if self.config.models.detect_in == "hazy" else dehazing().image_rgb
            detection = _timed(seconds, "detect", lambda: self._detect(frame, picture, prior, prediction))
        points = detection
        rng = rng or np.random.default_rng([self.config.seed, zlib.crc32(frame.file.encode())])
        estimate = _timed(seconds, "localize", lambda: self.localizer(frame, points, self.config, rng))
        flags = self._monitor(prediction, estimate, None if is_given else points)
        track = _timed(seconds, "track", lambda: self._update_track(prediction, points, estimate, flags))
        advice = _timed(seconds, "guide", lambda: guidance(frame, estimate, track, self.config.approach))
        return FrameResult(frame, dehazing, points, estimate, advice, seconds, track)

    def _detect(
        self, frame: Frame, picture: NDArray[np.uint8], prior: RunwayPrior | None, prediction: Prediction | None
    ) -> Detection:
        tracked = None if prediction is None else prediction.runway
        for known in (prior, tracked, self._survey):
            box = None if known is None else project_prior(frame, known)
            if box is not None:
                is_sure = known is tracked and self.tracker is not None and not self.tracker.is_flagged
                return self._detect_in_box(frame, picture, box, is_sure)
        box = None if self.tracker is None else self._image_prior.predict(frame)
        return self._detect_in_box(frame, picture, box, is_sure=True)

    def _detect_in_box(self, frame: Frame, picture: NDArray[np.uint8], box: Box | None, is_sure: bool) -> Detection:
        """Lines in the picture; `box`: where they should be, `is_sure`: as the frames before confirm."""
        if self._scheduler is None:
            return self.detector(picture, box)
        return self._scheduler.detect(frame.time_s, picture, box, is_sure)

    def _monitor(
        self, prediction: Prediction | None, estimate: RunwayEstimate, detection: Detection | None
    ) -> Diagnostics:
        """The flags of all monitors; `detection`: None when the points were given. Late frames are not monitored."""
        if prediction is None or prediction.refused is not None:
            return ()
        flags = (monitor.update(prediction.frame, estimate, detection) for monitor in self._monitors)
        return tuple(chain.from_iterable(flags))

    def _update_track(
        self, prediction: Prediction | None, detection: Detection, estimate: RunwayEstimate, flags: Diagnostics
    ) -> Track | None:
        if self.tracker is None or prediction is None:
            return None
        self._image_prior.update(prediction.frame, detection, estimate)
        return self.tracker.update(prediction, estimate, flags)


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
