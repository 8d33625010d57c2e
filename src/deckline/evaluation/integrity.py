"""`deckline eval integrity`: faults put into flights, and whether they are noticed."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from deckline.config import Models, RunConfig
from deckline.config_file import to_toml_text
from deckline.dehaze import NOT_DEHAZED
from deckline.evaluation.chain import single_frames
from deckline.evaluation.integrity_faults import FAULTS
from deckline.evaluation.integrity_measure import ALERT_S, FaultRow, Moment, fault_row, flags_raised, share_interval
from deckline.evaluation.integrity_points import PointNoise
from deckline.evaluation.integrity_runs import NOMINAL, Run, detect_shots, fly_points, fly_shots
from deckline.evaluation.localization_book import Book
from deckline.evaluation.localization_flights import FlightsConfig, plain, sensors_text
from deckline.evaluation.tables import MISSING as NONE
from deckline.evaluation.tables import JsonFile, Table, publish
from deckline.flight import Flight
from deckline.processes import map_ordered
from deckline.progress import progress
from deckline.report.provenance import settings_of

BOOK_FILE = "integrity.jsonl"
GOOD_SHARE, FALSE_ALARMS = 0.99, 0.001  # asked for: of runs, of nominal frames
NOTES = """\
A frame misleads when the lateral deviation or the height above the deck is farther off than its protection level and no
flag is up. A run is detected when a flag came and no stretch misled for longer than the time to alert; harmless when no
frame misled and no flag came; misleading otherwise. Left out: frames of which a measurement contradicted the track and
was not used. Not guided: frames with a flag, or without a protected centre line.
Square brackets: 95 % intervals (Clopper and Pearson) of runs or frames taken as independent; frames of one run are not,
and theirs are too narrow. The same flights carry every fault."""


@dataclass(frozen=True)
class IntegrityConfig:
    """Put faults into flights and print how many are detected, harmless or misleading, and how often nominal flights
    raise an alarm.

    Without --rendered there are no pictures: true lines are projected and points drawn from a model of the detector's
    noise. With --out, a stopped command goes on where it was when it is given again.

    Args:
        runs: with each fault.
        nominal: runs without one.
        fault: which are put in.
        rendered: render the flights and let the detector look at them; takes a second a frame.
        flights: what is flown.
        noise: of the points where nothing is rendered.
        alert_s: time to alert.
        jobs: processes, where nothing is rendered; 0: one for every core.
        out: folder of every run's frames.
        json_file: write the figures here as well.
        markdown: write the tables here as well.
    """

    runs: int = 30
    nominal: int = 90
    fault: tuple[str, ...] = tuple(FAULTS)
    rendered: bool = False
    flights: Annotated[FlightsConfig, tyro.conf.arg(name="")] = field(default_factory=FlightsConfig)
    noise: PointNoise = field(default_factory=PointNoise)
    alert_s: float = ALERT_S
    jobs: int = 1
    out: Path | None = None
    json_file: JsonFile = None
    markdown: Path | None = None

    def __post_init__(self) -> None:
        for name, least in (("runs", 1), ("nominal", 1), ("alert_s", 0.0)):
            if not getattr(self, name) >= least:
                raise ValueError(f"--{name.replace('_', '-')} must be at least {least:g}, got {getattr(self, name)}")
        unknown = [name for name in self.fault if name not in FAULTS]
        if unknown:
            raise ValueError(f"unknown fault {unknown[0]!r}: use any of {', '.join(FAULTS)}")

    @property
    def wanted(self) -> list[Run]:
        """All runs, those of one flight together."""
        most = max(self.runs, self.nominal)
        numbered = [(name, number) for number in range(most) for name in (NOMINAL, *dict.fromkeys(self.fault))]
        return [Run(name, k) for name, k in numbered if k < (self.nominal if name == NOMINAL else self.runs)]


def integrity(config: Annotated[IntegrityConfig, tyro.conf.arg(name="")]) -> int:
    config.flights.approach(0)  # refuses before the work, not after
    detector = Flight.from_config(_detecting(config.flights.run)) if config.rendered else None
    seen_by = {"points": asdict(config.noise)} if detector is None else settings_of(detector)
    made_with = {**plain(config.flights), "run": to_toml_text(config.flights.run)}
    book = Book(config.out, BOOK_FILE, {**made_with, "seen by": seen_by})
    missing = [run for run in config.wanted if run.name not in book.runs]
    with progress("flying", len(config.wanted), len(config.wanted) - len(missing)) as advance:
        for run, moments in fly_runs(missing, config, detector):
            book.add(run.name, [asdict(moment) for moment in moments])
            advance()
    by_fault: dict[str, list[list[Moment]]] = {}
    for run in config.wanted:
        by_fault.setdefault(run.fault, []).append([moment_from(row) for row in book.runs[run.name]])
    _report(by_fault, config)
    return 0


def _detecting(run: RunConfig) -> RunConfig:
    """The configuration that finds the points of rendered frames, each frame for itself."""
    return replace(single_frames(run), models=Models(NOT_DEHAZED, run.models.detector))


def moment_from(row: dict[str, Any]) -> Moment:
    """A frame as the book holds it."""
    return Moment(**(row | {"flags": tuple(row["flags"])}))


def fly_runs(
    runs: Sequence[Run], config: IntegrityConfig, detector: Flight | None
) -> Iterator[tuple[Run, list[Moment]]]:
    """Every run with its frames, as they are flown."""
    if detector is not None:
        for number in dict.fromkeys(run.number for run in runs):
            shots = list(detect_shots(detector, config.flights, number))
            for run in runs:
                if run.number == number:
                    yield run, fly_shots(shots, run, config.flights)
        return
    by_flight = [list(group) for _, group in groupby(runs, key=lambda run: run.number)]  # a process caches its flight
    work = partial(_fly_together, flights=config.flights, noise=config.noise)
    with closing(map_ordered(work, by_flight, config.jobs)) as results:
        for group, moments in zip(by_flight, results, strict=True):
            yield from zip(group, moments, strict=True)


def _fly_together(runs: list[Run], flights: FlightsConfig, noise: PointNoise) -> list[list[Moment]]:
    """The frames of runs that share a flight."""
    return [fly_points(run, flights, noise) for run in runs]


def integrity_tables(by_fault: Mapping[str, Sequence[Sequence[Moment]]], alert_s: float) -> list[Table]:
    """Faults, then nominal flights."""
    rows = {name: fault_row(runs, alert_s) for name, runs in by_fault.items() if name != NOMINAL}
    tables = [faults_table(rows)] if rows else []
    tables += [nominal_table(by_fault[NOMINAL])] if by_fault.get(NOMINAL) else []
    return [*tables, flags_table(by_fault)]


def faults_table(rows: Mapping[str, FaultRow]) -> Table:
    """One row a fault, and all of them together."""
    cells = []
    for name, row in rows.items():
        cells.append((name, *_counts(row), NONE if np.isnan(row.delay_s) else f"{row.delay_s:.1f}"))
    runs, good = sum(row.runs for row in rows.values()), sum(row.detected + row.harmless for row in rows.values())
    together = f"{_share(good, runs)}; {100 * GOOD_SHARE:g} % is asked for"
    columns = ("fault", "runs", "detected", "harmless", "misleading", "detected or harmless, %", "misleading frames, %",
               "left out, %", "not guided, %", "flag after, s")  # fmt: skip
    return Table(f"faults: {together}", columns, tuple(cells))


def _counts(row: FaultRow) -> tuple[str, ...]:
    good = row.detected + row.harmless
    counts = (str(count) for count in (row.runs, row.detected, row.harmless, row.misleading))
    frames = (
        f"{100 * count / row.frames:.2f}" for count in (row.misleading_frames, row.excluding_frames, row.lost_frames)
    )
    return (*counts, _share(good, row.runs), *frames)


def nominal_table(runs: Sequence[Sequence[Moment]]) -> Table:
    """Flights without a fault."""
    moments = [moment for run in runs for moment in run]
    counts = [sum(getattr(m, name) for m in moments) for name in ("flagged", "misleading", "excluded")]
    counts.append(sum(not moment.protected for moment in moments))
    title = f"nominal flights; false alarms on at most {100 * FALSE_ALARMS:g} % of the frames are asked for"
    cells = (str(len(runs)), str(len(moments)), *(_share(count, len(moments)) for count in counts))
    return Table(
        title, ("runs", "frames", "false alarms, %", "misleading, %", "left out, %", "not guided, %"), (cells,)
    )


def flags_table(by_fault: Mapping[str, Sequence[Sequence[Moment]]]) -> Table:
    """Which flags each fault raised, in how many frames; one frame may raise several."""
    raised = {name: flags_raised(runs) for name, runs in by_fault.items()}
    rows = (
        (name, ", ".join(f"{flag} {count}" for flag, count in each.items()) or NONE) for name, each in raised.items()
    )
    return Table("frames by flag", ("fault", "flags"), tuple(rows))


def _share(hits: int, of: int) -> str:
    low, high = share_interval(hits, of)
    return f"{100 * hits / of:.2f} [{100 * low:.2f}, {100 * high:.2f}]"


def flat_figures(by_fault: Mapping[str, Sequence[Sequence[Moment]]], alert_s: float) -> dict[str, float]:
    """The tables' numbers under dotted names."""
    figures: dict[str, float] = {}
    for name, runs in by_fault.items():
        row: dict[str, Any] = asdict(fault_row(runs, alert_s)) if name != NOMINAL else _nominal(runs)
        figures |= {f"{name}.{key}": float(value) for key, value in row.items()}
    return figures


def _nominal(runs: Sequence[Sequence[Moment]]) -> dict[str, int]:
    moments = [moment for run in runs for moment in run]
    counts = {
        name: sum(getattr(m, name) for m in moments) for name in ("flagged", "misleading", "excluded", "protected")
    }
    return {"runs": len(runs), "frames": len(moments), **counts}


def _report(by_fault: Mapping[str, Sequence[Sequence[Moment]]], config: IntegrityConfig) -> None:
    flights, run = config.flights, config.flights.run
    how = f"rendered, detector {run.models.detector}" if config.rendered else f"{config.noise}"
    title = (
        f"{config.runs} runs of each fault, {config.nominal} without; preset {flights.preset}, "
        f"{flights.frames} frames, V {flights.visibility} m, {flights.range_m[0]:g} to {flights.range_m[1]:g} m, "
        f"navigation {sensors_text(run.sensors)}, sea state {run.deck.sea_state:g}, seed {flights.seed}; "
        f"time to alert {config.alert_s:g} s; {how}"
    )
    tables, figures = integrity_tables(by_fault, config.alert_s), flat_figures(by_fault, config.alert_s)
    publish(title, tables, figures, config.json_file, config.markdown, [NOTES])


integrity.__doc__ = IntegrityConfig.__doc__
