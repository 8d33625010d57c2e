"""The runway over frames: one filter per flight, of constant memory and time per frame."""

from dataclasses import dataclass, replace

import numpy as np

from deckline.track.aircraft import Aircraft, first_seen, flown, pose_of
from deckline.track.config import TrackConfig
from deckline.track.extent import Extent, extended, runway_prior, sailed, seen_extent, seen_ramp
from deckline.track.frozen import Look, looked
from deckline.track.gate import Gated, gated
from deckline.track.integrity import protection
from deckline.track.measurement import measure
from deckline.track.output import lines, rates_of
from deckline.track.state import Pose, State, initial_state, predict, shifted, updated
from deckline.track.watch import Watch, alarms, confused
from deckline.types import SIDES, Flag, Frame, RunwayEstimate, RunwayLine, RunwayPrior, Track, TrackState

BACK_S = 2.0  # a time this far back is another flight, not a late frame
ROUNDING_S = 1e-6  # of sums of times
FROZEN = Flag("frozen", "the camera shows the same picture while the aircraft moves")


@dataclass(frozen=True, eq=False)
class _Memory:
    """What is carried from frame to frame."""

    state: State
    aircraft: Aircraft
    extent: Extent | None
    seen_s: float  # when lines were last used
    agreed_s: float  # when lines were last used, or none were there to contradict
    began_s: float


@dataclass(frozen=True, eq=False)
class _Moment:
    """One frame as the track sees it."""

    frame: Frame
    estimate: RunwayEstimate
    found: dict[str, RunwayLine]  # the edge lines that may be used
    step_s: float  # since the frame before; 0 at the beginning
    flags: tuple[Flag, ...]  # found before any filtering
    reason: str  # why the frame, or the track before it, is not used


class Tracker:
    """Follows the runway through the frames of one flight, in the order of their times.

    Frames that cannot be used are ridden out and say why in `Track.reason`: without pose, without a line, with a time
    that is not a number, repeated, or a little earlier than one before. A time more than two seconds back, a gap longer
    than `coast_s`, or a pose that jumps begins a new track.

    `Track.flags` names what lasts and would mislead; a single measurement that was left out is in `Track.excluded`.
    """

    def __init__(self, config: TrackConfig | None = None) -> None:
        self.config = config or TrackConfig()
        self._memory: _Memory | None = None
        self._watch = Watch()
        self._look: Look | None = None
        self._time_s: float | None = None
        self._last: Track | None = None

    def update(self, frame: Frame, estimate: RunwayEstimate) -> Track:
        """The track after one more frame."""
        refused = self._refused(frame.time_s)
        if refused:
            if self._last is None:
                return Track(frame.time_s, TrackState.LOST, {}, reason=refused)
            return replace(self._last, reason=refused, excluded=())
        before, self._time_s = self._time_s, frame.time_s
        self._last = self._advanced(frame, estimate, None if before is None else frame.time_s - before)
        return self._last

    def runway_prior(self, frame: Frame) -> RunwayPrior | None:
        """Where the runway should be in a frame that comes next, before it is looked at; None when it is lost."""
        memory = self._memory
        if memory is None or memory.extent is None or self._refused(frame.time_s):
            return None
        if not 0 <= frame.time_s - memory.seen_s <= self.config.coast_s + ROUNDING_S:
            return None
        camera = frame.world_from_camera
        place = None if camera is None else camera.translation
        state = predict(memory.state, frame.time_s, place, self.config)
        pose = pose_of(memory.aircraft, frame)
        return runway_prior(state, memory.extent, lines(state, pose, 0.0, self.config), frame.time_s - memory.seen_s)

    def _refused(self, time_s: float) -> str:
        """Why a frame of this time cannot be used, or an empty text."""
        if not np.isfinite(time_s):
            return "the frame's time is not a number"
        if self._time_s is None or time_s < self._time_s - BACK_S or time_s > self._time_s:
            return ""
        if time_s == self._time_s:
            return f"the frame's time {time_s:.3f} s was there before"
        return f"the frame is {self._time_s - time_s:.3f} s older than the one before"

    def _advanced(self, frame: Frame, estimate: RunwayEstimate, step_s: float | None) -> Track:
        memory, reason = self._predicted(frame, step_s)
        self._look, frozen = looked(self._look, frame, estimate)
        found = {side: estimate.lines[side] for side in SIDES if side in estimate.lines}
        if frame.world_from_body is None:
            found, reason = {}, reason or "the frame has no pose"
        crossed = confused(found)
        if crossed or frozen:
            found, reason = {}, "; ".join(filter(None, [reason, FROZEN.reason if frozen else crossed]))
        flags = (FROZEN,) if frozen else (Flag("swapped", crossed),) if crossed else ()
        moment = _Moment(frame, estimate, found, step_s or 0.0, flags, reason)
        if memory is not None:
            return self._followed(memory, moment)
        return self._begun(replace(moment, step_s=0.0))

    def _predicted(self, frame: Frame, step_s: float | None) -> tuple[_Memory | None, str]:
        """The memory at the frame's time; None, and why, where the track ends."""
        memory = self._memory
        if memory is None or step_s is None:
            return None, ""
        young = frame.time_s - step_s == memory.began_s  # one frame is no track: unrelated frames lose nothing
        if step_s < 0:
            self._watch = Watch()
            return None, "" if young else "began anew: the time went back"
        if step_s > self.config.coast_s + ROUNDING_S:
            return None, "" if young else f"began anew: no frame for {step_s:.1f} s"
        aircraft, jump_m = flown(memory.aircraft, frame, self.config.errors.position_white_m)
        if jump_m:
            return None, "" if young else f"began anew: the pose jumped by {jump_m:.0f} m"
        camera = frame.world_from_camera
        state = predict(memory.state, frame.time_s, None if camera is None else camera.translation, self.config)
        return replace(memory, state=state, aircraft=aircraft or memory.aircraft), ""

    def _begun(self, moment: _Moment) -> Track:
        """A new track where both lines are seen: one alone may be any line of the deck."""
        before, self._memory = self._memory, None
        self._watch = self._watch.anew(None if before is None else before.state)
        frame, found = moment.frame, moment.found
        aircraft = first_seen(frame, self.config.errors.position_white_m)
        if len(found) < len(SIDES) or aircraft is None:
            return self._lost(moment, None, moment.flags)
        line = moment.estimate.lines.get("centre") or found["left"]
        bare = initial_state(frame.time_s, line, None, self.config)
        seen = seen_extent(frame, moment.estimate, bare)
        near = moment.estimate.ramp_m if seen is None else bare.point_m + seen[0] * bare.along
        state = initial_state(frame.time_s, line, near, self.config)
        return self._followed(_Memory(state, aircraft, None, -np.inf, frame.time_s, frame.time_s), moment)

    def _followed(self, memory: _Memory, moment: _Moment) -> Track:
        """The predicted memory with the frame's lines, kept for the next frame."""
        config, time_s = self.config, moment.frame.time_s
        pose = pose_of(memory.aircraft, moment.frame)
        gate = None
        if pose is not None and moment.found:
            measured = measure(memory.state, moment.found, moment.estimate.mode, pose, moment.step_s, config)
            gate = None if measured is None else gated(memory.state, measured, config.gate)
        self._watch = self._watch.after(gate, time_s, moment.step_s, config)
        memory = self._taken(memory, gate, moment)
        too_long = time_s - memory.seen_s > config.coast_s + ROUNDING_S
        if too_long or time_s - memory.agreed_s > config.reacquire_s + ROUNDING_S:
            self._memory = None
            if np.isfinite(memory.seen_s):
                self._watch = self._watch.anew(memory.state)
            return self._lost(moment, gate, moment.flags + alarms(self._watch, gate, None, None, time_s, config))
        self._memory = memory
        flags = moment.flags + alarms(self._watch, gate, memory.state, memory.extent, time_s, config)
        return self._told(memory, moment, pose, gate, flags)

    def _taken(self, memory: _Memory, gate: Gated | None, moment: _Moment) -> _Memory:
        """The memory after what the gate let through."""
        time_s = moment.frame.time_s
        if gate is None:
            return replace(memory, agreed_s=time_s)
        if gate.kept is None:
            return memory
        state = updated(memory.state, gate.kept.values, gate.kept.design, gate.kept.noise)
        state = shifted(state, gate.kept.x_m)
        ramp = seen_ramp(moment.frame, moment.estimate, state)
        speed = self.config.motion.ship_velocity_m_s
        along = None if speed is None else float(np.array(speed) @ state.along[:2])
        seen = seen_extent(moment.frame, moment.estimate, state)
        since_s = 0.0 if memory.extent is None else time_s - memory.seen_s
        extent = extended(memory.extent, state, seen, ramp, since_s, along)
        return replace(memory, state=state, extent=extent, seen_s=time_s, agreed_s=time_s)

    def _lost(self, moment: _Moment, gate: Gated | None, flags: tuple[Flag, ...]) -> Track:
        excluded = _excluded(gate)
        reason = "; ".join(filter(None, [moment.reason, *(flag.reason for flag in excluded)]))
        time_s = moment.frame.time_s
        return Track(time_s, TrackState.LOST, {}, flags=flags, excluded=excluded, reason=reason)

    def _told(
        self, memory: _Memory, moment: _Moment, pose: Pose | None, gate: Gated | None, flags: tuple[Flag, ...]
    ) -> Track:
        """What is said of the memory."""
        extent, state, config = memory.extent, memory.state, self.config
        if extent is not None:
            extent = sailed(extent, state, moment.frame.time_s - memory.seen_s)
        ramp = extent if extent is not None and extent.is_ramp else None
        touchdown = None if extent is None else float(state.local(extent.near_m)[0]) + config.touchdown_m
        at_m = touchdown or 0.0
        lateral, height, closing = rates_of(state, memory.aircraft, pose, ramp, at_m, config)
        used = gate is not None and gate.kept is not None
        return Track(
            moment.frame.time_s,
            TrackState.TRACKING if used else TrackState.COASTING,
            lines(state, pose, at_m, config),
            protection=None if pose is None else protection(state, pose, touchdown, config),
            flags=flags,
            excluded=_excluded(gate),
            ramp_m=None if ramp is None else ramp.near_m,
            ramp_sigma_m=None if ramp is None else ramp.sigma_m,
            lateral_rate_m_s=lateral,
            height_rate_m_s=height,
            closing_m_s=closing,
            reason=moment.reason,
            age_s=moment.frame.time_s - memory.began_s,
        )


def _excluded(gate: Gated | None) -> tuple[Flag, ...]:
    return () if gate is None else tuple(Flag(name, reason) for name, reason in gate.left_out.items())
