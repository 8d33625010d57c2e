"""The frames in which detection went worst, as pictures with a line of figures each."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from deckline.atomic import write_atomic
from deckline.evaluation.detection_score import DetectionScore
from deckline.evaluation.detection_truth import ExpectedLines, Scene
from deckline.evaluation.frames import FrameSet
from deckline.flight import Flight
from deckline.geometry import Camera
from deckline.report.draw import CENTRE, Image, draw_dashes, write_picture
from deckline.report.overlay import draw_overlay, draw_panels
from deckline.types import SIDES

PAGE = "worst.md"
FOLDER = "worst"


def write_worst(
    out: Path, sets: Mapping[str, FrameSet], scores: Sequence[DetectionScore], count: int, flight: Flight
) -> Path:
    """Write `out`/worst.md and a PNG of each of the `count` worst frames, the worst first; returns the page.

    The left picture shows the true lines dashed, the right one what was found. Frames that nothing is wrong with are
    left out.
    """
    (out / FOLDER).mkdir(parents=True, exist_ok=True)
    parts = ["# Worst detections", "Left: as the camera saw it, true lines dashed. Right: what was found.", ""]
    ranked = sorted(scores, key=lambda score: score.badness, reverse=True)[:count]
    for rank, score in enumerate((score for score in ranked if score.badness[0] > 0), 1):
        sample = sets[score.source].load(score.index)
        if sample is None:
            continue
        name = f"{FOLDER}/{rank:03d}.png"
        result = flight(sample.frame)
        pictures = draw_panels(result)
        _draw_truth(pictures.hazy, sample.expected, sample.frame.camera)
        write_picture(out / name, draw_overlay(sample.frame, result.guidance, pictures))
        parts += [f"## {rank}. {score.file}", figures_line(score), f"\n![{score.file}]({name})\n"]
    for item in sets.values():
        item.close()
    page = out / PAGE
    write_atomic(page, "\n".join(parts).encode())
    return page


def figures_line(score: DetectionScore) -> str:
    """What is known of a frame, in one line."""
    parts = [f"{score.source} frame {score.index}", score.ship]
    if np.isfinite(score.range_m):
        parts.append(f"{score.range_m:.0f} m to the ramp")
    if not np.isnan(score.visibility_m):
        parts.append("clear air" if np.isinf(score.visibility_m) else f"visibility {score.visibility_m:.0f} m")
    if score.scene == Scene.DECK:
        parts.append(f"lines {score.extent_px:.0f} px across")
    return "; ".join([*parts, *(_side(score, side) for side in SIDES)])


def _side(score: DetectionScore, side: str) -> str:
    errors, confidence = score.errors_px[side], score.confidence[side]
    if not errors:
        return f"{side}: {'not found' if score.scene == Scene.DECK else 'none'}"
    sure = f"confidence {np.mean(confidence):.2f}"
    if score.scene != Scene.DECK:
        return f"{side}: {len(errors)} false points, {sure}"
    return f"{side}: {np.median(errors):.1f} px median, {np.percentile(errors, 95):.1f} px 95 %, {sure}"


def _draw_truth(picture: Image, expected: ExpectedLines, camera: Camera) -> None:
    scale = [picture.shape[1] / camera.width, picture.shape[0] / camera.height]
    for line in expected.lines_px.values():
        if line is not None:
            ends = (line[[0, -1]] + 0.5) * scale - 0.5
            draw_dashes(picture, ends, CENTRE, 1, dash_px=5.0)
