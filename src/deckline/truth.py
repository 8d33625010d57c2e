"""What the estimates should have been, where a frame carries truth."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import Approach
from deckline.geometry import wrap_angle
from deckline.guide import guidance
from deckline.types import (
    DepthMode,
    Frame,
    Guidance,
    InWidths,
    LineVisibility,
    PoseSource,
    RunwayEstimate,
    RunwayLine,
    Segment,
    Truth,
    Value,
)

ACROSS_DEG = 89.0  # direction error from which a line lies across the runway and passes nothing of it
METRES = (
    "lateral_deviation_m",
    "height_above_deck_m",
    "distance_to_ramp_m",
    "vertical_deviation_m",
    "distance_to_touchdown_m",
)
WIDTHS = ("lateral_deviation", "height_above_deck", "distance_to_ramp")  # of `InWidths`
ANGLES = ("heading_error", "lateral_deviation", "vertical_deviation")

Array = NDArray[np.float64]


def true_line(truth: Segment) -> RunwayLine:
    """A true line as an estimate without error, at its ramp end."""
    along = truth.p1_m - truth.p0_m
    return RunwayLine(truth.p0_m, float(np.arctan2(along[1], along[0])), np.zeros((3, 3)))


def true_segments(truth: Truth | None) -> dict[str, Segment]:
    """The true left, right and centre lines by name; empty where there is no runway."""
    if truth is None or truth.left is None or truth.right is None:
        return {}
    left, right = truth.left, truth.right
    return {"left": left, "right": right, "centre": Segment((left.p0_m + right.p0_m) / 2, (left.p1_m + right.p1_m) / 2)}


def true_centre(truth: Truth | None) -> Segment | None:
    """The centre line between both true lines; None where there is no runway."""
    return true_segments(truth).get("centre")


def true_width_m(truth: Truth | None) -> float | None:
    """Distance between the true edge lines at the ramp, across the centre line, m; None where there is no runway."""
    if not (lines := true_segments(truth)):
        return None
    return float(abs((lines["right"].p0_m - lines["left"].p0_m) @ true_line(lines["centre"]).right))


def lengths_in_widths(guidance: Guidance | None, width_m: float | None) -> InWidths | None:
    """Lateral deviation, height and distance of a guidance in metres, in widths of the runway; None without these."""
    if guidance is None or width_m is None:
        return None
    lateral, height, distance = (getattr(guidance, f"{name}_m") for name in WIDTHS)
    if lateral is None or height is None:
        return None
    scaled = (value and Value(value.value / width_m, value.sigma / width_m) for value in (lateral, height, distance))
    return InWidths(*scaled)


def touchdown(centre: Segment, touchdown_m: float) -> Array:
    """The touchdown point (3,) on a true centre line, in the world."""
    along = centre.p1_m - centre.p0_m
    return centre.p0_m + touchdown_m / float(np.hypot(along[0], along[1])) * along


def range_to_ramp_m(frame: Frame) -> float:
    """Horizontal distance from the aircraft to the true ramp (middle of both lines' near ends), m; NaN if unknown."""
    centre = true_centre(frame.truth)
    if centre is None or frame.true_world_from_body is None:
        return float("nan")
    return float(np.linalg.norm((frame.true_world_from_body.translation - centre.p0_m)[:2]))


def state_error(line: RunwayLine, truth: Segment) -> Array:
    """Estimated minus true (3,) in the terms of a line's covariance: offset to the right, m; azimuth, rad; z, m.

    Taken at the line's own point, against the true line continued. Azimuths differ by a quarter turn at most: a line
    has two directions.
    """
    exact = true_line(truth)
    along = truth.p1_m - truth.p0_m
    delta = line.point_m - truth.p0_m
    turn = float(wrap_angle(line.azimuth_rad - exact.azimuth_rad))
    if abs(turn) > np.pi / 2:
        turn -= np.sign(turn) * np.pi
    slope = float(along[2] / np.hypot(along[0], along[1]))
    return np.array([delta @ exact.right, turn, delta[2] - slope * (delta @ exact.direction)])


def passing_distance_m(line: RunwayLine, truth: Segment, place_m: Array) -> tuple[float, float]:
    """How far right of and how far below (+) a point (3,) of the true line an estimated one passes, m."""
    exact = true_line(truth)
    delta = line.point_m - place_m
    back = float(delta @ exact.direction) / float(line.direction @ exact.direction)
    return float((delta - back * line.direction) @ exact.right), float(delta[2])


def compare_line(line: RunwayLine, truth: Segment) -> dict[str, float]:
    """Sizes of the errors of one line against the true one.

    Returns:
        `direction_error_deg` (0 to 90; the paper's delta-theta of Table 6), `lateral_error_m` at the true line's ramp
        end, left out for a line across the runway, and `height_error_m` at the estimate's own point. The lateral error
        replaces the paper's intercept difference, which depends on the world's origin.
    """
    _, turn, height = state_error(line, truth)
    errors = {"direction_error_deg": abs(float(np.rad2deg(turn))), "height_error_m": abs(float(height))}
    if errors["direction_error_deg"] < ACROSS_DEG:
        errors["lateral_error_m"] = abs(passing_distance_m(line, truth, truth.p0_m)[0])
    return errors


def true_guidance(frame: Frame, approach: Approach) -> Guidance | None:
    """Guidance from the true lines and the true pose, the deck's height that of the touchdown point.

    None without truth, runway or pose.
    """
    centre = true_centre(frame.truth)
    if centre is None or frame.true_world_from_body is None:
        return None
    line = replace(true_line(centre), point_m=touchdown(centre, approach.touchdown_m))
    exact = RunwayEstimate(LineVisibility.BOTH, DepthMode.NONE, {}, {"centre": line}, centre.p0_m, 0.0)
    placed = replace(
        frame, world_from_body=frame.true_world_from_body, pose_source=PoseSource.NAVIGATION, in_widths=False
    )
    return guidance(placed, exact, None, approach)


def errors_against(
    truth: Truth, estimate: RunwayEstimate, measured: Guidance, exact: Guidance | None
) -> dict[str, dict[str, float | None]] | None:
    """How far a frame's estimate is from its truth; None where the scene has no runway.

    The line errors are those of `compare_line`, of each of the lines; a picture's pose has none, because its lines lie
    in the runway's own frame. "guidance" is measured minus true, with sign, under the names that records use.
    """
    segments = true_segments(truth)
    if not segments:
        return None
    placed = {} if measured.pose_source is PoseSource.PICTURE else estimate.lines
    found = {side: compare_line(placed[side], line) for side, line in segments.items() if side in placed}
    names = {  # in records, and of `compare_line`
        "direction_error_deg": "direction_error_deg",
        "lateral_error_at_ramp_m": "lateral_error_m",
        "height_error_m": "height_error_m",
    }
    errors: dict[str, dict[str, float | None]] = {
        written: {side: found.get(side, {}).get(name) for side in segments} for written, name in names.items()
    }
    return errors | {"guidance": _guidance_errors(measured, exact, true_width_m(truth))}


def _guidance_errors(measured: Guidance, truth: Guidance | None, width_m: float | None) -> dict[str, float | None]:
    errors: dict[str, float | None] = {}
    widths, true_widths = measured.in_widths, lengths_in_widths(truth, width_m)
    for name in WIDTHS:
        errors[f"{name}_widths"] = _difference(getattr(widths, name, None), getattr(true_widths, name, None))
    for name in METRES:
        errors[name] = _difference(getattr(measured, name), None if truth is None else getattr(truth, name))
    for name in ANGLES:
        angle = f"{name}_rad"
        error = _difference(getattr(measured, angle), None if truth is None else getattr(truth, angle))
        errors[f"{name}_deg"] = None if error is None else float(np.rad2deg(wrap_angle(error)))
    return errors


def _difference(measured: Value | None, truth: Value | None) -> float | None:
    return None if measured is None or truth is None else measured.value - truth.value
