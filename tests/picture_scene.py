"""What the picture alone gives of the short approach: the same place in the runway's own frame."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from approach_scene import chain, frame
from deckline.flight import FrameResult
from deckline.types import (
    DepthMode,
    Diagnostic,
    InWidths,
    PoseSource,
    Reason,
    RunwayLine,
    Scale,
    Status,
    Track,
    TrackState,
    Value,
)

WIDTH_M = 16.0
RAMP_M = np.array([0.0, 0.0, -20.0])
LENGTHS = ("lateral_deviation", "height_above_deck", "distance_to_ramp")
NO_WIDTH = Diagnostic(Reason.NO_WIDTH, "the width is not stated: lengths in runway widths")
YOUNG = Diagnostic(Reason.YOUNG_TRACK, "the track is 0.5 s old")


def picture_result(in_widths: bool = True, is_ok: bool = False, range_m: float = 120.0, index: int = 0) -> FrameResult:
    """A result of the approach, as if no pose had come with the frame; its truth knows the true pose.

    Args:
        in_widths: the runway's width is not stated.
        is_ok: camera, width and horizon are stated and agree; else unverified.
        range_m: to the ramp.
        index: of the frame.
    """
    flown = chain(frame(index, range_m))
    unit_m, at = WIDTH_M if in_widths else 1.0, flown.frame
    true, guided = at.world_from_body, flown.guidance
    pose = RigidTransform.from_components((true.translation - RAMP_M) / unit_m, true.rotation)
    truth = replace(at.truth, world_from_body=true)
    seen = replace(
        at, world_from_body=pose, deck_z_m=None, truth=truth, pose_source=PoseSource.PICTURE, in_widths=in_widths
    )
    lines = {side: _move(line, unit_m) for side, line in flown.estimate.lines.items()}
    ramp = (flown.estimate.ramp_m - RAMP_M) / unit_m
    estimate = replace(flown.estimate, mode=DepthMode.WIDTH, lines=lines, ramp_m=ramp, ramp_sigma_m=2.0 / unit_m)
    values = {name: getattr(guided, f"{name}_m") for name in LENGTHS}
    widths = InWidths(**{name: Value(value.value / unit_m, value.sigma / unit_m) for name, value in values.items()})
    advice = replace(
        guided,
        status=Status.OK if is_ok else Status.UNVERIFIED,
        mode=DepthMode.WIDTH,
        pose_source=PoseSource.PICTURE,
        diagnostics=() if is_ok else (NO_WIDTH,) if in_widths else (YOUNG,),
        scale_sources=() if in_widths else (Scale.WIDTH,),
        track=TrackState.TRACKING,
    )
    if in_widths:
        names = (*(f"{name}_m" for name in LENGTHS), "vertical_deviation_m", "distance_to_touchdown_m")
        angles = ("lateral_deviation_rad", "vertical_deviation_rad")
        advice = replace(advice, in_widths=widths, **dict.fromkeys((*names, *angles)))
    track = Track(at.time_s, TrackState.TRACKING, lines, ramp_m=ramp, ramp_sigma_m=2.0 / unit_m, age_s=2.0)
    return replace(
        flown, frame=seen, estimate=estimate, guidance=advice, track=track, seconds={**flown.seconds, "picture": 0.002}
    )


def _move(line: RunwayLine, unit_m: float) -> RunwayLine:
    """The line in the runway's frame."""
    scale = np.diag([1.0 / unit_m, 1.0, 1.0 / unit_m])
    covariance = scale @ line.covariance @ scale
    return replace(
        line, point_m=(line.point_m - RAMP_M) / unit_m, covariance=covariance, relative_covariance=None, errors=None
    )
