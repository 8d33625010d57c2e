"""`deckline eval localization`: the paper's Table 6 on fresh approaches, and what a pilot needs to know."""

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from deckline.atomic import write_atomic
from deckline.checks import check_numbers
from deckline.files import print_line
from deckline.localize import localize
from deckline_lab.evaluation.approaches import (
    FlightsConfig,
    Sighting,
    describe_flights,
    flight_settings,
    fly,
    fly_points,
)
from deckline_lab.evaluation.localization_methods import (
    LocalizationBench,
    Method,
    load,
    methods_of,
    point_bench,
    point_methods,
)
from deckline_lab.evaluation.localization_score import LocalizationScore, score_approach
from deckline_lab.evaluation.localization_tables import flat_figures, localization_tables
from deckline_lab.evaluation.pictures import write_figure
from deckline_lab.evaluation.store import Store
from deckline_lab.evaluation.tables import TO_TERMINAL, Output, publish
from deckline_sim.processes import Jobs, map_ordered, works_here
from deckline_sim.progress import progress
from deckline_sim.workers import RayOption, choose_workers

SCORES_FILE, CSV_FILE, FIGURES = "localization.jsonl", "localization.csv", "figures"


@dataclass(frozen=True)
class LocalizationConfig:
    """Fly approaches through haze and compare where each method puts the runway lines with where they are.

    Prints the paper's Table 6 and the improvement over its first row, a pilot's errors by range and visibility beside
    what landing asks for, whether covariances are honest, how near the errors come to their bound, and what protection
    levels are worth. Every frame is rendered once and given to all rows. With --out, a stopped command
    resumes after the last whole approach.

    Args:
        approaches: how many are flown.
        flights: how.
        rival: detectors to compare with, without and with dehazing: names or .onnx files. Improvements refer to the
            first one's row without.
        points: render nothing: project the true lines and draw points with a stated noise; only estimators and the
            tracker are compared then, in seconds an approach.
        jobs: processes, each with a share of the cores; 0: one for every core.
        ray: fly as Ray tasks, on the cluster at ADDRESS (HOST:PORT, or auto), without it on one that is started here.
        out: folder of the scores of every frame, as CSV too, and of pictures of our rows.
        output: files of the results.
    """

    approaches: int = 10
    flights: Annotated[FlightsConfig, tyro.conf.arg(name="")] = field(default_factory=FlightsConfig)
    rival: tuple[str, ...] = ("ufld",)
    points: bool = False
    jobs: int = 1
    ray: RayOption = None
    out: Path | None = None
    output: Output = TO_TERMINAL

    def __post_init__(self) -> None:
        check_numbers(self, "", "approaches", least=1)


def localization(config: Annotated[LocalizationConfig, tyro.conf.arg(name="")]) -> int:
    config.flights.approach(0)  # refuses before the work, not after
    workers = choose_workers(config.ray, config.jobs)
    work = _prepare(config)
    settings = {**flight_settings(config.flights), "methods": work.bench.settings}
    with Store(config.out, SCORES_FILE, settings) as store:
        _fly_all(store, config, work, workers)
    scores = [LocalizationScore(**row) for number in range(config.approaches) for row in store.rows[number,]]
    by_method = {method.name: [score for score in scores if score.method == method.name] for method in work.methods}
    models = config.flights.run.models
    names = f"dehazer {models.dehazer}, detector {models.detector}"
    seen_by = f"{config.flights.point_noise}" if config.points else names
    title = f"{config.approaches} approaches of {describe_flights(config.flights)}; {seen_by}"
    tables, figures = localization_tables(by_method, work.methods), flat_figures(by_method)
    publish(title, tables, figures, config.output)
    if config.out is not None:
        _write_csv(config.out / CSV_FILE, [score for members in by_method.values() for score in members])
        _write_figures(
            config.out / FIGURES, {m.name: by_method[m.name] for m in work.methods if m.localizer is localize}
        )
    return 0


@dataclass(frozen=True, eq=False)
class Work:
    """What is flown and compared."""

    methods: list[Method]
    bench: LocalizationBench
    fly: Callable[[int], Iterator[Sighting]]  # the frames of an approach


def _prepare(config: LocalizationConfig) -> Work:
    flights = config.flights
    if config.points:
        methods = point_methods(flights.run)
        bench = point_bench(methods, flights.point_noise)
        sensors, noise = flights.run.sensors, flights.point_noise
        return Work(methods, bench, lambda number: fly_points(flights.approach(number), sensors, noise))
    methods = methods_of(flights.run, config.rival)
    return Work(methods, load(methods), lambda number: map(Sighting, fly(flights, number)))


def _fly_all(store: Store, config: LocalizationConfig, work: Work, workers: Jobs) -> None:
    frames = config.flights.frames
    missing = [number for number in range(config.approaches) if (number,) not in store.rows]
    with progress("flying", config.approaches * frames, (config.approaches - len(missing)) * frames) as advance:
        if not works_here(workers):
            with closing(map_ordered(partial(_fly_in_process, config=config), missing, workers)) as results:
                for number, rows in zip(missing, results, strict=True):
                    store.add((number,), rows)
                    for _ in range(frames):
                        advance()
            return
        for number in missing:
            rows = []
            for scores in score_approach(work.fly(number), number, work.methods, work.bench):
                rows += map(asdict, scores)
                advance()
            store.add((number,), rows)


_prepare_once = lru_cache(maxsize=1)(_prepare)  # in a process, for all of its approaches


def _fly_in_process(number: int, config: LocalizationConfig) -> list[dict[str, Any]]:
    work = _prepare_once(config)
    frames = score_approach(work.fly(number), number, work.methods, work.bench)
    return [asdict(score) for scores in frames for score in scores]


def _write_csv(path: Path, scores: Sequence[LocalizationScore]) -> None:
    """One row for each frame and method; empty cells for what does not exist."""
    keys = ("approach", "index", "method", "range_m", "visibility_m", "mode")
    text = io.StringIO()
    writer = csv.DictWriter(text, [*keys, *sorted({name for score in scores for name in score.figures})])
    writer.writeheader()
    writer.writerows({key: getattr(score, key) for key in keys} | score.figures for score in scores)
    write_atomic(path, text.getvalue().encode())
    print(path)


def _write_figures(folder: Path, scores: dict[str, list[LocalizationScore]]) -> None:
    """A picture of every method that gave a centre line; one line on stderr without matplotlib."""
    for name, members in scores.items():
        if any("centre.lateral_m" in score.figures for score in members):
            words = "".join(c if c.isalnum() else " " for c in name).split()
            path = folder / f"{'-'.join(words)}.png"
            try:
                write_figure(path, name, members)
            except ImportError as error:
                print_line(f"no pictures in {folder}: {error}")
                return
            print(path)


localization.__doc__ = LocalizationConfig.__doc__
