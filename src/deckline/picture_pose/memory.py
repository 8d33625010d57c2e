"""What a track of pictures carries from frame to frame, and its updates: lines, attitude, ramp, a late horizon."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.dehaze.horizon import Horizon, NoHorizon
from deckline.geometry import Camera
from deckline.picture_pose.model import (
    Mount,
    attitude_innovation,
    distance2,
    horizon_innovation,
    lines_innovation,
    ramp_innovation,
    update,
)
from deckline.picture_pose.ramp import SPAN_S, RampFix, RampSight, check_closing, sight_ramp
from deckline.picture_pose.sights import HorizonSight, LevelSight, LineSight, sight_horizon
from deckline.picture_pose.states import PLACE_SIGMA_M, TURN_SIGMA_RAD_S, Belief, States, predict
from deckline.probability import chi2_gate
from deckline.trackers import RAMP_CORRELATION_S, noise_inflation
from deckline.types import SIDES, Detection, Diagnostic, Diagnostics, Frame, Reason, RunwayEstimate

Array = NDArray[np.float64]
RAMP_EVERY_S = 0.2  # so often the near ends are searched
SINGLE_FRAME_S = 0.15  # a line that is left out for no longer may be one frame's error
MIN_STEP_S = 1e-6
MAX_TURN_RAD_S = 2 * TURN_SIGMA_RAD_S  # of pitch and heading; beyond, something else moves the picture


@dataclass(frozen=True, eq=False)
class Sighting:
    """What one frame measures, as long as it may be needed again."""

    time_s: float
    lines: dict[str, LineSight]
    ramp: RampSight | None
    level: LevelSight
    times: float  # of the variances: frames close together count as one
    mount: Mount


@dataclass(frozen=True, eq=False)
class Picture:
    """One frame as the tracker sees it."""

    frame: Frame
    detection: Detection
    estimate: RunwayEstimate
    sights: dict[str, LineSight]  # of the edge lines that may be used
    shared: Array  # (13,) 1-sigma of `States.SHARED` as stated
    mount: Mount
    level: LevelSight  # the sensor's attitude, if there is one
    flags: Diagnostics  # of the monitors


@dataclass(eq=False)
class TrackMemory:
    """What is carried from frame to frame."""

    belief: Belief
    start_s: float
    seen_s: float  # when lines were last used
    consistent_s: float  # when lines were last used, or none were there to contradict
    has_ramp: bool = False
    ramp_s: float = -np.inf  # when the near ends were last searched
    ramp_seen_s: float = -np.inf  # and used
    agreed_s: float = -np.inf  # time of the last horizon or attitude that agreed
    horizons: int = 0  # that agreed
    excluded_s: dict[Reason, float] = field(default_factory=dict)  # since when a line is left out
    contradicted: float = 0.0  # share of the frames in `tracking.reacquire_s` whose lines all contradict the track
    turned_s: float = -np.inf  # when the picture last turned faster than an aircraft
    ramp_fixes: list[RampFix] = field(default_factory=list)  # of the last `SPAN_S`
    zoom_flag: Diagnostic | None = None
    horizon_flag: Diagnostic | None = None
    level_flag: Diagnostic | None = None
    anchor: Belief | None = None  # at the frame whose horizon is searched, with its lines
    anchor_mount: Mount | None = None  # of that frame's camera
    since: list[Sighting] = field(default_factory=list)  # of the frames after it


def note_contradictions(
    memory: TrackMemory, picture: Picture, lines: dict[str, LineSight], excluded: Diagnostics, weight: float
) -> bool:
    """Remember which lines contradict the track; returns whether one is back that had done so for longer than a frame.

    Args:
        picture: whose lines passed the gate, or not. A line that it does not show changes nothing.
        lines: that passed.
        excluded: the others.
        weight: of this frame in the share of frames that contradict the track.
    """
    time_s, before = picture.frame.time_s, memory.excluded_s
    unseen = {reason: since for reason, since in before.items() if str(reason) not in picture.sights}
    memory.excluded_s = unseen | {d.reason: before.get(d.reason, time_s) for d in excluded}
    if picture.sights:
        memory.contradicted += weight * ((not lines) - memory.contradicted)
    return any(time_s - before[Reason(side)] > SINGLE_FRAME_S for side in lines if Reason(side) in before)


def use_lines(
    memory: TrackMemory, picture: Picture, lines: dict[str, LineSight], step_s: float, config: RunConfig
) -> None:
    """Update with the lines that passed the gate, and with the ramp now and then."""
    time_s = picture.frame.time_s
    times = noise_inflation(step_s, time_s - memory.seen_s, picture.detection.frames)
    level = _select_level(memory, picture, config)
    sighting = Sighting(time_s, lines, None, level, times, picture.mount)
    memory.belief = _update_lines(memory.belief, sighting)
    memory.seen_s = memory.consistent_s = time_s
    if np.abs(memory.belief.mean[States.TURN][1:]).max() > MAX_TURN_RAD_S:
        memory.turned_s = time_s
    if len(lines) == len(SIDES) and time_s - memory.ramp_s >= RAMP_EVERY_S:
        sighting = replace(sighting, ramp=_use_ramp(memory, picture, config))
    if memory.anchor is not None:
        memory.since.append(sighting)


def _select_level(memory: TrackMemory, picture: Picture, config: RunConfig) -> LevelSight:
    """The sensor's attitude where it agrees; a contradiction is flagged."""
    level = picture.level
    if level.attitude is None:
        return level
    innovation = attitude_innovation(memory.belief, level.attitude, level.white_rad)
    if distance2(memory.belief, innovation) > chi2_gate(config.tracking.gate_sigma, 2):
        off = float(np.rad2deg(np.abs(innovation.residuals).max()))
        message = f"the sensor's attitude lies {off:.1f} degrees off what lines and horizon suggest"
        memory.level_flag = Diagnostic(Reason.ATTITUDE, message)
        return LevelSight()
    memory.level_flag, memory.agreed_s = None, picture.frame.time_s
    return level


def _use_ramp(memory: TrackMemory, picture: Picture, config: RunConfig) -> RampSight | None:
    """Update with the ramp that is in view; returns it with the 1-sigma that it counted with.

    Where the near ends are not found, the nearest part of the lines that is passes for them: a ramp far beyond the
    known one is left out. A nearer one is more of the runway: the frame's origin moves there.
    """
    frame, belief, gate = picture.frame, memory.belief, config.tracking.gate_sigma
    memory.ramp_s = frame.time_s
    ramp = sight_ramp(frame, picture.detection, picture.estimate, belief, config)
    if ramp is None:
        return None
    innovation = ramp_innovation(belief, ramp.ray, ramp.sigma_m, picture.mount)
    farther_m, sigma_m = float(innovation.residuals[0]), np.hypot(belief.sigma(States.DISTANCE), ramp.sigma_m)
    since_s, memory.ramp_seen_s = frame.time_s - memory.ramp_seen_s, frame.time_s
    if not memory.has_ramp or farther_m < -gate * sigma_m:
        memory.belief, memory.has_ramp = start_ramp(belief, ramp, picture.mount), True
        memory.anchor, memory.ramp_fixes = None, []  # counted from another origin
        return None
    _check_closing(memory, ramp, farther_m)
    if farther_m > gate * sigma_m:
        return None
    times = max(1.0, 2 * RAMP_CORRELATION_S / max(since_s, MIN_STEP_S))
    memory.belief = update(belief, innovation.inflate(times))
    return replace(ramp, sigma_m=float(np.sqrt(times)) * ramp.sigma_m)


def _check_closing(memory: TrackMemory, ramp: RampSight, farther_m: float) -> None:
    """Compare the ramp with those of the last `SPAN_S`; a contradiction stays flagged, as the zoom stays."""
    belief, (closing, *_) = memory.belief, range(States.SIZE)[States.RATES]
    measured_m = float(belief.mean[States.DISTANCE]) + farther_m
    fix = RampFix(belief.time_s, measured_m, ramp.sigma_m, -float(belief.mean[closing]), belief.sigma(closing))
    recent = [one for one in memory.ramp_fixes if fix.time_s - one.time_s <= SPAN_S]
    found = (check_closing(one, fix) for one in recent)
    memory.zoom_flag = memory.zoom_flag or next((flag for flag in found if flag is not None), None)
    memory.ramp_fixes = [*recent, fix]


def use_horizon(memory: TrackMemory, found: Horizon | NoHorizon, picture: Picture, config: RunConfig) -> None:
    """Update with a horizon that was searched: at its own frame, then the lines of the frames since again."""
    anchor, since, memory.anchor, memory.since = memory.anchor, memory.since, None, []
    horizon = sight_level_horizon(picture.frame.camera, found)
    if anchor is None or memory.anchor_mount is None or horizon is None:
        return
    innovation = horizon_innovation(anchor, horizon, memory.anchor_mount)
    if distance2(anchor, innovation) > chi2_gate(config.tracking.gate_sigma, 2):
        off = float(np.rad2deg(np.abs(innovation.residuals).max()))
        memory.horizon_flag = Diagnostic(
            Reason.ATTITUDE, f"the horizon lies {off:.1f} degrees off what the lines suggest"
        )
        return
    memory.horizon_flag, memory.agreed_s, memory.horizons = None, anchor.time_s, memory.horizons + 1
    belief, drift_s = update(anchor, innovation), config.sensors.drift_s
    for sighting in since:
        belief = _update_lines(predict(belief, sighting.time_s, picture.shared, drift_s), sighting)
    memory.belief = predict(belief, memory.belief.time_s, picture.shared, drift_s)  # over frames without a line


def select_lines(
    belief: Belief, sights: dict[str, LineSight], mount: Mount, gate_sigma: float
) -> tuple[dict[str, LineSight], Diagnostics]:
    """The lines that agree with the belief, and which were left out: one contradiction is assumed at most."""
    if _excess(belief, sights, mount, gate_sigma) <= 1:
        return sights, ()
    best: dict[str, LineSight] = {}
    if len(sights) > 1:
        alone = [{side: sight} for side, sight in sights.items()]
        excess = [_excess(belief, lines, mount, gate_sigma) for lines in alone]
        best = alone[int(np.argmin(excess))] if min(excess) <= 1 else {}
    left_out = [side for side in sights if side not in best]
    return best, tuple(Diagnostic(Reason(side), f"the {side} line contradicts the track") for side in left_out)


def _excess(belief: Belief, sights: dict[str, LineSight], mount: Mount, gate_sigma: float) -> float:
    """Squared distance of some lines over that of the gate."""
    if not sights:
        return 0.0
    return distance2(belief, lines_innovation(belief, sights, mount)) / chi2_gate(gate_sigma, 2 * len(sights))


def _update_lines(belief: Belief, sighting: Sighting) -> Belief:
    mount, level = sighting.mount, sighting.level
    innovation = lines_innovation(belief, sighting.lines, mount).inflate(sighting.times)
    if level.attitude is not None:
        innovation = innovation + attitude_innovation(belief, level.attitude, level.white_rad)
    belief = update(belief, innovation)
    if sighting.ramp is None:
        return belief
    return update(belief, ramp_innovation(belief, sighting.ramp.ray, sighting.ramp.sigma_m, sighting.mount))


def start_ramp(belief: Belief, ramp: RampSight, mount: Mount) -> Belief:
    """The belief with the origin of its frame moved to a ramp that is seen for the first time, or nearer."""
    moved = belief.covariance.copy()
    moved[States.DISTANCE], moved[:, States.DISTANCE] = 0.0, 0.0
    moved[States.DISTANCE, States.DISTANCE] = PLACE_SIGMA_M**2
    return update(replace(belief, covariance=moved), ramp_innovation(belief, ramp.ray, ramp.sigma_m, mount))


def sight_level_horizon(camera: Camera, found: Horizon | NoHorizon | None) -> HorizonSight | None:
    """A horizon that was found, where the lens bends no lines."""
    return sight_horizon(camera, found) if isinstance(found, Horizon) and not camera.has_distortion else None
