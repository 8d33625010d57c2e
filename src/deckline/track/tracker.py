"""The runway over frames: one filter per flight, of constant memory and time per frame."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.track.aircraft import Aircraft, first_seen, flown, pose_of
from deckline.track.config import TrackConfig
from deckline.track.extent import Extent, extended, seen_extent
from deckline.track.gate import Gated, gated
from deckline.track.measurement import measure
from deckline.track.output import rates_of
from deckline.track.state import Pose, State, initial_state, lines, predict, shifted, updated
from deckline.types import SIDES, Flag, Frame, RunwayEstimate, RunwayLine, Track, TrackState

Array = NDArray[np.float64]
BACK_S = 2.0  # a time this far back is another flight, not a late frame
ROUNDING_S = 1e-6  # of sums of times


@dataclass(frozen=True, eq=False)
class _Memory:
    """What is carried from frame to frame."""

    state: State
    aircraft: Aircraft | None
    extent: Extent | None
    seen_s: float  # when lines were last used
    agreed_s: float  # when lines were last used, or none were there to contradict
    frames: int  # since the track began


class Tracker:
    """Follows the runway through the frames of one flight, in the order of their times.

    Frames that cannot be used are ridden out and say why in `Track.reason`: without pose, without a line, with a time
    that is not a number, repeated, or a little earlier than one before. A time more than two seconds back, a gap longer
    than `coast_s`, or a pose that jumps begins a new track.
    """

    def __init__(self, config: TrackConfig | None = None) -> None:
        self.config = config or TrackConfig()
        self._memory: _Memory | None = None
        self._time_s: float | None = None
        self._last: Track | None = None

    def update(self, frame: Frame, estimate: RunwayEstimate) -> Track:
        """The track after one more frame."""
        refused = self._refused(frame.time_s)
        if refused:
            return self._ridden_out(frame, refused)
        before, self._time_s = self._time_s, frame.time_s
        step_s = None if before is None else frame.time_s - before
        self._last = self._advanced(frame, estimate, step_s)
        return self._last

    def _refused(self, time_s: float) -> str:
        """Why a frame of this time cannot be used, or an empty text."""
        if not np.isfinite(time_s):
            return "the frame's time is not a number"
        if self._time_s is None or time_s < self._time_s - BACK_S:
            return ""
        if time_s == self._time_s:
            return f"the frame's time {time_s:.3f} s was there before"
        return f"the frame is {self._time_s - time_s:.3f} s older than the one before" if time_s < self._time_s else ""

    def _ridden_out(self, frame: Frame, reason: str) -> Track:
        if self._last is None:
            return Track(frame.time_s, TrackState.LOST, {}, reason=reason)
        return replace(self._last, reason=reason, excluded=())

    def _advanced(self, frame: Frame, estimate: RunwayEstimate, step_s: float | None) -> Track:
        memory, why = self._predicted(frame, step_s)
        pose = None if memory is None or memory.aircraft is None else pose_of(memory.aircraft, frame)
        found = {side: estimate.lines[side] for side in SIDES if side in estimate.lines}
        if pose is None and frame.world_from_body is None:
            found = {}
            why = why or "the frame has no pose"
        if memory is None:
            return self._begun(frame, estimate, found, why)
        return self._followed(memory, frame, estimate, found, pose, step_s or 0.0, why)

    def _predicted(self, frame: Frame, step_s: float | None) -> tuple[_Memory | None, str]:
        """The memory at the frame's time; None, and why, where the track ends."""
        memory = self._memory
        if memory is None or step_s is None:
            return None, ""
        if step_s < 0:
            return None, "began anew: the time went back"
        if step_s > self.config.coast_s + ROUNDING_S:
            return None, f"began anew: no frame for {step_s:.1f} s"
        aircraft, jump_m = self._flown(memory.aircraft, frame)
        if jump_m:
            return None, f"began anew: the pose jumped by {jump_m:.0f} m"
        camera = frame.world_from_camera
        state = predict(memory.state, frame.time_s, None if camera is None else camera.translation, self.config)
        return replace(memory, state=state, aircraft=aircraft or memory.aircraft), ""

    def _flown(self, before: Aircraft | None, frame: Frame) -> tuple[Aircraft | None, float]:
        sigma_m = self.config.errors.position_white_m
        if before is None:
            return first_seen(frame, sigma_m), 0.0
        return flown(before, frame, sigma_m)

    def _begun(self, frame: Frame, estimate: RunwayEstimate, found: dict[str, RunwayLine], why: str) -> Track:
        """A new track where there is enough to begin one."""
        self._memory = None
        enough = SIDES if self.config.runway_width_m is None else found
        aircraft = first_seen(frame, self.config.errors.position_white_m)
        if not found or any(side not in found for side in enough) or aircraft is None:
            return Track(frame.time_s, TrackState.LOST, {}, reason=why or estimate.reason)
        line = estimate.lines.get("centre") or next(iter(found.values()))
        state = initial_state(frame.time_s, line, self.config)
        memory = _Memory(state, aircraft, None, frame.time_s, frame.time_s, 0)
        return self._followed(memory, frame, estimate, found, pose_of(aircraft, frame), 0.0, why)

    def _followed(
        self,
        memory: _Memory,
        frame: Frame,
        estimate: RunwayEstimate,
        found: dict[str, RunwayLine],
        pose: Pose | None,
        step_s: float,
        why: str,
    ) -> Track:
        """The predicted memory with the frame's lines, kept for the next frame."""
        gate = None
        if pose is not None and found:
            measured = measure(memory.state, found, estimate.mode, pose, step_s, self.config)
            gate = None if measured is None else gated(memory.state, measured, self.config.gate)
        memory = self._taken(memory, gate, frame, estimate, step_s)
        time_s, config = frame.time_s, self.config
        unseen_s, against_s = time_s - memory.seen_s, time_s - memory.agreed_s
        excluded = () if gate is None else tuple(Flag(name, reason) for name, reason in gate.left_out.items())
        longest = (config.coast_s + ROUNDING_S, config.reacquire_s + ROUNDING_S)
        if unseen_s > longest[0] or against_s > longest[1] or memory.frames == 0:
            self._memory = None
            reason = "; ".join(filter(None, [why, *(flag.reason for flag in excluded)])) or estimate.reason
            return Track(time_s, TrackState.LOST, {}, excluded=excluded, reason=reason)
        self._memory = memory
        used = gate is not None and gate.kept is not None
        return self._told(memory, frame, pose, used, excluded, why or ("" if used else estimate.reason))

    def _taken(
        self, memory: _Memory, gate: Gated | None, frame: Frame, estimate: RunwayEstimate, step_s: float
    ) -> _Memory:
        """The memory after what the gate let through."""
        time_s = frame.time_s
        if gate is None:
            return replace(memory, agreed_s=time_s)
        if gate.kept is None:
            return memory
        state = updated(memory.state, gate.kept.values, gate.kept.design, gate.kept.noise)
        state = shifted(state, gate.kept.x_m, self.config)
        ramp = None
        if estimate.ramp_m is not None and estimate.ramp_sigma_m is not None:
            ramp = estimate.ramp_m, estimate.ramp_sigma_m
        speed = self.config.motion.ship_velocity_m_s
        along = None if speed is None else float(np.array(speed) @ state.along[:2])
        extent = extended(memory.extent, state, seen_extent(frame, estimate, state), ramp, step_s, along)
        return replace(memory, state=state, extent=extent, seen_s=time_s, agreed_s=time_s, frames=memory.frames + 1)

    def _told(
        self, memory: _Memory, frame: Frame, pose: Pose | None, used: bool, excluded: tuple[Flag, ...], reason: str
    ) -> Track:
        """What is said of the memory."""
        extent = memory.extent
        ramp = extent if extent is not None and extent.is_ramp else None
        lateral, vertical, closing = rates_of(memory.state, memory.aircraft, pose, ramp, self.config)
        return Track(
            frame.time_s,
            TrackState.TRACKING if used else TrackState.COASTING,
            lines(memory.state, pose, self.config),
            excluded=excluded,
            ramp_m=None if ramp is None else ramp.near_m,
            ramp_sigma_m=None if ramp is None else ramp.sigma_m,
            lateral_rate_m_s=lateral,
            height_rate_m_s=vertical,
            closing_m_s=closing,
            reason=reason,
        )
