"""The rows of `deckline eval localization`: which chain each is, and how they share what they have in common."""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from deckline.config import Models, RunConfig
from deckline.dehaze import NOT_DEHAZED
from deckline.detect import Detector
from deckline.flight import Flight
from deckline.localize import Localizer, localize
from deckline.report.provenance import settings_of
from deckline_lab.evaluation.approaches import PointNoise, point_flight
from deckline_lab.evaluation.chain import single_frames
from deckline_lab.evaluation.dehazers import SharedDehazer, detector_label
from deckline_lab.rivals.catalog import flight_from_config
from deckline_lab.rivals.sgd import localize_by_descent


@dataclass(frozen=True)
class Method:
    """A row of the tables: a configuration, and the estimator of its lines in the world."""

    name: str
    config: RunConfig
    localizer: Localizer = localize

    @property
    def tracked(self) -> bool:
        return self.config.tracking.enabled


def methods_of(config: RunConfig, ufld: str, rivals: Sequence[str] = ()) -> list[Method]:
    """The rows of the table, the one that improvements refer to first.

    Args:
        config: of our rows; the last one flies it as `deckline run` does, but for the picture for people.
        ufld: the detector of the first row, which sees the haze.
        rivals: detectors of further rows, as the first.

    Raises:
        ValueError: two rivals that would have one name.
    """
    single, models = single_frames(config), config.models

    def hazy(detector: str) -> RunConfig:
        return replace(single, models=Models(NOT_DEHAZED, detector, "hazy"))

    dehazed = replace(models, detect_in="dehazed")
    named = {"ufld": ufld}
    for each in rivals:
        if named.setdefault(detector_label(each), each) != each:
            raise ValueError(f"rival: two rows would be called {detector_label(each)}: rename {each} or its folder")
    ours = [
        Method("dehazed, paper's", replace(single, models=dehazed), localize_by_descent),
        Method("dehazed, ours", replace(single, models=dehazed)),
        Method("dehazed, ours, tracked", replace(config, models=dehazed)),
        Method("hazy, ours, tracked", replace(config, models=hazy(models.detector).models)),
    ]
    return [
        *(Method(f"{name}, hazy, paper's", hazy(each), localize_by_descent) for name, each in named.items()),
        *ours,
    ]


@dataclass(frozen=True, eq=False)
class LocalizationBench:
    """Every method's models, loaded once."""

    start: Callable[[Method], Flight]  # a new flight of a method
    settings: dict[str, Any]  # what decides the numbers: plain values
    correlation: float = 0.0  # of neighbouring points' errors, where they are drawn: what the bound counts


def load(methods: Sequence[Method]) -> LocalizationBench:
    """Load each model once; methods that share a dehazer share its work."""
    settings: dict[str, Any] = {}
    dehazers: dict[str, SharedDehazer] = {}
    detectors: dict[str, Detector] = {}
    for method in methods:
        flight = flight_from_config(method.config)
        settings[method.name] = {**settings_of(flight), "estimator": method.localizer.__name__}
        dehazers.setdefault(method.config.models.dehazer, SharedDehazer(flight.dehazer))
        detectors.setdefault(method.config.models.detector, flight.detector)

    def start(method: Method) -> Flight:
        models = method.config.models
        return Flight(method.config, dehazers[models.dehazer], detectors[models.detector], method.localizer)

    return LocalizationBench(start, settings)


def point_methods(config: RunConfig) -> list[Method]:
    """The rows that need no picture."""
    single = single_frames(config)
    return [
        Method("paper's", single, localize_by_descent),
        Method("ours", single),
        Method("ours, tracked", config),
    ]


def point_bench(methods: list[Method], noise: PointNoise) -> LocalizationBench:
    """Flights that are given their detections."""

    def start(method: Method) -> Flight:
        return point_flight(method.config, method.localizer)

    settings: dict[str, Any] = {"points": asdict(noise)}
    settings |= {method.name: settings_of(start(method)) for method in methods}
    return LocalizationBench(start, settings, noise.correlation)


def point_rng(file: str) -> np.random.Generator:
    """RANSAC's draws of one frame."""
    return np.random.default_rng(zlib.crc32(file.encode()))
