"""`deckline eval integrity`: faults put into flights, and whether they are noticed."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, astuple, dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from deckline.checks import check_numbers
from deckline.config_file import to_toml_text
from deckline.flight import Flight
from deckline.report.provenance import settings_of
from deckline_lab.evaluation.approaches import (
    FlightsConfig,
    Sighting,
    describe_flights,
    flight_settings,
    fly,
    fly_points,
)
from deckline_lab.evaluation.coverage import coverage_table
from deckline_lab.evaluation.integrity_faults import FAULTS, Runs
from deckline_lab.evaluation.integrity_score import (
    AIDS,
    ALERT_S,
    NOMINAL,
    SETTLED_S,
    FaultRow,
    FaultRun,
    FrameState,
    Outcome,
    fault_row,
    flags_raised,
    fly_run,
    outcome,
    settled_frames,
)
from deckline_lab.evaluation.store import Store
from deckline_lab.evaluation.tables import MISSING, TO_TERMINAL, Figures, Output, Table, number, publish
from deckline_lab.rivals.catalog import flight_from_config
from deckline_lab.statistics import share_interval, share_interval_of_runs
from deckline_sim.landing.modelled_detector import point_flight
from deckline_sim.processes import map_ordered
from deckline_sim.progress import progress
from deckline_sim.workers import RayOption, choose_workers

STATES_FILE = "integrity.jsonl"
RENDERED_AIDS = tuple(name for name in AIDS if name)
GOOD_SHARE, FALSE_ALARMS = 0.99, 0.001  # asked for: of runs, of nominal frames
NOMINAL_COUNTS = {  # of frames, and what people call them
    "flagged": "false alarms",
    "misleading": "misleading",
    "excluded": "left out",
    "protected": "guided",
    "is_ok": "ok",
}
SETTLED_OK = f"ok after {SETTLED_S:g} s, %"
FAULTS_NOTE = "The same flights carry every fault: the interval of all faults is over flights."
NOTES = f"""\
A frame misleads when lateral deviation, height above the deck, heading or distance to the ramp is farther off than its
protection level and no flag is up. A run is detected when a flag came and no stretch misled for longer than the time to
alert; harmless when no frame misled and no flag came; misleading otherwise. Misleading as ok: runs that mislead whoever
follows `ok` guidance alone, as an autopilot should. Left out: frames of which a measurement contradicted the track and
was not used. Guided: frames without a flag and with a protected centre line; ok: those of them that an autopilot takes;
ok after {SETTLED_S:g} s: the same share of the guided frames from so long after a flight's first one on.
Square brackets: 95 % intervals. Of one fault's runs: Clopper and Pearson. Of all faults and of frames: a bootstrap over
flights, never narrower than for independent runs or frames; where none or all have it, Clopper and Pearson's of the
flights."""


@dataclass(frozen=True)
class IntegrityConfig:
    """Put faults into flights and print how many are detected, harmless or misleading, and how often nominal flights
    raise an alarm.

    Without --rendered there are no pictures: true lines are projected and points drawn from a model of the detector's
    noise. With it each approach is rendered once and flown as `deckline run` flies, with every fault and every aid; the
    faults are then those of pictures, poses and times. With --out, a stopped command resumes.

    Args:
        runs: with each fault.
        nominal: runs without one.
        fault: which are put in; all when not given.
        rendered: render the flights and run the detector on their pictures.
        aid: with --rendered, what measures the scale besides pose and deck height: any of `no aid`, `depth`, `width`,
            `depth, width`.
        flights: what is flown.
        alert_s: time to alert.
        jobs: processes, where nothing is rendered; 0: one for every core.
        ray: where nothing is rendered, fly as Ray tasks, on the cluster at ADDRESS (HOST:PORT, or auto), without it on
            one that is started here.
        out: folder of every run's frames.
        films: with --rendered, folder in which each run is flown once more as `deckline run` writes it: film, report,
            records. A run that --out holds already is not filmed.
        output: files of the results.
    """

    runs: int = 30
    nominal: int = 90
    fault: tuple[str, ...] = ()
    rendered: bool = False
    aid: tuple[str, ...] = RENDERED_AIDS
    flights: Annotated[FlightsConfig, tyro.conf.arg(name="")] = field(default_factory=FlightsConfig)
    alert_s: float = ALERT_S
    jobs: int = 1
    ray: RayOption = None
    out: Path | None = None
    films: Path | None = None
    output: Output = TO_TERMINAL

    def __post_init__(self) -> None:
        check_numbers(self, "", "runs", least=0)
        check_numbers(self, "", "nominal", least=1)
        check_numbers(self, "", "alert_s", least=0)
        for what, names, known in (("fault", self.fault, self.faults), ("aid", self.aid, RENDERED_AIDS)):
            unknown = [name for name in names if name not in known]
            if unknown:
                raise ValueError(f"unknown {what} {unknown[0]!r}: use any of {', '.join(known)}")

        if self.films is not None and not self.rendered:
            raise ValueError("--films needs pictures: use --rendered")

    @property
    def faults(self) -> list[str]:
        """Names of the faults that these flights can have."""
        runs = Runs.RENDERED if self.rendered else Runs.MODELLED
        return [name for name, fault in FAULTS.items() if runs in fault.runs]

    @property
    def wanted(self) -> list[FaultRun]:
        """All runs, those of one flight together."""
        names = (NOMINAL, *dict.fromkeys(self.fault or self.faults))
        aids = dict.fromkeys(self.aid if self.rendered else ("",))
        most = max(self.runs, self.nominal)
        numbered = [(name, number, aid) for number in range(most) for name in names for aid in aids]
        return [FaultRun(*run) for run in numbered if run[1] < (self.nominal if run[0] == NOMINAL else self.runs)]


def integrity(config: Annotated[IntegrityConfig, tyro.conf.arg(name="")]) -> int:
    flights = config.flights
    flights.approach(0)  # refuses before the work, not after
    models = flight_from_config(flights.run) if config.rendered else point_flight(flights.run)
    points = settings_of(models) if config.rendered else {"points": asdict(flights.point_noise)}
    settings = {**flight_settings(flights), "run": to_toml_text(flights.run), "seen by": points}
    with Store(config.out, STATES_FILE, settings) as store:
        missing = [run for run in config.wanted if astuple(run) not in store.rows]
        with progress("flying", len(config.wanted), len(config.wanted) - len(missing)) as advance:
            for run, states in fly_runs(missing, config, models):
                store.add(astuple(run), [asdict(state) for state in states])
                advance()
    by_fault: dict[str, list[list[FrameState]]] = {}
    for run in config.wanted:
        by_fault.setdefault(run.name, []).append([FrameState(**row) for row in store.rows[astuple(run)]])
    how = f"rendered, detector {flights.run.models.detector}" if config.rendered else f"{flights.point_noise}"
    title = (
        f"{config.runs} runs of each fault, {config.nominal} without, of {describe_flights(flights)}; "
        f"time to alert {config.alert_s:g} s; {how}"
    )
    tables, figures = integrity_tables(by_fault, config.alert_s), flat_figures(by_fault, config.alert_s)
    publish(title, tables, figures, config.output, [NOTES])
    return 0


def fly_runs(
    runs: Sequence[FaultRun], config: IntegrityConfig, models: Flight
) -> Iterator[tuple[FaultRun, list[FrameState]]]:
    """Every run with its frames, as they are flown. All faults are put into one flight after the other."""
    by_flight = [list(group) for _, group in groupby(runs, key=lambda run: run.number)]
    if config.rendered:
        for group in by_flight:
            yield from _fly_rendered(group, config, models)
        return
    work = partial(_fly_modelled, flights=config.flights)
    with closing(map_ordered(work, by_flight, choose_workers(config.ray, config.jobs))) as results:
        for group, states in zip(by_flight, results, strict=True):
            yield from zip(group, states, strict=True)


def _fly_rendered(
    runs: Sequence[FaultRun], config: IntegrityConfig, models: Flight
) -> Iterator[tuple[FaultRun, list[FrameState]]]:
    sightings = [Sighting(frame) for frame in fly(config.flights, runs[0].number)]
    for run in runs:
        if config.films is not None:
            from deckline_lab.evaluation.integrity_films import film

            film(sightings, run, config.flights, models, config.films)
        yield run, fly_run(sightings, run, config.flights, models)


def _fly_modelled(runs: Sequence[FaultRun], flights: FlightsConfig) -> list[list[FrameState]]:
    sightings = list(fly_points(flights.approach(runs[0].number), flights.run.sensors, flights.point_noise))
    models = point_flight(flights.run)
    return [fly_run(sightings, run, flights, models) for run in runs]


def integrity_tables(by_fault: Mapping[str, Sequence[Sequence[FrameState]]], alert_s: float) -> list[Table]:
    """Faults, then nominal flights, then which flags were raised: one frame may raise several."""
    rows = {name: fault_row(runs, alert_s) for name, runs in by_fault.items() if not name.startswith(NOMINAL)}
    tables = [_faults_table(rows, _share_of_runs(*_good_by_flight(by_fault, alert_s)))] if rows else []
    nominal = {name: runs for name, runs in by_fault.items() if name.startswith(NOMINAL)}
    if nominal:
        title = f"nominal flights; false alarms on at most {100 * FALSE_ALARMS:g} % of the frames are asked for"
        columns = ("flights", "runs", "frames", *(f"{what}, %" for what in NOMINAL_COUNTS.values()), SETTLED_OK)
        tables.append(Table(title, columns, [_nominal_cells(name, runs) for name, runs in nominal.items()]))
    tables += [coverage_table(name, runs) for name, runs in nominal.items()]
    raised = {name: flags_raised(runs) for name, runs in by_fault.items()}
    flags = [(name, ", ".join(f"{flag} {n}" for flag, n in each.items()) or MISSING) for name, each in raised.items()]
    return [*tables, Table("frames by flag", ("fault", "flags"), flags)]


def _good_by_flight(
    by_fault: Mapping[str, Sequence[Sequence[FrameState]]], alert_s: float
) -> tuple[list[int], list[int]]:
    """Runs that are detected or harmless, and all runs with a fault, of each flight."""
    faults = [runs for name, runs in by_fault.items() if not name.startswith(NOMINAL)]
    flights = range(max(map(len, faults)))
    by_flight = [[runs[number] for runs in faults if number < len(runs)] for number in flights]
    good = [sum(outcome(run, alert_s) is not Outcome.MISLEADING for run in runs) for runs in by_flight]
    return good, [len(runs) for runs in by_flight]


def _faults_table(rows: Mapping[str, FaultRow], good_share: str) -> Table:
    """One row a fault; the title has the share of all of them together."""
    cells = []
    for name, row in rows.items():
        if not row.frames:
            raise ValueError(f"{name}: the fault must be in at least 1 frame, got 0: use more --frames or --runs")
        counts = (row.runs, row.detected, row.harmless, row.misleading, row.misleading_ok)
        frames = (row.misleading_frames, row.excluding_frames, row.frames - row.lost_frames)
        shares = (f"{100 * count / row.frames:.2f}" for count in frames)
        ok = f"{row.misleading_ok_frames} of {row.ok_frames}"
        good = _share(row.detected + row.harmless, row.runs, share_interval(row.detected + row.harmless, row.runs))
        cells.append((name, *map(str, counts), good, *shares, ok, number(row.delay_s, ".1f")))
    title = f"faults: {good_share}; {100 * GOOD_SHARE:g} % is asked for"
    columns = ("fault", "runs", "detected", "harmless", "misleading", "misleading as ok", "detected or harmless, %")
    return Table(
        title,
        (*columns, "misleading frames, %", "left out, %", "guided, %", "misleading ok frames", "flag after, s"),
        cells,
        [FAULTS_NOTE],
    )


def _nominal_cells(name: str, runs: Sequence[Sequence[FrameState]]) -> tuple[str, ...]:
    by_run = [_count_nominal([run]) for run in runs]

    def cell(what: str, of: str) -> str:
        return _share_of_runs([counts[what] for counts in by_run], [counts[of] for counts in by_run])

    shares = (cell(what, "frames") for what in NOMINAL_COUNTS)
    frames = sum(counts["frames"] for counts in by_run)
    return (name, str(len(runs)), str(frames), *shares, cell("settled_ok", "settled"))


def _share_of_runs(hits: Sequence[int], trials: Sequence[int]) -> str:
    if not sum(trials):
        return MISSING
    return _share(sum(hits), sum(trials), share_interval_of_runs(hits, trials, np.random.default_rng(0)))


def _share(hits: int, trials: int, interval: tuple[float, float]) -> str:
    low, high = interval
    return f"{100 * hits / trials:.2f} [{100 * low:.2f}, {100 * high:.2f}]"


def flat_figures(by_fault: Mapping[str, Sequence[Sequence[FrameState]]], alert_s: float) -> Figures:
    """The tables' numbers under dotted names."""
    figures: Figures = {}
    for name, runs in by_fault.items():
        is_nominal = name.startswith(NOMINAL)
        row: dict[str, Any] = _count_nominal(runs) if is_nominal else asdict(fault_row(runs, alert_s))
        figures |= {f"{name}.{key}": float(value) for key, value in row.items()}
    return figures


def _count_nominal(runs: Sequence[Sequence[FrameState]]) -> dict[str, int]:
    frames = [frame for run in runs for frame in run]
    counts = {name: sum(getattr(frame, name) for frame in frames) for name in NOMINAL_COUNTS}
    settled = [frame for run in runs for frame in settled_frames(run)]
    counts |= {"settled": len(settled), "settled_ok": sum(frame.is_ok for frame in settled)}
    return {"runs": len(runs), "frames": len(frames), **counts}


integrity.__doc__ = IntegrityConfig.__doc__
