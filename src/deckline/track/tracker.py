"""The runway over frames: one filter per flight, of constant memory and time per frame."""

from dataclasses import dataclass, replace

import numpy as np

from deckline.config import RunConfig
from deckline.track.extent import (
    locate_ramp,
    runway_prior,
    update_extent,
    visible_extent,
)
from deckline.track.filter import (
    error_sigmas,
    initial_state,
    predict,
    shift_reference,
    track_lines,
    update,
)
from deckline.track.forecast import Forecast, TrackMemory, describe_track
from deckline.track.frozen import FrozenImageMonitor
from deckline.track.integrity import FaultMonitor, check_order
from deckline.track.measurement import GatedMeasurement, measure, select_consistent
from deckline.track.motion import Aircraft, Pose, advance_aircraft, start_aircraft
from deckline.types import (
    SIDES,
    Diagnostic,
    Diagnostics,
    Frame,
    Reason,
    RunwayEstimate,
    RunwayLine,
    RunwayPrior,
    Track,
    TrackState,
)

NEW_FLIGHT_S = 2.0  # a time this far back is another flight, not a late frame
MOST_REFUSED = 10  # frames in a row: without a time nobody knows how old the track is
# Frames so close together err alike, so that they count as one: points are off the same way, and a deck moves otherwise
# than as an oscillation. 30 full frames a second contradict a stated width in half of the nominal flights.
CORRELATION_TIME_S = 0.33
ROUNDING_S = 1e-6  # of sums of times
MIN_SIGMA_RAD, MIN_SIGMA_M, MIN_SHARE = 1e-5, 1e-3, 1e-4  # floors of exact sensors
FROZEN = Diagnostic(Reason.FROZEN, "the camera shows the same picture while time goes on")


@dataclass(frozen=True, eq=False)
class FrameContext:
    """One frame as the track sees it."""

    frame: Frame
    estimate: RunwayEstimate
    lines: dict[str, RunwayLine]  # the edge lines that may be used
    step_s: float  # since the frame before; 0 at the beginning
    flags: Diagnostics  # found before any filtering
    diagnostics: Diagnostics  # why the frame, or the track before it, is not used


class Tracker:
    """Follows the runway through the frames of one flight, in the order of their times.

    Frames that cannot be used are bridged and say why in `Track.diagnostics`: without pose, without a line, with a time
    that is not a number, repeated, or a little earlier than one before. A time more than two seconds back, a gap longer
    than `tracking.coast_s`, or a pose that jumps starts a new track.

    `Track.flags` names what lasts and would mislead; a single measurement that was left out is in `Track.excluded`.
    """

    def __init__(self, config: RunConfig | None = None) -> None:
        config = config or RunConfig()
        sensors = config.sensors.with_floor(MIN_SIGMA_RAD, MIN_SIGMA_M, MIN_SHARE)
        self.config = replace(config, sensors=sensors)
        self._memory: TrackMemory | None = None
        self._faults = FaultMonitor()
        self._images = FrozenImageMonitor()
        self._time_s: float | None = None
        self._refused = 0  # frames in a row whose time cannot be used
        self._last: Track | None = None

    def update(self, frame: Frame, estimate: RunwayEstimate) -> Track:
        """The track after one more frame."""
        refused = self._check_time(frame.time_s)
        if refused is not None:
            self._refused += 1
            if self._last is None or self._refused > MOST_REFUSED:
                return Track(frame.time_s, TrackState.LOST, {}, diagnostics=(refused,))
            state = TrackState.COASTING if self._last.state is TrackState.TRACKING else self._last.state
            return replace(self._last, state=state, diagnostics=(refused,), excluded=())
        self._refused = 0
        before, self._time_s = self._time_s, frame.time_s
        self._last = self._advance(frame, estimate, None if before is None else frame.time_s - before)
        return self._last

    def forecast(self) -> Forecast | None:
        """What the track after the last frame says of later times; None when it is lost."""
        return None if self._memory is None or self._last is None else Forecast(self._memory, self._last, self.config)

    def runway_prior(self, frame: Frame) -> RunwayPrior | None:
        """Where the runway should be in the next frame, before its picture is searched; None when the track is lost."""
        memory = self._memory
        if memory is None or memory.extent is None or self._check_time(frame.time_s) is not None:
            return None
        step_s = frame.time_s - memory.seen_s
        if not 0 <= step_s <= self.config.tracking.coast_s + ROUNDING_S:
            return None
        camera = frame.world_from_camera
        state = predict(memory.state, frame.time_s, None if camera is None else camera.translation, self.config)
        lines = track_lines(state, memory.aircraft.camera_pose(frame), 0.0, self.config)
        return runway_prior(state, memory.extent, lines, step_s)

    def _check_time(self, time_s: float) -> Diagnostic | None:
        """Why a frame of this time cannot be used."""
        if not np.isfinite(time_s):
            return Diagnostic(Reason.BAD_TIME, "the frame's time is not a number")
        if self._time_s is None or time_s < self._time_s - NEW_FLIGHT_S or time_s > self._time_s:
            return None
        if time_s == self._time_s:
            return Diagnostic(Reason.BAD_TIME, f"the frame's time {time_s:.3f} s was there before")
        return Diagnostic(Reason.BAD_TIME, f"the frame is {self._time_s - time_s:.3f} s older than the one before")

    def _advance(self, frame: Frame, estimate: RunwayEstimate, step_s: float | None) -> Track:
        memory, restart = self._predict(frame, step_s)
        diagnostics = () if restart is None else (restart,)
        self._images = self._images.update(frame, estimate)
        lines = {side: estimate.lines[side] for side in SIDES if side in estimate.lines}
        if frame.missing is not None:
            lines, diagnostics = {}, diagnostics or (frame.missing,)
        flag = FROZEN if self._images.is_frozen else check_order(lines)
        if flag is not None:
            lines, diagnostics = {}, (*diagnostics, flag)
        flags = () if flag is None else (flag,)
        if memory is not None:
            return self._continue_track(memory, FrameContext(frame, estimate, lines, step_s or 0.0, flags, diagnostics))
        return self._start_track(FrameContext(frame, estimate, lines, 0.0, flags, diagnostics))

    def _predict(self, frame: Frame, step_s: float | None) -> tuple[TrackMemory | None, Diagnostic | None]:
        """The memory at the frame's time; None, and why, where the track ends."""
        memory = self._memory
        if memory is None or step_s is None:
            return None, None
        young = frame.time_s - step_s == memory.start_s  # one frame is no track: unrelated frames lose nothing
        if step_s < 0:
            self._forget()
            return None, None if young else _restart("the time went back")
        if step_s > self.config.tracking.coast_s + ROUNDING_S:
            return None, None if young else _restart(f"no frame for {step_s:.1f} s")
        aircraft, jump_m = advance_aircraft(memory.aircraft, frame, self.config.sensors.position_white_m)
        if jump_m:
            self._forget()
            return None, None if young else _restart(f"the pose jumped by {jump_m:.0f} m")
        camera = frame.world_from_camera
        state = predict(memory.state, frame.time_s, None if camera is None else camera.translation, self.config)
        return replace(memory, state=state, aircraft=aircraft or memory.aircraft), None

    def _forget(self) -> None:
        """Another flight, or another place: what was learned says nothing of it."""
        self._memory, self._faults = None, FaultMonitor()

    def _start_track(self, context: FrameContext, aircraft: Aircraft | None = None) -> Track:
        """A new track where both lines are seen: one alone may be any line of the deck.

        Args:
            aircraft: whose motion is known from before; None: its pose is all that is known.
        """
        before, self._memory = self._memory, None
        self._faults = self._faults.restart(None if before is None else before.state, self.config)
        frame, lines = context.frame, context.lines
        aircraft = aircraft or start_aircraft(frame, self.config.sensors.position_white_m)
        if len(lines) < len(SIDES) or aircraft is None:
            return _lost_track(context, None, context.flags)
        line = context.estimate.lines.get("centre") or lines["left"]
        bare = initial_state(frame.time_s, line, None, self.config)
        visible = visible_extent(frame, context.estimate, bare)
        near = context.estimate.ramp_m if visible is None else bare.point_m + visible[0] * bare.along
        state = initial_state(frame.time_s, line, near, self.config)
        return self._continue_track(TrackMemory(state, aircraft, None, -np.inf, frame.time_s, frame.time_s), context)

    def _continue_track(self, memory: TrackMemory, context: FrameContext) -> Track:
        """Update the predicted memory with the frame's lines and keep it for the next frame."""
        config, time_s = self.config, context.frame.time_s
        pose, gated = memory.aircraft.camera_pose(context.frame), None
        if pose is not None and context.lines:
            measurement = measure(memory.state, context.lines, context.estimate.mode, pose, config)
            gated = select_consistent(memory.state, measurement, config.tracking.gate_sigma)
            if self._faults.is_readmitted(gated, time_s, config):
                self._faults = self._faults.forget()
                back = _restart("a measurement that was left out is back")
                return self._start_track(replace(context, diagnostics=(*context.diagnostics, back)), memory.aircraft)
        if gated is not None and gated.excluded and memory.start_s == time_s:  # nothing of a track is there to be right
            self._faults = self._faults.forget()
            return _lost_track(context, gated, context.flags + gated.excluded)
        self._faults = self._faults.update(gated, time_s, context.step_s, config)
        memory = self._update_memory(memory, gated, context)
        unseen_s, inconsistent_s = time_s - memory.seen_s, time_s - memory.consistent_s
        coast_s = config.tracking.coast_s if memory.seen_s > memory.start_s else 0.0  # what one frame saw may be noise
        if unseen_s > coast_s + ROUNDING_S or inconsistent_s > config.tracking.reacquire_s + ROUNDING_S:
            self._memory = None
            if np.isfinite(memory.seen_s):
                self._faults = self._faults.restart(memory.state, config)
            flags = context.flags + self._faults.active_flags(gated, None, None, None, time_s, config)
            return _lost_track(context, gated, flags)
        self._memory = memory
        aircraft_m = None if pose is None else pose.position_m
        flags = context.flags + self._faults.active_flags(
            gated, memory.state, memory.extent, aircraft_m, time_s, config
        )
        return self._track(memory, context, pose, gated, flags)

    def _update_memory(self, memory: TrackMemory, gated: GatedMeasurement | None, context: FrameContext) -> TrackMemory:
        """The memory after the part of the measurement that passed the gate."""
        time_s = context.frame.time_s
        if gated is None:
            return replace(memory, consistent_s=time_s)
        if gated.kept is None:
            return memory
        alike = CORRELATION_TIME_S / context.step_s if 0 < context.step_s < CORRELATION_TIME_S else 1.0
        state = update(memory.state, gated.kept.innovation, gated.kept.design, alike * gated.kept.noise)
        state = shift_reference(state, gated.kept.x_m)
        ramp = locate_ramp(context.frame, context.estimate, state, error_sigmas(self.config) ** 2)
        speed = self.config.deck.ship_velocity_m_s
        along = None if speed is None else float(np.array(speed) @ state.along[:2])
        visible = visible_extent(context.frame, context.estimate, state)
        step_s = 0.0 if memory.extent is None else time_s - memory.seen_s
        extent = update_extent(memory.extent, state, visible, ramp, step_s, along, self.config.tracking.gate_sigma)
        return replace(memory, state=state, extent=extent, seen_s=time_s, consistent_s=time_s)

    def _track(
        self,
        memory: TrackMemory,
        context: FrameContext,
        pose: Pose | None,
        gated: GatedMeasurement | None,
        flags: Diagnostics,
    ) -> Track:
        used = gated is not None and gated.kept is not None
        return replace(
            describe_track(memory, pose, self.config),
            state=TrackState.TRACKING if used else TrackState.COASTING,
            flags=flags,
            excluded=() if gated is None else gated.excluded,
            diagnostics=context.diagnostics,
        )


def _lost_track(context: FrameContext, gated: GatedMeasurement | None, flags: Diagnostics) -> Track:
    excluded = () if gated is None else gated.excluded
    diagnostics = context.diagnostics + excluded
    return Track(context.frame.time_s, TrackState.LOST, {}, flags=flags, excluded=excluded, diagnostics=diagnostics)


def _restart(why: str) -> Diagnostic:
    return Diagnostic(Reason.RESTARTED, f"began anew: {why}")
