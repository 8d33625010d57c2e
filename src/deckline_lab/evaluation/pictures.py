"""The pictures of evaluations: dehazed side by side, the worst detections, errors of localization against range."""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.stats import norm

from deckline.atomic import write_atomic
from deckline.dehaze import NOT_DEHAZED, Dehazer, dehaze_for_display, restore
from deckline.extras import needs_extra
from deckline.flight import Flight
from deckline.geometry import Camera
from deckline.report.draw import CENTRE, Image, draw_dashes, draw_tag, write_picture
from deckline.report.overlay import draw_overlay, draw_panels
from deckline.types import SIDES
from deckline_lab.evaluation.dehazing_pairs import Pair, PairSource
from deckline_lab.evaluation.dehazing_score import ImageScore, restoration
from deckline_lab.evaluation.detection_score import DetectionScore
from deckline_lab.evaluation.detection_truth import ExpectedLines, SceneKind
from deckline_lab.evaluation.frames import FrameSet
from deckline_lab.evaluation.localization_score import LocalizationScore
from deckline_lab.evaluation.pilot_errors import STATES

TILE_PX = 360  # width
TEXT_PX = 15
INK, PAPER = (255, 255, 255), (20, 26, 34)
PAGE = "worst.md"
FOLDER = "worst"
PANELS = {  # figure: words, unit, its protection level
    "deviation": ("sideways,\nbeside the aircraft", "m", "lateral"),
    "lateral": ("sideways,\nat the touchdown point", "m", None),
    "heading": ("heading", "deg", None),
    "height": ("height,\nat the touchdown point", "m", "height"),
}
WIDTH_IN, ROW_IN, DPI = 9.0, 2.4, 110
BINS = np.linspace(-5.0, 5.0, 41)  # of errors over their 1-sigma
RANGE_BIN_M = 50.0  # medians of sigma, bound and protection level are drawn once in each
LEAST = 1e-4  # m or deg; smaller errors are drawn here
ERROR, SIGMA, BOUND, PROTECTION = "#555555", "#1f77b4", "#2ca02c", "#d62728"


def sheet(
    sources: Sequence[PairSource],
    dehazers: Mapping[str, Dehazer],
    scores: Sequence[ImageScore],
    visibilities_m: Sequence[float],
) -> Image:
    """One picture: a column for each visibility, from hazy over every dehazer down to clear; tagged with the PSNR.

    The pair of each column is the scored one nearest in visibility.

    Raises:
        ValueError: no visibilities, or no pair of known visibility.
    """
    if not visibilities_m:
        raise ValueError("a sheet needs at least one visibility")
    by_name = {source.name: source for source in sources}
    chosen = [nearest(scores, visibility) for visibility in visibilities_m]
    columns = [np.concatenate(tiles_of(by_name[name].load(key), dehazers)) for name, key in chosen]
    height = max(len(column) for column in columns)
    return np.concatenate([np.pad(column, ((0, height - len(column)), (0, 0), (0, 0))) for column in columns], axis=1)


def nearest(scores: Sequence[ImageScore], visibility_m: float) -> tuple[str, str]:
    """The image whose visibility is nearest by ratio, among those with both lines in view if there are any."""
    known = {score.image: score for score in scores if score.visibility_m > 0 and math.isfinite(score.visibility_m)}
    if not known:
        raise ValueError("no pair has a known visibility, so none can be chosen for the sheet")
    candidates = [score for score in known.values() if score.found is not None] or list(known.values())
    return min(candidates, key=lambda score: abs(math.log(score.visibility_m / visibility_m))).image


def tiles_of(pair: Pair, dehazers: Mapping[str, Dehazer]) -> list[Image]:
    """Small pictures of one size: hazy, what every dehazer makes of it, and clear; tagged with name and PSNR."""
    pictures = {f"hazy, {pair.visibility_m:.0f} m": pair.frame.image_rgb}
    pictures |= {
        name: restore(dehazer, pair.frame).image_rgb for name, dehazer in dehazers.items() if name != NOT_DEHAZED
    }
    tiles = []
    for name, image in pictures.items():
        if pair.clear_rgb is not None:
            name += f": {restoration(image, pair.clear_rgb, None)['psnr_db']:.1f} dB"
        tiles.append(_tile(image, name))
    return tiles if pair.clear_rgb is None else [*tiles, _tile(pair.clear_rgb, "clear")]


def _tile(image: Image, words: str) -> Image:
    height = round(TILE_PX * image.shape[0] / image.shape[1])
    tile = np.ascontiguousarray(cv2.resize(image, (TILE_PX, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    draw_tag(tile, words, (6, 6), TEXT_PX, PAPER, INK)
    return tile


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
        dehazed = result.dehazed or dehaze_for_display(result.frame, flight.dehazer, flight.config.models)
        pictures = draw_panels(result, dehazed)
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
    if score.scene == SceneKind.DECK:
        parts.append(f"lines {score.extent_px:.0f} px across")
    return "; ".join([*parts, *(_side(score, side) for side in SIDES)])


def _side(score: DetectionScore, side: str) -> str:
    errors, confidence = score.errors_px[side], score.confidence[side]
    if not errors:
        return f"{side}: {'not found' if score.scene == SceneKind.DECK else 'none'}"
    sure = f"confidence {np.mean(confidence):.2f}"
    if score.scene != SceneKind.DECK:
        return f"{side}: {len(errors)} false points, {sure}"
    return f"{side}: {np.median(errors):.1f} px median, {np.percentile(errors, 95):.1f} px 95 %, {sure}"


def _draw_truth(picture: Image, expected: ExpectedLines, camera: Camera) -> None:
    scale = [picture.shape[1] / camera.width, picture.shape[0] / camera.height]
    for line in expected.lines_px.values():
        if line is not None:
            ends = (line[[0, -1]] + 0.5) * scale - 0.5
            draw_dashes(picture, ends, CENTRE, 1, dash_px=5.0)


def write_figure(path: Path, title: str, scores: Sequence[LocalizationScore]) -> None:
    """Write a PNG: sizes of a centre line's errors against range, and a histogram of normalised errors.

    Raises:
        ValueError: no frame with a centre line.
        ImportError: the viz extra is not installed.
    """
    with needs_extra("viz"):
        from matplotlib.figure import Figure
    known = [score for score in scores if "centre.lateral_m" in score.figures]
    if not known:
        raise ValueError(f"{title}: no frame with a centre line, so there is nothing to draw")
    figure = Figure(figsize=(WIDTH_IN, ROW_IN * (len(PANELS) + 1)), dpi=DPI, layout="constrained")
    axes = figure.subplots(len(PANELS) + 1, 1)
    for axis, what in zip(axes, PANELS, strict=False):
        _error_panel(axis, known, what)
    axes[0].set_title(title)
    axes[len(PANELS) - 1].set_xlabel("range to the ramp, m")
    _histogram(axes[-1], known)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, buffer.getvalue())


def _error_panel(axis: Any, scores: Sequence[LocalizationScore], what: str) -> None:
    words, unit, protected = PANELS[what]
    errors = np.abs([score.figures[f"centre.{what}_{unit}"] for score in scores])
    range_m = [score.range_m for score in scores]
    axis.plot(range_m, np.maximum(errors, LEAST), ".", color=ERROR, markersize=3, label="error")
    bands = {"1-sigma": (f"centre.{what}_sigma_{unit}", SIGMA), "bound": (f"bound.{what}_{unit}", BOUND)}
    if protected is not None:
        bands["protection level"] = (f"protection.{protected}_{unit}", PROTECTION)
    for label, (name, colour) in bands.items():
        at, middle = medians_by_range(scores, name)
        if len(at):
            axis.plot(at, middle, color=colour, label=label)
    axis.set_ylabel(f"{words}, {unit}")
    axis.set_yscale("log")
    axis.grid(visible=True, alpha=0.3)
    axis.legend(loc="lower right", fontsize="small", ncols=4)


def medians_by_range(scores: Sequence[LocalizationScore], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Middle of each stretch of range that has the figure, m, and the figure's median there."""
    known = np.array([(score.range_m // RANGE_BIN_M, score.figures[name]) for score in scores if name in score.figures])
    bins, values = known.reshape(-1, 2).T
    places = np.unique(bins)
    return (places + 0.5) * RANGE_BIN_M, np.array([np.median(values[bins == place]) for place in places])


def _histogram(axis: Any, scores: Sequence[LocalizationScore]) -> None:
    for name in STATES:
        figure = f"centre.ratio.{name}"
        values = np.clip([s.figures[figure] for s in scores if figure in s.figures], BINS[0], BINS[-1])
        if len(values):
            axis.hist(values, BINS, density=True, histtype="step", label=name)
    axis.plot(BINS, norm.pdf(BINS), color="black", linewidth=1, label="honest")
    axis.set_xlabel("error over its 1-sigma (beyond 5: in the outermost bins)")
    axis.set_ylabel("density")
    axis.legend(fontsize="small")
