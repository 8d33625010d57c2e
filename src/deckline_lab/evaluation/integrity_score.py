"""Flights with faults: is a fault noticed, harmless, or does it mislead?"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from deckline.config import Approach
from deckline.flight import Flight, FrameResult
from deckline.truth import range_to_ramp_m, true_guidance, true_width_m
from deckline.types import Status
from deckline_lab.evaluation.approaches import FlightsConfig, Sighting
from deckline_lab.evaluation.integrity_faults import FAULTS, inject
from deckline_lab.evaluation.pilot_errors import pilot_figures

ALERT_S = 1.0  # a misleading frame this much before the flag still counts as detected; our choice
SETTLED_S = 2.0  # after the first guidance: contradictions have had time to show
ONSET = (0.2, 0.6)  # part of the flight after which a sudden fault comes, drawn between these
NOMINAL = "nominal"  # a run without a fault
DRAW, RANSAC, WIDTH = 41, 42, 43  # random streams


@dataclass(frozen=True)
class FaultRun:
    """One flight; its number decides weather, errors and how bad the fault is."""

    fault: str
    """Name in FAULTS, or NOMINAL."""
    number: int
    """Of the flight, from 0."""
    aid: str = ""
    """Name in AIDS; empty for modelled detections."""

    @property
    def name(self) -> str:
        """The row of the tables that it belongs to."""
        return f"{self.fault}; {self.aid}" if self.aid else self.fault


@dataclass(frozen=True)
class Aid:
    """What measures the scale of a flight besides its pose and deck height."""

    depth: bool
    """The depth camera."""
    width: bool
    """The configured distance between the lines."""


AIDS = {
    "": Aid(True, False),  # of modelled detections
    "no aid": Aid(False, False),
    "depth": Aid(True, False),
    "width": Aid(False, True),
    "depth, width": Aid(True, True),
}


class Outcome(StrEnum):
    """Of a run with a fault."""

    DETECTED = "detected"  # a flag, or no guidance any more, and nothing misled for longer than the time to alert
    HARMLESS = "harmless"  # no flag was needed: no error was ever beyond its protection level
    MISLEADING = "misleading"


@dataclass(frozen=True)
class FrameState:
    """One frame of a run, as the pilot has it."""

    time_s: float
    faulty: bool  # the fault is there by now
    flagged: bool
    lateral_m: float | None  # error of the lateral deviation; None: no centre line was given
    height_m: float | None  # error of the height above the deck, at the touchdown point
    lateral_level_m: float | None  # protection levels; None: none was given
    height_level_m: float | None
    heading_deg: float | None = None  # error of the heading
    distance_m: float | None = None  # error of the distance to the ramp
    heading_level_deg: float | None = None
    distance_level_m: float | None = None
    status: str = Status.UNVERIFIED
    excluded: bool = False  # a measurement contradicted the track and was left out of it
    flags: tuple[str, ...] = ()  # names of what is flagged
    lateral_sigma_m: float | None = None  # 1-sigma as guidance states it
    height_sigma_m: float | None = None
    heading_sigma_deg: float | None = None
    distance_sigma_m: float | None = None
    range_m: float | None = None  # true, to the ramp
    visibility_m: float | None = None  # true; None: not known

    @property
    def protected(self) -> bool:
        """A line with a protection level, and no flag: what a pilot may follow who reads flags alone."""
        given = (self.lateral_m, self.height_m, self.lateral_level_m, self.height_level_m)
        return not self.flagged and None not in given

    @property
    def misleading(self) -> bool:
        """Followed, and with an error beyond its protection level."""
        pairs = (
            (self.lateral_m, self.lateral_level_m),
            (self.height_m, self.height_level_m),
            (self.heading_deg, self.heading_level_deg),
            (self.distance_m, self.distance_level_m),
        )
        return self.protected and any(
            error is not None and level is not None and abs(error) > level for error, level in pairs
        )

    @property
    def is_ok(self) -> bool:
        """A protected line in guidance that is `ok`: what an autopilot takes."""
        return self.protected and self.status == Status.OK


@dataclass(frozen=True)
class FaultRow:
    """All runs of one fault."""

    runs: int
    detected: int
    harmless: int
    misleading: int
    frames: int  # while the fault was there
    misleading_frames: int
    flagged_frames: int
    excluding_frames: int
    lost_frames: int  # without a protected line, flagged or not
    misleading_ok: int  # runs, where frames that are not `ok` are not followed
    ok_frames: int  # while the fault was there
    misleading_ok_frames: int  # of them
    delay_s: float  # median from the fault's beginning to the first flag; NaN without one


def outcome(run: Sequence[FrameState], alert_s: float = ALERT_S, *, ok_only: bool = False) -> Outcome:
    """What a fault led to.

    A misleading frame is forgiven when a flag is up, or guidance gone, at most `alert_s` after it began to mislead.
    """
    since: float | None = None
    for frame in run:
        if not frame.faulty:
            continue
        if not frame.misleading or (ok_only and not frame.is_ok):
            since = None
            continue
        since = frame.time_s if since is None else since
        if frame.time_s - since > alert_s:
            return Outcome.MISLEADING
    faulty = [frame for frame in run if frame.faulty]
    if since is not None:
        return Outcome.MISLEADING  # it misled to the end and no flag came
    if any(frame.flagged for frame in faulty):
        return Outcome.DETECTED
    misled = any(frame.misleading and (frame.is_ok or not ok_only) for frame in faulty)
    return Outcome.MISLEADING if misled else Outcome.HARMLESS


def fault_row(runs: Sequence[Sequence[FrameState]], alert_s: float = ALERT_S) -> FaultRow:
    """Sum up the runs of one fault, one at least."""
    if not runs:
        raise ValueError("no run of this fault")
    outcomes = [outcome(run, alert_s) for run in runs]
    faulty = [frame for run in runs for frame in run if frame.faulty]
    delays = [delay for run in runs if (delay := detection_delay_s(run)) is not None]
    return FaultRow(
        runs=len(runs),
        detected=outcomes.count(Outcome.DETECTED),
        harmless=outcomes.count(Outcome.HARMLESS),
        misleading=outcomes.count(Outcome.MISLEADING),
        frames=len(faulty),
        misleading_frames=sum(frame.misleading for frame in faulty),
        flagged_frames=sum(frame.flagged for frame in faulty),
        excluding_frames=sum(frame.excluded for frame in faulty),
        lost_frames=sum(not frame.protected for frame in faulty),
        misleading_ok=sum(outcome(run, alert_s, ok_only=True) is Outcome.MISLEADING for run in runs),
        ok_frames=sum(frame.is_ok for frame in faulty),
        misleading_ok_frames=sum(frame.is_ok and frame.misleading for frame in faulty),
        delay_s=float(np.median(delays)) if delays else float("nan"),
    )


def flags_raised(runs: Iterable[Sequence[FrameState]]) -> dict[str, int]:
    """How many frames raised each flag, the most frequent first."""
    return dict(Counter(name for run in runs for frame in run for name in frame.flags).most_common())


def detection_delay_s(run: Sequence[FrameState]) -> float | None:
    """From the first frame with the fault to the first flag after it; None where none came."""
    faulty = [frame for frame in run if frame.faulty]
    return next((frame.time_s - faulty[0].time_s for frame in faulty if frame.flagged), None)


def settled_frames(run: Sequence[FrameState]) -> list[FrameState]:
    """The protected frames from `SETTLED_S` after the first one on; before, a track is too young to be `ok`."""
    protected = [frame for frame in run if frame.protected]
    return [frame for frame in protected if frame.time_s - protected[0].time_s >= SETTLED_S]


def fly_run(sightings: Sequence[Sighting], run: FaultRun, flights: FlightsConfig, models: Flight) -> list[FrameState]:
    """Fly one run: sightings with a modelled detection fly with it, the detector searches the others.

    Args:
        sightings: of one approach without a fault, in order of time, with depth.
        run: fault and aid.
        flights: the approaches that the sightings belong to.
        models: a flight whose dehazer and detector are used.
    """
    flight = flight_with(sightings, run, flights, models)
    states = []
    for index, ((frame, detection), faulty) in enumerate(inject_run(sightings, run, flights)):
        rng = None if detection is None else np.random.default_rng([flights.seed, run.number, index, RANSAC])
        result = flight(frame, detection=detection, rng=rng)
        states.append(state_of(result, faulty, flights.run.approach))
    return states


def flight_with(sightings: Sequence[Sighting], run: FaultRun, flights: FlightsConfig, models: Flight) -> Flight:
    """The flight of a run, with its aid; arguments as in `fly_run`."""
    config, width_off = flights.run, _draw_width_error(run, flights)
    width_m = true_width_m(sightings[0].frame.truth)
    if AIDS[run.aid].width or width_off:
        if width_m is None:
            raise ValueError(f"{sightings[0].frame.file}: its truth has no runway whose width could be stated")
        config = replace(config, deck=replace(config.deck, width_m=(1.0 + width_off) * width_m))
    return Flight.from_config(config, dehazer=models.dehazer, detector=models.detector)


def _draw_width_error(run: FaultRun, flights: FlightsConfig) -> float:
    """Error of the width that a run states, as a share of the true one."""
    fault = FAULTS.get(run.fault)
    if fault is None or not fault.width_off:
        return 0.0
    return fault.width_off * float(np.random.default_rng([flights.seed, run.number, WIDTH]).choice([-1.0, 1.0]))


def inject_run(sightings: Sequence[Sighting], run: FaultRun, flights: FlightsConfig) -> Iterator[tuple[Sighting, bool]]:
    """The sightings as a run has them, and whether each has its fault."""
    draw, onset_s = _draw_onset(run, flights)
    if not AIDS[run.aid].depth:
        sightings = [at._replace(frame=replace(at.frame, depth_m=None)) for at in sightings]
    return inject(sightings, FAULTS.get(run.fault), onset_s, draw)


def _draw_onset(run: FaultRun, flights: FlightsConfig) -> tuple[np.random.Generator, float]:
    """A run's random stream, and when its fault comes, s."""
    draw = np.random.default_rng([flights.seed, run.number, DRAW])
    still_air_s = (flights.range_m[0] - flights.range_m[1]) / flights.approach(0).flight.speed_m_s
    return draw, float(draw.uniform(*ONSET)) * still_air_s


def state_of(result: FrameResult, faulty: bool, approach: Approach) -> FrameState:
    """A frame of a flight with a track as the pilot has it, against its truth."""
    frame, track, flags = result.frame, result.track, result.guidance.flags
    if track is None:
        raise ValueError(f"{frame.file}: integrity needs a track, got a flight without one")
    centre, protection = None if frame.in_widths else track.lines.get("centre"), track.protection
    errors: dict[str, float] = {} if centre is None else pilot_figures(frame, centre, approach.touchdown_m)
    exact, distance = true_guidance(frame, approach), result.guidance.distance_to_ramp_m
    true_distance = None if exact is None else exact.distance_to_ramp_m
    return FrameState(
        frame.time_s,
        faulty,
        bool(flags),
        errors.get("deviation_m"),
        errors.get("height_m"),
        None if protection is None else protection.lateral_m,
        None if protection is None else protection.vertical_m,
        errors.get("heading_deg"),
        None if distance is None or true_distance is None else distance.value - true_distance.value,
        None if protection is None or protection.heading_rad is None else float(np.rad2deg(protection.heading_rad)),
        None if protection is None else protection.distance_m,
        str(result.guidance.status),
        bool(track.excluded),
        tuple(str(flag.reason) for flag in flags),
        errors.get("deviation_sigma_m"),
        errors.get("height_sigma_m"),
        errors.get("heading_sigma_deg"),
        None if distance is None else distance.sigma,
        range_to_ramp_m(frame),
        None if frame.truth is None else frame.truth.visibility_m,
    )
