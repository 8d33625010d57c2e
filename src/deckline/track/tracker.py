"""The runway over frames: one filter per flight, of constant memory and time per frame."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.track.extent import move_ramp_to_deck, runway_prior, update_extent, visible_extent
from deckline.track.filter import predict, shift_reference, track_lines, update
from deckline.track.forecast import Forecast, TrackMemory, describe_track
from deckline.track.integrity import FaultMonitor, check_order
from deckline.track.measurement import GatedMeasurement, Measurement, measure
from deckline.track.motion import advance_aircraft, start_aircraft
from deckline.track.prior_tests import is_young
from deckline.track.protection import fault_gains
from deckline.track.stated_width import compare_width
from deckline.track.states import SENSOR_FLOOR, FilterState, initial_state
from deckline.trackers import UNUSABLE, noise_inflation
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

Array = NDArray[np.float64]
NEW_FLIGHT_S = 2.0  # a time this far back is another flight, not a late frame
CAUSE_SIGMA = 3.0  # of the stated width, beyond which it is named as the cause of lines that begin no track
ROUNDING_S = 1e-6  # of sums of times
MAX_SPEED_SIGMA_M_S = 3.0  # of the runway along its lines, beyond which its speed counts as unknown


@dataclass(frozen=True, eq=False)
class Prediction:
    """The track at the time of a frame, from the frames before: made once, for the detector's prior and the update."""

    frame: Frame
    """The frame."""
    refused: Diagnostic | None = None
    """Why the frame's time cannot be used; None: it can."""
    step_s: float = 0.0
    """Since the frame before, s; 0: there is none; negative: another flight begins."""
    memory: TrackMemory | None = None
    """The track's memory with state and aircraft at the frame's time, and its camera; None: no track continues."""
    runway: RunwayPrior | None = None
    """Where the detector should expect the runway, world; None: not known."""
    restart: Diagnostic | None = None
    """Why the track ends here; None: it does not."""
    is_new_flight: bool = False
    """Whether nothing learned from the frames before holds in this frame."""


@dataclass(frozen=True, eq=False)
class FrameContext:
    """One frame as the track sees it."""

    frame: Frame
    estimate: RunwayEstimate
    lines: dict[str, RunwayLine]  # the edge lines that may be used
    step_s: float  # since the frame before; 0 at the beginning
    flags: Diagnostics  # found before any filtering
    diagnostics: Diagnostics  # why the frame, or the track before it, is not used
    frames: int = 1  # whose pictures the lines are from


class Tracker:
    """Follows the runway through the frames of one flight, in the order of their times.

    Frames without a pose or a line are bridged; `Track.diagnostics` gives the reason. A frame whose time is not a
    number, repeated, or a little earlier than the one before changes nothing, and its `Track` is LOST. A time more than
    two seconds back, a gap longer than `tracking.coast_s`, or a pose that jumps starts a new track.

    `Track.flags` names what lasts and would mislead; a single measurement that was left out is in `Track.excluded`.
    """

    def __init__(self, config: RunConfig | None = None) -> None:
        config = config or RunConfig()
        self.config = replace(config, sensors=config.sensors.with_floor(*SENSOR_FLOOR))
        self.reset()

    def reset(self) -> None:
        """Start another flight: forget all frames."""
        self._memory: TrackMemory | None = None
        self._faults = FaultMonitor()
        self._time_s: float | None = None  # of the last frame that was used
        self._last: Track | None = None

    def predict(self, frame: Frame) -> Prediction:
        """The track at the time of the next frame; changes nothing."""
        refused, memory, time_s = self._check_time(frame.time_s), self._memory, frame.time_s
        if refused is not None or self._time_s is None:
            return Prediction(frame, refused)
        step_s = time_s - self._time_s
        if step_s < 0:
            return Prediction(frame, None, step_s, restart=self._end("the time went back"), is_new_flight=True)
        if memory is None:
            return Prediction(frame, None, step_s)
        if step_s > self.config.tracking.coast_s + ROUNDING_S:
            return Prediction(frame, None, step_s, restart=self._end(f"no frame for {step_s:.1f} s"))
        camera = frame.world_from_camera
        state = predict(memory.state, time_s, None if camera is None else camera.translation, self.config)
        found = Prediction(frame, None, step_s, runway=self._predict_runway(replace(memory, state=state), frame))
        aircraft, jump_m = advance_aircraft(memory.aircraft, frame, self.config.sensors.position_white_m)
        if jump_m:
            return replace(found, restart=self._end(f"the pose jumped by {jump_m:.0f} m"), is_new_flight=True)
        return replace(
            found, memory=replace(memory, state=state, aircraft=aircraft or memory.aircraft, camera=frame.camera)
        )

    def update(
        self, prediction: Prediction, estimate: RunwayEstimate, flags: Diagnostics = (), frames: int = 1
    ) -> Track:
        """The track after one more frame.

        Args:
            prediction: by `predict`, of the frame.
            estimate: lines of the frame alone.
            flags: of the frame's monitors; they join those of the track.
            frames: whose pictures the lines are from, this one's and those right before it.
        """
        time_s = prediction.frame.time_s
        if prediction.refused is not None:
            return Track(time_s, TrackState.LOST, {}, diagnostics=(prediction.refused,))
        self._time_s = time_s
        unusable = tuple(flag for flag in flags if flag.reason in UNUSABLE)
        track = self._advance(prediction, estimate, unusable, frames)
        self._last = replace(track, flags=track.flags + tuple(flag for flag in flags if flag not in unusable))
        return self._last

    @property
    def is_flagged(self) -> bool:
        """Whether anything contradicts the track after the last frame."""
        return self._last is not None and bool(self._last.flags)

    def forecast(self) -> Forecast | None:
        """Predicts the track after the last frame to later times; None when it is lost."""
        return None if self._memory is None or self._last is None else Forecast(self._memory, self._last, self.config)

    def _check_time(self, time_s: float) -> Diagnostic | None:
        """Why a frame of this time cannot be used."""
        if not np.isfinite(time_s):
            return Diagnostic(Reason.BAD_TIME, "the frame's time is not a number")
        if self._time_s is None or time_s < self._time_s - NEW_FLIGHT_S or time_s > self._time_s:
            return None
        if time_s == self._time_s:
            return Diagnostic(Reason.BAD_TIME, f"the frame's time {time_s:.3f} s was there before")
        return Diagnostic(Reason.BAD_TIME, f"the frame is {self._time_s - time_s:.3f} s older than the one before")

    def _end(self, why: str) -> Diagnostic | None:
        """Why the track ends; None: there is none, or one of a single frame: unrelated frames lose nothing."""
        memory = self._memory
        return None if memory is None or memory.start_s == self._time_s else _restart(why)

    def _predict_runway(self, memory: TrackMemory, frame: Frame) -> RunwayPrior | None:
        """Where the runway should be in the frame; None when no line was used for too long."""
        unseen_s = frame.time_s - memory.seen_s
        if memory.extent is None or unseen_s > self.config.tracking.coast_s + ROUNDING_S:
            return None
        lines = track_lines(memory.state, memory.aircraft.camera_pose(frame), 0.0, self.config)
        return runway_prior(memory.state, memory.extent, lines, unseen_s)

    def _advance(self, prediction: Prediction, estimate: RunwayEstimate, unusable: Diagnostics, frames: int) -> Track:
        if prediction.is_new_flight:  # or another place, where no memory holds
            self._memory, self._faults = None, FaultMonitor()
        frame, diagnostics = prediction.frame, () if prediction.restart is None else (prediction.restart,)
        lines = {side: estimate.lines[side] for side in SIDES if side in estimate.lines}
        if frame.missing is not None:
            lines, diagnostics = {}, diagnostics or (frame.missing,)
        order = None if unusable else check_order(lines)
        flags = unusable if order is None else (order,)
        if flags:
            lines, diagnostics = {}, (*diagnostics, *flags)
        if prediction.memory is None:
            return self._start_track(FrameContext(frame, estimate, lines, 0.0, flags, diagnostics, frames))
        context = FrameContext(frame, estimate, lines, prediction.step_s, flags, diagnostics, frames)
        return self._continue_track(prediction.memory, context)

    def _start_track(self, context: FrameContext) -> Track:
        """A new track where both lines are seen: one alone may be any line of the deck."""
        self._faults = self._faults.restart(_comparable(self._memory, self.config), self.config)
        self._memory = None
        frame, lines = context.frame, context.lines
        aircraft = start_aircraft(frame, self.config.sensors.position_white_m)
        if len(lines) < len(SIDES) or aircraft is None:
            return _lost_track(context, None, context.flags)
        line = context.estimate.lines.get("centre") or lines["left"]
        bare = initial_state(frame.time_s, line, None, self.config)
        visible = visible_extent(frame, context.estimate, bare)
        near = context.estimate.ramp_m if visible is None else bare.point_m + visible[0] * bare.along
        state = initial_state(frame.time_s, line, near, self.config)
        self._faults = self._faults.forget()
        return self._continue_track(
            TrackMemory(state, aircraft, None, -np.inf, frame.time_s, frame.time_s, frame.camera), context
        )

    def _continue_track(self, memory: TrackMemory, context: FrameContext) -> Track:
        """Update the predicted memory with the frame's lines and store it for the next frame."""
        config, time_s = self.config, context.frame.time_s
        pose, gated = memory.aircraft.camera_pose(context.frame), None
        if pose is not None and context.lines:
            measurement = measure(memory.state, context.lines, context.estimate.mode, pose, config)
            gated = self._faults.gate(memory.state, measurement, config)
            if memory.start_s == time_s and (flags := self._start_flags(memory, measurement, gated, context)):
                return _lost_track(context, gated, context.flags + flags)
        self._faults = self._faults.update(gated, time_s, context.step_s, config)
        memory = self._update_memory(memory, gated, context)
        unseen_s, inconsistent_s = time_s - memory.seen_s, time_s - memory.consistent_s
        coast_s = config.tracking.coast_s if memory.seen_s > memory.start_s else 0.0  # what one frame saw may be noise
        if unseen_s > coast_s + ROUNDING_S or inconsistent_s > config.tracking.reacquire_s + ROUNDING_S:
            self._memory = None
            if np.isfinite(memory.seen_s):
                self._faults = self._faults.restart(_comparable(memory, config), config)
            flags = context.flags + self._faults.active_flags(gated, None, None, None, time_s, config)
            return _lost_track(context, gated, flags)
        self._memory = memory
        aircraft_m = None if pose is None else pose.position_m
        flags = context.flags + self._faults.active_flags(
            gated, memory.state, memory.extent, aircraft_m, time_s, config
        )
        used = gated is not None and gated.accepted is not None
        track = describe_track(memory, pose, config)
        return replace(
            track,
            state=TrackState.TRACKING if used else TrackState.COASTING,
            flags=flags,
            excluded=() if gated is None else gated.excluded,
            diagnostics=context.diagnostics,
        )

    def _start_flags(
        self, memory: TrackMemory, measurement: Measurement, gated: GatedMeasurement, context: FrameContext
    ) -> Diagnostics:
        """Why there is no track that could begin with these lines: the stated width, else what was left out."""
        width = compare_width(memory.state, measurement, context.estimate.mode, self.config)
        limit = CAUSE_SIGMA if gated.excluded else self.config.integrity.alarm_sigma
        self._faults = self._faults.update_width(width, limit)
        flag = None if width is None else width.flag(limit)
        return gated.excluded if flag is None else (flag,)

    def _update_memory(self, memory: TrackMemory, gated: GatedMeasurement | None, context: FrameContext) -> TrackMemory:
        """The memory after the part of the measurement that passed the gate."""
        time_s = context.frame.time_s
        if gated is None:
            return replace(memory, consistent_s=time_s)
        if gated.accepted is None:
            return memory
        inflation = noise_inflation(context.step_s, time_s - memory.seen_s, context.frames)
        state = update(memory.state, gated.accepted.innovation, gated.accepted.design, inflation * gated.accepted.noise)
        state = shift_reference(state, gated.accepted.x_m)
        near_m = 0.0 if memory.extent is None else float(state.local(memory.extent.near_m)[0])
        ramp = move_ramp_to_deck(context.frame, context.estimate, state, fault_gains(state, near_m, self.config))
        speed = self.config.deck.ship_velocity_m_s
        along = None if speed is None else float(np.array(speed) @ state.along[:2])
        visible = visible_extent(context.frame, context.estimate, state)
        step_s = 0.0 if memory.extent is None else time_s - memory.seen_s
        extent = update_extent(memory.extent, state, visible, ramp, step_s, along, self.config.tracking.gate_sigma)
        return replace(memory, state=state, extent=extent, seen_s=time_s, consistent_s=time_s)


def ship_velocity(prediction: Prediction | None, config: RunConfig) -> Array:
    """Velocity of the runway, north and east, m/s (2,): stated, else along its lines by the track; 0 if not known."""
    if config.deck.ship_velocity_m_s is not None:
        return np.array(config.deck.ship_velocity_m_s)
    memory = None if prediction is None else prediction.memory
    if memory is None or memory.extent is None or memory.extent.speed.sigma > MAX_SPEED_SIGMA_M_S:
        return np.zeros(2)
    return np.asarray(memory.extent.speed_m_s * memory.state.along[:2])


def _comparable(memory: TrackMemory | None, config: RunConfig) -> FilterState | None:
    """The state of an ended track that the next one must agree with; None: it was too young to be believed itself."""
    if memory is None or is_young(memory.state, memory.seen_s - memory.start_s, config):
        return None
    return memory.state


def _lost_track(context: FrameContext, gated: GatedMeasurement | None, flags: Diagnostics) -> Track:
    excluded = () if gated is None else gated.excluded
    diagnostics = context.diagnostics + excluded
    return Track(context.frame.time_s, TrackState.LOST, {}, flags=flags, excluded=excluded, diagnostics=diagnostics)


def _restart(why: str) -> Diagnostic:
    return Diagnostic(Reason.RESTARTED, f"began anew: {why}")
