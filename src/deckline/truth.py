"""What the guidance should have said, where the frame carries truth."""

from dataclasses import replace

import numpy as np

from deckline.evaluation.localization_measure import touchdown, true_centre
from deckline.evaluation.metrics import direction_error_rad, height_error_m, lateral_error_m
from deckline.geometry import wrap_angle
from deckline.guide import guidance
from deckline.types import (
    DepthMode,
    Frame,
    Guidance,
    RunwayEstimate,
    RunwayLine,
    Segment,
    Status,
    Truth,
    Value,
)

METRES = (
    "lateral_deviation_m",
    "height_above_deck_m",
    "distance_to_ramp_m",
    "vertical_deviation_m",
    "distance_to_touchdown_m",
)
ANGLES = ("heading_error", "lateral_deviation", "vertical_deviation")
ACROSS_DEG = 89.0  # direction error from which a line counts as lying across the runway


def true_guidance(frame: Frame) -> Guidance | None:
    """Guidance from the true lines and the true pose, the deck's height that of the touchdown point.

    None without truth, runway or pose.
    """
    centre = None if frame.truth is None else true_centre(frame.truth)
    if centre is None or frame.true_world_from_body is None:
        return None
    along = centre.p1_m - centre.p0_m
    line = RunwayLine(touchdown(centre), float(np.arctan2(along[1], along[0])), np.zeros((3, 3)))
    exact = RunwayEstimate(Status.OK, DepthMode.NONE, {}, {"centre": line}, centre.p0_m, 0.0)
    return guidance(replace(frame, world_from_body=frame.true_world_from_body), exact)


def errors_against(
    truth: Truth, estimate: RunwayEstimate, measured: Guidance, exact: Guidance | None
) -> dict[str, dict[str, float | None]] | None:
    """How far a frame's estimate is from its truth; None where the scene has no runway.

    The line errors have the names and meanings of `deckline eval`: sizes without a sign, of each of the lines.
    "guidance" is measured minus true, with sign, under the names that records use.
    """
    centre = true_centre(truth)
    if truth.left is None or truth.right is None or centre is None:
        return None
    segments = {"left": truth.left, "right": truth.right, "centre": centre}
    found = {side: (estimate.lines[side], segments[side]) for side in segments if side in estimate.lines}
    missing: dict[str, float | None] = dict.fromkeys(segments)
    return {
        "direction_error_deg": missing | {side: _direction_deg(*pair) for side, pair in found.items()},
        "lateral_error_at_ramp_m": missing | {side: _lateral(*pair) for side, pair in found.items()},
        "height_error_m": missing | {side: abs(height_error_m(*pair)) for side, pair in found.items()},
        "guidance": _guidance_errors(measured, exact),
    }


def _direction_deg(line: RunwayLine, truth: Segment) -> float:
    return float(np.rad2deg(direction_error_rad(line, truth)))


def _lateral(line: RunwayLine, truth: Segment) -> float | None:
    """None for a line across the runway, which never passes beside its ramp end."""
    return None if _direction_deg(line, truth) > ACROSS_DEG else abs(lateral_error_m(line, truth))


def _guidance_errors(measured: Guidance, truth: Guidance | None) -> dict[str, float | None]:
    errors: dict[str, float | None] = {}
    for name in METRES:
        errors[name] = _difference(getattr(measured, name), None if truth is None else getattr(truth, name))
    for name in ANGLES:
        angle = f"{name}_rad"
        away = _difference(getattr(measured, angle), None if truth is None else getattr(truth, angle))
        errors[f"{name}_deg"] = None if away is None else float(np.rad2deg(wrap_angle(away)))
    return errors


def _difference(measured: Value | None, truth: Value | None) -> float | None:
    return None if measured is None or truth is None else measured.value - truth.value
