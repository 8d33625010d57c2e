"""The pose from the picture over frames: one filter per flight, of constant memory and bounded time per frame.

The horizon is found in the background and is a fraction of a second old when it arrives. The filter then goes back to
the frame that it belongs to, and through the lines of the frames since.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2, norm

from deckline.config import RunConfig
from deckline.dehaze.horizon import Horizon, NoHorizon, find_horizon
from deckline.dehaze.horizon_search import ANSWER_S, HorizonSearch
from deckline.geometry import Camera
from deckline.picture_pose.answer import estimate_of, in_widths, track_of, with_pose
from deckline.picture_pose.fit import fit_pose
from deckline.picture_pose.integrity import Evidence, bias_flag, unverified_reasons
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
from deckline.picture_pose.sights import HorizonSight, LevelSight, LineSight, sight_horizon, sight_lines
from deckline.picture_pose.states import (
    PLACE_SIGMA_M,
    TURN_SIGMA_RAD_S,
    USUAL_WIDTH_M,
    Belief,
    States,
    predict,
    shared_sigmas,
)
from deckline.types import (
    SIDES,
    Detection,
    Diagnostic,
    Diagnostics,
    Frame,
    Reason,
    RunwayEstimate,
    Track,
    TrackState,
)

Array = NDArray[np.float64]
CORRELATION_TIME_S = 0.33  # frames so close together err alike, so that they count as one; as in `track.states`
RAMP_CORRELATION_S = 1.0  # the same of the ramp
RAMP_EVERY_S = 0.2  # so often the near ends are looked for
HORIZON_VALID_S = 3.0  # a horizon that agreed so long ago still confirms the roll
MIN_STEP_S = 1e-6
MAX_TURN_RAD_S = 2 * TURN_SIGMA_RAD_S  # of pitch and heading; beyond, something else moves the picture
STEADY_S = 1.0  # without such a turn
UNUSABLE = {Reason.FROZEN}  # flags of a frame whose lines may not update the track


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
class PictureAnswer:
    """What the picture gives of one frame."""

    frame: Frame
    """The frame with the pose of the picture; as it was where there is none."""
    estimate: RunwayEstimate
    """Its estimate with the lines in the runway's frame, or with the reason why there are none."""
    track: Track | None
    """Of the frames so far; None: every frame is for itself."""


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
class _Memory:
    """What is carried from frame to frame."""

    belief: Belief
    start_s: float
    seen_s: float  # when lines were last used
    consistent_s: float  # when lines were last used, or none were there to contradict
    has_ramp: bool = False
    ramp_s: float = -np.inf  # when the near ends were last looked for
    agreed_s: float = -np.inf  # time of the last horizon that agreed
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


@dataclass(frozen=True, eq=False)
class PictureForecast:
    """Predicts a track to later times. It never changes, so any thread may use it."""

    belief: Belief  # at the frame
    seen_s: float  # when lines were last used
    has_ramp: bool
    shared_sigma: Array
    track: Track
    config: RunConfig

    def at(self, time_s: float) -> tuple[Track, RigidTransform, float] | None:
        """Track, world_from_body and 1-sigma of its heading beside the track's, rad, at a time.

        None before the frame, and when no line was seen for longer than `tracking.coast_s`.
        """
        if not self.belief.time_s <= time_s <= self.seen_s + self.config.tracking.coast_s:
            return None
        belief = predict(self.belief, time_s, self.shared_sigma)
        track = track_of(belief, self.track.state, self.has_ramp, self.shared_sigma, self.config)
        same = {name: getattr(self.track, name) for name in ("flags", "diagnostics", "doubts")}
        age_s = self.track.age_s + time_s - self.belief.time_s
        return replace(track, age_s=age_s, **same), belief.world_from_body, 0.0


class PictureTracker:
    """Follows the aircraft in the runway's frame by its pictures alone, through the frames of one flight.

    Args:
        config: what is stated of runway, camera and aircraft; `tracking` as for a navigation unit's track.
    """

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        self._search = HorizonSearch(config.tracking.horizon_s)
        self.reset()

    def reset(self) -> None:
        """Start another flight: forget all frames."""
        self._search.reset()
        self._memory: _Memory | None = None
        self._camera: Camera | None = None
        self._time_s = -np.inf
        self._last: Track | None = None
        self._shared = np.ones(0)

    def close(self) -> None:
        """End the thread of the search for the horizon."""
        self._search.close()

    def update(
        self, frame: Frame, detection: Detection, estimate: RunwayEstimate, flags: Diagnostics = ()
    ) -> PictureAnswer:
        """The pose after one more frame.

        Args:
            frame: without a pose; a camera that is not known is taken for a usual one, with a wide 1-sigma.
            detection: points of its lines.
            estimate: its lines in the image.
            flags: of the frame's monitors; they join those of the track.
        """
        given = frame
        if not frame.camera.known:
            frame = replace(frame, camera=Camera.assumed(frame.camera.width, frame.camera.height))
        if not self.config.tracking.enabled:
            return self._answer_alone(given, self._sight(frame, detection, estimate, flags))
        if not np.isfinite(frame.time_s) or frame.time_s <= self._time_s:
            if not frame.time_s <= self._time_s - self.config.tracking.coast_s:
                late = Diagnostic(Reason.BAD_TIME, f"the frame's time {frame.time_s:.3f} s is not after the one before")
                return PictureAnswer(given, estimate, _lost(frame, (late,)))
            self.reset()
        if frame.camera != self._camera and not _is_same(frame.camera, self._camera):
            self.reset()
        self._camera, self._time_s = frame.camera, frame.time_s
        picture = self._sight(frame, detection, estimate, flags)
        self._take_horizon(picture)
        diagnostics = self._advance(picture)
        self._search_horizon(picture)
        if self._memory is None:
            return PictureAnswer(given, estimate, replace(_lost(frame, diagnostics), flags=flags))
        return self._answer(self._memory, picture, diagnostics)

    def _sight(self, frame: Frame, detection: Detection, estimate: RunwayEstimate, flags: Diagnostics) -> Picture:
        is_usable = not any(flag.reason in UNUSABLE for flag in flags)
        sights = sight_lines(frame.camera, detection, estimate.pixel_lines) if is_usable else {}
        self._shared = shared_sigmas(frame.camera, self.config)
        mount = Mount.of(frame.body_from_camera)
        attitude = None if frame.level_from_body is None else frame.level_from_body.as_matrix()
        level = LevelSight(None, attitude, self.config.sensors.attitude_white_rad)
        return Picture(frame, detection, estimate, sights, self._shared, mount, level, flags)

    def forecast(self) -> "PictureForecast | None":
        """Predicts where the aircraft is after the last frame; None without a track, and in runway widths."""
        memory = self._memory
        if memory is None or self.config.deck.width_m is None or self._last is None:
            return None
        return PictureForecast(memory.belief, memory.seen_s, memory.has_ramp, self._shared, self._last, self.config)

    def _answer_alone(self, given: Frame, picture: Picture) -> PictureAnswer:
        """One frame for itself: its horizon is found at once."""
        frame, estimate, config = picture.frame, picture.estimate, self.config
        found = find_horizon(frame.image_rgb) if len(picture.sights) == len(SIDES) else None
        level = replace(picture.level, horizon=_sight_horizon(frame.camera, found))
        belief = self._fit(picture, level)
        if isinstance(belief, Diagnostic) and belief.reason is Reason.ATTITUDE:
            level, belief = LevelSight(), self._fit(picture, LevelSight())
        if isinstance(belief, Diagnostic):
            return PictureAnswer(given, replace(estimate, diagnostics=(*estimate.diagnostics, belief)), None)
        ramp = sight_ramp(frame, picture.detection, estimate, belief, config)
        if ramp is not None:
            belief = _start_ramp(belief, ramp, picture.mount)
        evidence = Evidence(0.0, level.is_known, ramp is not None, True, 0.0)
        doubts = unverified_reasons(belief, evidence, picture.shared, config)
        lines = estimate_of(estimate, belief, ramp is not None, config)
        lines = replace(lines, diagnostics=(*lines.diagnostics, *doubts))
        track = track_of(belief, TrackState.TRACKING, ramp is not None, picture.shared, config)
        placed, lines, _ = self._in_unit(with_pose(frame, belief), lines, track)
        return PictureAnswer(placed, lines, None)

    def _fit(self, picture: Picture, level: LevelSight) -> Belief | Diagnostic:
        """The pose by one picture alone."""
        return fit_pose(picture.frame.time_s, picture.sights, level, picture.mount, picture.shared, self.config)

    def _advance(self, picture: Picture) -> Diagnostics:
        """The memory after the lines of one more frame; returns why it is lost or began anew."""
        tracking, memory, time_s = self.config.tracking, self._memory, picture.frame.time_s
        if memory is None or time_s - memory.seen_s > tracking.coast_s:
            return self._start(picture)
        step_s = time_s - memory.belief.time_s
        memory.belief = predict(memory.belief, time_s, picture.shared)
        lines, excluded = _select_lines(memory.belief, picture.sights, picture.mount, tracking.gate_sigma)
        weight = -float(np.expm1(-step_s / tracking.reacquire_s))
        memory.contradicted += weight * (bool(picture.sights and not lines) - memory.contradicted)
        memory.excluded_s = {d.reason: memory.excluded_s.get(d.reason, time_s) for d in excluded}
        if lines:
            self._use(memory, picture, lines, step_s)
        elif not picture.sights:
            memory.consistent_s = time_s
        elif time_s - memory.consistent_s > tracking.reacquire_s:
            return (Diagnostic(Reason.RESTARTED, "began anew: the lines contradict the track"), *self._start(picture))
        return ()

    def _start(self, picture: Picture) -> Diagnostics:
        """A new track where both lines are seen; returns why there is none."""
        self._memory = None
        if not picture.sights:
            return ()
        belief, time_s = self._fit(picture, picture.level), picture.frame.time_s
        if isinstance(belief, Diagnostic):
            return (belief,)
        agreed_s = -np.inf if picture.level.attitude is None else time_s
        self._memory = _Memory(belief, time_s, time_s, time_s, agreed_s=agreed_s)
        ramp = sight_ramp(picture.frame, picture.detection, picture.estimate, belief, self.config)
        if ramp is not None:
            self._memory.belief, self._memory.has_ramp = _start_ramp(belief, ramp, picture.mount), True
        return ()

    def _use(self, memory: _Memory, picture: Picture, lines: dict[str, LineSight], step_s: float) -> None:
        """Update with the lines that passed the gate, and with the ramp now and then."""
        time_s = picture.frame.time_s
        times = max(1.0, CORRELATION_TIME_S / max(step_s, MIN_STEP_S))
        level = self._select_level(memory, picture)
        sighting = Sighting(time_s, lines, None, level, times, picture.mount)
        memory.belief = _update_lines(memory.belief, sighting)
        memory.seen_s = memory.consistent_s = time_s
        if np.abs(memory.belief.mean[States.TURN][1:]).max() > MAX_TURN_RAD_S:
            memory.turned_s = time_s
        if len(lines) == len(SIDES) and time_s - memory.ramp_s >= RAMP_EVERY_S:
            sighting = replace(sighting, ramp=self._use_ramp(memory, picture))
        if memory.anchor is not None:
            memory.since.append(sighting)

    def _select_level(self, memory: _Memory, picture: Picture) -> LevelSight:
        """The sensor's attitude where it agrees; a contradiction is flagged."""
        level = picture.level
        if level.attitude is None:
            return level
        innovation = attitude_innovation(memory.belief, level.attitude, level.white_rad)
        if distance2(memory.belief, innovation) > _gate(self.config.tracking.gate_sigma, 2):
            off = float(np.rad2deg(np.abs(innovation.residuals).max()))
            message = f"the sensor's attitude lies {off:.1f} degrees off what lines and horizon suggest"
            memory.level_flag = Diagnostic(Reason.ATTITUDE, message)
            return LevelSight()
        memory.level_flag, memory.agreed_s = None, picture.frame.time_s
        return level

    def _use_ramp(self, memory: _Memory, picture: Picture) -> RampSight | None:
        """Update with the ramp that is in view; returns it with the 1-sigma that it counted with.

        Where the near ends are not found, the nearest part of the lines that is passes for them: a ramp far beyond the
        known one is left out. A nearer one is more of the runway: the frame's origin moves there.
        """
        frame, belief, gate = picture.frame, memory.belief, self.config.tracking.gate_sigma
        ramp = sight_ramp(frame, picture.detection, picture.estimate, belief, self.config)
        if ramp is None:
            return None
        innovation = ramp_innovation(belief, ramp.ray, ramp.sigma_m, picture.mount)
        farther_m, sigma_m = float(innovation.residuals[0]), np.hypot(belief.sigma(States.DISTANCE), ramp.sigma_m)
        since_s, memory.ramp_s = frame.time_s - memory.ramp_s, frame.time_s
        if not memory.has_ramp or farther_m < -gate * sigma_m:
            memory.belief, memory.has_ramp = _start_ramp(belief, ramp, picture.mount), True
            memory.anchor, memory.ramp_fixes = None, []  # counted from another origin
            return None
        self._check_closing(memory, ramp, farther_m)
        if farther_m > gate * sigma_m:
            return None
        times = max(1.0, 2 * RAMP_CORRELATION_S / max(since_s, MIN_STEP_S))
        memory.belief = update(belief, innovation.inflate(times))
        return replace(ramp, sigma_m=float(np.sqrt(times)) * ramp.sigma_m)

    def _check_closing(self, memory: _Memory, ramp: RampSight, farther_m: float) -> None:
        """Compare the ramp with those of the last `SPAN_S`; a contradiction stays flagged, as the zoom stays."""
        belief, (closing, *_) = memory.belief, range(States.SIZE)[States.RATES]
        measured_m = float(belief.mean[States.DISTANCE]) + farther_m
        fix = RampFix(belief.time_s, measured_m, ramp.sigma_m, -float(belief.mean[closing]), belief.sigma(closing))
        recent = [one for one in memory.ramp_fixes if fix.time_s - one.time_s <= SPAN_S]
        found = (check_closing(one, fix) for one in recent)
        memory.zoom_flag = memory.zoom_flag or next((flag for flag in found if flag is not None), None)
        memory.ramp_fixes = [*recent, fix]

    def _search_horizon(self, picture: Picture) -> None:
        """Begin the search in a frame whose lines the filter used."""
        memory, frame = self._memory, picture.frame
        if memory is None or memory.seen_s != frame.time_s or frame.camera.has_distortion:
            return
        if self._search.is_due(frame.time_s):
            self._search.start(frame.time_s, frame.image_rgb)
            memory.anchor, memory.anchor_mount, memory.since = memory.belief, picture.mount, []

    def _take_horizon(self, picture: Picture) -> None:
        """Use the horizon that is due: at its own frame, then the lines of the frames since again."""
        found, memory = self._search.take(picture.frame.time_s), self._memory
        if memory is None or memory.anchor is None or memory.anchor_mount is None or found is None:
            return
        anchor, since, memory.anchor, memory.since = memory.anchor, memory.since, None, []
        horizon = _sight_horizon(picture.frame.camera, found)
        if horizon is None:
            return
        innovation = horizon_innovation(anchor, horizon, memory.anchor_mount)
        if distance2(anchor, innovation) > _gate(self.config.tracking.gate_sigma, 2):
            off = float(np.rad2deg(np.abs(innovation.residuals).max()))
            message = f"the horizon lies {off:.1f} degrees off what the lines suggest"
            memory.horizon_flag = Diagnostic(Reason.ATTITUDE, message)
            return
        memory.horizon_flag, memory.agreed_s = None, anchor.time_s
        belief = update(anchor, innovation)
        for sighting in since:
            belief = _update_lines(predict(belief, sighting.time_s, picture.shared), sighting)
        memory.belief = belief

    def _answer(self, memory: _Memory, picture: Picture, diagnostics: Diagnostics) -> PictureAnswer:
        frame, belief, config = picture.frame, memory.belief, self.config
        time_s, age_s = frame.time_s, frame.time_s - memory.start_s
        has_level = time_s - memory.agreed_s <= HORIZON_VALID_S + ANSWER_S
        is_steady = time_s - memory.turned_s > STEADY_S
        evidence = Evidence(age_s, has_level, memory.has_ramp, is_steady, memory.contradicted)
        lasting = tuple(
            Diagnostic(reason, f"the {reason} line contradicts the track, for {time_s - since:.1f} s")
            for reason, since in memory.excluded_s.items()
            if time_s - since >= config.integrity.persist_s
        )
        flags = [
            *lasting,
            memory.horizon_flag,
            memory.level_flag,
            memory.zoom_flag,
            bias_flag(belief, picture.shared, config),
            *picture.flags,
        ]
        state = TrackState.TRACKING if memory.seen_s == time_s else TrackState.COASTING
        track = replace(
            track_of(belief, state, memory.has_ramp, picture.shared, config),
            flags=tuple(flag for flag in flags if flag is not None),
            excluded=tuple(Diagnostic(reason, f"the {reason} line is left out") for reason in memory.excluded_s),
            diagnostics=diagnostics,
            age_s=age_s,
            doubts=unverified_reasons(belief, evidence, picture.shared, config),
        )
        self._last = track
        estimate = estimate_of(picture.estimate, belief, memory.has_ramp, config)
        return PictureAnswer(*self._in_unit(with_pose(frame, belief), estimate, track))

    def _in_unit(self, frame: Frame, estimate: RunwayEstimate, track: Track) -> tuple[Frame, RunwayEstimate, Track]:
        """In metres where the width is stated, else in runway widths."""
        if self.config.deck.width_m is not None:
            return frame, estimate, track
        return in_widths(frame, estimate, track, USUAL_WIDTH_M)


def _select_lines(
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
    return distance2(belief, lines_innovation(belief, sights, mount)) / _gate(gate_sigma, 2 * len(sights))


def _update_lines(belief: Belief, sighting: Sighting) -> Belief:
    mount, level = sighting.mount, sighting.level
    innovation = lines_innovation(belief, sighting.lines, mount).inflate(sighting.times)
    if level.attitude is not None:
        innovation = innovation + attitude_innovation(belief, level.attitude, level.white_rad)
    belief = update(belief, innovation)
    if sighting.ramp is None:
        return belief
    return update(belief, ramp_innovation(belief, sighting.ramp.ray, sighting.ramp.sigma_m, sighting.mount))


def _start_ramp(belief: Belief, ramp: RampSight, mount: Mount) -> Belief:
    """The belief with the origin of its frame moved to a ramp that is seen for the first time, or nearer."""
    moved = belief.covariance.copy()
    moved[States.DISTANCE], moved[:, States.DISTANCE] = 0.0, 0.0
    moved[States.DISTANCE, States.DISTANCE] = PLACE_SIGMA_M**2
    return update(replace(belief, covariance=moved), ramp_innovation(belief, ramp.ray, ramp.sigma_m, mount))


def _sight_horizon(camera: Camera, found: Horizon | NoHorizon | None) -> HorizonSight | None:
    return sight_horizon(camera, found) if isinstance(found, Horizon) and not camera.has_distortion else None


@lru_cache(maxsize=16)
def _gate(sigma: float, degrees: int) -> float:
    return float(chi2.isf(2 * norm.sf(sigma), degrees))


def _is_same(camera: Camera, other: Camera | None) -> bool:
    return other is not None and vars(camera) == vars(other)


def _lost(frame: Frame, diagnostics: Diagnostics) -> Track:
    return Track(frame.time_s, TrackState.LOST, {}, diagnostics=diagnostics)
