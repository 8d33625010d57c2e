"""Lateral deviation, heading error, height, distance and their status, from a frame's lines and its track."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.config import Approach
from deckline.geometry import rotation_matrix, wrap_angle
from deckline.types import (
    DepthMode,
    Diagnostic,
    Diagnostics,
    Frame,
    Guidance,
    InWidths,
    LineVisibility,
    PoseSource,
    Reason,
    RunwayEstimate,
    RunwayLine,
    Scale,
    Status,
    Track,
    TrackState,
    Value,
    focal_doubts,
)

MIN_LEVEL_SHARE = 0.1  # horizontal share of the nose's direction below which it has no heading
MIN_BASE_M = 10.0  # distance to the aim point below which no angle is given
NOT_LOCALIZED = Diagnostic(Reason.NOT_LOCALIZED, "no line was localized")
NO_SCALE = Diagnostic(
    Reason.NO_SCALE, "only the stated deck height gives the scale: state the runway's width or use a depth camera"
)
ONE_FRAME = Diagnostic(Reason.YOUNG_TRACK, "no track: one frame alone shows no contradictions")
LINE_REASONS = {Reason.LEFT, Reason.RIGHT}
NOT_FRESH = {Reason.FROZEN, Reason.STALE}
NO_HEADING = Diagnostic(Reason.NO_HEADING, "no heading: the nose points straight up or down")


def guidance(frame: Frame, estimate: RunwayEstimate, track: Track | None, approach: Approach) -> Guidance:
    """Deviations of the aircraft from the centre line and the glideslope.

    1-sigma is the line's covariance propagated to the aircraft: an azimuth error grows with the distance to the point
    where the line was measured. Errors of the aircraft's own position and heading move the measured line with the
    aircraft and cancel; the line's `relative_covariance` leaves them out.

    The height is measured over the deck at the point of the centre line. A track's point is the touchdown point, where
    a pitching deck has another height than at the ramp or below the aircraft. One frame's point is in the middle of the
    visible lines.

    A deviation that cannot be measured is None; `diagnostics` gives the reason.

    Args:
        frame: the pose.
        estimate: lines of this frame alone: used without a track, in its first frame, or when it is lost and nothing is
            flagged.
        track: lines of all frames so far, with rates, protection levels and flags.
        approach: the wanted approach, and the point of the aircraft that deviations refer to; in runway widths they
            refer to the body's origin.
    """
    source = _select_source(estimate, track)
    flags = estimate.flags if track is None else track.flags + estimate.flags
    scale_sources = _scale_sources(estimate, track)
    doubts = _find_doubts(frame, track, scale_sources)
    base = Guidance(
        frame.time_s,
        guidance_status(estimate, track, flags, doubts),
        estimate.mode,
        glideslope_rad=float(np.deg2rad(approach.glideslope_deg)),
        track=None if track is None else track.state,
        flags=flags,
        scale_sources=scale_sources,
        pose_source=None if frame.world_from_body is None else frame.pose_source,
    )
    if frame.world_from_body is None or not source.lines:
        return replace(base, diagnostics=source.diagnostics + flags or (NOT_LOCALIZED,))
    doubts = doubts if base.status is Status.UNVERIFIED else ()
    base = replace(base, diagnostics=source.diagnostics + flags + doubts)
    point_m = (0.0, 0.0, 0.0) if frame.in_widths else approach.point_m
    found = _add_deviations(base, frame.world_from_body, source, point_m)
    if "centre" in source.lines and track is not None and source.lines is track.lines:
        found = replace(
            found,
            lateral_rate_m_s=track.lateral_rate_m_s,
            height_rate_m_s=track.height_rate_m_s,
            deck_acceleration_m_s2=track.deck_acceleration_m_s2,
            closing_m_s=track.closing_m_s,
            protection=track.protection,
        )
    return _in_widths(found) if frame.in_widths else add_approach(found, approach)


def _in_widths(found: Guidance) -> Guidance:
    """Guidance that was computed in runway widths, with none of them called a metre."""
    lateral, height = found.lateral_deviation_m, found.height_above_deck_m
    known = None if lateral is None or height is None else InWidths(lateral, height, found.distance_to_ramp_m)
    return replace(found, in_widths=known, lateral_deviation_m=None, height_above_deck_m=None, distance_to_ramp_m=None)


def _find_doubts(frame: Frame, track: Track | None, scale_sources: tuple[Scale, ...]) -> Diagnostics:
    """Why two lines that nothing contradicts are not `ok`; a track has its own doubts, of the focal length too."""
    by_picture = frame.pose_source is PoseSource.PICTURE
    scale: Diagnostics = () if scale_sources or by_picture else (NO_SCALE,)
    if track is not None and track.lines:
        return scale + track.doubts
    focal: Diagnostics = () if by_picture else focal_doubts(frame.camera.focal_sigma)
    return (*scale, *focal, ONE_FRAME)


def _scale_sources(estimate: RunwayEstimate, track: Track | None) -> tuple[Scale, ...]:
    has_depth = estimate.mode is DepthMode.FINE or estimate.depth_confirms_height
    by_depth: tuple[Scale, ...] = (Scale.DEPTH,) if has_depth else ()
    if track is None or not track.lines or track.age_s == 0.0:  # a track's first frame is used alone
        return by_depth
    return by_depth + track.scale_sources


def _add_deviations(
    base: Guidance, body: RigidTransform, source: RunwayEstimate, point_m: tuple[float, float, float]
) -> Guidance:
    """The same with height, lateral deviation, heading error and distance of the aircraft's reference point."""
    place = body.apply(np.array(point_m))
    centre = source.lines.get("centre")
    line = centre or next(iter(source.lines.values()))
    height = Value(float(line.height_m - place[2]), float(np.sqrt(line.aircraft_covariance[2, 2])))
    found = replace(base, height_above_deck_m=height)
    if centre is None:
        return found
    heading, ramp = _heading_error(body, centre), None
    if source.ramp_m is not None and source.ramp_sigma_m is not None:
        ramp = Value(float((source.ramp_m - place) @ centre.direction), source.ramp_sigma_m)
    return replace(
        found,
        lateral_deviation_m=_lateral_deviation(place, centre),
        heading_error_rad=heading,
        distance_to_ramp_m=ramp,
        diagnostics=base.diagnostics if heading is not None else (*base.diagnostics, NO_HEADING),
    )


def guidance_status(estimate: RunwayEstimate, track: Track | None, flags: Diagnostics, doubts: Diagnostics) -> Status:
    """The status of guidance from one frame and its track.

    Args:
        track: None: the frame is used alone.
        flags: of both.
        doubts: why two lines are not `ok` though nothing contradicts them.
    """
    if any(flag.reason in NOT_FRESH for flag in flags):
        return Status.STALE
    has_track = track is not None and bool(track.lines)
    is_unused = track is not None and track.state is TrackState.COASTING
    if has_track and (is_unused or estimate.seen is LineVisibility.NONE):
        return Status.COASTING
    if estimate.seen is LineVisibility.NONE:
        return Status.NOT_SEEN
    if estimate.seen is LineVisibility.ONE or (
        track is not None and any(n.reason in LINE_REASONS for n in track.excluded)
    ):
        return Status.ONE_LINE
    is_placed = has_track or "centre" in estimate.lines
    return Status.OK if is_placed and not doubts and not flags else Status.UNVERIFIED


def _select_source(estimate: RunwayEstimate, track: Track | None) -> RunwayEstimate:
    """The lines and ramp to use: the track's while it lasts, none where a lost track is flagged, else the frame's."""
    if track is None:
        return estimate
    first = track.age_s == 0.0 and bool(estimate.lines)
    diagnostics = tuple(dict.fromkeys(track.diagnostics + estimate.diagnostics))
    if (not track.lines or first) and not track.flags and not track.excluded:
        return replace(estimate, diagnostics=diagnostics)
    return replace(
        estimate, lines=track.lines, ramp_m=track.ramp_m, ramp_sigma_m=track.ramp_sigma_m, diagnostics=diagnostics
    )


def add_approach(found: Guidance, approach: Approach) -> Guidance:
    """Guidance with the deviations from the path to the aim point; the same where a length is not known."""
    lateral, height, ramp = found.lateral_deviation_m, found.height_above_deck_m, found.distance_to_ramp_m
    if lateral is None or height is None or ramp is None:
        return found
    ahead = ramp.value + approach.touchdown_m
    above = Value(height.value - ahead * approach.slope, float(np.hypot(height.sigma, ramp.sigma * approach.slope)))
    found = replace(found, distance_to_touchdown_m=Value(ahead, ramp.sigma), vertical_deviation_m=above)
    if ahead < MIN_BASE_M:
        return found
    angle = _angle(height, ramp.sigma, ahead)
    return replace(
        found,
        vertical_deviation_rad=Value(angle.value - float(np.deg2rad(approach.glideslope_deg)), angle.sigma),
        lateral_deviation_rad=_angle(lateral, ramp.sigma, ahead),
    )


def _angle(across: Value, ahead_sigma_m: float, ahead_m: float) -> Value:
    """Angle of a deviation, rad, as seen from the aim point at a distance."""
    sigma = np.hypot(across.sigma * ahead_m, ahead_sigma_m * across.value) / (ahead_m**2 + across.value**2)
    return Value(float(np.arctan2(across.value, ahead_m)), float(sigma))


def _lateral_deviation(place_m: np.ndarray, centre: RunwayLine) -> Value:
    """The place's distance from the centre line, m, positive to its right."""
    offset = place_m - centre.point_m
    # The line's offset abreast of the aircraft: its offset at its point plus azimuth times the distance to it.
    lever = np.array([1.0, float(offset @ centre.direction), 0.0])
    return Value(float(offset @ centre.right), float(np.sqrt(lever @ centre.aircraft_covariance @ lever)))


def _heading_error(body: RigidTransform, centre: RunwayLine) -> Value | None:
    """The nose's azimuth minus the centre line's, rad; None for a nose that points straight up or down."""
    nose = rotation_matrix(body)[:, 0]
    if np.hypot(nose[0], nose[1]) < MIN_LEVEL_SHARE:
        return None
    error = wrap_angle(np.arctan2(nose[1], nose[0]) - centre.azimuth_rad)
    return Value(float(error), float(np.sqrt(centre.aircraft_covariance[1, 1])))
