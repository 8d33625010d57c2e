"""The track described at the time of its last frame, and predicted to later times."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.config import RunConfig
from deckline.geometry import Camera
from deckline.probability import two_sided_quantile
from deckline.track.extent import Extent, advance_extent
from deckline.track.filter import deck_acceleration, predict, track_lines, track_rates
from deckline.track.motion import Aircraft, Pose, predict_aircraft
from deckline.track.prior_tests import prior_tests, unverified_reasons
from deckline.track.protection import least_closing_speed, protection_levels, undetected_yaw
from deckline.track.states import FilterState
from deckline.types import RunwayLine, Scale, Track, TrackState, focal_doubts

# From so far before the ramp to so far, m, 1-sigmas grow by up to so many times: split conformal prediction. The 95 %
# quantile of error over 1-sigma in 40 rendered flights (paper's ship, sea state 4, 500 to 3000 m) was 0.97 of a
# normal's between 500 and 600 m, 1.14 to 700 m, 1.25 to 800 m; heights kept theirs. Source: Angelopoulos and Bates,
# "Conformal prediction: a gentle introduction", 2023.
FAR_M, FAR_SIGMA_INFLATION = (550.0, 800.0), 1.3
TURN_SIGMA_RAD_S = float(np.deg2rad(2.0))  # of the averaged turn rate; simulated approaches in gusts stay below


@dataclass(frozen=True, eq=False)
class TrackMemory:
    """What is carried from frame to frame."""

    state: FilterState
    aircraft: Aircraft
    extent: Extent | None
    seen_s: float  # when lines were last used
    consistent_s: float  # when lines were last used, or none were there to contradict
    start_s: float
    camera: Camera  # of the last frame


def describe_track(memory: TrackMemory, pose: Pose | None, config: RunConfig) -> Track:
    """The track at the time of the memory's state, as one that coasts.

    Args:
        pose: of the camera at that time; None: not known.
    """
    extent, state, near_m, touchdown = memory.extent, memory.state, 0.0, None
    if extent is not None:
        extent = advance_extent(extent, state, state.time_s - memory.seen_s)
        near_m = float(state.local(extent.near_m)[0])
        touchdown = near_m + config.approach.touchdown_m
    ramp = extent if extent is not None and extent.is_ramp else None
    at_m, far = touchdown or 0.0, 1.0
    if pose is not None:
        far = float(np.interp(near_m - state.local(pose.position_m)[0], FAR_M, (1.0, FAR_SIGMA_INFLATION)))
    lateral, height, closing = track_rates(
        state, memory.aircraft, pose, None if ramp is None else ramp.speed, at_m, config
    )
    yaw_rad = None if pose is None else undetected_yaw(state, least_closing_speed(state, pose, closing, config), config)
    tests, age_s = prior_tests(state, near_m, config), state.time_s - memory.start_s
    doubts = focal_doubts(memory.camera.focal_sigma, config.sensors.focal_fraction)
    return Track(
        state.time_s,
        TrackState.COASTING,
        {side: _scale_sigmas(line, far) for side, line in track_lines(state, pose, at_m, config).items()},
        protection=None
        if pose is None
        else protection_levels(state, pose, touchdown, ramp, tests, yaw_rad, far, config),
        ramp_m=None if ramp is None else ramp.near_m,
        ramp_sigma_m=None if ramp is None else far * ramp.sigma_m,
        lateral_rate_m_s=lateral,
        height_rate_m_s=height,
        deck_acceleration_m_s2=deck_acceleration(state, at_m, config),
        closing_m_s=closing,
        age_s=age_s,
        doubts=doubts + unverified_reasons(state, age_s, tests, yaw_rad, config),
        scale_sources=() if config.deck.width_m is None else (Scale.WIDTH,),
    )


@dataclass(frozen=True, eq=False)
class Forecast:
    """Predicts a track to later times. It never changes, so any thread may use it."""

    memory: TrackMemory
    track: Track  # at the frame
    config: RunConfig

    def at(self, time_s: float) -> tuple[Track, RigidTransform, float] | None:
        """Track, world_from_body and 1-sigma of its heading, rad, at a time.

        The aircraft is predicted with constant velocity and turn rate. The growing 1-sigma of its position is part of
        the lines' covariance, of the ramp's 1-sigma and of the protection levels. None before the frame, for a frame
        without a pose, and when no line was seen for longer than `tracking.coast_s`.
        """
        memory, before = self.memory, self.memory.aircraft
        known = before.time_s == memory.state.time_s <= time_s <= memory.seen_s + self.config.tracking.coast_s
        if not known or not self.track.lines:
            return None
        aircraft = predict_aircraft(before, time_s)
        pose = Pose(aircraft.position_m, aircraft.velocity_m_s, aircraft.turn_rate_rad_s)
        state = predict(memory.state, time_s, aircraft.position_m, self.config)
        track = describe_track(replace(memory, state=state, aircraft=aircraft), pose, self.config)
        turn_rad = TURN_SIGMA_RAD_S * (time_s - before.time_s)
        track = _add_motion_uncertainty(track, float(aircraft.covariance[0, 0] - before.covariance[0, 0]), turn_rad)
        track = replace(track, state=self.track.state, flags=self.track.flags, diagnostics=self.track.diagnostics)
        body = RigidTransform.from_components(aircraft.position_m, aircraft.attitude)
        return track, body, turn_rad


def _scale_sigmas(line: RunwayLine, times: float) -> RunwayLine:
    """The line with the 1-sigmas of its place and direction so many times as large."""
    scale = np.outer([times, times, 1.0], [times, times, 1.0])
    relative = line.relative_covariance
    relative = None if relative is None else scale * relative
    return replace(line, covariance=scale * line.covariance, relative_covariance=relative)


def _add_motion_uncertainty(track: Track, variance_m2: float, turn_rad: float) -> Track:
    """The track with the variance that the aircraft's position gained, and the 1-sigma of its turn."""
    sigma_m, protection, ramp_sigma_m = float(np.sqrt(variance_m2)), track.protection, track.ramp_sigma_m
    if protection is not None:
        quantile = two_sided_quantile(protection.risk)
        bound_m = quantile * sigma_m
        protection = replace(
            protection,
            lateral_m=protection.lateral_m + bound_m,
            vertical_m=protection.vertical_m + bound_m,
            heading_rad=None if protection.heading_rad is None else protection.heading_rad + quantile * turn_rad,
            distance_m=None if protection.distance_m is None else protection.distance_m + bound_m,
        )
    ramp_sigma_m = None if ramp_sigma_m is None else float(np.hypot(ramp_sigma_m, sigma_m))
    added = np.diag([variance_m2, 0.0, variance_m2])
    lines = {
        side: replace(line, covariance=line.covariance + added, relative_covariance=line.aircraft_covariance + added)
        for side, line in track.lines.items()
    }
    return replace(track, lines=lines, protection=protection, ramp_sigma_m=ramp_sigma_m)
