"""`deckline eval localization --points`: the same tables without pictures, of points with a stated noise."""

import zlib
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from deckline.config import RunConfig
from deckline.dehaze import DEHAZERS, NOT_DEHAZED
from deckline.detect import ClassicalDetector
from deckline.evaluation.chain import single_frames
from deckline.evaluation.integrity_points import PointNoise
from deckline.evaluation.localization_flights import FlightsConfig
from deckline.evaluation.localization_methods import Bench, Method
from deckline.extras import needs_extra
from deckline.flight import Flight
from deckline.report.provenance import settings_of
from deckline.research.sgd import localize_by_descent
from deckline.types import Detection, Frame


def point_methods(config: RunConfig) -> list[Method]:
    """The rows that need no picture."""
    single = single_frames(config)
    return [
        Method("paper's", single, localize_by_descent),
        Method("ours", single),
        Method("ours, tracked", config),
    ]


def point_bench(methods: list[Method], noise: PointNoise) -> Bench:
    """Flights that are given their detections."""

    def start(method: Method) -> Flight:
        return Flight(method.config, DEHAZERS[NOT_DEHAZED](), ClassicalDetector(), method.localizer)

    settings: dict[str, Any] = {"points": asdict(noise)}
    settings |= {method.name: settings_of(start(method)) for method in methods}
    return Bench(start, lambda: None, settings, noise.correlation)


def fly_points(flights: FlightsConfig, number: int, noise: PointNoise) -> Iterator[tuple[Frame, Detection]]:
    """The frames of one approach with the modelled detections.

    Raises:
        ImportError: the sim extra is not installed.
    """
    with needs_extra("sim"):
        from deckline.evaluation.integrity_flights import point_flight
    for shot in point_flight(flights.approach(number), flights.run.sensors, noise):
        yield shot.frame, shot.detection


def point_rng(file: str) -> np.random.Generator:
    """RANSAC's draws of one frame."""
    return np.random.default_rng(zlib.crc32(file.encode()))
