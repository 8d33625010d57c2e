"""How far one frame's lines are from the truth: as the paper counts (Table 6), and as a pilot does."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import wrap_angle
from deckline.truth import compare_line, passing_distance_m, state_error, touchdown, true_centre, true_line
from deckline.types import SIDES, Frame, RunwayLine, Segment

STATES = ("offset", "azimuth", "height")  # of a line; m, rad, m

Array = NDArray[np.float64]
Figures = dict[str, float]


@dataclass(frozen=True, eq=False)
class Score:
    """What one method made of one frame of an approach. Figures that do not exist are left out."""

    approach: int
    index: int  # of the frame in its approach
    method: str
    range_m: float  # aircraft to the ramp, horizontal
    visibility_m: float
    mode: str  # where the distances came from: fine, coarse, none
    figures: Figures  # as `line_figures` and `pilot_figures` name them


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
    }
    figures |= _normalised(state_error(line, truth), line.covariance)
    return {f"{name}.{side}": value for name, value in figures.items()}


def pilot_figures(frame: Frame, line: RunwayLine, touchdown_m: float) -> Figures:
    """Errors of a centre line as seen from the aircraft: what its own position and heading are wrong by is taken out.

    `lateral_m` and `height_m` are at the touchdown point: how far right and how far below the true
    one the estimate lies; `deviation_m` is the same sideways beside the aircraft, `heading_deg` of the direction.
    `*_sigma*` is what the estimate says of itself there, `ratio.*` an error of the line's own state over its 1-sigma.

    Raises:
        ValueError: the frame has no pose, no true pose or no true lines.
    """
    centre = true_centre(frame.truth)
    measured, true = frame.world_from_body, frame.true_world_from_body
    if centre is None or measured is None or true is None:
        raise ValueError(f"{frame.file}: a pilot's errors need the pose and the true lines")
    seen = carried(line, measured, true)
    covariance = line.covariance if line.relative_covariance is None else line.relative_covariance
    place = touchdown(centre, touchdown_m)
    lateral, height = passing_distance_m(seen, centre, place)
    error = state_error(seen, centre)
    figures = {
        "lateral_m": lateral,
        "deviation_m": passing_distance_m(seen, centre, beside(centre, true.translation))[0],
        "height_m": height,
        "heading_deg": float(np.rad2deg(error[1])),
        "lateral_sigma_m": offset_sigma(seen, covariance, place),
        "deviation_sigma_m": offset_sigma(seen, covariance, true.translation),
        "height_sigma_m": float(np.sqrt(covariance[2, 2])),
        "heading_sigma_deg": float(np.rad2deg(np.sqrt(covariance[1, 1]))),
    }
    return figures | _normalised(error, covariance)


def _normalised(error: Array, covariance: Array) -> Figures:
    """Squared error over covariance, and each state's error over its 1-sigma; nothing for a covariance of no use."""
    variance = np.diag(covariance)
    if not np.all(variance > 0) or np.linalg.cond(covariance / np.sqrt(np.outer(variance, variance))) > 1e12:
        return {}
    ratios = {f"ratio.{name}": float(e / s) for name, e, s in zip(STATES, error, np.sqrt(variance), strict=True)}
    return {"normalised": float(error @ np.linalg.solve(covariance, error)), **ratios}


def carried(line: RunwayLine, measured: RigidTransform, true: RigidTransform) -> RunwayLine:
    """The line where an aircraft at its true place would draw it: moved by the error of position and heading alone.

    Args:
        measured, true: world_from_body.
    """
    turn = (true.rotation * measured.rotation.inv()).as_rotvec()[2]
    point = Rotation.from_rotvec([0.0, 0.0, turn]).apply(line.point_m - measured.translation) + true.translation
    azimuth = float(wrap_angle(line.azimuth_rad + turn))
    return RunwayLine(point, azimuth, line.covariance, line.relative_covariance)


def beside(line: Segment, place_m: Array) -> Array:
    """The point (3,) of a true line, continued, that is abreast of a place (3,)."""
    along = line.p1_m - line.p0_m
    return line.p0_m + float((place_m - line.p0_m)[:2] @ along[:2]) / float(along[:2] @ along[:2]) * along


def offset_sigma(line: RunwayLine, covariance: Array, place_m: Array) -> float:
    """1-sigma, m, of a line's offset abreast of a place (3,): an azimuth error counts with the way there."""
    lever = np.array([1.0, float((place_m - line.point_m) @ line.direction), 0.0])
    return float(np.sqrt(lever @ covariance @ lever))


def unit_figures(frame: Frame) -> Figures:
    """World errors of lines that are seen exactly and placed where the measured pose puts them, by `unit.` and side.

    What the navigation unit is wrong by about its own position and heading; nothing for a frame without such a pose.
    """
    truth, measured, true = frame.truth, frame.world_from_body, frame.true_world_from_body
    if truth is None or truth.left is None or truth.right is None or measured is None or true is None:
        return {}
    figures: Figures = {}
    for side, segment in zip(SIDES, (truth.left, truth.right), strict=True):
        line = carried(true_line(segment), true, measured)
        errors = compare_line(line, segment)
        figures[f"unit.lateral_error_m.{side}"] = errors["lateral_error_m"]
        figures[f"unit.direction_error_deg.{side}"] = errors["direction_error_deg"]
        figures[f"unit.intercept_error_m.{side}"] = abs(line.intercept_m - true_line(segment).intercept_m)
    return figures


def bound_figures(covariance: Array) -> Figures:
    """The least 1-sigma of a pilot's errors, of a bound on a centre line's offset beside the touchdown point.

    Args:
        covariance: (3, 3) of offset, m; azimuth, rad; z, m.
    """
    offset, azimuth, height = np.sqrt(np.diag(covariance))
    return {"lateral_m": float(offset), "heading_deg": float(np.rad2deg(azimuth)), "height_m": float(height)}


def frame_figures(frame: Frame, lines: Mapping[str, RunwayLine], touchdown_m: float) -> Figures:
    """All figures of the lines that were found: Table 6's of left and right, the pilot's of the centre line.

    `true_slope`, `true_intercept_m`, `true_height_m` and `unit_figures` are given of both sides, found or not.

    Raises:
        ValueError: a frame without truth.
    """
    truth = frame.truth
    if truth is None or truth.left is None or truth.right is None:
        raise ValueError(f"{frame.file} has no true lines to compare with")
    segments = {"left": truth.left, "right": truth.right}
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
