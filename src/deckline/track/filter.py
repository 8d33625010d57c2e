"""The tracker's Kalman filter: a centre line, a spacing, a moving deck, and the errors that all frames share.

Coordinates: x along the centre line in the direction of landing, y to its right, z down, from a point on the centre
line. The line's world coordinates are those of the aircraft's own navigation: an error of its position or heading moves
line and aircraft together, and their relative position stays right.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.geometry import wrap_angle
from deckline.track.motion import PITCH_PERIOD_S, ROLL_PERIOD_S, Aircraft, Pose, oscillate, stationary_covariance
from deckline.types import RunwayLine, Value

Array = NDArray[np.float64]
# The state. Of the line: y of the centre line at the point, m; its azimuth, rad; spacing of the lines there, m; right
# line's azimuth minus left line's, rad; deck z at rest, m; the centre line's speed to the right, m/s.
OFFSET, AZIMUTH, SPACING, ANGLE, HEIGHT, DRIFT = range(6)
# Of the deck about its rest, each with its rate: z at the point, m; slope along and to the right, rad.
HEAVE, HEAVE_RATE, PITCH, PITCH_RATE, ROLL, ROLL_RATE = range(6, 12)
# Errors that all frames share: attitude about x and y, rad; reported deck z at rest, m; depth scale, focal length, as
# shares; pose behind the picture, s; left and right line, m.
ATTITUDE_X, ATTITUDE_Y, DECK, SCALE, FOCAL, DELAY, LEFT, RIGHT = range(12, 20)
SIZE = 20
MAX_SPEED_SIGMA_M_S = 20.0  # of the aircraft's velocity, above which no rate is given
OSCILLATIONS = ((HEAVE, PITCH_PERIOD_S), (PITCH, PITCH_PERIOD_S), (ROLL, ROLL_PERIOD_S))
SIGN = {"left": -1.0, "right": 1.0, "centre": 0.0}
SPACING_M, SPACING_SIGMA_M = 20.0, 20.0  # of an unknown spacing: between 14.7 m (Li et al. 2024) and 24 m (carriers)
DRIFT_SIGMA_M_S = 2.0  # of the lines' unknown sideways speed: 25 knots along a ship whose lines are angled
KNOWN_DRIFT_SIGMA_M_S = 0.3  # the same when the ship's velocity is known
DRIFT_M_S15 = 0.05  # noise density of that speed
TURN_RAD_S05 = float(np.deg2rad(0.08))  # random walk of the lines' direction: yaw, and pitch seen from far
SPACING_M_S05 = 0.005  # random walk of the spacing, so that a wrong one is unlearned
RAMP_SIGMA_M = 20.0  # of the ramp's place at first, far away
INITIAL_SIGMA_M, INITIAL_SIGMA_RAD = 1000.0, 1.0  # of an unknown line


@dataclass(frozen=True, eq=False)
class FilterState:
    """Mean and covariance. OFFSET, AZIMUTH and HEIGHT of the mean are folded into point and azimuth, so they are 0."""

    time_s: float
    point_m: Array  # (3,) world, on the centre line; z of the deck at rest
    azimuth_rad: float
    mean: Array  # (20,)
    covariance: Array  # (20, 20)

    @property
    def along(self) -> Array:
        return np.array([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad), 0.0])

    @property
    def right(self) -> Array:
        return np.array([-np.sin(self.azimuth_rad), np.cos(self.azimuth_rad), 0.0])

    @property
    def deck_z_m(self) -> float:
        """World z of the deck at the point at the moment."""
        return float(self.point_m[2] + self.mean[HEAVE])

    def local(self, point_m: Array) -> Array:
        """World point (3,) -> x, y, z from the state's point."""
        offset = point_m - self.point_m
        return np.array([offset @ self.along, offset @ self.right, offset[2]])


def width_sigma_m(config: RunConfig) -> float:
    """1-sigma of a stated spacing: of itself, and of the place along not quite parallel lines where it holds."""
    return float(np.hypot(config.deck.width_sigma_m, config.deck.angle_sigma_rad * RAMP_SIGMA_M))


def drift_sigma(config: RunConfig) -> float:
    """1-sigma of the lines' sideways speed, m/s."""
    return DRIFT_SIGMA_M_S if config.deck.ship_velocity_m_s is None else KNOWN_DRIFT_SIGMA_M_S


def error_sigmas(config: RunConfig) -> Array:
    """1-sigma (8,) of the shared errors, from ATTITUDE_X on."""
    s = config.sensors
    deck = float(np.hypot(config.deck_rest_sigma_m, s.position_m))  # the pose's own height errs like the deck's
    return np.array(
        [s.attitude_rad, s.attitude_rad, deck, s.depth_scale, s.focal_fraction, s.delay_s, s.line_m, s.line_m]
    )


def deck_motion_sigmas(config: RunConfig) -> Array:
    """1-sigma (3,) of heave, pitch and roll."""
    motion = config.deck.motion
    return np.array([motion.heave_m, motion.pitch_rad, motion.roll_rad])


def initial_state(time_s: float, line: RunwayLine, ramp_m: Array | None, config: RunConfig) -> FilterState:
    """Nothing is known but that there is a runway near a measured line, whose point and direction are the reference.

    Args:
        ramp_m: (3,) world, about where the runway begins and has its stated spacing; None: at the line's point.
    """
    width = config.deck.width_m
    mean = np.zeros(SIZE)
    mean[SPACING] = SPACING_M if width is None else width
    mean[ANGLE] = config.deck.angle_rad
    sigma = np.zeros(SIZE)
    sigma[[OFFSET, AZIMUTH, HEIGHT]] = INITIAL_SIGMA_M, INITIAL_SIGMA_RAD, INITIAL_SIGMA_M
    sigma[SPACING] = SPACING_SIGMA_M if width is None else width_sigma_m(config)
    sigma[ANGLE] = config.deck.angle_sigma_rad
    sigma[DRIFT] = drift_sigma(config)
    sigma[ATTITUDE_X:] = error_sigmas(config)
    covariance = np.diag(sigma**2)
    for (index, period_s), size in zip(OSCILLATIONS, deck_motion_sigmas(config), strict=True):
        covariance[index : index + 2, index : index + 2] = size**2 * stationary_covariance(period_s)
    state = FilterState(time_s, line.point_m, line.azimuth_rad, mean, covariance)
    if ramp_m is None:
        return state
    transfer = np.eye(SIZE)
    transfer[SPACING, ANGLE] = -float(state.local(ramp_m)[0])
    return replace(state, mean=transfer @ mean, covariance=transfer @ state.covariance @ transfer.T)


def predict(state: FilterState, time_s: float, aircraft_m: Array | None, config: RunConfig) -> FilterState:
    """The state at a later time.

    Args:
        aircraft_m: (3,) world; a drifting heading turns the line about it. None: not known, about the line's point.
    """
    dt = time_s - state.time_s
    sensors = config.sensors
    transition, noise = np.eye(SIZE), np.zeros((SIZE, SIZE))
    transition[OFFSET, DRIFT] = dt
    drift = DRIFT_M_S15**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    noise[np.ix_([OFFSET, DRIFT], [OFFSET, DRIFT])] = drift
    for (index, period_s), size in zip(OSCILLATIONS, deck_motion_sigmas(config), strict=True):
        both = slice(index, index + 2)
        transition[both, both], process = oscillate(dt, period_s)
        noise[both, both] = size**2 * process
    keep = float(np.exp(-dt / sensors.drift_s))
    attitude = [ATTITUDE_X, ATTITUDE_Y]
    transition[attitude, attitude] = keep
    noise[attitude, attitude] = sensors.attitude_rad**2 * (1 - keep**2)
    noise[SPACING, SPACING] = SPACING_M_S05**2 * dt
    noise[AZIMUTH, AZIMUTH] = TURN_RAD_S05**2 * dt
    renewed = 2 * dt / sensors.drift_s  # share of a drifting error's variance
    noise[[OFFSET, HEIGHT], [OFFSET, HEIGHT]] += sensors.position_m**2 * renewed
    x = 0.0 if aircraft_m is None else float(state.local(aircraft_m)[0])
    heading = np.zeros(SIZE)
    heading[[OFFSET, AZIMUTH]] = -x, 1.0
    noise += sensors.attitude_rad**2 * renewed * np.outer(heading, heading)
    point = state.point_m + dt * np.array([*(config.deck.ship_velocity_m_s or (0.0, 0.0)), 0.0])
    covariance = transition @ state.covariance @ transition.T + noise
    return _fold(replace(state, time_s=time_s, point_m=point, mean=transition @ state.mean, covariance=covariance))


def _fold(state: FilterState) -> FilterState:
    """The same belief with the mean's offset, azimuth and height moved into point and azimuth."""
    mean = state.mean.copy()
    point = state.point_m + mean[OFFSET] * state.right + np.array([0.0, 0.0, mean[HEIGHT]])
    azimuth = float(wrap_angle(state.azimuth_rad + mean[AZIMUTH]))
    mean[[OFFSET, AZIMUTH, HEIGHT]] = 0.0
    return replace(state, point_m=point, azimuth_rad=azimuth, mean=mean)


def shift_reference(state: FilterState, x_m: float) -> FilterState:
    """The same belief, referred to a point `x_m` farther along the line."""
    transfer = np.eye(SIZE)
    for index, rate in ((OFFSET, AZIMUTH), (SPACING, ANGLE), (HEAVE, PITCH), (HEAVE_RATE, PITCH_RATE)):
        transfer[index, rate] = x_m
    covariance = transfer @ state.covariance @ transfer.T
    point = state.point_m + x_m * state.along
    return replace(state, point_m=point, mean=transfer @ state.mean, covariance=covariance)


def update(state: FilterState, innovation: Array, design: Array, noise: Array) -> FilterState:
    """Kalman update in Joseph's form, which keeps the covariance symmetric and positive.

    Args:
        innovation: (m,) measured minus predicted.
        design: (m, 20) what a state's component does to a measurement.
        noise: (m, m).
    """
    variance = design @ state.covariance @ design.T + noise
    gain = np.linalg.solve(variance, design @ state.covariance).T
    rest = np.eye(SIZE) - gain @ design
    covariance = rest @ state.covariance @ rest.T + gain @ noise @ gain.T
    mean = state.mean + gain @ innovation
    return _fold(replace(state, mean=mean, covariance=(covariance + covariance.T) / 2))


def track_lines(state: FilterState, pose: Pose | None, at_m: float, config: RunConfig) -> dict[str, RunwayLine]:
    """The three lines in the world, as measured with the aircraft's pose.

    Args:
        pose: of the camera; None: not known, which leaves the heading's part out of the covariance.
        at_m: where along the line they are evaluated, m from the state's point: the deck's height is that there.
    """
    s = config.sensors
    x = 0.0 if pose is None else float(state.local(pose.position_m)[0])
    delay = np.zeros(3) if pose is None else delay_effect(state, pose, at_m - x)
    heading = np.array([at_m - x, 1.0, 0.0])
    by_heading, by_position = np.outer(heading, heading), np.diag([1.0, 0.0, 1.0])
    white = s.attitude_white_rad**2 * by_heading + s.position_white_m**2 * by_position
    total = s.attitude_rad**2 * by_heading + s.position_m**2 * by_position
    found = {}
    for side, sign in SIGN.items():
        rows = line_rows(state, sign, at_m, delay)
        y, turn, down = rows @ state.mean
        covariance = rows @ state.covariance @ rows.T + white
        point = state.point_m + at_m * state.along + y * state.right + np.array([0.0, 0.0, down])
        azimuth = float(wrap_angle(state.azimuth_rad + turn))
        found[side] = RunwayLine(point, azimuth, covariance + total, covariance)
    return found


def line_rows(state: FilterState, sign: float, at_m: float, delay: Array) -> Array:
    """Rows (3, 20) that give a line's offset, azimuth and z at a place along it.

    Args:
        sign: of the line's side.
        at_m: the place, from the state's point.
        delay: (3,) what a second of delay adds to them.
    """
    rows = np.zeros((3, SIZE))
    rows[0, [OFFSET, AZIMUTH, SPACING, ANGLE]] = 1.0, at_m, sign / 2, sign / 2 * at_m
    rows[1, [AZIMUTH, ANGLE]] = 1.0, sign / 2
    rows[2, [HEIGHT, HEAVE, PITCH, ROLL]] = 1.0, 1.0, at_m, sign / 2 * state.mean[SPACING]
    rows[:, DELAY] = delay
    return rows


def delay_effect(state: FilterState, pose: Pose, ahead_m: float) -> Array:
    """Change (3,) of offset, azimuth and z at a point `ahead_m` of the aircraft by a second of delay of the pose."""
    turn_rate = float(pose.turn_rate_rad_s[2])
    return -np.array([pose.velocity_m_s @ state.right + ahead_m * turn_rate, turn_rate, pose.velocity_m_s[2]])


def track_rates(
    state: FilterState,
    aircraft: Aircraft,
    pose: Pose | None,
    ramp_speed: Value | None,
    at_m: float,
    config: RunConfig,
) -> tuple[Value | None, Value | None, Value | None]:
    """Rates of the lateral deviation, of the height above deck, and the closing speed, m/s; None: not known.

    The lines' own motion - of ship and deck - is part of the rates.

    Args:
        ramp_speed: of the ramp along the line, m/s; None: not known.
        at_m: where the height is evaluated, from the state's point.
    """
    if pose is None or aircraft.velocity_sigma_m_s > MAX_SPEED_SIGMA_M_S:
        return None, None, None
    own, velocity = aircraft.velocity_sigma_m_s, aircraft.velocity_m_s
    ship = np.array([*(config.deck.ship_velocity_m_s or (0.0, 0.0)), 0.0])
    lateral = (velocity - ship) @ state.right - state.mean[DRIFT]
    climb = np.zeros(SIZE)
    climb[[HEAVE_RATE, PITCH_RATE]] = 1.0, at_m
    height = climb @ state.mean - velocity[2]
    closing = None
    if ramp_speed is not None:
        closing = Value(float(velocity @ state.along - ramp_speed.value), float(np.hypot(own, ramp_speed.sigma)))
    return (
        Value(float(lateral), float(np.sqrt(own**2 + state.covariance[DRIFT, DRIFT]))),
        Value(float(height), float(np.sqrt(own**2 + climb @ state.covariance @ climb))),
        closing,
    )
