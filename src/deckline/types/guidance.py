"""What follows from all frames so far: the track, and what an autopilot is told."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from deckline.types.diagnostics import Diagnostic, Diagnostics, PoseSource, Scale, Status, message_of
from deckline.types.lines import DepthMode, RunwayLine


@dataclass(frozen=True, eq=False)
class Value:
    """A measured number with its 1-sigma, in the same unit."""

    value: float
    """The measurement."""
    sigma: float
    """Its 1-sigma."""


class TrackState(StrEnum):
    """Whether the runway is followed over frames."""

    TRACKING = "tracking"
    """Lines of this frame updated the track."""
    COASTING = "coasting"
    """No line is measured, for a short time."""
    LOST = "lost"
    """There is no track."""


@dataclass(frozen=True)
class Protection:
    """Errors larger than these, without a flag, have a probability of `risk`."""

    lateral_m: float
    """Bound on the error of the lateral deviation, m."""
    vertical_m: float
    """Bound on the error of the height above deck, m."""
    heading_rad: float | None
    """Bound on the error of the heading error, rad; None: nothing bounds the yaw of a turned camera."""
    distance_m: float | None
    """Bound on the error of the distance to the ramp, m; None: no ramp is known."""
    risk: float
    """Probability that an error without a flag exceeds its bound, per frame and direction."""


@dataclass(frozen=True, eq=False)
class Track:
    """Where the lines are, from all frames so far."""

    time_s: float
    """Of the frame, s."""
    state: TrackState
    """Whether this frame updated the track."""
    lines: dict[str, RunwayLine]
    """Of "left", "right" and "centre", world, as the frame's pose has it, at the touchdown point; {} when lost."""
    protection: Protection | None = None
    """None when lost, or without a pose."""
    flags: Diagnostics = ()
    """What contradicts the track; empty: nothing is known to be wrong."""
    excluded: Diagnostics = ()
    """Measurements of this frame that were left out: LEFT, RIGHT, HEIGHT."""
    ramp_m: NDArray[np.float64] | None = None
    """(3,) near end of the centre line, world, m."""
    ramp_sigma_m: float | None = None
    """1-sigma of `ramp_m` along the deck, m."""
    lateral_rate_m_s: Value | None = None
    """Rate of the lateral deviation, m/s; positive: to the right."""
    height_rate_m_s: Value | None = None
    """Rate of the height above deck, m/s; positive: climbing."""
    deck_acceleration_m_s2: Value | None = None
    """Expected upward acceleration of the deck at the touchdown point, m/s2, by the model of its swing."""
    closing_m_s: Value | None = None
    """Closing speed, m/s; positive: the aircraft comes nearer to the ramp."""
    diagnostics: Diagnostics = ()
    """Why a frame was not used or the track began again."""
    age_s: float = 0.0
    """Since the track began, s; 0: this frame began it."""
    scale_sources: tuple[Scale, ...] = ()
    """What confirms the scale in all its frames."""
    doubts: Diagnostics = ()
    """Why it is not `ok` though nothing is flagged."""


@dataclass(frozen=True, eq=False)
class InWidths:
    """Where the aircraft is in runway widths: what a picture gives whose runway's width is not stated."""

    lateral_deviation: Value
    """Runway widths; positive: right of the centre line."""
    height_above_deck: Value
    """Runway widths."""
    distance_to_ramp: Value | None = None
    """Runway widths along the centre line; positive: the ramp is ahead; None: the ramp is not seen."""


@dataclass(frozen=True, eq=False)
class Guidance:
    """Where the aircraft is relative to the centre line and the glideslope."""

    time_s: float
    """Of the frame, s."""
    status: Status
    """What it is worth."""
    mode: DepthMode
    """Where distances come from."""
    lateral_deviation_m: Value | None = None
    """m; positive: the aircraft is right of the centre line, looking along the landing."""
    heading_error_rad: Value | None = None
    """rad; positive: the nose points right of the centre line."""
    height_above_deck_m: Value | None = None
    """m; above the touchdown point with a track, else above what this frame shows."""
    distance_to_ramp_m: Value | None = None
    """m along the centre line; positive: the ramp is ahead."""
    diagnostics: Diagnostics = ()
    """Why something is missing."""
    vertical_deviation_m: Value | None = None
    """m; positive: above the glideslope."""
    lateral_deviation_rad: Value | None = None
    """rad at the aim point, as a localizer shows it; positive: right."""
    vertical_deviation_rad: Value | None = None
    """rad at the aim point; positive: above."""
    distance_to_touchdown_m: Value | None = None
    """m along the centre line; positive: the aim point is ahead."""
    lateral_rate_m_s: Value | None = None
    """Rate of the lateral deviation, m/s; positive: to the right."""
    height_rate_m_s: Value | None = None
    """Rate of the height above deck, m/s; negative in a descent."""
    deck_acceleration_m_s2: Value | None = None
    """Expected upward acceleration of the deck at the touchdown point, m/s2, by the track's model of its swing."""
    closing_m_s: Value | None = None
    """Closing speed, m/s; positive: the ramp comes nearer."""
    protection: Protection | None = None
    """Bounds on its errors; None: not known."""
    track: TrackState | None = None
    """State of the track; None: from this frame alone."""
    flags: Diagnostics = ()
    """What is found wrong; empty: nothing is known to be wrong."""
    glideslope_rad: float | None = None
    """The wanted glideslope above the deck, rad."""
    scale_sources: tuple[Scale, ...] = ()
    """What confirms the scale."""
    pose_source: PoseSource | None = None
    """Where the pose comes from; None: there is none."""
    in_widths: InWidths | None = None
    """Lengths in runway widths, where metres are not known; the lengths in metres are then None."""

    @property
    def reason(self) -> str:
        """Why something is missing, for people."""
        return message_of(self.diagnostics)

    def with_flag(self, flag: Diagnostic) -> "Guidance":
        """The same with one more contradiction, and its reason."""
        return replace(self, flags=(*self.flags, flag), diagnostics=(*self.diagnostics, flag))
