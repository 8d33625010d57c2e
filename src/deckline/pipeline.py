"""From frame to guidance: the only module that joins the stages.

dehaze, detect -> localize -> guide. Each stage is a plain callable; swap any of them. A detector that was trained on
haze finds more in the hazy picture; the dehazed one is for people, and for detectors that were not (`detect_in`).
"""

import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze import DEHAZERS, Dehazer, OnnxDehazer, restore
from deckline.detect import DETECTORS, Detector, OnnxDetector
from deckline.detect.crop import Box
from deckline.detect.prior import RunwaySurvey, prior_from_survey, project_prior
from deckline.guide import guidance
from deckline.localize import LocalizeConfig, localize
from deckline.types import Detection, Frame, Guidance, RunwayEstimate, RunwayPrior, Track

T = TypeVar("T")
Picture = Literal["hazy", "dehazed"]


@dataclass(frozen=True)
class PipelineConfig:
    """What the chain is made of. A dehazer or detector is a name of the shipped ones or the path of an ONNX file."""

    dehazer: str = "coarse-t"
    detector: str = "hybrid"
    localize: LocalizeConfig = field(default_factory=LocalizeConfig)
    seed: int = 0  # of RANSAC's draws; every frame has its own generator
    runway: RunwaySurvey = field(default_factory=RunwaySurvey)  # where the runway is, if known beforehand
    detect_in: Picture = "hazy"  # the picture that lines are looked for in; the paper's way is the dehazed one


@dataclass(frozen=True, eq=False)
class FrameResult:
    """Everything that came out of one frame."""

    frame: Frame
    dehazed_rgb: NDArray[np.uint8]  # (H, W, 3)
    detection: Detection
    estimate: RunwayEstimate
    guidance: Guidance
    seconds: dict[str, float]  # wall time of "dehaze", "detect", "localize", "guide"
    track: Track | None = None  # of the frames so far; None: every frame for itself


class Pipeline:
    """The chain with its models loaded once.

    Raises:
        ValueError: an unknown dehazer or detector, or a model file that cannot be used.
    """

    def __init__(self, config: PipelineConfig | None = None) -> None:
        self.config = config or PipelineConfig()
        self.dehaze: Dehazer = _build(self.config.dehazer, DEHAZERS, OnnxDehazer, "dehazer")
        self.detect: Detector = _build(self.config.detector, DETECTORS, OnnxDetector, "detector")
        self.survey = prior_from_survey(self.config.runway)

    def __call__(self, frame: Frame, prior: RunwayPrior | None = None, prior_box: Box | None = None) -> FrameResult:
        """One frame through the chain.

        Args:
            prior: where the runway should be, as a tracker predicts it; used before the survey.
            prior_box: box in this image where the runway should be, for when neither prior nor survey has one.
        """
        rng = np.random.default_rng([self.config.seed, zlib.crc32(frame.file.encode())])
        seconds: dict[str, float] = {}
        prior_box = self._prior_box(frame, prior) or prior_box
        restored = _timed(seconds, "dehaze", lambda: restore(self.dehaze, frame))
        picture = frame.image_rgb if self.config.detect_in == "hazy" else restored.image_rgb
        detection = _timed(seconds, "detect", lambda: self.detect(picture, prior_box))
        estimate = _timed(seconds, "localize", lambda: localize(frame, detection, self.config.localize, rng))
        advice = _timed(seconds, "guide", lambda: guidance(frame, estimate))
        if restored.note:
            advice = replace(advice, reason="; ".join(filter(None, (restored.note, advice.reason))))
        return FrameResult(frame, restored.image_rgb, detection, estimate, advice, seconds)

    def _prior_box(self, frame: Frame, prior: RunwayPrior | None) -> Box | None:
        """Where the runway should be in the image: as the caller says, else the survey."""
        for known in (prior, self.survey):
            box = None if known is None else project_prior(frame, known)
            if box is not None:
                return box
        return None


def _build(name: str, builders: dict[str, Callable[[], T]], from_file: Callable[[Path], T], what: str) -> T:
    if name in builders:
        return builders[name]()
    if name.endswith(".onnx"):
        return from_file(Path(name))
    raise ValueError(f"unknown {what} {name!r}: use one of {', '.join(builders)}, or the path of an .onnx file")


def _timed(seconds: dict[str, float], stage: str, call: Callable[[], T]) -> T:
    start = time.perf_counter()
    result = call()
    seconds[stage] = time.perf_counter() - start
    return result
