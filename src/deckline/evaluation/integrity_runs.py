"""One flight with one fault, through localization and tracking: what a pilot would have been told."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from deckline.dehaze import DEHAZERS, NOT_DEHAZED
from deckline.detect import ClassicalDetector
from deckline.evaluation.integrity_faults import FAULTS, Fault, Shot, inject
from deckline.evaluation.integrity_measure import Moment
from deckline.evaluation.integrity_points import PointNoise
from deckline.evaluation.localization_flights import FlightsConfig, fly
from deckline.evaluation.localization_measure import pilot_figures
from deckline.extras import needs_extra
from deckline.flight import Flight, FrameResult
from deckline.types import Frame

ONSET = (0.2, 0.6)  # part of the flight after which a sudden fault comes, drawn between these
NOMINAL = "nominal"  # a run without a fault
DRAW, RANSAC = 41, 42  # random streams


@dataclass(frozen=True)
class Run:
    """One flight; its number decides weather, errors and how bad the fault is."""

    fault: str  # of FAULTS, or NOMINAL
    number: int

    @property
    def name(self) -> str:
        return f"{self.fault}, run {self.number}"


def fly_points(run: Run, flights: FlightsConfig, noise: PointNoise) -> list[Moment]:
    """A run without pictures.

    Raises:
        ImportError: the sim extra is not installed.
    """
    return fly_shots(_points(flights, noise, run.number), run, flights)


@lru_cache(maxsize=1)  # all faults are put into one flight after the other
def _points(flights: FlightsConfig, noise: PointNoise, number: int) -> tuple[Shot, ...]:
    with needs_extra("sim"):
        from deckline.evaluation.integrity_flights import point_flight
    return tuple(point_flight(flights.approach(number), flights.run.sensors, noise))


def detect_shots(flight: Flight, flights: FlightsConfig, number: int) -> Iterator[Shot]:
    """The rendered frames of one approach, and what the detector saw in each."""
    for frame in fly(flights, number):
        yield Shot(frame, flight(frame).detection)


def fly_shots(shots: Iterable[Shot], run: Run, flights: FlightsConfig) -> list[Moment]:
    """A run over frames in order of time."""
    draw = np.random.default_rng([flights.seed, run.number, DRAW])
    fault = FAULTS.get(run.fault)
    onset_s = float(draw.uniform(*ONSET)) * duration_s(flights)
    flight = Flight(flights.run, DEHAZERS[NOT_DEHAZED](), ClassicalDetector())
    moments = []
    for index, shot in enumerate(inject(shots, fault, onset_s, draw)):
        rng = np.random.default_rng([flights.seed, run.number, index, RANSAC])
        result = flight(shot.frame, detection=shot.detection, rng=rng)
        moments.append(moment_of(result, is_there(fault, shot.frame, onset_s), flights.run.approach.touchdown_m))
    return moments


def is_there(fault: Fault | None, frame: Frame, onset_s: float) -> bool:
    """Whether a fault has begun."""
    return fault is not None and (not fault.sudden or frame.time_s >= onset_s)


def duration_s(flights: FlightsConfig) -> float:
    """How long an approach takes in still air."""
    return (flights.range_m[0] - flights.range_m[1]) / flights.approach(0).flight.speed_m_s


def moment_of(result: FrameResult, faulty: bool, touchdown_m: float) -> Moment:
    """A frame as the pilot has it, against its truth.

    Raises:
        ValueError: a flight without a track.
    """
    frame, track, flags = result.frame, result.track, result.guidance.flags
    if track is None:
        raise ValueError(f"{frame.file}: integrity needs a track, got a flight without one")
    centre, protection = track.lines.get("centre"), track.protection
    errors: dict[str, Any] = {} if centre is None else pilot_figures(frame, centre, touchdown_m)
    return Moment(
        frame.time_s,
        faulty,
        bool(flags),
        errors.get("deviation_m"),
        errors.get("height_m"),
        None if protection is None else protection.lateral_m,
        None if protection is None else protection.vertical_m,
        bool(track.excluded),
        tuple(str(flag.reason) for flag in flags),
    )
