"""`deckline eval detection` and `deckline eval detectors`: how well both lines are found, and false ones without."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro

from deckline.config import Models
from deckline.dehaze import NOT_DEHAZED
from deckline.detect import Detector
from deckline.flight import Flight
from deckline.report.bands import share
from deckline.report.provenance import settings_of
from deckline.types import Detection, RunwayPrior
from deckline_lab.evaluation.chain import single_frames_with
from deckline_lab.evaluation.dehazers import SharedDehazer, detector_label
from deckline_lab.evaluation.detection_cost import cost_table, measure_costs
from deckline_lab.evaluation.detection_flown import FLOWN, SINGLE, FlightPerSet, approach_figures, approach_table
from deckline_lab.evaluation.detection_score import (
    DetectionScore,
    groups,
    reliability,
    score_detection,
    summarise,
    visible_figures,
    with_scene,
)
from deckline_lab.evaluation.detection_truth import SceneKind, draw_runway_prior
from deckline_lab.evaluation.frames import FrameSample, FrameSet, RenderOptions, Task, name_sets, score_frames
from deckline_lab.evaluation.pictures import write_worst
from deckline_lab.evaluation.tables import MISSING, TO_TERMINAL, Columns, Figures, Output, Table, cells, publish
from deckline_lab.evaluation.visible_distance import visible_tables
from deckline_lab.rivals.catalog import flight_from_config, open_flights
from deckline_lab.statistics import paired_difference

SCORES_FILE, FLOWN_FOLDER = "scores.jsonl", "flown"
DETECTION_FRAMES, COMPARISON_FRAMES = RenderOptions(), RenderOptions(visibility="200..3000")
COUNTS: Columns = {name: (name, 1.0, ".0f") for name in ("frames", "decks", "empty")}
COLUMNS: Columns = {
    "found %": ("found_rate", 100.0, ".1f"),
    "in 3 px %": ("placed_rate", 100.0, ".1f"),
    "px": ("error_px.median", 1.0, ".2f"),
    "95 % px": ("error_px.p95", 1.0, ".2f"),
    "acc %": ("tusimple.accuracy", 100.0, ".1f"),
    "FP %": ("tusimple.false_positive", 100.0, ".1f"),
    "FN %": ("tusimple.false_negative", 100.0, ".1f"),
    "F1 %": ("culane.f1", 100.0, ".1f"),
    "ECE %": ("expected_calibration_error", 100.0, ".1f"),
    "false %": ("false_rate", 100.0, ".1f"),
    "both false %": ("false_pair_rate", 100.0, ".1f"),
}
COMPARED: Columns = {name: COLUMNS[name] for name in ("found %", "in 3 px %", "px", "95 % px", "false %", "ECE %")}
NOTES = """\
decks: frames with both lines in view, 10 % of each, whose light comes through the air to 2 % or more (bands: of the
ramp's); empty: without anything of a runway in the image; the others are not rated. contrast: what sets the lines
apart from the deck in the picture; below one grey level it takes a clean camera to see them. found: points on both
lines; in 3 px: and half of each line's points or more within 3 px of 1280. px: error of all points of decks, normal to
the line, median and 95th percentile. acc, FP, FN: TuSimple's, on 56 rows that the lines have, 20 px of 1280. F1:
CULane's, lines drawn 30 px of 1640 wide, IoU over 0.5. ECE: expected calibration error of the points' confidence.
false: empty frames with any point; both false: with points on both lines."""
COMPARISON_NOTES = """\
to the first: found, percentage points against the first row on the same decks, with the 95 % interval (bootstrap over
decks); frames of one flight resemble each other, so that their interval is too narrow."""
Key = tuple[str, str]  # detector, dehazer
Find = Callable[[FrameSample], Detection]


class Finder(NamedTuple):
    """A way to find lines, whose scores are stored in a folder."""

    out: Path | None
    settings: Mapping[str, Any]
    find: Find
    in_order: bool = False


def detection(
    sources: tyro.conf.Positional[tuple[Path, ...]] = (),
    render: Annotated[RenderOptions, tyro.conf.arg(name="")] = DETECTION_FRAMES,
    dehazer: str = NOT_DEHAZED,
    detector: str = Models.detector,
    prior_sigma_m: float | None = None,
    out: Path | None = None,
    flown: bool = False,
    poses: bool = True,
    single: bool = True,
    worst: int = 0,
    output: Output = TO_TERMINAL,
) -> int:
    """Measure how well the lines are found in frames whose lines are known, and false lines in frames without.

    Prints found-rate, errors, lane scores and calibration of all frames, then by range, visibility, light, contrast and
    ship; of approaches how far away the lines are first held. With --out, a stopped command resumes.

    Args:
        sources: recordings with truth, folders with labels.json, or folders of recordings.
        render: which frames are rendered.
        dehazer: name or .onnx file, whose pictures the detector sees; none: the hazy ones, as in the chain.
        detector: name or .onnx file.
        prior_sigma_m: give the chain a runway prior with drawn errors of this 1-sigma and 2 degrees, and in frames
            without a runway a false one in view.
        out: folder of the scores of every frame and of the worst frames' pictures.
        flown: fly the recordings too, tracked and with their poses as in `deckline run`, beside single pictures.
        poses: with --flown, give the flight its poses; without them it is flown as a video.
        single: score single pictures, each searched whole, up to 44 views; with --flown they can be left out.
        worst: so many of the worst frames become pictures in --out, with a line of figures each in worst.md.
        output: files of the results.
    """
    if worst < 0 or (worst and out is None):
        raise ValueError(f"--worst must not be negative and needs --out FOLDER for its pictures, got {worst}")
    if prior_sigma_m is not None and not (math.isfinite(prior_sigma_m) and prior_sigma_m >= 0):
        raise ValueError(f"--prior-sigma-m must be a number of metres, 0 or more, got {prior_sigma_m}")
    if flown and not sources:
        raise ValueError("--flown needs recordings: rendered views are no flight")
    if not poses and not flown:
        raise ValueError("--no-poses is for flights: state --flown as well")
    if not single and not flown:
        raise ValueError("--no-single leaves nothing to score: state --flown as well")
    sets = render.open_sets(sources)
    flight = flight_from_config(single_frames_with(dehazer, detector))
    with FlightPerSet(sets, flight, poses) as flights:
        modes = _score_modes(sets, flight, prior_sigma_m, flights if flown else None, single, out)
    scores = next(iter(modes.values()))
    title = f"{name_sets(sets)}; dehazer {dehazer}, detector {detector}"
    title += "" if prior_sigma_m is None else f"; runway prior with 1-sigma of {prior_sigma_m:g} m"
    approaches = {mode: approach_figures(members) for mode, members in modes.items()}
    is_flight = flown or "approaches" in approaches[SINGLE]
    figures, tables = flat_figures(scores), detection_tables(scores)
    if is_flight:
        figures |= {f"{mode}.{name}": value for mode, part in approaches.items() for name, value in part.items()}
        tables.insert(1, approach_table(approaches))
    publish(title, tables, figures, output, [NOTES])
    if out is not None and worst:
        print(write_worst(out, {item.name: item for item in sets}, scores, worst, flight))
    return 0


def _score_modes(
    sets: Sequence[FrameSet],
    flight: Flight,
    prior_sigma_m: float | None,
    flown: FlightPerSet | None,
    single: bool,
    out: Path | None,
) -> dict[str, list[DetectionScore]]:
    """The scores of single pictures and those as flown, where they are asked for."""

    def prior_of(sample: FrameSample) -> RunwayPrior | None:
        return None if prior_sigma_m is None else draw_runway_prior(sample.frame, prior_sigma_m)

    def find(sample: FrameSample) -> Detection:
        return flight(sample.frame, prior=prior_of(sample)).detection

    stated = {"prior_sigma_m": prior_sigma_m}
    modes: dict[str, Finder] = {SINGLE: Finder(out, settings_of(flight) | stated, find)} if single else {}
    if flown is not None:
        settings, folder = flown.settings | stated, None if out is None else out / FLOWN_FOLDER
        modes[FLOWN] = Finder(folder, settings, lambda one: flown(one, prior_of(one)).detection, in_order=True)
    return dict(zip(modes, score_detections(sets, list(modes.values())), strict=True))


def detectors(
    sources: tyro.conf.Positional[tuple[Path, ...]] = (),
    detector: tuple[str, ...] = (Models.detector,),
    dehazer: tuple[str, ...] = (NOT_DEHAZED, Models.dehazer),
    render: Annotated[RenderOptions, tyro.conf.arg(name="")] = COMPARISON_FRAMES,
    cost: bool = False,
    out: Path | None = None,
    output: Output = TO_TERMINAL,
) -> int:
    """Compare detectors, each behind every dehazer, on the same frames: does dehazing help to find the lines?

    With --out, a stopped command resumes, and one with more detectors or dehazers adds theirs.

    Args:
        sources: recordings with truth, folders with labels.json, or folders of recordings.
        detector: names or .onnx files, each behind every dehazer.
        dehazer: names or .onnx files; none does nothing.
        render: which frames are rendered.
        cost: the networks' parameters and MACs, and the time of a pass on this machine.
        out: folder of the scores of every frame.
        output: files of the results.
    """
    sets = render.open_sets(sources)
    restorers: dict[str, SharedDehazer] = {}
    methods: dict[Key, Finder] = {}
    loaded: dict[str, Detector] = {}
    pairs = list(product(dict.fromkeys(detector), dict.fromkeys(dehazer)))
    flights = open_flights(single_frames_with(before, each) for each, before in pairs)
    for (each, before), flight in zip(pairs, flights, strict=True):
        restorer = restorers.setdefault(before, SharedDehazer(flight.dehazer))
        key = (detector_label(each), detector_label(before))
        if key in methods:
            raise ValueError(f"two methods would be called {' behind '.join(key)}: give their files other names")
        find = partial(_find_restored, restorer, flight.detector)
        loaded[key[0]] = flight.detector
        methods[key] = Finder(None if out is None else out / "+".join(key), settings_of(flight), find)
    scores = dict(zip(methods, score_detections(sets, list(methods.values())), strict=True))
    title = f"{name_sets(sets)}, visibility of rendered frames {render.visibility} m"
    summaries = {"+".join(key): summarise(found) for key, found in scores.items()}
    figures = {f"{name}.{key}": value for name, part in summaries.items() for key, value in part.items()}
    tables = comparison_tables(scores)
    visible = {key: visible_figures(found) for key, found in scores.items()}
    tables += visible_tables(visible.items(), ("detector", "dehazer"))
    figures |= {f"{'+'.join(key)}.{name}": value for key, part in visible.items() for name, value in part.items()}
    if cost:
        costs = measure_costs(loaded)
        figures |= {f"{name}.{key}": value for name, part in costs.items() for key, value in part.items()}
        tables.append(cost_table(costs))
    publish(title, tables, figures, output, [NOTES, COMPARISON_NOTES])
    return 0


def _find_restored(restorer: SharedDehazer, detector: Callable[..., Detection], sample: FrameSample) -> Detection:
    return detector(restorer.restore(sample.frame).image_rgb)


def score_detections(sets: Sequence[FrameSet], methods: Sequence[Finder]) -> list[list[DetectionScore]]:
    """Scores of every method."""

    def score(find: Find, sample: FrameSample) -> dict[str, Any]:
        return asdict(score_detection(sample, find(sample)))

    tasks = [Task(each.out, SCORES_FILE, each.settings, partial(score, each.find), each.in_order) for each in methods]
    return [[DetectionScore(**row) for row in rows] for rows in score_frames(sets, tasks)]


def detection_tables(scores: Sequence[DetectionScore]) -> list[Table]:
    """All frames, then by range, visibility, light, contrast and ship, then how far confidence can be trusted."""
    found = reliability(scores)
    points = [
        (f"{b.low:.1f} to {b.high:.1f}", str(b.points), f"{100 * b.confidence:.1f}", f"{100 * b.right:.1f}")
        for b in found.bins
        if b.points
    ]
    error = 100 * found.expected_calibration_error
    title = f"points by confidence; expected calibration error {error:.1f} %" if points else "no points"
    return [
        _figures_table("all frames", {"all": list(scores)}),
        *(_figures_table(f"by {what}", members) for what, members in groups(scores).items() if members),
        Table(title, ("confidence", "points", "mean, %", "within 3 px, %"), points),
    ]


def _figures_table(title: str, named: Mapping[str, Sequence[DetectionScore]]) -> Table:
    """A row a group; columns that are empty in every row are left out."""
    rows = [(name, *cells(summarise(members), {**COUNTS, **COLUMNS})) for name, members in named.items()]
    columns = ("", *COUNTS, *COLUMNS)
    full = [k for k in range(len(columns)) if any(row[k] != MISSING for row in rows)]
    return Table(title, [columns[k] for k in full], [[row[k] for k in full] for row in rows])


def flat_figures(scores: Sequence[DetectionScore]) -> Figures:
    """Every number of the tables under dotted names."""
    figures = dict(summarise(scores))
    for what, named in groups(scores).items():
        for name, members in named.items():
            figures |= {f"{what}.{name}.{key}": value for key, value in summarise(members).items()}
    for b in reliability(scores).bins:
        values = {"points": float(b.points), "confidence": b.confidence, "right": b.right}
        figures |= {f"reliability.{b.low:.1f}-{b.high:.1f}.{key}": value for key, value in values.items()}
    return figures


def comparison_tables(scores: Mapping[Key, list[DetectionScore]]) -> list[Table]:
    """All frames, then the share of decks found by range, visibility, light that arrives and contrast."""
    first = next(iter(scores))
    figures = {key: summarise(found) for key, found in scores.items()}
    rows = []
    for key, found in scores.items():
        difference = MISSING if key == first else _found_difference(found, scores[first])
        rows.append((*key, *cells(figures[key], COMPARED), difference))
    title = f"{figures[first]['decks']:.0f} decks, {figures[first]['empty']:.0f} frames without a runway"
    tables = [Table(title, ("detector", "dehazer", *COMPARED, "found, to the first"), rows)]
    decks = {key: groups(with_scene(found, SceneKind.DECK)) for key, found in scores.items()}
    for what in ("range to the ramp", "visibility", "light through the air", "contrast of the fainter line"):
        rows = [
            (*key, *(f"{100 * share(members, lambda score: score.found == 2):.1f}" for members in named[what].values()))
            for key, named in decks.items()
        ]
        tables.append(Table(f"found %, by {what}", ("detector", "dehazer", *decks[first][what]), rows))
    return tables


def _found_difference(scores: Sequence[DetectionScore], first: Sequence[DetectionScore]) -> str:
    before = {(score.source, score.index): score.found == 2 for score in with_scene(first, SceneKind.DECK)}
    pairs = [(score.found == 2) - before[score.source, score.index] for score in with_scene(scores, SceneKind.DECK)]
    if not pairs:
        return MISSING
    return paired_difference(100.0 * np.array(pairs), np.random.default_rng(0)).text("+.1f")
