"""`deckline eval labels`: detected points against labelled lines."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from deckline.config import Models
from deckline.dehaze import NOT_DEHAZED
from deckline.flight import FrameResult
from deckline.report.bands import share
from deckline.report.provenance import settings_of
from deckline.types import SIDES, LineVisibility
from deckline_lab.evaluation.chain import single_frames_with
from deckline_lab.evaluation.frames import FrameSample, Recorded, Task, score_frames
from deckline_lab.evaluation.metrics import distance_px
from deckline_lab.evaluation.tables import MISSING, TO_TERMINAL, Figures, Output, Table, figures_table, publish
from deckline_lab.labels import Labels
from deckline_lab.rivals.catalog import flight_from_config
from deckline_lab.statistics import median_and_p95


@dataclass(frozen=True)
class LabelScore:
    """One labelled frame's errors. Plain values: a score is a line of JSON."""

    file: str
    seen: str
    labelled: bool  # both lines are labelled
    errors_px: dict[str, list[float]]  # by side: normal distance of every detected point; found lines only

    @property
    def found(self) -> bool:
        """Points on both lines."""
        return all(side in self.errors_px for side in SIDES)


def labels(
    folders: tyro.conf.Positional[tuple[Path, ...]],
    deck_z_m: float | None = None,
    dehazer: str = NOT_DEHAZED,
    detector: str = Models.detector,
    out: Path | None = None,
    output: Output = TO_TERMINAL,
) -> int:
    """Find the lines in images that carry labels (labels.json beside them) and print the distance to them in pixels.

    Args:
        folders: image folders with camera.toml and labels.json.
        deck_z_m: world z of the deck plane, for what localization makes of the lines.
        dehazer: name or .onnx file, whose pictures the detector sees; none: the hazy ones, as in the chain.
        detector: name or .onnx file.
        out: folder of every frame's errors; a stopped command resumes from it.
        output: files of the results.
    """
    flight = flight_from_config(single_frames_with(dehazer, detector))
    sets = [Recorded(folder, deck_z_m) for folder in folders]

    def score(sample: FrameSample) -> dict[str, Any]:
        if sample.labels is None:
            raise ValueError(f"{sample.source}: no labels.json: nothing to compare with")
        return asdict(score_labels(flight(sample.frame), sample.labels))

    [rows] = score_frames(sets, [Task(out, "labels.jsonl", settings_of(flight), score)])
    scores = [LabelScore(**row) for row in rows]
    figures = summarise(scores)
    title = f"{len(scores)} labelled frames; dehazer {dehazer}, detector {detector}"
    publish(title, [_frames_table(scores), figures_table("all frames", figures)], figures, output)
    return 0


def score_labels(result: FrameResult, labels: Labels) -> LabelScore:
    """Compare one frame's detected points with its labels. Points where no line is labelled are infinitely wrong."""
    errors = {}
    for side in SIDES:
        points, line = getattr(result.detection, side).points_px, labels[side]
        if len(points):
            far = np.full(len(points), np.inf)
            errors[side] = (far if line is None else distance_px(points, line, result.frame.camera)).tolist()
    labelled = all(labels[side] is not None for side in SIDES)
    return LabelScore(result.frame.file, result.estimate.seen, labelled, errors)


def summarise(scores: Sequence[LabelScore]) -> Figures:
    """Found-rate, false lines and pixel errors of one frame or more under dotted names."""
    if not scores:
        raise ValueError("no labelled frame could be evaluated")
    figures = {"frames": float(len(scores))}
    runway, empty = ([score for score in scores if score.labelled is both] for both in (True, False))
    if runway:
        figures["found_rate"] = share(runway, lambda score: score.found)
        figures["ok_rate"] = share(runway, lambda score: score.seen == LineVisibility.BOTH)
        lines = [score.errors_px[side] for score in runway for side in SIDES if side in score.errors_px]
        if lines:
            figures |= median_and_p95(np.concatenate(lines), "error_px")
            figures["worst_line_median_px"] = max(float(np.median(line)) for line in lines)
    if empty:
        figures["false_line_rate"] = share(empty, lambda score: bool(score.errors_px))
    return figures


def _frames_table(scores: Sequence[LabelScore]) -> Table:
    rows = []
    for score in scores:
        lines = (score.errors_px.get(side) for side in SIDES)
        cells = ([f"{q:.2f}" for q in np.percentile(line, (50, 95))] if line else [MISSING] * 2 for line in lines)
        rows.append((score.file, score.seen, *(text for pair in cells for text in pair)))
    columns = ("frame", "seen", *(f"{side} {what}, px" for side in SIDES for what in ("median", "95 %")))
    return Table("by frame", columns, rows)
