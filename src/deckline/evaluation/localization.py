"""`deckline eval localization`: the paper's Table 6 on fresh approaches, and what a pilot needs to know."""

import csv
import io
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from deckline.atomic import write_atomic
from deckline.evaluation.cramer_rao import cramer_rao
from deckline.evaluation.integrity_points import PointNoise
from deckline.evaluation.localization_book import Book
from deckline.evaluation.localization_flights import FlightsConfig, fly, plain, sensors_text
from deckline.evaluation.localization_measure import (
    Figures,
    Score,
    bound_figures,
    frame_figures,
)
from deckline.evaluation.localization_methods import Bench, Method, load, methods_of
from deckline.evaluation.localization_points import fly_points, point_bench, point_methods, point_rng
from deckline.evaluation.localization_tables import NOTES, flat_figures, localization_tables
from deckline.evaluation.tables import JsonFile, publish
from deckline.flight import FrameResult
from deckline.localize import localize
from deckline.processes import map_ordered, process_count
from deckline.progress import progress
from deckline.truth import range_to_ramp_m, touchdown, true_centre
from deckline.types import SIDES, Detection, Frame, Track

Sighting = tuple[Frame, Detection | None]  # a frame, and what is detected in it where that is modelled
BOOK_FILE, CSV_FILE, FIGURES = "localization.jsonl", "localization.csv", "figures"


@dataclass(frozen=True)
class LocalizationConfig:
    """Fly approaches through haze and compare where each method puts the runway lines with where they are.

    Prints the paper's Table 6 and the improvement over its first row, a pilot's errors by range and visibility beside
    what landing asks for, whether covariances are honest, how near the errors come to their bound, and what protection
    levels are worth. Every frame is rendered once and given to all rows. With --out, a stopped command goes on after
    the last whole approach when it is given again.

    Args:
        approaches: how many are flown.
        flights: how.
        ufld: detector of the first row, without dehazing: name or .onnx file.
        resa: .onnx file of a RESA network; its row is left out without it.
        enet_sad: .onnx file of an ENet-SAD network; its row is left out without it.
        points: render nothing: project the true lines and draw points with a stated noise; only estimators and the
            tracker are compared then, in seconds an approach.
        noise: of these points.
        jobs: processes, each with a share of the cores; 0: one for every core. They say how far they are after every
            approach, one process after every frame.
        out: folder of the scores of every frame, as CSV too, and of pictures of our rows.
        json_file: write the tables' numbers here as well.
        markdown: write the tables here as well.
    """

    approaches: int = 10
    flights: Annotated[FlightsConfig, tyro.conf.arg(name="")] = field(default_factory=FlightsConfig)
    ufld: str = "ufld"
    resa: Path | None = None
    enet_sad: Path | None = None
    points: bool = False
    noise: PointNoise = field(default_factory=PointNoise)
    jobs: int = 1
    out: Path | None = None
    json_file: JsonFile = None
    markdown: Path | None = None

    def __post_init__(self) -> None:
        if self.approaches < 1:
            raise ValueError(f"--approaches must be at least 1, got {self.approaches}")


def localization(config: Annotated[LocalizationConfig, tyro.conf.arg(name="")]) -> int:
    config.flights.approach(0)  # refuses before the work, not after
    process_count(config.jobs)
    work = _prepare(config)
    if config.out is not None:
        from deckline.evaluation.localization_figures import write_figure  # likewise
    book = Book(config.out, BOOK_FILE, {**plain(config.flights), "methods": work.bench.settings})
    _fly_all(book, config, work)
    scores = [score_from(values) for number in range(config.approaches) for values in book.runs[_run_name(number)]]
    by_method = {method.name: [score for score in scores if score.method == method.name] for method in work.methods}
    _report(by_method, work, config)
    if config.out is not None:
        _write_csv(config.out / CSV_FILE, [score for scores in by_method.values() for score in scores])
        for method in work.methods:
            drawn = by_method[method.name]
            if method.localizer is localize and any("centre.lateral_m" in score.figures for score in drawn):
                path = config.out / FIGURES / f"{_file_name(method.name)}.png"
                write_figure(path, method.name, drawn)
                print(path)
    return 0


@dataclass(frozen=True, eq=False)
class Work:
    """What is flown and compared."""

    methods: list[Method]
    notes: list[str]  # what is left out, and why
    bench: Bench
    fly: Callable[[int], Iterator[Sighting]]  # the frames of an approach


def _prepare(config: LocalizationConfig) -> Work:
    flights = config.flights
    if config.points:
        methods = point_methods(flights.run)
        bench = point_bench(methods, config.noise)
        return Work(methods, [], bench, lambda number: fly_points(flights, number, config.noise))
    rivals = {"resa": config.resa, "enet-sad": config.enet_sad}
    methods, notes = methods_of(flights.run, config.ufld, rivals)
    return Work(methods, notes, load(methods), lambda number: ((frame, None) for frame in fly(flights, number)))


def _fly_all(book: Book, config: LocalizationConfig, work: Work) -> None:
    """Fly every approach that the book does not know yet."""
    flights, count = config.flights, process_count(config.jobs)
    missing = [number for number in range(config.approaches) if _run_name(number) not in book.runs]
    total, left = (flown * flights.frames for flown in (config.approaches, len(missing)))
    with progress("flying", total, total - left) as advance:
        if count > 1:
            with closing(map_ordered(partial(_flown, config=config), missing, count)) as results:
                for number, rows in zip(missing, results, strict=True):
                    book.add(_run_name(number), rows)
                    for _ in range(flights.frames):
                        advance()
            return
        for number in missing:
            scores: list[Score] = []
            for of_frame in score_approach(work.fly(number), number, work.methods, work.bench):
                scores += of_frame
                advance()
            book.add(_run_name(number), [_row(score) for score in scores])


@lru_cache(maxsize=1)
def _prepared(config: LocalizationConfig) -> Work:
    """What a process needs, loaded once for all of its approaches."""
    return _prepare(config)


def _flown(number: int, config: LocalizationConfig) -> list[dict[str, Any]]:
    """One approach in a process of its own."""
    work = _prepared(config)
    frames = score_approach(work.fly(number), number, work.methods, work.bench)
    return [_row(score) for scores in frames for score in scores]


def _run_name(approach: int) -> str:
    return f"approach {approach}"


def _row(score: Score) -> dict[str, Any]:
    """A score as JSON holds it: infinite numbers, as the visibility of clear air is one, as text."""
    figures = {name: value for name, value in score.figures.items() if math.isfinite(value)}
    return vars(score) | {"visibility_m": str(score.visibility_m), "figures": figures}


def score_from(row: dict[str, Any]) -> Score:
    """A score as the book holds it."""
    return Score(**(row | {"visibility_m": float(row["visibility_m"])}))


def score_approach(
    sightings: Iterator[Sighting], approach: int, methods: Sequence[Method], bench: Bench
) -> Iterator[list[Score]]:
    """All methods' scores of each frame of one approach, frames in order of time."""
    flights = {method.name: bench.start(method) for method in methods}
    for index, (frame, detection) in enumerate(sightings):
        scores = []
        for method in methods:
            rng = None if detection is None else point_rng(frame.file)
            result = flights[method.name](frame, detection=detection, rng=rng)
            if result.track is None:
                lines, extra = result.estimate.lines, bound_of(result, method, bench.correlation)
            else:
                lines, extra = result.track.lines, track_figures(result.track)
            visibility = frame.truth.visibility_m if frame.truth else None
            scores.append(
                Score(
                    approach,
                    index,
                    method.name,
                    range_to_ramp_m(frame),
                    float("nan") if visibility is None else visibility,
                    str(result.estimate.mode),
                    frame_figures(frame, lines, method.config.approach.touchdown_m) | extra,
                )
            )
        bench.forget()
        yield scores


def track_figures(track: Track) -> Figures:
    """What a track promises: protection levels, and whether it warns."""
    figures: Figures = {"flagged": float(bool(track.flags))}
    if track.protection is not None:
        figures["protection.lateral_m"] = track.protection.lateral_m
        figures["protection.height_m"] = track.protection.vertical_m
    return figures


def bound_of(result: FrameResult, method: Method, correlation: float) -> Figures:
    """The least errors that the points of a frame, whose neighbours err alike by so much, allow its centre line.

    As seen from the aircraft. Nothing where the joint estimator is not used, or gave no centre line.
    """
    frame, estimate, seen = result.frame, result.estimate, result.detection
    centre = true_centre(frame.truth)
    if method.localizer is not localize or centre is None or "centre" not in estimate.lines:
        return {}
    lines = {"left": seen.left, "right": seen.right, "centre": seen.centre}
    kept = {side: line.inliers for side, line in estimate.pixel_lines.items()}
    if not set(SIDES) <= kept.keys():
        return {}
    bound = cramer_rao(
        frame,
        {side: lines[side].points_px[keep] for side, keep in kept.items()},
        {side: lines[side].sigma_px[keep] for side, keep in kept.items()},
        method.config.localization.mode,
        method.config,
        beside_m=touchdown(centre, method.config.approach.touchdown_m),
        relative=True,
        correlation=correlation,
    )
    return {f"bound.{name}": value for name, value in bound_figures(bound.centre).items()}


def _report(scores: dict[str, list[Score]], work: Work, config: LocalizationConfig) -> None:
    flights, run = config.flights, config.flights.run
    seen_by = f"{config.noise}" if config.points else f"dehazer {run.models.dehazer}, detector {run.models.detector}"
    title = (
        f"{config.approaches} approaches of {flights.frames} frames, preset {flights.preset}, "
        f"V {flights.visibility} m, {flights.range_m[0]:g} to {flights.range_m[1]:g} m, navigation "
        f"{sensors_text(run.sensors)}, sea state {run.deck.sea_state:g}, seed {flights.seed}; {seen_by}"
    )
    tables = localization_tables(scores, work.methods)
    publish(title, tables, flat_figures(scores), config.json_file, config.markdown, [*work.notes, NOTES])


def _write_csv(path: Path, scores: Sequence[Score]) -> None:
    """One row for each frame and method; empty cells for what does not exist."""
    names = sorted({name for score in scores for name in score.figures})
    text = io.StringIO()
    writer = csv.writer(text)
    keys = ("approach", "index", "method", "range_m", "visibility_m", "mode")
    writer.writerow([*keys, *names])
    for score in scores:
        figures = (score.figures.get(name, "") for name in names)
        writer.writerow([*(getattr(score, key) for key in keys), *figures])
    write_atomic(path, text.getvalue().encode())
    print(path)


def _file_name(name: str) -> str:
    return "-".join("".join(c if c.isalnum() else " " for c in name).split())


localization.__doc__ = LocalizationConfig.__doc__
