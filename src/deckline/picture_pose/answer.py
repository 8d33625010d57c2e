"""A belief as what the chain passes on: the frame with its pose, its lines, the track, or all of it in widths."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.config import RunConfig
from deckline.picture_pose.integrity import protection_levels
from deckline.picture_pose.model import SIGN
from deckline.picture_pose.states import Belief, States, line_rows
from deckline.trackers import MAX_SPEED_SIGMA_M_S
from deckline.types import (
    DepthMode,
    Frame,
    PoseSource,
    Reason,
    RunwayEstimate,
    RunwayLine,
    Scale,
    Track,
    TrackState,
    Value,
)

Array = NDArray[np.float64]
REPLACED = {Reason.NO_POSE, Reason.NO_CAMERA}  # reasons that hold no longer


def with_pose(frame: Frame, belief: Belief) -> Frame:
    """The frame with the pose that its picture gives, above a deck at z = 0."""
    return replace(
        frame,
        world_from_body=belief.world_from_body,
        deck_z_m=0.0,
        sea_z_m=None,
        pose_source=PoseSource.PICTURE,
    )


def lines_of(belief: Belief, at_m: float, config: RunConfig) -> dict[str, RunwayLine]:
    """Left, right and centre line in the runway's frame, at a place along it, with their errors as seen from the
    aircraft; the camera's mounting errs in yaw as stated, and turns the lines about the aircraft."""
    rows = line_rows(belief, at_m)
    mount = np.array([belief.mean[States.DISTANCE] + at_m, 1.0, 0.0]) * config.sensors.attitude_rad
    covariance = rows @ belief.covariance @ rows.T + np.outer(mount, mount)
    z = at_m * float(belief.mean[States.SLOPE])
    found = {}
    for side, sign in {**SIGN, "centre": 0.0}.items():
        half = sign / 2 * (belief.width_m + at_m * belief.mean[States.ANGLE])
        azimuth = sign / 2 * float(belief.mean[States.ANGLE])
        found[side] = RunwayLine(np.array([at_m, half, z]), azimuth, covariance, covariance)
    return found


def estimate_of(estimate: RunwayEstimate, belief: Belief, ramp: bool, config: RunConfig) -> RunwayEstimate:
    """The frame's estimate with the lines of a belief."""
    diagnostics = tuple(d for d in estimate.diagnostics if d.reason not in REPLACED)
    return replace(
        estimate,
        mode=DepthMode.WIDTH,
        lines=lines_of(belief, reference_m(ramp, config), config),
        ramp_m=np.zeros(3) if ramp else None,
        ramp_sigma_m=belief.sigma(States.DISTANCE) if ramp else None,
        diagnostics=diagnostics,
    )


def reference_m(ramp: bool, config: RunConfig) -> float:
    """Where lines and height are given, m along the runway: the touchdown point, or the nearest visible part."""
    return config.approach.touchdown_m if ramp else 0.0


def track_of(belief: Belief, state: TrackState, ramp: bool, shared_sigma: Array, config: RunConfig) -> Track:
    """The track of a belief, without flags and doubts."""
    at_m = reference_m(ramp, config)
    rates = [Value(float(belief.mean[i]), belief.sigma(i)) for i in range(States.SIZE)[States.RATES]]
    distance, lateral, height = (None if rate.sigma > MAX_SPEED_SIGMA_M_S else rate for rate in rates)
    return Track(
        belief.time_s,
        state,
        lines_of(belief, at_m, config),
        protection=protection_levels(belief, at_m, ramp, shared_sigma, config),
        ramp_m=np.zeros(3) if ramp else None,
        ramp_sigma_m=belief.sigma(States.DISTANCE) if ramp else None,
        lateral_rate_m_s=lateral,
        height_rate_m_s=height,
        closing_m_s=None if distance is None or not ramp else Value(-distance.value, distance.sigma),
        scale_sources=() if config.deck.width_m is None else (Scale.WIDTH,),
    )


def in_widths(
    frame: Frame, estimate: RunwayEstimate, track: Track, width_m: float
) -> tuple[Frame, RunwayEstimate, Track]:
    """The same with every length of the runway's frame counted in runway widths; rates and levels are left out."""
    by, pose = 1 / width_m, frame.world_from_body
    if pose is not None:
        placed, mounted = (
            RigidTransform.from_components(by * np.asarray(one.translation), one.rotation)
            for one in (pose, frame.body_from_camera)
        )
        frame = replace(frame, world_from_body=placed, body_from_camera=mounted, in_widths=True)
    ramp_sigma = None if track.ramp_sigma_m is None else by * track.ramp_sigma_m
    lines = {side: _scale_line(line, by) for side, line in track.lines.items()}
    estimate = replace(estimate, lines=lines, ramp_sigma_m=ramp_sigma)
    track = replace(track, lines=lines, ramp_sigma_m=ramp_sigma, protection=None, closing_m_s=None)
    return frame, estimate, replace(track, lateral_rate_m_s=None, height_rate_m_s=None)


def _scale_line(line: RunwayLine, by: float) -> RunwayLine:
    scale = np.outer([by, 1.0, by], [by, 1.0, by])
    covariance = scale * line.covariance
    return RunwayLine(by * line.point_m, line.azimuth_rad, covariance, covariance)
