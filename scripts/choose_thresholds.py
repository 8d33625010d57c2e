"""What the detector's thresholds cost and buy: lines found on decks against lines seen where there are none.

    python scripts/choose_thresholds.py SOURCE... [--detector hybrid] [--deckless 600 --seed 901]

Sources are recordings with truth; further views without a runway are rendered. Every view is looked at once with
thresholds that let everything pass; all combinations are then tried on what the network said. For every share of false
lines the combination that finds most is printed, after the detector's own.
"""

import argparse
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from deckline.app.evaluation.detection import rendered_sets
from deckline.app.evaluation.detection_frames import FrameSet, open_recorded
from deckline.detect import DETECTORS, OnnxDetector
from deckline.detect.looks import DetectConfig, NetworkOutput, detect_lines, read_lines
from deckline.detect.preprocess import Window
from deckline.detect.region import decode_region
from deckline.evaluate.detection import Expected, Scene
from deckline.evaluate.labels import distance_px
from deckline.geometry import Camera
from deckline.recording import FrameError
from deckline.types import SIDES

FIRST = (0.3, 0.5, 0.7, 0.85, 0.9, 0.95, 0.98)  # of a runway in the whole image
CLOSE = (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99)  # of a runway in a close look
ROW = (0.3, 0.4, 0.5, 0.6, 0.7)  # of a row
LINE = (0.5, 0.6, 0.7, 0.75, 0.8, 0.85)  # of a line, mean over its rows
FALSE_SHARES = (0.0, 0.002, 0.005, 0.01, 0.02, 0.04)  # of the views without a runway
WRONG_PX = 10.0  # median distance of a line's points from which it is another line
OPEN = {"first_probability": 0.0, "close_probability": 0.0}


@dataclass(frozen=True, eq=False)
class Seen:
    """What is in a view, and what the network said of it."""

    camera: Camera
    expected: Expected
    output: NetworkOutput  # of the last look
    window: Window  # where that was
    first: float  # probability of a runway in the first look
    close: float  # least of the others; 1 without any


def looked_at(sets: list[FrameSet], detector: OnnxDetector) -> list[Seen]:
    """Every view of the sets that has a clear answer."""
    config = replace(detector.config, **OPEN)
    places = [(item, index) for item in sets for index in range(len(item))]
    seen = []
    for item, index in track(places, "looking"):
        try:
            question = item.load(index)
        except FrameError as error:
            print(f"skipped {error}")
            continue
        if question is None or question.expected.scene is Scene.UNRATED:
            continue
        outputs: list[NetworkOutput] = []

        def infer(view: NDArray[np.float32], kept: list[NetworkOutput] = outputs) -> NetworkOutput:
            kept.append(detector.infer(view))
            return kept[-1]

        u0, v0, u1, _ = detect_lines(question.frame.image_rgb, infer, config).region_px or (0.0, 0.0, 1.0, 1.0)
        window = Window(u0 + 0.5, v0 + 0.5, (u1 - u0) / config.grid.width)
        sure = [decode_region(output.region, output.box).probability for output in outputs]
        seen.append(
            Seen(question.frame.camera, question.expected, outputs[-1], window, sure[0], min(sure[1:], default=1.0))
        )
    return seen


def errors_of(one: Seen, config: DetectConfig) -> dict[str, NDArray[np.float64]]:
    """Distances of the points, px, by the sides on which these thresholds of rows and lines leave a line."""
    detection = read_lines(one.output, one.window, config)
    errors = {}
    for side in SIDES:
        points, line = getattr(detection, side).points_px, one.expected.lines_px[side]
        if len(points):
            far = np.full(len(points), np.inf)
            errors[side] = far if line is None else distance_px(points, line, one.camera)
    return errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sources", type=Path, nargs="+")
    parser.add_argument("--detector", default="hybrid", help="name, or an .onnx file")
    parser.add_argument("--deckless", type=int, default=0, help="views without a runway to render besides")
    parser.add_argument("--seed", type=int, default=901, help="of these")
    given = parser.parse_args()
    sets = open_recorded(tuple(given.sources))
    if given.deckless:
        sets += rendered_sets(0, given.deckless, ("train",), given.seed, "200..3000", None, 90.0)
    detector = OnnxDetector(Path(given.detector)) if given.detector.endswith(".onnx") else DETECTORS[given.detector]()
    if not isinstance(detector, OnnxDetector):
        raise SystemExit(f"{given.detector} has no network")
    seen = looked_at(sets, detector)
    is_deck = np.array([one.expected.scene is Scene.DECK for one in seen])
    thick = np.array([one.expected.visibility_m < 500 for one in seen])
    first, close = np.array([one.first for one in seen]), np.array([one.close for one in seen])
    rows = []
    for row, line in track(list(product(ROW, LINE)), "trying"):
        config = replace(detector.config, **OPEN, min_confidence=row, min_line_confidence=line)
        by_side = [errors_of(one, config) for one in seen]
        lines = np.array([len(errors) for errors in by_side])
        both, some = lines == 2, lines > 0
        errors = [np.concatenate([*errors.values(), []]) for errors in by_side]
        wrong = np.array([len(e) > 0 and not np.median(e) <= WRONG_PX for e in errors])
        for needed in product(FIRST, CLOSE):
            on = (first >= needed[0]) & (close >= needed[1])
            found, false = both & on, some & on
            px = np.concatenate([e for e, good in zip(errors, found & is_deck, strict=True) if good] or [[np.inf]])
            rates = [found[is_deck & ~thick].mean(), found[is_deck & thick].mean(), found[is_deck].mean()]
            alone = on & (lines == 1) & is_deck
            rows.append(
                (false[~is_deck].mean(), rates, np.percentile(px, (50, 95)), (*needed, row, line), alone, wrong)
            )
    print(f"{is_deck.sum()} decks, {(is_deck & thick).sum()} at V < 500 m; {(~is_deck).sum()} views without a runway")
    print("false %   found % V >= 500   < 500   all   px median   95 %   one line, wrong   first, close, row, line")
    usual = detector.config
    mine = usual.first_probability, usual.close_probability, usual.min_confidence, usual.min_line_confidence
    chosen = [r for r in rows if r[3] == mine]
    for share in FALSE_SHARES:
        chosen.append(max((r for r in rows if r[0] <= share), key=lambda r: r[1][2]))
    for false_share, rates, px, thresholds, alone, wrong in chosen:
        words = "  ".join(f"{100 * rate:.1f}" for rate in rates)
        print(
            f"{100 * false_share:.2f}   {words}   {px[0]:.2f}  {px[1]:.2f}   {alone.sum()}, {(alone & wrong).sum()}   {thresholds}"
        )


if __name__ == "__main__":
    main()
