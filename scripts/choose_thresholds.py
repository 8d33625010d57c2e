"""Choose the detector's thresholds: print lines found on decks against false lines where there is no runway.

    python scripts/choose_thresholds.py SOURCE... [--detector hybrid] [--deckless 600 --seed 901]

Sources are recordings with truth and folders with labels.json, where null for both lines means no runway; further
views without a runway are rendered. The likeliest places of every view are searched once; tiles, whose pairs count by
their shape too, are not. All combinations are then tried on the network's stored outputs. For every share of false
lines the combination that finds most is printed, after the detector's own.
"""

import argparse
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from deckline.detect import OnnxDetector
from deckline.detect.search import CropView, Search
from deckline.flight import open_detector
from deckline.geometry import Camera
from deckline.recording import FrameError
from deckline.types import SIDES, Detection
from deckline_lab.evaluation.detection_truth import ExpectedLines, SceneKind
from deckline_lab.evaluation.frames import FrameSet, RenderOptions, open_recorded
from deckline_lab.evaluation.metrics import distance_px

ROW = (0.3, 0.4, 0.5, 0.6)  # of a row
BOTH = (*np.arange(0.3, 0.9, 0.05).round(2), 1.1)  # of both lines, with the whole image; 1.1: none
CLOSE = (*np.arange(0.5, 0.95, 0.05).round(2), 1.1)  # of both lines in the close view alone
LONE = (*np.arange(0.6, 1.0, 0.05).round(2), 1.1)  # of a line without the other one; 1.1: none
FALSE_SHARES = (0.0, 0.002, 0.005, 0.01, 0.02, 0.04)  # of the views without a runway
THICK_M = 500.0  # visibility below which haze is thick
WRONG_PX = 10.0  # median distance of a line's points from which it is another line
Thresholds = tuple[float, float, float, float]  # of NAMES
NAMES = ("min_confidence", "min_probability", "min_close_probability", "min_lone_probability")


class ScoredView(NamedTuple):
    """The expected lines of a view and the network's outputs for it."""

    camera: Camera
    expected: ExpectedLines
    whole: CropView  # of the whole image
    candidates: list[CropView]


class Trial(NamedTuple):
    """The scores of one combination of thresholds."""

    thresholds: Thresholds
    false_share: float  # of the views without a runway that give a line
    found: tuple[float, float, float]  # share of decks with both lines: V >= 500 m, less, all
    error_px: tuple[float, float]  # of their points, median and 95th percentile
    alone: tuple[int, int]  # decks with one line, and those where it is another line


def run_on_sets(sets: list[FrameSet], detector: OnnxDetector) -> list[ScoredView]:
    """Every view of the sets that has a clear answer."""
    places = [(item, index) for item in sets for index in range(len(item))]
    views = []
    for item, index in track(places, "detecting"):
        try:
            sample = item.load(index)
        except FrameError as error:
            print(f"skipped {error}")
            continue
        if sample is not None and sample.expected.scene is not SceneKind.UNRATED:
            views.append(run_detector(sample.frame.image_rgb, sample.frame.camera, sample.expected, detector))
    return views


def run_detector(
    image_rgb: NDArray[np.uint8], camera: Camera, expected: ExpectedLines, detector: OnnxDetector
) -> ScoredView:
    found = Search(image_rgb, detector.infer, detector.config)
    found.search_whole()
    return ScoredView(camera, expected, found.whole, found.candidates)


class Rated(NamedTuple):
    """A candidate's lines, of both sides or of one."""

    errors: NDArray[np.float64]  # distances of their points, px
    probability: float
    clear: float  # the same with the whole image's


def rate(one: ScoredView, count: int, row: float) -> list[Rated]:
    """The candidates with so many lines; the search takes the first one that counts."""
    rated = []
    for candidate in one.candidates:
        view = replace(candidate, config=replace(candidate.config, min_confidence=row))
        if view.count == count:
            clear = view.probability * (1.0 if candidate is one.whole else one.whole.region.probability)
            rated.append(Rated(measure_errors(one, view.lines), view.probability, clear))
    return sorted(rated, key=lambda each: -each.probability)


def measure_errors(one: ScoredView, lines: Detection) -> NDArray[np.float64]:
    """Distances of all points from their side's true line, px."""
    errors = []
    for side in SIDES:
        points, line = getattr(lines, side), one.expected.lines_px[side]
        if len(points):
            infinite = np.full(len(points), np.inf)
            errors.append(infinite if line is None else distance_px(points.points_px, line, one.camera))
    return np.concatenate(errors)


def tabulate(rated: list[list[Rated]], name: str) -> NDArray[np.float64]:
    """A value of each view's candidates, (views, most candidates); 0 where there are fewer."""
    table = np.zeros((len(rated), max(1, *map(len, rated))))
    for values, candidates in zip(table, rated, strict=True):
        values[: len(candidates)] = [getattr(each, name) for each in candidates]
    return table


def share_of(found: NDArray[np.bool_], some: NDArray[np.bool_]) -> float:
    return float(found[some].mean()) if some.any() else float("nan")


def try_thresholds(views: list[ScoredView], row: float) -> list[Trial]:
    """Every set of thresholds of lines, with this one of rows."""
    pairs, lines = ([rate(one, count, row) for one in views] for count in (2, 1))
    close, clear, single = tabulate(pairs, "probability"), tabulate(pairs, "clear"), tabulate(lines, "clear")
    deck = np.array([one.expected.scene is SceneKind.DECK for one in views])
    thick = np.array([one.expected.visibility_m < THICK_M for one in views])
    tried = []
    for thresholds in product(BOTH, CLOSE, LONE):
        counts_as_pair, counts_alone = (clear >= thresholds[0]) | (close >= thresholds[1]), single >= thresholds[2]
        found = counts_as_pair.any(axis=1)
        alone = ~found & counts_alone.any(axis=1)
        px = [pairs[k][counts_as_pair[k].argmax()].errors for k in np.flatnonzero(found & deck)]
        singles = [lines[k][counts_alone[k].argmax()].errors for k in np.flatnonzero(alone & deck)]
        median, most = np.percentile(np.concatenate(px), (50, 95)) if px else (np.inf, np.inf)
        shares = share_of(found, deck & ~thick), share_of(found, deck & thick), share_of(found, deck)
        false = float((found | alone)[~deck].mean())
        counts = len(singles), sum(not np.median(errors) <= WRONG_PX for errors in singles)
        tried.append(Trial((row, *thresholds), false, shares, (float(median), float(most)), counts))
    return tried


def rank(trial: Trial) -> tuple[float, int, float]:
    """What is better is larger: both lines on more decks, then one line on more, then fewer false ones."""
    return trial.found[2], trial.alone[0] - trial.alone[1], -trial.false_share


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sources", type=Path, nargs="+")
    parser.add_argument("--detector", default="hybrid", help="name, or an .onnx file")
    parser.add_argument("--deckless", type=int, default=0, help="views without a runway to render besides")
    parser.add_argument("--seed", type=int, default=901, help="of these")
    given = parser.parse_args()
    sets = open_recorded(tuple(given.sources))
    if given.deckless:
        sets += RenderOptions(0, given.deckless, ("train",), given.seed, "200..3000").open_sets()
    detector = open_detector(given.detector)
    if not isinstance(detector, OnnxDetector):
        raise SystemExit(f"{given.detector} has no network")
    views = run_on_sets(sets, detector)
    decks = sum(one.expected.scene is SceneKind.DECK for one in views)
    if decks in (0, len(views)):
        raise SystemExit(
            f"no view {'without' if decks else 'with'} a runway: add a source that has some, or --deckless"
        )
    tried = [trial for row in track(ROW, "trying") for trial in try_thresholds(views, row)]
    usual = tuple(getattr(detector.config, name) for name in NAMES)
    best = [max((t for t in tried if t.false_share <= share), key=rank) for share in FALSE_SHARES]
    print(f"{decks} decks, {len(views) - decks} views without a runway")
    print("false %; found % at V >= 500 m, less, all; px median, 95 %; one line, wrong; row, both, close, lone")
    for trial in [*(t for t in tried if t.thresholds == usual), *best]:
        found = ", ".join(f"{100 * share:.1f}" for share in trial.found)
        px = ", ".join(f"{value:.2f}" for value in trial.error_px)
        print(f"{100 * trial.false_share:.2f}; {found}; {px}; {trial.alone}; {trial.thresholds}")


if __name__ == "__main__":
    main()
