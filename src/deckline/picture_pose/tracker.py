"""The pose from the picture over frames: one filter per flight, of constant memory and bounded time per frame.

The horizon is found in the background and is a fraction of a second old when it arrives. The filter then goes back to
the frame that it belongs to, and through the lines of the frames since.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import USUAL_WIDTH_M, RunConfig
from deckline.dehaze.horizon import find_horizon
from deckline.dehaze.horizon_search import ANSWER_S, HorizonSearch
from deckline.geometry import Camera, camera_mount
from deckline.picture_pose.answer import estimate_of, in_widths, track_of, with_pose
from deckline.picture_pose.fit import check_height, fit_pose
from deckline.picture_pose.forecast import PictureForecast
from deckline.picture_pose.integrity import Evidence, bias_flag, unverified_reasons
from deckline.picture_pose.memory import (
    Picture,
    TrackMemory,
    note_contradictions,
    select_lines,
    sight_level_horizon,
    start_ramp,
    use_horizon,
    use_lines,
)
from deckline.picture_pose.model import Mount
from deckline.picture_pose.ramp import sight_ramp
from deckline.picture_pose.sights import LevelSight, LineSight, sight_lines
from deckline.picture_pose.states import MIN_LEVEL_RAD, Belief, predict, shared_sigmas
from deckline.trackers import UNUSABLE
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
MIN_HORIZONS = 2  # that agree: one alone may be a cloud's edge
HORIZON_VALID_S = 3.0  # a horizon that agreed so long ago still confirms the roll
STEADY_S = 1.0  # without a turn that no aircraft makes


@dataclass(frozen=True, eq=False)
class PictureAnswer:
    """What the picture gives of one frame."""

    frame: Frame
    """The frame with the pose of the picture; as it was where there is none."""
    estimate: RunwayEstimate
    """Its estimate with the lines in the runway's frame, or with the reason why there are none."""
    track: Track | None
    """Of the frames so far; None: every frame is for itself."""


class PictureTracker:
    """Follows the aircraft in the runway's frame by its pictures alone, through the frames of one flight.

    Their times are finite and increase: `Tracker.predict` names those that do not.

    Args:
        config: what is stated of runway, camera and aircraft; `tracking` as for a navigation unit's track.
    """

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        self._search = HorizonSearch(config.tracking.horizon_s)
        self._mounting = camera_mount()  # whose arrays `_mount` has
        self._mount = Mount.of(self._mounting)
        self.reset()

    def reset(self) -> None:
        """Start another flight: forget all frames."""
        self._search.reset()
        self._memory: TrackMemory | None = None
        self._camera: Camera | None = None
        self._changed_s = -np.inf  # when a track ended by a contradiction; the tracks after it are in doubt
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
            flags: of the frame's monitors; they join those of the track.
        """
        given = frame
        if not frame.camera.known:
            frame = replace(frame, camera=Camera.assumed(frame.camera.width, frame.camera.height))
        if not self.config.tracking.enabled:
            return self._answer_alone(given, self._sight(frame, detection, estimate, flags))
        if frame.camera != self._camera:
            self.reset()
        self._camera = frame.camera
        picture = self._sight(frame, detection, estimate, flags)
        found = self._search.take(frame.time_s)
        if found is not None and self._memory is not None:
            use_horizon(self._memory, found, picture, self.config)
        diagnostics = self._advance(picture)
        self._search_horizon(picture)
        if self._memory is None:
            return PictureAnswer(given, estimate, replace(_lost(frame, diagnostics), flags=flags))
        return self._answer(self._memory, picture, diagnostics)

    def _sight(self, frame: Frame, detection: Detection, estimate: RunwayEstimate, flags: Diagnostics) -> Picture:
        is_usable = not any(flag.reason in UNUSABLE for flag in flags)
        sights = sight_lines(frame.camera, detection, estimate.pixel_lines) if is_usable else {}
        self._shared = shared_sigmas(frame.camera, self.config)
        if frame.body_from_camera is not self._mounting:
            self._mounting, self._mount = frame.body_from_camera, Mount.of(frame.body_from_camera)
        attitude = None if frame.level_from_body is None else frame.level_from_body.as_matrix()
        level = LevelSight(None, attitude, max(self.config.sensors.attitude_white_rad, MIN_LEVEL_RAD))
        return Picture(frame, detection, estimate, sights, self._shared, self._mount, level, flags)

    def forecast(self) -> PictureForecast | None:
        """Predicts where the aircraft is after the last frame; None without a track, and in runway widths."""
        memory = self._memory
        if memory is None or self.config.deck.width_m is None or self._last is None:
            return None
        return PictureForecast(memory.belief, memory.seen_s, memory.has_ramp, self._shared, self._last, self.config)

    def _answer_alone(self, given: Frame, picture: Picture) -> PictureAnswer:
        """One frame for itself: its horizon is found at once."""
        frame, estimate, config = picture.frame, picture.estimate, self.config
        found = find_horizon(frame.image_rgb) if len(picture.sights) == len(SIDES) else None
        level = replace(picture.level, horizon=sight_level_horizon(frame.camera, found))
        belief = self._fit(picture, level)
        if isinstance(belief, Diagnostic) and belief.reason is Reason.ATTITUDE:
            level, belief = LevelSight(), self._fit(picture, LevelSight())
        if isinstance(belief, Diagnostic):
            return PictureAnswer(given, replace(estimate, diagnostics=(*estimate.diagnostics, belief)), None)
        ramp = sight_ramp(frame, picture.detection, estimate, belief, config)
        if ramp is not None:
            belief = start_ramp(belief, ramp, picture.mount)
        evidence = Evidence(0.0, level.is_known, ramp is not None, True, 0.0, np.inf)
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
        memory.belief = predict(memory.belief, time_s, picture.shared, self.config.sensors.drift_s)
        if contradiction := check_height(memory.belief):
            return self._restart(picture, contradiction.message)
        lines, excluded = select_lines(memory.belief, picture.sights, picture.mount, tracking.gate_sigma)
        weight = -float(np.expm1(-step_s / tracking.reacquire_s))
        is_back = note_contradictions(memory, picture, lines, excluded, weight)
        if why := self._contradiction(memory, picture, lines, is_back):
            return self._restart(picture, why)
        if lines:
            use_lines(memory, picture, lines, step_s, self.config)
            if contradiction := check_height(memory.belief):
                return self._restart(picture, contradiction.message)
        elif not picture.sights:
            memory.consistent_s = time_s
        return ()

    def _restart(self, picture: Picture, why: str) -> Diagnostics:
        """A new track in place of one that cannot go on."""
        self._changed_s = picture.frame.time_s
        return (Diagnostic(Reason.RESTARTED, f"began anew: {why}"), *self._start(picture))

    def _contradiction(self, memory: TrackMemory, picture: Picture, lines: dict[str, LineSight], is_back: bool) -> str:
        """Why the track cannot go on; empty: it can.

        A line that is left out may be another marking, or the track's own lines were. While it is left out the
        covariance grows, so that a line as wrong as before passes the gate again: neither can be trusted then.
        """
        time_s, limit_s = picture.frame.time_s, self.config.tracking.reacquire_s
        if is_back:
            return "a line that was left out is back"
        if len(picture.sights) == len(SIDES) and any(time_s - since > limit_s for since in memory.excluded_s.values()):
            return "a line contradicts the track for too long"
        if picture.sights and not lines and time_s - memory.consistent_s > limit_s:
            return "the lines contradict the track"
        return ""

    def _start(self, picture: Picture) -> Diagnostics:
        """A new track where both lines are seen; returns why there is none."""
        self._memory = None
        if not picture.sights:
            return ()
        belief, time_s = self._fit(picture, picture.level), picture.frame.time_s
        if isinstance(belief, Diagnostic):
            return (belief,)
        agreed_s = -np.inf if picture.level.attitude is None else time_s
        self._memory = TrackMemory(belief, time_s, time_s, time_s, agreed_s=agreed_s)
        ramp = sight_ramp(picture.frame, picture.detection, picture.estimate, belief, self.config)
        if ramp is not None:
            self._memory.belief, self._memory.has_ramp = start_ramp(belief, ramp, picture.mount), True
        return ()

    def _search_horizon(self, picture: Picture) -> None:
        """Begin the search in a frame whose lines the filter used."""
        memory, frame = self._memory, picture.frame
        if memory is None or memory.seen_s != frame.time_s or frame.camera.has_distortion:
            return
        if self._search.is_due(frame.time_s):
            self._search.start(frame.time_s, frame.image_rgb)
            memory.anchor, memory.anchor_mount, memory.since = memory.belief, picture.mount, []

    def _answer(self, memory: TrackMemory, picture: Picture, diagnostics: Diagnostics) -> PictureAnswer:
        frame, belief, config = picture.frame, memory.belief, self.config
        time_s, age_s = frame.time_s, frame.time_s - memory.start_s
        is_recent = time_s - memory.agreed_s <= HORIZON_VALID_S + ANSWER_S
        has_level = is_recent and (memory.horizons >= MIN_HORIZONS or picture.level.attitude is not None)
        is_steady = time_s - memory.turned_s > STEADY_S
        changed_s = time_s - self._changed_s
        evidence = Evidence(age_s, has_level, memory.has_ramp, is_steady, memory.contradicted, changed_s)
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


def _lost(frame: Frame, diagnostics: Diagnostics) -> Track:
    return Track(frame.time_s, TrackState.LOST, {}, diagnostics=diagnostics)
