"""The rows of `deckline eval localization`: which chain each is, and how they share what they have in common."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from deckline.dehaze import NOT_DEHAZED
from deckline.detect import Detector
from deckline.evaluation.dehazing_methods import SharedDehazer
from deckline.localize import LocalizeConfig
from deckline.pipeline import FrameResult, Pipeline, PipelineConfig
from deckline.report.provenance import settings_of
from deckline.types import Detection, Frame, RunwayPrior

Estimator = Literal["paper", "joint"]
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Method:
    """A chain. Dehazer and detector are names or paths of .onnx files."""

    name: str
    dehazer: str
    detector: str
    estimator: Estimator
    tracked: bool = False


def methods_of(
    dehazer: str, detector: str, ufld: str, others: Mapping[str, Path | None]
) -> tuple[list[Method], list[str]]:
    """The rows of the table, the one that improvements refer to first, and what is left out and why.

    Args:
        dehazer, detector: of our rows.
        ufld: the detector of the first row, which sees the haze.
        others: rivals by name; None leaves one out.
    """
    rivals = [
        Method(f"{name}, hazy, paper's", NOT_DEHAZED, str(path), "paper") for name, path in others.items() if path
    ]
    notes = [
        f"no row for {name}: give its network with --{name} FILE.onnx" for name, path in others.items() if not path
    ]
    ours = [
        Method("dehazed, paper's", dehazer, detector, "paper"),
        Method("dehazed, ours", dehazer, detector, "joint"),
        Method("dehazed, ours, tracked", dehazer, detector, "joint", tracked=True),
        Method("hazy, ours, tracked", NOT_DEHAZED, detector, "joint", tracked=True),
    ]
    return [Method("ufld, hazy, paper's", NOT_DEHAZED, ufld, "paper"), *rivals, *ours], notes


class SharedDetector:
    """A detector that gives the same pictures' points again without working for them twice, until `forget`."""

    def __init__(self, detector: Detector) -> None:
        self.name = detector.name
        self._detector = detector
        self._known: list[tuple[NDArray[np.uint8], Box | None, Detection]] = []

    def __call__(self, image_rgb: NDArray[np.uint8], prior_box: Box | None = None) -> Detection:
        for image, box, detection in self._known:
            if image is image_rgb and box == prior_box:
                return detection
        found = self._detector(image_rgb, prior_box)
        self._known.append((image_rgb, prior_box, found))
        return found

    def forget(self) -> None:
        """Let go of the pictures: the next frame brings others."""
        self._known.clear()


class Chain(Protocol):
    """A pipeline, or what stands in for one."""

    @property
    def config(self) -> PipelineConfig: ...

    def __call__(self, frame: Frame, prior: RunwayPrior | None = None) -> FrameResult: ...


@dataclass(frozen=True, eq=False)
class Bench:
    """Every method's chain, loaded once."""

    pipelines: Mapping[str, Chain]  # by the method's name
    forget: Callable[[], None]  # between frames
    settings: dict[str, Any]  # what decides the numbers: plain values
    correlation: float = 0.0  # of neighbouring points' errors, where they are drawn: what the bound counts


def load(methods: list[Method], localize: LocalizeConfig, seed: int = 0) -> Bench:
    """Build the chains; those that share a dehazer or a detector share its work.

    Raises:
        ValueError: an unknown dehazer or detector, or a file that is none.
    """
    pipelines: dict[str, Pipeline] = {}
    settings: dict[str, Any] = {}
    dehazers: dict[str, SharedDehazer] = {}
    detectors: dict[str, SharedDetector] = {}
    for method in methods:
        estimator = replace(localize, method=method.estimator)
        config = PipelineConfig(method.dehazer, method.detector, estimator, seed=seed, detect_in="dehazed")
        pipeline = Pipeline(config)
        settings[method.name] = {**settings_of(pipeline), "tracked": method.tracked}
        pipeline.dehaze = dehazers.setdefault(method.dehazer, SharedDehazer(pipeline.dehaze))
        pipeline.detect = detectors.setdefault(method.detector, SharedDetector(pipeline.detect))
        pipelines[method.name] = pipeline

    def forget() -> None:
        for detector in detectors.values():
            detector.forget()

    return Bench(pipelines, forget, settings)
