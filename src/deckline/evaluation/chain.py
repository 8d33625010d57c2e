"""The whole chain against truth: found-rate, line errors, restoration, per frame and summed up."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.evaluation.metrics import (
    below_horizon,
    direction_error_rad,
    height_error_m,
    lateral_error_m,
    normal_pixel_error,
    psnr_db,
    ssim,
)
from deckline.pipeline import FrameResult
from deckline.types import DepthMode, Frame, Segment, Status

RANGE_BANDS_M = ((0.0, 100.0), (100.0, 200.0), (200.0, 400.0), (400.0, 800.0), (800.0, np.inf))
VISIBILITY_BANDS_M = ((0.0, 500.0), (500.0, 1000.0), (1000.0, 2000.0), (2000.0, np.inf))
PAIRED_QUANTILES = (("median", 50.0), ("p95", 95.0))


@dataclass(frozen=True, eq=False)
class FrameScore:
    """One frame's errors. Values that do not exist are left out of `errors`."""

    file: str
    status: Status
    mode: DepthMode
    has_runway: bool
    range_m: float  # aircraft to the ramp, horizontal; NaN without pose or runway
    visibility_m: float  # NaN when unknown
    errors: dict[str, float]  # dotted name -> value


def score_frame(result: FrameResult) -> FrameScore:
    """Compare one result with its frame's truth.

    Raises:
        ValueError: the frame carries no truth.
    """
    frame, truth = result.frame, result.frame.truth
    if truth is None:
        raise ValueError(f"{frame.file} has no truth to compare with: evaluate a recording with a scene.json")
    errors: dict[str, float] = {}
    if truth.left is not None and truth.right is not None:
        for side, segment in (("left", truth.left), ("right", truth.right)):
            errors |= _line_errors(result, side, segment)
        errors |= _guidance_errors(result, truth.left, truth.right)
    if truth.clear_rgb is not None:
        errors |= _restoration(result, truth.clear_rgb)
    errors |= {f"seconds.{stage}": seconds for stage, seconds in result.seconds.items()}
    visibility = np.nan if truth.visibility_m is None else truth.visibility_m
    return FrameScore(
        frame.file,
        result.estimate.status,
        result.estimate.mode,
        truth.left is not None,
        range_to_ramp_m(frame),
        visibility,
        errors,
    )


def range_to_ramp_m(frame: Frame) -> float:
    """Horizontal distance from the aircraft to the true ramp (middle of both lines' near ends), m; NaN if unknown."""
    truth = frame.truth
    if truth is None or truth.left is None or truth.right is None or frame.true_world_from_body is None:
        return float("nan")
    ramp = (truth.left.p0_m + truth.right.p0_m) / 2
    return float(np.linalg.norm((frame.true_world_from_body.translation - ramp)[:2]))


def _line_errors(result: FrameResult, side: str, truth: Segment) -> dict[str, float]:
    errors = {}
    line = result.estimate.lines.get(side)
    if line is not None:
        errors[f"direction_error_deg.{side}"] = float(np.rad2deg(direction_error_rad(line, truth)))
        errors[f"lateral_error_at_ramp_m.{side}"] = abs(lateral_error_m(line, truth))
        errors[f"height_error_m.{side}"] = abs(height_error_m(line, truth))
    points = getattr(result.detection, side).points_px
    world_from_camera = result.frame.true_world_from_camera
    if len(points) and world_from_camera is not None:
        ends = world_from_camera.inv().apply(np.stack([truth.p0_m, truth.p1_m]))
        errors[f"point_error_px.{side}"] = float(np.median(normal_pixel_error(points, ends, result.frame.camera)))
    return errors


def _guidance_errors(result: FrameResult, left: Segment, right: Segment) -> dict[str, float]:
    """Lateral error of the centre line at the ramp, and height above deck, against truth."""
    centre = result.estimate.lines.get("centre")
    if centre is None:
        return {}
    truth = Segment((left.p0_m + right.p0_m) / 2, (left.p1_m + right.p1_m) / 2)
    return {
        "direction_error_deg.centre": float(np.rad2deg(direction_error_rad(centre, truth))),
        "lateral_error_at_ramp_m.centre": abs(lateral_error_m(centre, truth)),
        "height_error_m.centre": abs(height_error_m(centre, truth)),
    }


def _restoration(result: FrameResult, clear_rgb: NDArray[np.uint8]) -> dict[str, float]:
    """PSNR and SSIM before and after dehazing; PSNR also without the sky, which haze hides completely."""
    frame = result.frame
    figures = {}
    pictures = {"": result.dehazed_rgb, "_hazy": frame.image_rgb}
    pose = frame.true_world_from_camera
    surface = None if pose is None else below_horizon(frame.camera, pose)
    for name, picture in pictures.items():
        figures[f"psnr_db{name}"] = psnr_db(picture, clear_rgb)
        figures[f"ssim{name}"] = ssim(picture, clear_rgb)
        if surface is not None and surface.any():
            figures[f"psnr_db_surface{name}"] = psnr_db(picture, clear_rgb, surface)
    return figures


def summarise(scores: list[FrameScore]) -> dict[str, float]:
    """Flat figures under dotted names: rates, and median / p95 / mean of every error.

    Raises:
        ValueError: no frames.
    """
    if not scores:
        raise ValueError("no frame could be evaluated")
    figures = {"frames": float(len(scores))}
    decks = [s for s in scores if s.has_runway]
    empty = [s for s in scores if not s.has_runway]
    if decks:
        figures["found_rate"] = _share(decks, lambda s: s.status is Status.OK)
        figures["one_line_rate"] = _share(decks, lambda s: s.status is Status.ONE_LINE)
        figures["not_seen_rate"] = _share(decks, lambda s: s.status is Status.NOT_SEEN)
    if empty:
        figures["false_line_rate"] = _share(empty, lambda s: s.status is not Status.NOT_SEEN)
    for mode in (DepthMode.FINE, DepthMode.COARSE, DepthMode.NONE):
        figures[f"mode_rate.{mode}"] = sum(s.mode is mode for s in scores) / len(scores)
    figures |= _quantiles(scores)
    for mode in (DepthMode.FINE, DepthMode.COARSE):
        subset = [s for s in scores if s.mode is mode]
        figures |= {f"{mode}.{name}": value for name, value in _quantiles(subset, lines_only=True).items()}
    return figures


def _quantiles(scores: list[FrameScore], lines_only: bool = False) -> dict[str, float]:
    names = sorted({name for score in scores for name in score.errors})
    figures = {}
    for name in names:
        values = np.array([s.errors[name] for s in scores if name in s.errors])
        if name.startswith(("psnr", "ssim", "seconds")):
            if not lines_only:
                figures[f"{name}.mean"] = float(values.mean())
            continue
        for label, percent in PAIRED_QUANTILES:
            figures[f"{name}.{label}"] = float(np.percentile(values, percent))
    return figures


def by_band(scores: list[FrameScore], key: str, bands: Iterable[tuple[float, float]]) -> dict[str, list[FrameScore]]:
    """Scores grouped by `range_m` or `visibility_m`; empty bands are left out."""
    groups = {}
    for low, high in bands:
        members = [s for s in scores if low <= getattr(s, key) < high or (np.isinf(high) and getattr(s, key) == high)]
        if members:
            groups[f"{low:.0f}+ m" if np.isinf(high) else f"{low:.0f}-{high:.0f} m"] = members
    return groups


def _share(scores: list[FrameScore], test: Callable[[FrameScore], bool]) -> float:
    return sum(map(test, scores)) / len(scores)
