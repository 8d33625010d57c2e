"""`deckline eval detectors`: several detectors behind several dehazers, on the same frames."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from deckline.dehaze import NOT_DEHAZED, Dehazer, restore
from deckline.detect import Detector
from deckline.evaluation.commands import JsonFile
from deckline.evaluation.dehazing_methods import file_label
from deckline.evaluation.detection import MarkdownFile, all_sets
from deckline.evaluation.detection_frames import named
from deckline.evaluation.detection_measure import DetectionScore, Scene
from deckline.evaluation.detection_scores import Method, evaluate, open_book
from deckline.evaluation.detection_summary import groups, summarise_detection
from deckline.evaluation.detection_tables import NOTES, TableText, cell, report
from deckline.evaluation.paired import paired_difference
from deckline.pipeline import Pipeline, PipelineConfig
from deckline.report.provenance import settings_of
from deckline.types import Detection, Frame

SHOWN = ("found %", "in 3 px %", "px", "95 % px", "false %", "ECE %")
COMPARED = """\
to the first: found, percentage points against the first row on the same decks, with the 95 % interval (bootstrap over
decks); frames of one flight resemble each other, so that their interval is too narrow."""
Key = tuple[str, str]  # detector, dehazer


def detectors(
    sources: tyro.conf.Positional[tuple[Path, ...]] = (),
    detector: tuple[str, ...] = (PipelineConfig.detector,),
    dehazer: tuple[str, ...] = (NOT_DEHAZED, PipelineConfig.dehazer),
    frames: int | None = None,
    deckless: int | None = None,
    preset: tuple[str, ...] = ("paper",),
    seed: int = 1000,
    visibility: str = "200..3000",
    range_m: tuple[float, float] | None = None,
    fov_deg: float = 90.0,
    out: Path | None = None,
    json_file: JsonFile = None,
    markdown_file: MarkdownFile = None,
) -> int:
    """Compare detectors, each behind every dehazer, on the same frames: does dehazing help to find the lines?

    With --out, a stopped command goes on where it was when it is given again, and one with more detectors or dehazers
    adds theirs.

    Args:
        sources: recordings with truth, folders with labels.json, or folders of recordings.
        detector: names or .onnx files, each behind every dehazer.
        dehazer: names or .onnx files; none does nothing.
        frames: rendered afresh of each preset, from random viewpoints; 200 when no source is given.
        deckless: rendered afresh without a runway in the image; 100 when no source is given.
        preset: ships of the rendered frames: paper, cvn, axial, small, runway, train.
        seed: of the simulator; the shipped weights never saw seeds from 1000 on.
        visibility: of the rendered frames, metres at 2 % contrast, LOW..HIGH or clear.
        range_m: distance of the rendered frames from the ramp; 60 to 800 m, 30 to 1500 m for preset train.
        fov_deg: horizontal field of view of the rendered frames; preset train draws its own.
        out: folder of the scores of every frame.
        json_file: write the figures here as well.
        markdown_file: write the tables here as well.
    """
    sets = all_sets(sources, frames, deckless, preset, seed, visibility, range_m, fov_deg)
    shared = {"frames": [item.settings for item in sets]}
    methods = _methods(tuple(dict.fromkeys(detector)), tuple(dict.fromkeys(dehazer)), out, shared)
    evaluate(sets, list(methods.values()))
    lengths = {item.name: len(item) for item in sets}  # an earlier command may have scored more frames
    scores = {
        key: [score for score in method.book.scores.values() if score.index < lengths[score.source]]
        for key, method in methods.items()
    }
    title = f"{named(sets)}, visibility of rendered frames {visibility} m"
    summaries = {"+".join(key): summarise_detection(found) for key, found in scores.items()}
    figures = {f"{name}.{key}": value for name, part in summaries.items() for key, value in part.items()}
    report(title, comparison_tables(scores), [NOTES, COMPARED], figures, json_file, markdown_file)
    return 0


def _methods(
    names: Sequence[str], dehazers: Sequence[str], out: Path | None, shared: dict[str, Any]
) -> dict[Key, Method]:
    methods: dict[Key, Method] = {}
    restorers: dict[str, _Restorer] = {}
    for name in names:
        for dehazer in dehazers:
            pipeline = Pipeline(PipelineConfig(dehazer, name, detect_in="dehazed"))
            restorer = restorers.setdefault(dehazer, _Restorer(pipeline.dehaze))
            key = (label(name), label(dehazer))
            if key in methods:
                raise ValueError(f"two methods would be called {' behind '.join(key)}: give their files other names")
            book = open_book(None if out is None else out / "+".join(key), {**settings_of(pipeline), **shared})
            methods[key] = Method(partial(_find, restorer, pipeline.detect), book)
    return methods


class _Restorer:
    """A dehazer that keeps the last frame's picture, for the next detector."""

    def __init__(self, dehaze: Dehazer) -> None:
        self._dehaze = dehaze
        self._last: tuple[Frame, NDArray[np.uint8]] | None = None

    def __call__(self, frame: Frame) -> NDArray[np.uint8]:
        if self._last is None or self._last[0] is not frame:
            self._last = frame, restore(self._dehaze, frame).image_rgb
        return self._last[1]


def _find(restorer: _Restorer, detect: Detector, frame: Frame) -> Detection:
    return detect(restorer(frame))


def label(name: str) -> str:
    """A method's name, or what its .onnx file is called."""
    return file_label(Path(name)) if name.endswith(".onnx") else name


def comparison_tables(scores: dict[Key, list[DetectionScore]]) -> list[TableText]:
    """All frames, then the share of decks found by range, visibility, light that arrives and contrast."""
    keys = list(scores)
    figures = {key: summarise_detection(found) for key, found in scores.items()}
    rows = [
        (*key, *(cell(figures[key], name) for name in SHOWN), _difference(scores[key], scores[keys[0]])) for key in keys
    ]
    one = figures[keys[0]]
    tables = [
        TableText(
            f"{one['decks']:.0f} decks, {one['empty']:.0f} frames without a runway",
            ("detector", "dehazer", *SHOWN, "found, to the first"),
            tuple(rows),
        )
    ]
    for what in ("range to the ramp", "visibility", "light through the air", "contrast of the fainter line"):
        bands = [name for name, members in groups(scores[keys[0]])[what].items() if _decks(members)]
        found = tuple(
            (*key, *(f"{100 * _found(groups(scores[key])[what][band]):.1f}" for band in bands)) for key in keys
        )
        tables.append(TableText(f"found %, by {what}", ("detector", "dehazer", *bands), found))
    return tables


def _decks(scores: Sequence[DetectionScore]) -> list[DetectionScore]:
    return [score for score in scores if score.scene is Scene.DECK]


def _found(scores: Sequence[DetectionScore]) -> float:
    decks = _decks(scores)
    return sum(score.found == 2 for score in decks) / len(decks) if decks else math.nan


def _difference(scores: Sequence[DetectionScore], first: Sequence[DetectionScore]) -> str:
    if scores is first:
        return "-"
    before = {(score.source, score.index): score.found == 2 for score in _decks(first)}
    pairs = [(score.found == 2) - before[score.source, score.index] for score in _decks(scores)]
    if not pairs:
        return "-"
    by = paired_difference(100.0 * np.array(pairs), np.random.default_rng(0))
    return f"{by.value:+.1f} [{by.low:+.1f}, {by.high:+.1f}]"
