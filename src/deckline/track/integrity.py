"""What contradicts a track: memory of measurements left out, of the track before, and of a wrong stated width."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.geometry import wrap_angle
from deckline.track.extent import Extent
from deckline.track.filter import predict
from deckline.track.measurement import (
    NAMES,
    GatedMeasurement,
    Measurement,
    has_returned,
    is_consistent,
    select_consistent,
)
from deckline.track.prior_tests import bias_flag, drift_flag
from deckline.track.stated_width import WidthTest
from deckline.track.states import FilterState, States
from deckline.types import Diagnostic, Diagnostics, Reason, RunwayLine

Array = NDArray[np.float64]
MIN_RESIDUALS = 10
WHAT = dict(NAMES.values())  # may be left out, in words
MAX_SPACING_SIGMA_M = 1.0  # of a track whose lines are compared with those of the next track
CHANGE_SIGMA = 4.0  # flags a new track against the one before; few tracks end, so that false alarms are rare
RETURN_SIGMA = 3.0  # gate of a measurement of which a part was flagged as left out
MIN_SPACING_M = 1.0  # below this left and right are swapped


@dataclass(frozen=True, eq=False)
class LeftOut:
    """A component of the measurements that does not pass the gate."""

    since_s: float
    innovation: Array  # when last measured, as in `Measurement`


@dataclass(frozen=True, eq=False)
class FaultMonitor:
    """Memory of contradictions between measurements and track."""

    squares: float = 0.0  # exponentially fading sum of squared normalised residuals
    degrees: float = 0.0  # and of their degrees of freedom
    left_out: dict[Reason, LeftOut] = field(default_factory=dict)  # LEFT, RIGHT, HEIGHT
    previous: FilterState | None = None  # of the track before this one, at its end
    contradiction: WidthTest | None = None  # the sharpest that the stated width failed

    def update(self, gated: GatedMeasurement | None, time_s: float, step_s: float, config: RunConfig) -> "FaultMonitor":
        """After one more frame; a frame without a line changes nothing about those that are left out."""
        fade, left_out = float(np.exp(-step_s / config.integrity.window_s)), self.left_out
        squares, degrees = fade * self.squares, fade * self.degrees
        if gated is not None:
            out = [diagnostic.reason for diagnostic in gated.excluded]
            since_s = {reason: left_out[reason].since_s if reason in left_out else time_s for reason in out}
            unmeasured = {reason: known for reason, known in left_out.items() if reason not in gated.measured}
            left_out = unmeasured | {reason: LeftOut(since_s[reason], gated.measured[reason]) for reason in out}
            if gated.accepted is not None:
                squares, degrees = squares + gated.distance2, degrees + gated.degrees
        return replace(self, squares=squares, degrees=degrees, left_out=left_out)

    def gate(self, state: FilterState, measurement: Measurement, config: RunConfig) -> GatedMeasurement:
        """The part of a measurement that may update the filter.

        What was flagged as left out comes back where it is at most half as far off as when last seen, and all agrees
        well. While it is left out the state's covariance grows, until what is as wrong as before would pass the gate.
        """
        flagged = {reason for reason in self.left_out if self._is_flagged(reason, state.time_s, config)}
        agrees = bool(flagged) and is_consistent(state, measurement, RETURN_SIGMA)
        kept_out = {
            reason
            for reason in flagged & measurement.rows_by_reason().keys()
            if not (agrees and has_returned(state, measurement, reason, self.left_out[reason].innovation))
        }
        return select_consistent(state, measurement, config.tracking.gate_sigma, kept_out)

    def _is_flagged(self, reason: Reason, time_s: float, config: RunConfig) -> bool:
        return time_s - self.left_out[reason].since_s >= config.integrity.persist_s

    def update_width(self, test: WidthTest | None, limit_sigma: float) -> "FaultMonitor":
        """After the first frame of a track: one that agrees with the stated width may withdraw a contradiction.

        It does where it contradicts the spacing that was found before. From a smaller height one spacing agrees with
        more: a test that would agree with that spacing as well withdraws nothing.
        """
        if test is None:
            return self
        known = self.contradiction
        if test.flag(limit_sigma) is not None:
            is_sharper = known is None or test.sigma_m < known.sigma_m
            return replace(self, contradiction=test) if is_sharper else self
        is_withdrawn = known is not None and abs(test.spacing_m - known.spacing_m) > limit_sigma * test.sigma_m
        return replace(self, contradiction=None) if is_withdrawn else self

    def forget(self) -> "FaultMonitor":
        """Without what is left out: the track that it contradicted is given up."""
        return replace(self, left_out={})

    def restart(self, before: FilterState | None, config: RunConfig) -> "FaultMonitor":
        """For a new track: compare it with the old one, unless the old one contradicts the one before it."""
        previous = self.previous
        if before is not None and np.sqrt(before.covariance[States.SPACING, States.SPACING]) < MAX_SPACING_SIGMA_M:
            is_other = previous is not None and _change_flag(previous, before, None, config) is not None
            previous = previous if is_other else before
        return FaultMonitor(left_out=self.left_out, previous=previous, contradiction=self.contradiction)

    def active_flags(
        self,
        gated: GatedMeasurement | None,
        state: FilterState | None,
        extent: Extent | None,
        aircraft_m: Array | None,
        time_s: float,
        config: RunConfig,
    ) -> Diagnostics:
        """All flags of one frame. What was left out when it was last seen stays flagged while nothing is seen.

        Args:
            gated: None: nothing was measured.
            state: None: the track is lost.
            extent: of the runway; None: not known.
            aircraft_m: (3,) world; None: not known.
        """
        messages = {} if gated is None else {diagnostic.reason: diagnostic.message for diagnostic in gated.excluded}
        flags: list[Diagnostic | None] = []
        for reason, known in self.left_out.items():
            if self._is_flagged(reason, time_s, config):
                lasts_s = time_s - known.since_s
                message = messages.get(reason, f"{WHAT[reason]} contradicted the track when last seen")
                flags.append(Diagnostic(reason, f"{message}, for {lasts_s:.1f} s"))
        if state is not None:
            near_m = 0.0 if extent is None else float(state.local(extent.near_m)[0])
            flags += [
                bias_flag(state, near_m, config, aircraft_m),
                drift_flag(state, config),
                self._residual_flag(config),
            ]
            flags += [] if self.previous is None else [_change_flag(self.previous, state, aircraft_m, config)]
            flags += [] if self.contradiction is None else [self.contradiction.flag(0.0)]
        return tuple(flag for flag in flags if flag is not None)

    def _residual_flag(self, config: RunConfig) -> Diagnostic | None:
        """Residuals that are too large for too long, each of them small enough to pass the gate."""
        if self.degrees < MIN_RESIDUALS or self.squares < config.integrity.excess * self.degrees:
            return None
        excess = float(np.sqrt(self.squares / self.degrees))
        return Diagnostic(Reason.RESIDUALS, f"measurements scatter {excess:.1f} times as much as they should")


def check_order(lines: dict[str, RunwayLine]) -> Diagnostic | None:
    """A flag for two lines that cannot be left and right of one runway."""
    if "left" not in lines or "right" not in lines:
        return None
    left, right = lines["left"], lines["right"]
    spacing = float((right.point_m - left.point_m) @ left.right)
    if spacing > MIN_SPACING_M:
        return None
    return Diagnostic(Reason.SWAPPED, f"the right line lies {-spacing:.1f} m left of the left line")


def _change_flag(
    previous: FilterState, state: FilterState, aircraft_m: Array | None, config: RunConfig
) -> Diagnostic | None:
    """A flag for lines that are not where those of the track before should be by now, or not as far apart.

    Args:
        previous: of the track before, at its end.
        aircraft_m: (3,) world, about which a drifting heading turned the lines; None: about the old track's point.
    """
    before = predict(previous, state.time_s, aircraft_m, config)
    x, y, _ = before.local(state.point_m)
    design = np.zeros((3, States.SIZE))
    design[0, [States.OFFSET, States.AZIMUTH]] = 1.0, x
    design[1, States.AZIMUTH] = 1.0
    design[2, [States.SPACING, States.ANGLE]] = 1.0, x
    turn = wrap_angle(state.azimuth_rad - before.azimuth_rad)
    spacing = before.mean[States.SPACING] + before.mean[States.ANGLE] * x
    changes = np.array([y, turn, state.mean[States.SPACING] - spacing])
    compared = [States.OFFSET, States.AZIMUTH, States.SPACING]
    own = state.covariance[compared, compared]
    sigmas = np.sqrt(np.einsum("ij,jk,ik->i", design, before.covariance, design) + own)
    worst = int(np.argmax(np.abs(changes) / sigmas))
    if abs(changes[worst]) <= CHANGE_SIGMA * sigmas[worst]:
        return None
    if worst == 2:
        message = f"the lines are {state.mean[States.SPACING]:.1f} m apart and were {spacing:.1f} m apart before"
        return Diagnostic(Reason.SPACING, message)
    off = f"{y:+.1f} m beside" if worst == 0 else f"{np.rad2deg(turn):+.1f} degrees from"
    return Diagnostic(Reason.OTHER_LINES, f"the lines lie {off} where the track before had them")
