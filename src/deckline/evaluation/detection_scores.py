"""Scores of an evaluation as they are made: kept in a file that a stopped command goes on from."""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deckline.evaluation.detection_frames import FrameSet
from deckline.evaluation.detection_measure import DetectionScore, score_detection, score_from_mapping, score_to_mapping
from deckline.progress import progress
from deckline.recording import FrameError
from deckline.types import Detection, Frame

SCORES_FILE = "scores.jsonl"
NOT_LABELLED = "not labelled"  # why a frame is left out without a word
MOST_SHOWN = 160  # characters of a setting in an error


@dataclass
class ScoreBook:
    """Scores by source and frame, appended to a file when there is one."""

    scores: dict[tuple[str, int], DetectionScore] = field(default_factory=dict)
    skipped: dict[tuple[str, int], str] = field(default_factory=dict)  # frames that were left out, and why
    path: Path | None = None

    def add(self, score: DetectionScore) -> None:
        self.scores[score.source, score.index] = score
        self._append({"score": score_to_mapping(score)})

    def skip(self, source: str, index: int, reason: str) -> None:
        self.skipped[source, index] = reason
        self._append({"skipped": [source, index, reason]})

    def knows(self, source: str, index: int) -> bool:
        return (source, index) in self.scores or (source, index) in self.skipped

    def _append(self, row: dict[str, Any]) -> None:
        if self.path is not None:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row, allow_nan=False) + "\n")


@dataclass(frozen=True, eq=False)
class Method:
    """A way to find lines, and how it did."""

    find: Callable[[Frame], Detection]
    book: ScoreBook


def open_book(out: Path | None, settings: dict[str, Any]) -> ScoreBook:
    """The scores in `out`, to be gone on with, or an empty book; without `out` nothing is kept.

    Raises:
        ValueError: `out` holds scores that were made with other settings.
    """
    if out is None:
        return ScoreBook()
    out.mkdir(parents=True, exist_ok=True)
    path, book, whole = out / SCORES_FILE, ScoreBook(), 0
    now = json.loads(json.dumps(settings))
    for end, row in _rows(path):
        whole = end
        if "settings" in row:
            _check_same(out, row["settings"], now)
        elif "score" in row:
            score = score_from_mapping(row["score"])
            book.scores[score.source, score.index] = score
        else:
            source, index, reason = row["skipped"]
            book.skipped[source, index] = reason
    path.touch()
    os.truncate(path, whole)  # a killed writer may have left half a line
    book.path = path
    if not whole:
        book._append({"settings": now})
    return book


def _rows(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Whole lines of a file, and the byte where each ends."""
    if not path.exists():
        return
    end = 0
    with path.open("rb") as file:
        for line in file:
            end += len(line)
            try:
                row = json.loads(line)
            except ValueError:
                return
            if not line.endswith(b"\n"):
                return
            yield end, row


def _check_same(out: Path, before: dict[str, Any], now: dict[str, Any]) -> None:
    for key in sorted({*before, *now}):
        if before.get(key) != now.get(key):
            was, wanted = (json.dumps(values.get(key))[:MOST_SHOWN] for values in (before, now))
            raise ValueError(f"{out} holds an evaluation with {key} {was}, not {wanted}: choose another folder")


def evaluate(sets: Sequence[FrameSet], methods: Sequence[Method]) -> None:
    """Score every frame by the methods whose books do not know it yet; each frame is loaded once."""
    frames = [(item, index) for item in sets for index in range(len(item))]
    waiting = [[m for m in methods if not m.book.knows(item.name, index)] for item, index in frames]
    with progress("evaluating", len(frames), sum(not asked for asked in waiting)) as advance:
        for (item, index), asked in zip(frames, waiting, strict=True):
            if asked:
                _score_one(item, index, asked)
                advance()
            if index + 1 == len(item):
                item.close()


def _score_one(item: FrameSet, index: int, methods: Sequence[Method]) -> None:
    try:
        question = item.load(index)
    except FrameError as error:
        question, why = None, str(error)
    else:
        why = NOT_LABELLED
    for method in methods:
        if question is None:
            method.book.skip(item.name, index, why)
        else:
            frame, found = question.frame, method.find(question.frame)
            method.book.add(score_detection(frame, found, question.expected, item.name, index, question.ship))
