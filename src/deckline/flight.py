"""From frame to guidance: the only module that joins the stages.

dehaze, detect -> localize -> track -> guide. A detector that was trained on haze finds more in the hazy picture; the
dehazed one is for people, and for detectors that never saw haze (`models.detect_in`).
"""

import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from deckline.attitude import AttitudeCheck
from deckline.config import Engine, Models, RunConfig
from deckline.dehaze import DEHAZERS, Dehazer, DehazeResult, OnnxDehazer, downscale_frame, restore
from deckline.detect import DETECTORS, Detector, OnnxDetector, SearchingDetector, SearchScheduler
from deckline.detect.crop import Box
from deckline.detect.prior import ImagePrior, prior_from_survey, project_prior
from deckline.guide import guidance
from deckline.localize import Localizer, localize
from deckline.paint import PaintCheck
from deckline.track import Tracker
from deckline.types import Detection, Diagnostic, Frame, Guidance, Reason, RunwayEstimate, RunwayPrior, Track, Value

T = TypeVar("T")
OTHER_LINES = Diagnostic(Reason.OTHER_LINES, "a search of the whole picture sees other lines than the track")


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
    """Called with every frame of one flight, in their order; answers where the aircraft is.

    The search starts where the track expects the runway, else where the survey says, else where the last picture
    showed it. Frames that are unrelated to each other are answered one by one; for these `tracking.enabled = false`
    saves the filter.

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
            detection: points of the lines that are known already; the picture is then neither dehazed nor searched.
            rng: RANSAC's draws; None: a generator of the frame's own, from `config.seed` and the file's name.
        """
        seconds: dict[str, float] = {}
        is_searched = detection is None and self.tracker is not None
        dehazing = Dehazing(frame, self.dehazer, seconds, self.config.models)
        if detection is None:
            picture = frame.image_rgb if self.config.models.detect_in == "hazy" else dehazing().image_rgb
            detection = _timed(seconds, "detect", lambda: self._detect(frame, picture, prior))
        points = detection
        rng = rng or np.random.default_rng([self.config.seed, zlib.crc32(frame.file.encode())])
        estimate = _timed(seconds, "localize", lambda: self.localizer(frame, points, self.config, rng))
        if is_searched:
            self._attitude(frame)
            self._paint(frame, estimate, points.edge)
        track = _timed(seconds, "track", lambda: self._follow(frame, points, estimate))
        advice = _timed(seconds, "guide", lambda: guidance(frame, estimate, track, self.config.approach))
        return FrameResult(frame, dehazing, points, estimate, advice, seconds, track)

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
    raise ValueError(
        f"unknown {what} {name!r}: use one of {', '.join(builders)}, or the path of an .onnx file; "
        "rivals to compare with belong to deckline eval"
    )


def _timed(seconds: dict[str, float], stage: str, call: Callable[[], T]) -> T:
    start = time.perf_counter()
    result = call()
    seconds[stage] = time.perf_counter() - start
    return result
