"""Where the aircraft is relative to the runway."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.geometry import wrap_angle
from deckline.types import Frame, Guidance, RunwayEstimate, RunwayLine, Value

STEEP = 0.1  # horizontal share of the nose's direction below which it has no heading


def guidance(frame: Frame, estimate: RunwayEstimate) -> Guidance:
    """Deviations of the aircraft (the body origin is its centre of mass) from the centre line.

    1-sigma is the line's covariance carried to the aircraft: an azimuth error counts with the distance to where the
    line was measured. Errors of the aircraft's own position and heading move the measured line along with the
    aircraft and cancel; where the line has a `relative_covariance` they are therefore not counted.

    What is impossible is None, and `reason` says why.
    """
    body = frame.world_from_body
    lines = estimate.lines
    if body is None or not lines:
        return Guidance(frame.time_s, estimate.status, estimate.mode, reason=estimate.reason or "no line was localized")
    centre = lines.get("centre")
    height = _height(body, centre or next(iter(lines.values())))
    if centre is None:
        return Guidance(
            frame.time_s, estimate.status, estimate.mode, height_above_deck_m=height, reason=estimate.reason
        )
    heading = _heading(body, centre)
    reason = estimate.reason
    if heading is None:
        reason = "; ".join(filter(None, [reason, "no heading: the nose points straight up or down"]))
    return Guidance(
        frame.time_s,
        estimate.status,
        estimate.mode,
        _lateral(body, centre),
        heading,
        height,
        _distance(body, centre, estimate),
        reason,
    )


def _covariance(line: RunwayLine) -> np.ndarray:
    return line.covariance if line.relative_covariance is None else line.relative_covariance


def _lateral(body: RigidTransform, centre: RunwayLine) -> Value:
    right = np.array([-np.sin(centre.azimuth_rad), np.cos(centre.azimuth_rad), 0.0])
    offset = body.translation - centre.point_m
    # Offset of the line beside the aircraft: offset at the line's point plus azimuth times the way back to it.
    lever = np.array([1.0, float(offset @ centre.direction), 0.0])
    return Value(float(offset @ right), float(np.sqrt(lever @ _covariance(centre) @ lever)))


def _heading(body: RigidTransform, centre: RunwayLine) -> Value | None:
    nose = body.rotation.apply([1.0, 0.0, 0.0])
    if np.hypot(nose[0], nose[1]) < STEEP:
        return None
    error = wrap_angle(np.arctan2(nose[1], nose[0]) - centre.azimuth_rad)
    return Value(float(error), float(np.sqrt(_covariance(centre)[1, 1])))


def _height(body: RigidTransform, line: RunwayLine) -> Value:
    return Value(float(line.height_m - body.translation[2]), float(np.sqrt(_covariance(line)[2, 2])))


def _distance(body: RigidTransform, centre: RunwayLine, estimate: RunwayEstimate) -> Value | None:
    if estimate.ramp_m is None or estimate.ramp_sigma_m is None:
        return None
    return Value(float((estimate.ramp_m - body.translation) @ centre.direction), estimate.ramp_sigma_m)
