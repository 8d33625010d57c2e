"""How far one frame's lines are from the truth: as the paper counts (Table 6), and as a pilot does."""

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deckline.config import RunConfig
from deckline.flight import FrameResult
from deckline.localize import localize
from deckline.truth import (
    compare_line,
    range_to_ramp_m,
    state_error,
    touchdown,
    true_centre,
    true_line,
    true_segments,
)
from deckline.types import SIDES, Detection, Frame, PoseSource, RunwayLine, Segment
from deckline_lab.evaluation.approaches import Sighting
from deckline_lab.evaluation.cramer_rao import cramer_rao
from deckline_lab.evaluation.localization_methods import LocalizationBench, Method
from deckline_lab.evaluation.pilot_errors import move_with_pose, normalise_error, pilot_figures
from deckline_lab.evaluation.tables import Figures
from deckline_lab.evaluation.visible_distance import is_right


@dataclass(frozen=True)
class LocalizationScore:
    """What one method made of one frame of an approach. Plain values: a score is a line of JSON."""

    approach: int
    index: int  # of the frame in its approach
    method: str
    range_m: float  # aircraft to the ramp, horizontal
    visibility_m: float
    mode: str  # where the distances came from: fine, coarse, none
    figures: Figures  # as `frame_figures` names them; what does not exist is left out


def score_approach(
    sightings: Iterator[Sighting], approach: int, methods: Sequence[Method], bench: LocalizationBench
) -> Iterator[list[LocalizationScore]]:
    """All methods' scores of each frame of one approach, frames in order of time.

    Methods without a track that share their configuration share its detections; one with a track detects on its own.
    """
    flights = {method.name: bench.start(method) for method in methods}
    for index, (frame, modelled) in enumerate(sightings):
        scores = []
        detected: dict[tuple[RunConfig, bool], Detection] = {}
        for method in methods:
            rng = None if modelled is None else np.random.default_rng(zlib.crc32(frame.file.encode()))  # of RANSAC
            key = method.config, method.exact_pose
            seen = replace(frame, world_from_body=frame.true_world_from_body) if method.exact_pose else frame
            result = flights[method.name](seen, detection=modelled or detected.get(key), rng=rng)
            if not method.tracked:
                detected[key] = result.detection
            lines = result.estimate.lines if result.track is None else result.track.lines
            figures = frame_figures(seen, lines, method.config.approach.touchdown_m)
            figures |= track_figures(result) | bound_figures(result, method, bench.correlation)
            figures |= {"time_s": frame.time_s, "is_right": float(is_right(frame, result.detection))}
            visibility_m = (frame.truth and frame.truth.visibility_m) or float("nan")
            mode = str(result.estimate.mode)
            finite = {name: value for name, value in figures.items() if np.isfinite(value)}
            scores.append(
                LocalizationScore(approach, index, method.name, range_to_ramp_m(frame), visibility_m, mode, finite)
            )
        yield scores


def frame_figures(frame: Frame, lines: Mapping[str, RunwayLine], touchdown_m: float) -> Figures:
    """All figures of the lines that were found: Table 6's of left and right, the pilot's of the centre line.

    `true_slope`, `true_intercept_m`, `true_height_m` and `unit_figures` are given of both sides, found or not.

    Raises:
        ValueError: a frame without truth.
    """
    segments = true_segments(frame.truth)
    if not segments:
        raise ValueError(f"{frame.file} has no true lines to compare with")
    figures = unit_figures(frame)
    for side in SIDES:
        exact = true_line(segments[side])
        truths = {"slope": exact.slope, "intercept_m": exact.intercept_m, "height_m": exact.height_m}
        figures |= {f"true_{name}.{side}": value for name, value in truths.items()}
        if side in lines and frame.pose_source is not PoseSource.PICTURE:  # else not in truth's world
            figures |= line_figures(lines[side], segments[side], side)
    if "centre" in lines:
        pilot = pilot_figures(frame, lines["centre"], touchdown_m)
        figures |= {f"centre.{name}": value for name, value in pilot.items()}
    return figures


def line_figures(line: RunwayLine, truth: Segment, side: str) -> Figures:
    """Table 6 of one line, and how its error compares with its covariance; names end in the side.

    `slope`, `intercept_m` and `height_m` are the estimate's; `*_error*` are sizes without sign; `lateral_error_m` is
    at the true line's ramp end; `normalised` is e' C^-1 e of offset, azimuth and height, 3 degrees of freedom.
    """
    exact = true_line(truth)
    figures = {
        "slope": line.slope,
        "intercept_m": line.intercept_m,
        "height_m": line.height_m,
        "slope_error": abs(line.slope - exact.slope),
        "intercept_error_m": abs(line.intercept_m - exact.intercept_m),
        **compare_line(line, truth),
        **normalise_error(state_error(line, truth), line.covariance),
    }
    return {f"{name}.{side}": value for name, value in figures.items()}


def unit_figures(frame: Frame) -> Figures:
    """World errors of lines that are seen exactly and placed where the measured pose puts them, by `unit.` and side.

    What the navigation unit is wrong by about its own position and heading; nothing for a frame without such a pose.
    """
    measured, true, segments = frame.world_from_body, frame.true_world_from_body, true_segments(frame.truth)
    if not segments or measured is None or true is None or frame.pose_source is PoseSource.PICTURE:
        return {}
    figures: Figures = {}
    for side in SIDES:
        exact = true_line(segments[side])
        line = move_with_pose(exact, true, measured)
        errors = compare_line(line, segments[side])
        figures |= {f"unit.{name}.{side}": errors[name] for name in ("lateral_error_m", "direction_error_deg")}
        figures[f"unit.intercept_error_m.{side}"] = abs(line.intercept_m - exact.intercept_m)
    return figures


def track_figures(result: FrameResult) -> Figures:
    """What a track promises: protection levels, and whether it warns; nothing without a track."""
    if result.track is None:
        return {}
    figures: Figures = {"flagged": float(bool(result.track.flags))}
    protection = result.track.protection
    if protection is not None:
        figures |= {"protection.lateral_m": protection.lateral_m, "protection.height_m": protection.vertical_m}
    return figures


def bound_figures(result: FrameResult, method: Method, correlation: float) -> Figures:
    """The least 1-sigma of a pilot's errors that the points of one frame allow: lateral, heading, height.

    As seen from the aircraft, beside the touchdown point. Nothing with a track, without the joint estimator, or without
    a centre line. `correlation` is that of the errors of neighbouring points.
    """
    estimate, centre = result.estimate, true_centre(result.frame.truth)
    joint = method.localizer is localize and result.track is None
    if not joint or centre is None or "centre" not in estimate.lines or not set(SIDES) <= estimate.pixel_lines.keys():
        return {}
    inliers = {side: (getattr(result.detection, side), line.inliers) for side, line in estimate.pixel_lines.items()}
    bound = cramer_rao(
        result.frame,
        {side: points.points_px[inlier] for side, (points, inlier) in inliers.items()},
        {side: points.sigma_px[inlier] for side, (points, inlier) in inliers.items()},
        method.config.localization.mode,
        method.config,
        beside_m=touchdown(centre, method.config.approach.touchdown_m),
        relative=True,
        correlation=correlation,
    )
    offset, azimuth, height = np.sqrt(np.diag(bound.centre)).tolist()
    names = {"bound.lateral_m": offset, "bound.heading_deg": np.rad2deg(azimuth), "bound.height_m": height}
    return {name: float(value) for name, value in names.items()}
