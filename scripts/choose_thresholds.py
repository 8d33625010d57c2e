"""What the detector's thresholds cost and buy: lines found on decks against lines views where there are none.

    python scripts/choose_thresholds.py SOURCE... [--detector hybrid] [--deckless 600 --seed 901]

Sources are recordings with truth; further views without a runway are rendered. Every view is searched once with
thresholds that let everything pass; all combinations are then tried on what the network said. For every share of false
lines the combination that finds most is printed, after the detector's own.
"""

import argparse
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from deckline.detect import DETECTORS, OnnxDetector
from deckline.detect import coarse_to_fine as search
from deckline.detect.anchors import decode_region
from deckline.detect.coarse_to_fine import DetectConfig, NetworkOutput
from deckline.detect.crop import Crop
from deckline.evaluation.detection_truth import ExpectedLines, Scene
from deckline.evaluation.frames import FrameSet, RenderOptions, open_recorded
from deckline.evaluation.metrics import distance_px
from deckline.geometry import Camera
from deckline.recording import FrameError
from deckline.types import SIDES

ROW = (0.3, 0.4, 0.5, 0.6)  # of a row
BOTH = tuple(np.arange(0.05, 1.0, 0.05).round(2))  # of both lines
LONE = (*np.arange(0.3, 1.0, 0.05).round(2), 1.1)  # of a line without the other one; 1.1: none
FALSE_SHARES = (0.0, 0.002, 0.005, 0.01, 0.02, 0.04)  # of the views without a runway
THICK_M = 500.0  # visibility below which haze is thick
WRONG_PX = 10.0  # median distance of a line's points from which it is another line
Thresholds = tuple[float, float, float]  # of NAMES
NAMES = ("min_confidence", "min_probability", "min_lone_probability")


class ScoredView(NamedTuple):
    """What is in a view, and what the network said of it."""

    camera: Camera
    expected: ExpectedLines
    output: NetworkOutput  # of the last crop
    window: Crop  # where that lay
    runway: float  # probability of a runway


class Trial(NamedTuple):
    """What a combination gives."""

    thresholds: Thresholds
    false_share: float  # of the views without a runway that give a line
    found: tuple[float, float, float]  # share of decks with both lines: V >= 500 m, less, all
    error_px: tuple[float, float]  # of their points, median and 95th percentile
    alone: tuple[int, int]  # decks with one line, and those where it is another line


def with_thresholds(config: DetectConfig, thresholds: Thresholds) -> DetectConfig:
    named: dict[str, Any] = dict(zip(NAMES, thresholds, strict=True))
    return replace(config, **named)


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
        if sample is not None and sample.expected.scene is not Scene.UNRATED:
            views.append(run_detector(sample.frame.image_rgb, sample.frame.camera, sample.expected, detector))
    return views


def run_detector(
    image_rgb: NDArray[np.uint8], camera: Camera, expected: ExpectedLines, detector: OnnxDetector
) -> ScoredView:
    outputs: list[NetworkOutput] = []

    def infer(view: NDArray[np.float32]) -> NetworkOutput:
        outputs.append(detector.infer(view))
        return outputs[-1]

    config = with_thresholds(detector.config, (0.0, 0.0, 0.0))
    u0, v0, u1, _ = search.detect_lines(image_rgb, infer, config).region_px or (0.0, 0.0, 1.0, 1.0)
    window = Crop(u0 + 0.5, v0 + 0.5, (u1 - u0) / config.grid.width)
    runway = search.runway_probability([decode_region(output.region, output.box).probability for output in outputs])
    return ScoredView(camera, expected, outputs[-1], window, runway)


def measure_lines(one: ScoredView, config: DetectConfig) -> tuple[list[NDArray[np.float64]], float]:
    """Distances of the points, px, of each line whose rows are sure enough, and the probability of the lines."""
    detection = search.decode_lines(one.output, one.window, config)
    errors = []
    for side in SIDES:
        points, line = getattr(detection, side), one.expected.lines_px[side]
        if len(points):
            infinite = np.full(len(points), np.inf)
            errors.append(infinite if line is None else distance_px(points.points_px, line, one.camera))
    return errors, search.lines_probability(detection, one.runway)


def try_thresholds(views: list[ScoredView], config: DetectConfig, row: float) -> list[Trial]:
    """Every pair of thresholds of lines, with this one of rows."""
    rated = [measure_lines(one, with_thresholds(config, (row, 0.0, 0.0))) for one in views]
    errors, sure = [each for each, _ in rated], np.array([probability for _, probability in rated])
    lines = np.array([len(sides) for sides in errors])
    wrong = np.array([len(sides) == 1 and not np.median(sides[0]) <= WRONG_PX for sides in errors])
    deck = np.array([one.expected.scene is Scene.DECK for one in views])
    thick = np.array([one.expected.visibility_m < THICK_M for one in views])
    tried = []
    for both, lone in product(BOTH, LONE):
        found, alone = (lines == 2) & (sure >= both), (lines == 1) & (sure >= lone)
        px = [np.concatenate(sides) for sides, good in zip(errors, found & deck, strict=True) if good]
        median, most = np.percentile(np.concatenate(px), (50, 95)) if px else (np.inf, np.inf)
        shares = float(found[deck & ~thick].mean()), float(found[deck & thick].mean()), float(found[deck].mean())
        false = float((found | alone)[~deck].mean())
        counts = int((alone & deck).sum()), int((alone & deck & wrong).sum())
        tried.append(Trial((row, float(both), float(lone)), false, shares, (float(median), float(most)), counts))
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
    detector = OnnxDetector(Path(given.detector)) if given.detector.endswith(".onnx") else DETECTORS[given.detector]()
    if not isinstance(detector, OnnxDetector):
        raise SystemExit(f"{given.detector} has no network")
    views = run_on_sets(sets, detector)
    tried = [trial for row in track(ROW, "trying") for trial in try_thresholds(views, detector.config, row)]
    usual = tuple(getattr(detector.config, name) for name in NAMES)
    best = [max((t for t in tried if t.false_share <= share), key=rank) for share in FALSE_SHARES]
    decks = sum(one.expected.scene is Scene.DECK for one in views)
    print(f"{decks} decks, {len(views) - decks} views without a runway")
    print("false %; found % at V >= 500 m, less, all; px median, 95 %; one line, wrong; row, both, lone")
    for trial in [*(t for t in tried if t.thresholds == usual), *best]:
        found = ", ".join(f"{100 * share:.1f}" for share in trial.found)
        px = ", ".join(f"{value:.2f}" for value in trial.error_px)
        print(f"{100 * trial.false_share:.2f}; {found}; {px}; {trial.alone}; {trial.thresholds}")


if __name__ == "__main__":
    main()
