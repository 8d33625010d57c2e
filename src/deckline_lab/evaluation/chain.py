"""`deckline eval chain` and `recording`: the whole chain against truth."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from deckline.config import Approach, Models, RunConfig
from deckline.dehaze import dehaze_frame
from deckline.flight import Flight, FrameResult
from deckline.options import DEFAULTS, FlightOptions
from deckline.recording import open_recording
from deckline.report.bands import RANGE_M, by_band, share
from deckline.report.provenance import settings_of
from deckline.truth import compare_line, errors_against, range_to_ramp_m, true_guidance, true_segments
from deckline.types import SIDES, DepthMode, LineVisibility, PoseSource
from deckline_lab.evaluation.frames import FrameSample, FrameSet, Recorded, RenderOptions, Task, score_frames
from deckline_lab.evaluation.metrics import below_horizon, normal_pixel_error, psnr_db, ssim
from deckline_lab.evaluation.tables import (
    TO_TERMINAL,
    Figures,
    Output,
    OutputFiles,
    Table,
    figures_table,
    number,
    publish,
)
from deckline_lab.rivals.catalog import flight_from_config
from deckline_lab.statistics import VISIBILITY_M

MEANS = ("psnr", "ssim", "seconds")  # figures that are averaged; of the others median and 95 % are given
BAND_COLUMNS = {
    "found": "found_rate",
    "direction left, deg": "direction_error_deg.left.median",
    "right, deg": "direction_error_deg.right.median",
    "lateral left, m": "lateral_error_at_ramp_m.left.median",
    "right, m": "lateral_error_at_ramp_m.right.median",
    "points left, px": "point_error_px.left.median",
    "right, px": "point_error_px.right.median",
    "hazy, dB": "psnr_db_hazy.mean",
    "dehazed, dB": "psnr_db.mean",
    "without sky, dB": "psnr_db_surface.mean",
}


@dataclass(frozen=True)
class FrameScore:
    """One frame's errors. Plain values: a score is a line of JSON."""

    file: str
    seen: str
    mode: str
    has_runway: bool
    range_m: float  # aircraft to the ramp, horizontal; NaN without pose or runway
    visibility_m: float  # NaN when unknown
    errors: Figures  # by dotted name; those that do not exist are left out


def single_frames(config: RunConfig) -> RunConfig:
    """The same configuration for unrelated frames: without a track."""
    return replace(config, tracking=replace(config.tracking, enabled=False))


def single_frames_with(dehazer: str, detector: str) -> RunConfig:
    """The default configuration for unrelated frames with other models."""
    return single_frames(RunConfig(models=Models(dehazer, detector, "dehazed")))


def chain(
    frames: int = 200,
    seed: int = 1000,
    preset: Literal["paper", "cvn", "train"] = "paper",
    visibility: str = "500..3000",
    range_m: tuple[float, float] = (60.0, 800.0),
    fov_deg: float = 90.0,
    options: FlightOptions = DEFAULTS,
    out: Path | None = None,
    output: Output = TO_TERMINAL,
) -> int:
    """Run the whole chain on freshly rendered frames with exact truth and print its errors.

    Args:
        frames: how many, from random viewpoints.
        seed: of the simulator; the shipped weights never saw seeds from 1000 on.
        preset: the ship.
        visibility: metres at 2 % contrast, LOW..HIGH.
        range_m: distance from the ramp, nearest and farthest.
        fov_deg: horizontal field of view.
        options: of the configuration that flies.
        out: folder of every frame's errors; a stopped command resumes from it.
        output: files of the results.
    """
    sets = RenderOptions(frames, 0, (preset,), seed, visibility, range_m, fov_deg).open_sets(keep_clear=True)
    title = (
        f"{frames} simulated frames, preset {preset}, seed {seed}, V {visibility} m, {range_m[0]:g}-{range_m[1]:g} m"
    )
    return _evaluate(sets, title, single_frames(options.run_config()), out, output)


def recording(
    source: tyro.conf.Positional[Path],
    options: FlightOptions = DEFAULTS,
    output: Output = TO_TERMINAL,
) -> int:
    """Run the whole chain on a recording that carries truth (scene.json) and print its errors.

    The frames fly in their order, as in `deckline run`: a stopped command begins again.

    Args:
        source: recording folder.
        options: of the configuration that flies.
        output: files of the results.
    """
    config = options.run_config(open_recording(source).base_config)
    return _evaluate([Recorded(source)], str(source), config, None, output)


def _evaluate(sets: Sequence[FrameSet], title: str, config: RunConfig, out: Path | None, output: OutputFiles) -> int:
    flight = flight_from_config(config)

    def score(sample: FrameSample) -> dict[str, Any]:
        result = flight(sample.frame)
        return asdict(score_frame(_with_dehazed(result, flight), config.approach))

    [rows] = score_frames(sets, [Task(out, "chain.jsonl", settings_of(flight), score)])
    scores = [FrameScore(**row) for row in rows]
    figures = summarise(scores)
    models = config.models
    title += f"; dehazer {models.dehazer}, detector {models.detector} in the {models.detect_in} picture"
    by_range = {"all": scores} | by_band(scores, lambda score: score.range_m, RANGE_M, short=True)
    by_visibility = by_band(scores, lambda score: score.visibility_m, VISIBILITY_M, short=True)
    tables = [
        _band_table("range to the ramp", by_range),
        _band_table("visibility", by_visibility),
        figures_table("all figures", figures),
    ]
    publish(title, tables, figures, output)
    return 0


def _with_dehazed(result: FrameResult, flight: Flight) -> FrameResult:
    """The result with its whole picture dehazed, where truth has a clear one to compare with."""
    truth, models = result.frame.truth, flight.config.models
    if truth is None or truth.clear_rgb is None or models.detect_in == "dehazed":
        return result
    start = time.perf_counter()
    dehazed = dehaze_frame(result.frame, flight.dehazer, models)
    return replace(result, dehazed=dehazed, seconds={**result.seconds, "dehaze": time.perf_counter() - start})


def score_frame(result: FrameResult, approach: Approach) -> FrameScore:
    """Compare one result with its frame's truth: the lines of the frame alone, and the guidance that is flown.

    Raises:
        ValueError: the frame carries no truth.
    """
    frame, truth = result.frame, result.frame.truth
    if truth is None:
        raise ValueError(f"{frame.file} has no truth to compare with: evaluate a recording with a scene.json")
    errors: Figures = {}
    placed = {} if frame.pose_source is PoseSource.PICTURE else result.estimate.lines  # else not in truth's world
    for side, segment in true_segments(truth).items():
        if side in placed:
            for name, value in compare_line(placed[side], segment).items():
                errors[f"{name.replace('lateral_error_m', 'lateral_error_at_ramp_m')}.{side}"] = value
        world_from_camera = frame.true_world_from_camera
        if side in SIDES and world_from_camera is not None:
            points = getattr(result.detection, side).points_px
            ends = world_from_camera.inv().apply(np.stack([segment.p0_m, segment.p1_m]))
            if len(points):
                errors[f"point_error_px.{side}"] = float(np.median(normal_pixel_error(points, ends, frame.camera)))
    exact = true_guidance(frame, approach)
    against = errors_against(truth, result.estimate, result.guidance, exact) or {"guidance": {}}
    missed = {name: value for name, value in against["guidance"].items() if value is not None}
    errors |= {f"guidance_error.{name}": abs(value) for name, value in missed.items()}
    if truth.clear_rgb is not None:
        errors |= _restoration(result, truth.clear_rgb)
    errors |= {f"seconds.{stage}": seconds for stage, seconds in result.seconds.items()}
    visibility = np.nan if truth.visibility_m is None else truth.visibility_m
    seen, mode = result.estimate.seen, result.estimate.mode
    has_runway, range_m = truth.left is not None, range_to_ramp_m(frame)
    return FrameScore(frame.file, seen, mode, has_runway, range_m, visibility, errors)


def _restoration(result: FrameResult, clear_rgb: NDArray[np.uint8]) -> Figures:
    """PSNR and SSIM before and after dehazing; PSNR also without the sky, which haze hides completely."""
    frame, figures = result.frame, {}
    pose = frame.true_world_from_camera
    surface = None if pose is None else below_horizon(frame.camera, pose)
    pictures = {} if result.dehazed is None else {"": result.dehazed.image_rgb}
    for name, picture in {**pictures, "_hazy": frame.image_rgb}.items():
        figures[f"psnr_db{name}"] = psnr_db(picture, clear_rgb)
        figures[f"ssim{name}"] = ssim(picture, clear_rgb)
        if surface is not None and surface.any():
            figures[f"psnr_db_surface{name}"] = psnr_db(picture, clear_rgb, surface)
    return figures


def summarise(scores: Sequence[FrameScore]) -> Figures:
    """Flat figures of one frame or more under dotted names: rates, and median / p95 / mean of every error."""
    if not scores:
        raise ValueError("no frame could be evaluated")
    figures = {"frames": float(len(scores))}
    decks, empty = ([score for score in scores if score.has_runway is has] for has in (True, False))
    if decks:
        rates = {
            "found_rate": LineVisibility.BOTH,
            "one_line_rate": LineVisibility.ONE,
            "not_seen_rate": LineVisibility.NONE,
        }
        for name, seen in rates.items():
            figures[name] = sum(score.seen == seen for score in decks) / len(decks)
    if empty:
        figures["false_line_rate"] = share(empty, lambda score: score.seen != LineVisibility.NONE)
    for mode in (DepthMode.FINE, DepthMode.COARSE, DepthMode.NONE):
        figures[f"mode_rate.{mode}"] = sum(score.mode == mode for score in scores) / len(scores)
    figures |= _error_figures(scores)
    for mode in (DepthMode.FINE, DepthMode.COARSE):
        of_mode = _error_figures([score for score in scores if score.mode == mode])
        figures |= {f"{mode}.{name}": value for name, value in of_mode.items() if not name.startswith(MEANS)}
    return figures


def _error_figures(scores: Sequence[FrameScore]) -> Figures:
    figures = {}
    for name in sorted({name for score in scores for name in score.errors}):
        values = np.array([score.errors[name] for score in scores if name in score.errors])
        if name.startswith(MEANS):
            figures[f"{name}.mean"] = float(values.mean())
        else:
            figures[f"{name}.median"], figures[f"{name}.p95"] = np.percentile(values, (50, 95)).tolist()
    return figures


def _band_table(by: str, groups: dict[str, list[FrameScore]]) -> Table:
    rows = []
    for band, members in groups.items():
        figures = summarise(members)
        cells = (number(figures.get(name), ".3g") for name in BAND_COLUMNS.values())
        rows.append((band, str(len(members)), *cells))
    return Table(f"by {by}", (by, "frames", *BAND_COLUMNS), rows)
