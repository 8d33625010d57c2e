"""Fault tests of the filter, and protection levels against what these tests miss.

The filter estimates the errors that all frames share from how lines change on the approach: with a wrong deck height,
for example, lines drift apart as the aircraft descends. An estimate farther from zero than its variance allows is a
fault. A fault of size m that no test shows moves the estimate by P_xb / P_bb(0) m (the posterior of a Gaussian with a
wrong prior mean). The protection level adds the largest of these, over faults up to the smallest size that one of the
tests surely shows, or the largest size that is possible.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from deckline.config import RunConfig
from deckline.geometry import wrap_angle
from deckline.track.extent import Extent
from deckline.track.filter import delay_effect, line_rows, predict
from deckline.track.measurement import MIN_HEIGHT_M, NAMES, GatedMeasurement
from deckline.track.motion import Pose
from deckline.track.states import (
    FAULTS,
    KNOWN_DRIFT_SIGMA_M_S,
    RAMP_SIGMA_M,
    FilterState,
    States,
    drift_sigma,
    error_sigmas,
    width_sigma_m,
)
from deckline.types import SIDES, DepthMode, Diagnostic, Diagnostics, Protection, Reason, RunwayLine, Value

Array = NDArray[np.float64]
OBSERVED_SHARE = 0.1  # of a prior's variance that must be gone before its estimate is tested
MIN_RESIDUALS = 10
WHAT = dict(NAMES.values())  # may be left out, in words
MAX_SPACING_SIGMA_M = 1.0  # of a track whose lines are compared with those of the next track
COMPARABLE_SIGMA = 1.5  # times the sigma of a contradicted width, up to which another test may withdraw it
MIN_SPACING_M = 1.0  # below this left and right are swapped
MESSAGES = {
    States.ATTITUDE_X: (Reason.BORESIGHT, "degrees", "the camera seems rolled by {:+.2f} degrees against its mounting"),
    States.ATTITUDE_Y: (
        Reason.BORESIGHT,
        "degrees",
        "the camera seems pitched by {:+.2f} degrees against its mounting",
    ),
    States.HEAVE: (Reason.HEIGHT, "m", "the deck seems {:+.1f} m below its rest, farther than its sea state moves it"),
    States.DECK: (Reason.HEIGHT, "m", "the deck's height or the aircraft's seems {:+.1f} m wrong"),
    States.SCALE: (Reason.DEPTH, "percent", "depths seem {:+.1f} % wrong"),
    States.FOCAL: (Reason.FOCAL, "percent", "the focal length seems {:+.2f} % wrong"),
    States.DELAY: (Reason.DELAY, "s", "the pose seems {:+.2f} s older than the picture"),
    States.LEFT: (Reason.LEFT, "m", "the left line seems to be another marking, {:+.1f} m beside it"),
    States.RIGHT: (Reason.RIGHT, "m", "the right line seems to be another marking, {:+.1f} m beside it"),
    States.SPACING: (Reason.SPACING, "m", "the lines' spacing is {:+.1f} m off what was stated"),
    States.ANGLE: (Reason.ANGLE, "degrees", "the angle between the lines is {:+.1f} degrees off what was stated"),
    States.DRIFT: (
        Reason.DRIFT,
        "m",
        "the lines drift sideways at {:+.1f} m/s, which neither ship nor heading explain",
    ),
}
YOUNG = Diagnostic(Reason.YOUNG_TRACK, "the track is too young to show contradictions")
UNLIKELY = Diagnostic(
    Reason.UNLIKELY_ERRORS, "the errors of sensors and paint that would explain the lines are unlikely together"
)
UNBOUNDED_YAW = Diagnostic(
    Reason.YAW, "at this closing speed the lines' drift does not show a camera that is turned in yaw"
)
SCALES = {"degrees": float(np.rad2deg(1.0)), "percent": 100.0, "m": 1.0, "s": 1.0}


def stated_priors(config: RunConfig) -> dict[int, tuple[float, float]]:
    """Prior mean and variance of every state that is tested against what was stated."""
    shared = range(States.SIZE)[States.SHARED_ERRORS]
    priors = {index: (0.0, float(sigma**2)) for index, sigma in zip(shared, error_sigmas(config), strict=True)}
    priors[States.HEAVE] = 0.0, config.deck.motion.heave_m**2
    priors[States.ANGLE] = config.deck.angle_rad, config.deck.angle_sigma_rad**2
    if config.deck.width_m is not None:
        priors[States.SPACING] = config.deck.width_m, width_sigma_m(config) ** 2
    if config.deck.ship_velocity_m_s is not None:
        priors[States.DRIFT] = 0.0, drift_sigma(config) ** 2
    return priors


def fault_gains(state: FilterState, near_m: float, config: RunConfig) -> Array:
    """What a unit of each possible fault moves the estimated states by, (20, 9): P_xb / P_bb(0).

    The faults are the shared errors, each in its own unit, and the stated width, m; `near_m` as in `prior_tests`.
    """
    gains = np.zeros((States.SIZE, FAULTS))
    gains[:, :-1] = state.covariance[:, States.SHARED_ERRORS] / error_sigmas(config) ** 2
    if config.deck.width_m is not None:
        gains[:, -1] = state.covariance @ _spacing_row(near_m) / width_sigma_m(config) ** 2
    return gains


def _spacing_row(near_m: float) -> Array:
    """Row (20,) that gives the spacing of the lines where the runway begins."""
    row = np.zeros(States.SIZE)
    row[[States.SPACING, States.ANGLE]] = 1.0, near_m
    return row


def drift_share(state: FilterState, config: RunConfig) -> float:
    """Share of the prior variance of the lines' sideways speed that frames have removed: the gain of its estimate."""
    return 1.0 - float(state.covariance[States.DRIFT, States.DRIFT]) / drift_sigma(config) ** 2


def is_drift_known(state: FilterState, config: RunConfig) -> bool:
    """Whether frames have measured the lines' sideways speed well enough for `drift_flag` and `undetected_yaw`."""
    share, variance = drift_share(state, config), float(state.covariance[States.DRIFT, States.DRIFT])
    return share > 0.0 and variance / share <= KNOWN_DRIFT_SIGMA_M_S**2


def least_closing_speed(state: FilterState, pose: Pose, closing: Value | None, config: RunConfig) -> float:
    """Lower bound on the closing speed, m/s: over a ship whose velocity is stated, else over the fastest that is
    possible, or over the ramp as it moves in the pictures.

    Args:
        closing: measured by the ramp's motion; None: not known.
    """
    along = float(pose.velocity_m_s @ state.along)
    if config.deck.ship_velocity_m_s is not None:
        return along - float(np.array(config.deck.ship_velocity_m_s) @ state.along[:2])
    slowest = along - config.integrity.max_ship_m_s
    if closing is None:
        return slowest
    return max(slowest, closing.value - float(norm.isf(config.integrity.risk / 2)) * closing.sigma)


def undetected_yaw(state: FilterState, closing_m_s: float, config: RunConfig) -> float | None:
    """Bound on the yaw of a turned camera, rad, by the drift of the lines; None: nothing bounds it.

    A camera that is turned by psi sees the lines drift at closing speed times sin(psi), and no picture shows more of
    it. The drift that a ship explains is its largest, or, where its velocity is stated, that velocity's error. What
    is left of the estimate, with its quantile, may be yaw.

    Args:
        closing_m_s: the least that is possible.
    """
    if not is_drift_known(state, config):
        return None
    test, share = config.integrity, drift_share(state, config)
    quantile = float(norm.isf(test.risk / 2))
    drift = abs(float(state.mean[States.DRIFT])) / share  # as frames measured it, without the prior
    if config.deck.ship_velocity_m_s is None:
        noise = float(state.covariance[States.DRIFT, States.DRIFT]) / share
        drift += test.max_drift_m_s + quantile * float(np.sqrt(noise))
    else:
        drift += quantile * drift_sigma(config) / float(np.sqrt(share))
    if drift > closing_m_s * np.sin(np.deg2rad(test.max_yaw_deg)):
        return None
    return float(np.arcsin(drift / closing_m_s))


def drift_flag(state: FilterState, config: RunConfig) -> Diagnostic | None:
    """A flag for lines that move sideways faster than a ship can, as they seem to where the camera is turned in yaw."""
    drift, sigma = float(state.mean[States.DRIFT]), float(np.sqrt(state.covariance[States.DRIFT, States.DRIFT]))
    if abs(drift) - config.integrity.alarm_sigma * sigma <= config.integrity.max_drift_m_s:
        return None
    message = f"the lines drift sideways at {drift:+.1f} m/s, faster than a ship's: is the camera turned in its mount?"
    return Diagnostic(Reason.DRIFT, message)


@dataclass(frozen=True, eq=False)
class PriorTest:
    """A state's estimate against what was stated of it."""

    index: int  # of the state
    row: Array  # (20,) that gives the estimate
    bias: float  # estimated minus stated
    sigma: float  # of that, if what was stated is true


def prior_tests(state: FilterState, near_m: float, config: RunConfig) -> Iterator[PriorTest]:
    """The tests of all states that frames have observed well enough.

    Args:
        near_m: where the runway begins, m along the line from the state's point: there it has its stated spacing.
    """
    for index, (expected, variance) in stated_priors(config).items():
        row, place = np.eye(States.SIZE)[index], 0.0
        if index == States.SPACING:
            row = _spacing_row(near_m)
            place = config.deck.angle_sigma_rad * RAMP_SIGMA_M  # what is stated holds where the runway truly begins
        observed = variance - float(row @ state.covariance @ row)
        if observed > OBSERVED_SHARE * variance:
            yield PriorTest(index, row, float(row @ state.mean - expected), float(np.sqrt(observed + place**2)))


def bias_flag(state: FilterState, near_m: float, config: RunConfig, camera_m: Array | None = None) -> Diagnostic | None:
    """The state that is most significantly off its prior, if any is.

    Args:
        state: of the track.
        near_m: as in `prior_tests`.
        config: limits.
        camera_m: (3,) world, for the message; None: not known.
    """
    tests = list(prior_tests(state, near_m, config))
    worst = max(tests, key=lambda test: abs(test.bias) / test.sigma, default=None)
    if worst is None or abs(worst.bias) / worst.sigma <= config.integrity.alarm_sigma:
        return None
    if worst.index in (States.HEAVE, States.SPACING) and config.deck.width_m is not None and camera_m is not None:
        return _spacing_contradiction(_spacing_by_height(state, near_m, camera_m), config.deck.width_m)
    if worst.index == States.DECK:
        by_lines, stated = state.point_m[2], state.point_m[2] + state.mean[States.DECK]
        return Diagnostic(Reason.HEIGHT, f"the deck is at z {by_lines:.1f} m by the lines; {stated:.1f} m is stated")
    reason, unit, message = MESSAGES[worst.index]
    return Diagnostic(reason, message.format(SCALES[unit] * worst.bias))


def _spacing_by_height(state: FilterState, near_m: float, camera_m: Array) -> float:
    """Spacing of the lines where the runway begins, as the stated height of the deck at rest scales it."""
    stated_m = state.point_m[2] + state.mean[States.DECK] - camera_m[2]
    return float(_spacing_row(near_m) @ state.mean * stated_m / (state.deck_z_m - camera_m[2]))


@dataclass(frozen=True, eq=False)
class WidthTest:
    """Spacing of both lines of a track's first frame against the stated width."""

    spacing_m: float  # as depth or the stated deck height scales it
    stated_m: float
    sigma_m: float  # of the difference, if what was stated is true
    mode: DepthMode  # of the frame

    def flag(self, alarm_sigma: float) -> Diagnostic | None:
        """A flag where the difference is larger than so many sigmas."""
        if abs(self.spacing_m - self.stated_m) <= alarm_sigma * self.sigma_m:
            return None
        return _spacing_contradiction(self.spacing_m, self.stated_m, self.mode)


def compare_width(
    state: FilterState, lines: dict[str, RunwayLine], mode: DepthMode, camera_m: Array, config: RunConfig
) -> WidthTest | None:
    """The stated width against the lines of a track's first frame; None without a stated width or a line.

    Args:
        state: the initial one.
        lines: of the frame.
        mode: of the frame: whether depth or the stated deck height scales the lines.
        camera_m: (3,) world.
        config: the stated width, and what the deck's height errs by.
    """
    if config.deck.width_m is None or len(lines) < len(SIDES):
        return None
    spacing_m = _lateral_spacing_m(lines["left"], lines["right"])
    height_m = max(lines["left"].height_m - camera_m[2], MIN_HEIGHT_M)
    is_fine = mode is DepthMode.FINE
    scale_sigma = config.sensors.depth_scale if is_fine else config.deck_height_sigma_m / height_m
    sigma_m = float(np.hypot(np.sqrt(state.covariance[States.SPACING, States.SPACING]), spacing_m * scale_sigma))
    return WidthTest(spacing_m, config.deck.width_m, sigma_m, mode)


def _spacing_contradiction(spacing_m: float, stated_m: float, mode: DepthMode = DepthMode.COARSE) -> Diagnostic:
    by = "depth camera" if mode is DepthMode.FINE else "stated deck height"
    message = f"the lines are {spacing_m:.1f} m apart by the {by}; {stated_m:.1f} m is stated"
    return Diagnostic(Reason.SPACING, message)


def unverified_reasons(
    state: FilterState, age_s: float, near_m: float, yaw_rad: float | None, config: RunConfig
) -> Diagnostics:
    """Why a track that no test flags is not verified.

    Several errors that are each just possible are unlikely together: the overall model test, which sums the squares of
    all prior tests. They count as independent, which they are not quite: one in 2,000 `ok` frames of modelled nominal
    flights is doubted by a risk of one in 1,000. Source: Teunissen, "Distributional theory for the DIA method", 2018.

    Args:
        state: of the track.
        age_s: of the track.
        near_m: as in `prior_tests`.
        yaw_rad: by `undetected_yaw`.
        config: limits.
    """
    young = age_s < config.integrity.persist_s or not is_drift_known(state, config)
    errors = np.array([test.bias / test.sigma for test in prior_tests(state, near_m, config)])
    unlikely = bool(len(errors)) and _joint_significance(errors) < config.integrity.doubt_risk
    is_unbounded = yaw_rad is None and not young
    return tuple(
        doubt for doubt, holds in ((YOUNG, young), (UNLIKELY, unlikely), (UNBOUNDED_YAW, is_unbounded)) if holds
    )


def _joint_significance(errors: Array) -> float:
    """Probability of errors (n,), in sigmas, at least as unlikely: by their sum of squares or by the largest alone.

    A sum of n squares hides one large error. The largest counts with the n tests that could have had it (Bonferroni).
    """
    largest = 2 * len(errors) * norm.sf(np.max(np.abs(errors)))
    return float(min(chi2.sf(np.sum(errors**2), len(errors)), largest))


def protection_levels(
    state: FilterState,
    pose: Pose,
    touchdown_m: float | None,
    ramp: Extent | None,
    yaw_rad: float | None,
    far: float,
    config: RunConfig,
) -> Protection:
    """Bounds on errors of the lateral deviation beside the aircraft, of the deck's height at touchdown, of the heading
    and of the distance to the ramp.

    All are as seen from the aircraft: an error of its own position or heading moves them with it. They hold for one
    fault at a time of those that `Integrity` names.

    Args:
        touchdown_m: touchdown point, m along the line from the state's point; None: not known, the point itself.
        ramp: None: not known.
        yaw_rad: by `undetected_yaw`.
        far: times by which 1-sigmas of place and direction are too small from so far away.
        config: limits.
    """
    x = float(state.local(pose.position_m)[0])
    delay, sensors = delay_effect(state, pose, 0.0), config.sensors
    near_m = 0.0 if touchdown_m is None else touchdown_m - config.approach.touchdown_m
    gains, quantile = fault_gains(state, near_m, config), float(norm.isf(config.integrity.risk / 2))
    faults = _undetected_faults(state, near_m, gains, config)

    def bound(row: Array, white: float, times: float) -> tuple[float, float]:
        """Of the filter's own error, and of one undetected fault."""
        sigma = float(np.sqrt(row @ state.covariance @ row + white**2))
        return quantile * times * sigma, float(np.max(np.abs(row @ gains) * faults))

    at_touchdown = line_rows(state, 0.0, touchdown_m or 0.0, delay)
    chance, fault = bound(at_touchdown[1], sensors.attitude_white_rad, far)
    distance_m = None
    if ramp is not None:
        distance_m = quantile * far * float(np.hypot(ramp.sigma_m, sensors.position_white_m))
        distance_m += float(np.max(np.abs(ramp.response[0]) * faults))
    return Protection(
        lateral_m=sum(bound(line_rows(state, 0.0, x, delay)[0], sensors.position_white_m, far)),
        vertical_m=sum(bound(at_touchdown[2], sensors.position_white_m, 1.0)),
        heading_rad=None if yaw_rad is None else chance + max(fault, yaw_rad),
        distance_m=distance_m,
        risk=config.integrity.risk,
    )


def _undetected_faults(state: FilterState, near_m: float, gains: Array, config: RunConfig) -> Array:
    """The largest size (9,) of each possible fault that may stay undetected by any test, in its own unit.

    An error of size m moves another state's estimate by P_xb / P_bb(0) m, and its own by 1 - P_bb / P_bb(0).
    """
    test = config.integrity
    boresight = float(np.deg2rad(test.max_boresight_deg))
    largest = [boresight, boresight, test.max_deck_z_m, test.max_depth_scale, test.max_focal_fraction]
    width = 0.0 if config.deck.width_m is None else test.max_width_fraction * config.deck.width_m
    undetected = np.array([*largest, test.max_delay_s, test.max_line_m, test.max_line_m, width])
    for one in prior_tests(state, near_m, config):
        own = np.append(np.eye(States.SIZE)[one.index, States.SHARED_ERRORS], float(one.index == States.SPACING))
        response = one.row @ gains - own
        surely = (test.alarm_sigma + test.missed_sigma) * one.sigma
        undetected = np.minimum(undetected, surely / np.maximum(np.abs(response), 1e-12))
    return undetected


@dataclass(frozen=True, eq=False)
class FaultMonitor:
    """Memory of contradictions between measurements and track."""

    squares: float = 0.0  # exponentially fading sum of squared normalised residuals
    degrees: float = 0.0  # and of their degrees of freedom
    since_s: dict[Reason, float] = field(default_factory=dict)  # since when a measurement is left out
    previous: FilterState | None = None  # of the track before this one, at its end
    contradiction: WidthTest | None = None  # the sharpest that the stated width failed

    def update(self, gated: GatedMeasurement | None, time_s: float, step_s: float, config: RunConfig) -> "FaultMonitor":
        """After one more frame; a frame without a line changes nothing about those that are left out."""
        fade, since_s = float(np.exp(-step_s / config.integrity.window_s)), self.since_s
        squares, degrees = fade * self.squares, fade * self.degrees
        if gated is not None:
            left_out = {diagnostic.reason: self.since_s.get(diagnostic.reason, time_s) for diagnostic in gated.excluded}
            since_s = {
                reason: since for reason, since in self.since_s.items() if reason not in gated.measured
            } | left_out
            if gated.accepted is not None:
                squares, degrees = squares + gated.distance2, degrees + gated.degrees
        return replace(self, squares=squares, degrees=degrees, since_s=since_s)

    def is_readmitted(self, gated: GatedMeasurement, time_s: float, config: RunConfig) -> bool:
        """Whether a measurement that was flagged as left out passes the gate again.

        While it was left out the state's covariance grew, so that a measurement as wrong as before may pass. Its
        earlier updates are still in the state. Neither can be trusted.
        """
        out = {diagnostic.reason for diagnostic in gated.excluded}
        return any(
            reason in gated.measured - out and time_s - since >= config.integrity.persist_s
            for reason, since in self.since_s.items()
        )

    def update_width(self, test: WidthTest | None, config: RunConfig) -> "FaultMonitor":
        """After the first frame of a track: one that agrees with the stated width withdraws a contradiction.

        From a smaller height the same width agrees with more, so a much weaker test withdraws nothing.
        """
        if test is None:
            return self
        known = self.contradiction
        if test.flag(config.integrity.alarm_sigma) is not None:
            is_sharper = known is None or test.sigma_m < known.sigma_m
            return replace(self, contradiction=test) if is_sharper else self
        is_withdrawn = known is not None and test.sigma_m <= COMPARABLE_SIGMA * known.sigma_m
        return replace(self, contradiction=None) if is_withdrawn else self

    def forget(self) -> "FaultMonitor":
        """Without what is left out: the track that it contradicted is given up."""
        return replace(self, since_s={})

    def restart(self, before: FilterState | None, config: RunConfig) -> "FaultMonitor":
        """For a new track: compare it with the old one, unless the old one contradicts the one before it."""
        previous = self.previous
        if before is not None and np.sqrt(before.covariance[States.SPACING, States.SPACING]) < MAX_SPACING_SIGMA_M:
            is_other = previous is not None and _change_flag(previous, before, None, config) is not None
            previous = previous if is_other else before
        return FaultMonitor(since_s=self.since_s, previous=previous, contradiction=self.contradiction)

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
            time_s: of the frame.
            config: limits.
        """
        messages = {} if gated is None else {diagnostic.reason: diagnostic.message for diagnostic in gated.excluded}
        flags: list[Diagnostic | None] = []
        for reason, since in self.since_s.items():
            if time_s - since >= config.integrity.persist_s:
                message = messages.get(reason, f"{WHAT[reason]} contradicted the track when last seen")
                flags.append(Diagnostic(reason, f"{message}, for {time_s - since:.1f} s"))
        if state is not None:
            near_m = 0.0 if extent is None else float(state.local(extent.near_m)[0])
            flags += [
                bias_flag(state, near_m, config, aircraft_m),
                drift_flag(state, config),
                self._residual_flag(config),
            ]
            flags += [] if self.previous is None else [_change_flag(self.previous, state, aircraft_m, config)]
            flags += [] if self.contradiction is None else [self.contradiction.flag(config.integrity.alarm_sigma)]
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
    spacing = _lateral_spacing_m(lines["left"], lines["right"])
    if spacing > MIN_SPACING_M:
        return None
    return Diagnostic(Reason.SWAPPED, f"the right line lies {-spacing:.1f} m left of the left line")


def _lateral_spacing_m(left: RunwayLine, right: RunwayLine) -> float:
    """How far the right line's point lies to the right of the left line."""
    lateral_axis = np.array([-left.direction[1], left.direction[0], 0.0])
    return float((right.point_m - left.point_m) @ lateral_axis)


def _change_flag(
    previous: FilterState, state: FilterState, aircraft_m: Array | None, config: RunConfig
) -> Diagnostic | None:
    """A flag for lines that are not where those of the track before should be by now, or not as far apart.

    Args:
        previous: of the track before, at its end.
        state: of the new track.
        aircraft_m: (3,) world, about which a drifting heading turned the lines; None: about the old track's point.
        config: limits.
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
    if abs(changes[worst]) <= config.integrity.alarm_sigma * sigmas[worst]:
        return None
    if worst == 2:
        message = f"the lines are {state.mean[States.SPACING]:.1f} m apart and were {spacing:.1f} m apart before"
        return Diagnostic(Reason.SPACING, message)
    off = f"{y:+.1f} m beside" if worst == 0 else f"{np.rad2deg(turn):+.1f} degrees from"
    return Diagnostic(Reason.OTHER_LINES, f"the lines lie {off} where the track before had them")
