"""Where the aircraft is relative to the runway."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import wrap_angle
from deckline.guide.config import GuideConfig
from deckline.types import Frame, Guidance, RunwayEstimate, RunwayLine, Track, Value

Array = NDArray[np.float64]
STEEP = 0.1  # horizontal share of the nose's direction below which it has no heading
MIN_BASE_M = 10.0  # closer to the aim point an angle says nothing
AS_USUAL = GuideConfig()
NO_LINE = "no line was localized"


def guidance(
    frame: Frame, estimate: RunwayEstimate, track: Track | None = None, config: GuideConfig = AS_USUAL
) -> Guidance:
    """Deviations of the aircraft from the centre line and the glideslope.

    1-sigma is the line's covariance carried to the aircraft: an azimuth error counts with the distance to where the
    line was measured. Errors of the aircraft's own position and heading move the measured line along with the
    aircraft and cancel; where the line has a `relative_covariance` they are therefore not counted.

    The height is that over the deck where the centre line is told: a track tells it at the touchdown point, where a
    deck that pitches has another height than at the ramp or below the aircraft; one frame where it saw the lines.

    What is impossible is None, and `reason` says why.

    Args:
        frame: the pose.
        estimate: lines of this frame alone: what counts without a track, in its first frame, or when it is lost and
            nothing is known to be wrong.
        track: lines of all frames so far, with rates, protection levels and flags.
        config: the wanted approach, and the point of the aircraft that is meant.
    """
    body = frame.world_from_body
    source = _source(estimate, track)
    base = Guidance(
        frame.time_s, estimate.status, estimate.mode, glideslope_rad=float(np.deg2rad(config.glideslope_deg))
    )
    if track is not None:
        base = replace(base, track=track.state, flags=track.flags)
    reason = "; ".join(filter(None, [source.reason, *(flag.reason for flag in base.flags)]))
    if body is None or not source.lines:
        return replace(base, reason=reason or NO_LINE)
    place = body.apply(np.array(config.point_m))
    centre = source.lines.get("centre")
    height = _height(place, centre or next(iter(source.lines.values())))
    if centre is None:
        return replace(base, height_above_deck_m=height, reason=reason)
    heading = _heading(body, centre)
    if heading is None:
        reason = "; ".join(filter(None, [reason, "no heading: the nose points straight up or down"]))
    found = replace(
        base,
        lateral_deviation_m=_lateral(place, centre),
        heading_error_rad=heading,
        height_above_deck_m=height,
        distance_to_ramp_m=_distance(place, centre, source),
        reason=reason,
    )
    if track is not None and source.lines is track.lines:
        found = replace(
            found,
            lateral_rate_m_s=track.lateral_rate_m_s,
            height_rate_m_s=track.height_rate_m_s,
            closing_m_s=track.closing_m_s,
            protection=track.protection,
        )
    return _on_approach(found, config)


def _source(estimate: RunwayEstimate, track: Track | None) -> RunwayEstimate:
    """Lines, ramp and reason that count: the track's where it lives; nothing where it is in doubt."""
    if track is None:
        return estimate
    young = track.age_s == 0.0 and bool(estimate.lines)
    reason = "; ".join(dict.fromkeys(filter(None, [track.reason, estimate.reason])))
    if (not track.lines or young) and not track.flags and not track.excluded:
        return replace(estimate, reason=reason)
    return replace(estimate, lines=track.lines, ramp_m=track.ramp_m, ramp_sigma_m=track.ramp_sigma_m, reason=reason)


def _on_approach(found: Guidance, config: GuideConfig) -> Guidance:
    """The same with what the way to the aim point decides."""
    lateral, height, ramp = found.lateral_deviation_m, found.height_above_deck_m, found.distance_to_ramp_m
    if lateral is None or height is None or ramp is None:
        return found
    ahead = ramp.value + config.touchdown_m
    above = Value(height.value - ahead * config.slope, float(np.hypot(height.sigma, ramp.sigma * config.slope)))
    found = replace(found, distance_to_touchdown_m=Value(ahead, ramp.sigma), vertical_deviation_m=above)
    if ahead < MIN_BASE_M:
        return found
    angle = _angle(height, ramp.sigma, ahead)
    return replace(
        found,
        vertical_deviation_rad=Value(angle.value - float(np.deg2rad(config.glideslope_deg)), angle.sigma),
        lateral_deviation_rad=_angle(lateral, ramp.sigma, ahead),
    )


def _angle(beside: Value, ahead_sigma_m: float, ahead_m: float) -> Value:
    """Angle, rad, under which the aim point sees a deviation from so far ahead."""
    across = np.hypot(beside.sigma * ahead_m, ahead_sigma_m * beside.value) / (ahead_m**2 + beside.value**2)
    return Value(float(np.arctan2(beside.value, ahead_m)), float(across))


def _covariance(line: RunwayLine) -> Array:
    return line.covariance if line.relative_covariance is None else line.relative_covariance


def _lateral(place_m: Array, centre: RunwayLine) -> Value:
    right = np.array([-np.sin(centre.azimuth_rad), np.cos(centre.azimuth_rad), 0.0])
    offset = place_m - centre.point_m
    # Offset of the line beside the aircraft: offset at the line's point plus azimuth times the way back to it.
    lever = np.array([1.0, float(offset @ centre.direction), 0.0])
    return Value(float(offset @ right), float(np.sqrt(lever @ _covariance(centre) @ lever)))


def _heading(body: RigidTransform, centre: RunwayLine) -> Value | None:
    nose = body.rotation.apply([1.0, 0.0, 0.0])
    if np.hypot(nose[0], nose[1]) < STEEP:
        return None
    error = wrap_angle(np.arctan2(nose[1], nose[0]) - centre.azimuth_rad)
    return Value(float(error), float(np.sqrt(_covariance(centre)[1, 1])))


def _height(place_m: Array, line: RunwayLine) -> Value:
    return Value(float(line.height_m - place_m[2]), float(np.sqrt(_covariance(line)[2, 2])))


def _distance(place_m: Array, centre: RunwayLine, source: RunwayEstimate) -> Value | None:
    if source.ramp_m is None or source.ramp_sigma_m is None:
        return None
    return Value(float((source.ramp_m - place_m) @ centre.direction), source.ramp_sigma_m)
