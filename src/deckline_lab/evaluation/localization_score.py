"""How far one frame's lines are from the truth: as the paper counts (Table 6), and as a pilot does."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import RunConfig
from deckline.flight import FrameResult
from deckline.geometry import wrap_angle
from deckline.localize import localize
from deckline.truth import (
    compare_line,
    passing_distance_m,
    range_to_ramp_m,
    state_error,
    touchdown,
    true_centre,
    true_line,
    true_segments,
)
from deckline.types import SIDES, Detection, Frame, RunwayLine, Segment
from deckline_lab.evaluation.approaches import Sighting
from deckline_lab.evaluation.cramer_rao import cramer_rao
from deckline_lab.evaluation.localization_methods import LocalizationBench, Method, point_rng
from deckline_lab.evaluation.tables import Figures

STATES = ("offset", "azimuth", "height")  # of a line; m, rad, m
MOST_CONDITION = 1e12  # of a correlation matrix; beyond it the covariance is unusable

Array = NDArray[np.float64]


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
        detected: dict[RunConfig, Detection] = {}
        for method in methods:
            rng = None if modelled is None else point_rng(frame.file)
            detection = modelled or detected.get(method.config)
            result = flights[method.name](frame, detection=detection, rng=rng)
            if not method.tracked:
                detected[method.config] = result.detection
            lines = result.estimate.lines if result.track is None else result.track.lines
            figures = frame_figures(frame, lines, method.config.approach.touchdown_m)
            figures |= track_figures(result) | bound_figures(result, method, bench.correlation)
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
        if side in lines:
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
        **_normalise(state_error(line, truth), line.covariance),
    }
    return {f"{name}.{side}": value for name, value in figures.items()}


def pilot_figures(frame: Frame, line: RunwayLine, touchdown_m: float) -> Figures:
    """Errors of a centre line as seen from the aircraft: what its own position and heading are wrong by is taken out.

    `lateral_m` and `height_m` are at the touchdown point: how far right and how far below the true one the estimate
    lies; `deviation_m` is the same sideways beside the aircraft, `heading_deg` of the direction. `*_sigma*` is the
    estimate's own 1-sigma there, `ratio.*` an error of the line's own state over its 1-sigma.

    Raises:
        ValueError: the frame has no pose, no true pose or no true lines.
    """
    centre = true_centre(frame.truth)
    measured, true = frame.world_from_body, frame.true_world_from_body
    if centre is None or measured is None or true is None:
        raise ValueError(f"{frame.file}: a pilot's errors need the pose and the true lines")
    seen = move_with_pose(line, measured, true)
    covariance = line.aircraft_covariance
    place = touchdown(centre, touchdown_m)
    lateral, height = passing_distance_m(seen, centre, place)
    error = state_error(seen, centre)
    return {
        "lateral_m": lateral,
        "deviation_m": passing_distance_m(seen, centre, abreast(centre, true.translation))[0],
        "height_m": height,
        "heading_deg": float(np.rad2deg(error[1])),
        "lateral_sigma_m": offset_sigma_m(seen, covariance, place),
        "deviation_sigma_m": offset_sigma_m(seen, covariance, true.translation),
        "height_sigma_m": float(np.sqrt(covariance[2, 2])),
        "heading_sigma_deg": float(np.rad2deg(np.sqrt(covariance[1, 1]))),
        **_normalise(error, covariance),
    }


def _normalise(error: Array, covariance: Array) -> Figures:
    """Squared error over covariance, and each state's error over its 1-sigma; nothing for a covariance of no use."""
    variance = np.diag(covariance)
    if not np.all(variance > 0) or np.linalg.cond(covariance / np.sqrt(np.outer(variance, variance))) > MOST_CONDITION:
        return {}
    ratios = {f"ratio.{name}": float(e / s) for name, e, s in zip(STATES, error, np.sqrt(variance), strict=True)}
    return {"normalised": float(error @ np.linalg.solve(covariance, error)), **ratios}


def move_with_pose(line: RunwayLine, measured: RigidTransform, true: RigidTransform) -> RunwayLine:
    """The line where an aircraft at its true pose would draw it: moved by the error of position and heading alone.

    `measured` and `true` are world_from_body.
    """
    turn = (true.rotation * measured.rotation.inv()).as_rotvec()[2]
    point = Rotation.from_rotvec([0.0, 0.0, turn]).apply(line.point_m - measured.translation) + true.translation
    azimuth = float(wrap_angle(line.azimuth_rad + turn))
    return RunwayLine(point, azimuth, line.covariance, line.relative_covariance)


def abreast(line: Segment, place_m: Array) -> Array:
    """The point (3,) of a true line, continued, that is abreast of a place (3,)."""
    along = line.p1_m - line.p0_m
    return line.p0_m + float((place_m - line.p0_m)[:2] @ along[:2]) / float(along[:2] @ along[:2]) * along


def offset_sigma_m(line: RunwayLine, covariance: Array, place_m: Array) -> float:
    """1-sigma, m, of a line's offset abreast of a place (3,): an azimuth error counts with the distance to it."""
    lever = np.array([1.0, float((place_m - line.point_m) @ line.direction), 0.0])
    return float(np.sqrt(lever @ covariance @ lever))


def unit_figures(frame: Frame) -> Figures:
    """World errors of lines that are seen exactly and placed where the measured pose puts them, by `unit.` and side.

    What the navigation unit is wrong by about its own position and heading; nothing for a frame without such a pose.
    """
    measured, true, segments = frame.world_from_body, frame.true_world_from_body, true_segments(frame.truth)
    if not segments or measured is None or true is None:
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
