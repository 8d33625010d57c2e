"""What the tracker believes: a centre line, a spacing, a deck that swings, and errors that all frames have in common.

Coordinates: x along the centre line in the direction of landing, y to its right, z down, from a point on the centre
line. The line stands in the world as the aircraft's own pose has it: an error of its position or heading moves the
line along with the aircraft, so that what counts between them stays right.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import wrap_angle
from deckline.track.config import TrackConfig
from deckline.track.swing import PITCH_S, ROLL_S, stationary, swing
from deckline.types import RunwayLine

Array = NDArray[np.float64]
# The state. Of the line: y of the centre line at the point, m; its azimuth, rad; spacing of the lines there, m; right
# line's azimuth minus left line's, rad; deck z at rest, m; the centre line's speed to the right, m/s.
OFFSET, AZIMUTH, SPACING, ANGLE, HEIGHT, DRIFT = range(6)
# Of the deck about its rest, each with its rate: z at the point, m; z per metre along and to the right, rad.
RISE, RISE_RATE, TILT, TILT_RATE, BANK, BANK_RATE = range(6, 12)
# Common errors: attitude about x and y, rad; reported deck z at rest, m; depth, focal length, share; pose behind the
# picture, s; lines, m.
ROLL, PITCH, DECK, SCALE, FOCAL, DELAY, LEFT, RIGHT = range(12, 20)
SIZE = 20
SWINGS = ((RISE, PITCH_S), (TILT, PITCH_S), (BANK, ROLL_S))
SIGN = {"left": -1.0, "right": 1.0, "centre": 0.0}
# Of a spacing of which nothing is known: between the paper's and SPEC section 7's.
SPACING_M, SPACING_SIGMA_M = 20.0, 20.0
KNOWN_DRIFT_M_S = 0.3  # 1-sigma of the lines' sideways speed when the ship's velocity is known
RAMP_M = 20.0  # by which the ramp may be missed at first, far away
START_M, START_RAD = 1000.0, 1.0  # 1-sigma of a line of which nothing is known


@dataclass(frozen=True, eq=False)
class Pose:
    """The aircraft in one frame, and how its pose changes; world frame, as the aircraft's unit has it."""

    position_m: Array  # (3,) of the camera
    velocity_m_s: Array  # (3,)
    turning_rad_s: Array  # (3,) about x, y and z of the world


@dataclass(frozen=True, eq=False)
class State:
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
        """World z of the deck at the point, as it lies now."""
        return float(self.point_m[2] + self.mean[RISE])

    def local(self, point_m: Array) -> Array:
        """World point (3,) -> x, y, z from the state's point."""
        away = point_m - self.point_m
        return np.array([away @ self.along, away @ self.right, away[2]])


def width_sigma_m(config: TrackConfig) -> float:
    """1-sigma of a stated spacing: of itself, and of where along lines that are not parallel it is meant."""
    return float(np.hypot(config.runway_width_sigma_m, config.angle_sigma_rad * RAMP_M))


def error_sigmas(config: TrackConfig) -> Array:
    """1-sigma (8,) of the common errors, from ROLL on."""
    e = config.errors
    deck = float(np.hypot(config.rest_z_m, e.position_m))  # the pose's own height is as wrong as the deck's
    attitude = (e.attitude_rad, e.attitude_rad)
    return np.array([*attitude, deck, e.depth_scale, e.focal_fraction, e.delay_s, e.line_m, e.line_m])


def swing_sigmas(config: TrackConfig) -> Array:
    """1-sigma (3,) of rise, tilt and bank."""
    return np.array([config.motion.rise_m, config.motion.tilt_rad, config.motion.bank_rad])


def initial_state(time_s: float, line: RunwayLine, ramp_m: Array | None, config: TrackConfig) -> State:
    """Nothing is known but that there is a runway near a measured line, whose point and direction count from now on.

    Args:
        ramp_m: (3,) world, about where the runway begins and has its stated spacing; None: at the line's point.
    """
    width, motion = config.runway_width_m, config.motion
    mean = np.zeros(SIZE)
    mean[SPACING] = SPACING_M if width is None else width
    mean[ANGLE] = config.angle_rad
    sigma = np.zeros(SIZE)
    sigma[[OFFSET, AZIMUTH, HEIGHT]] = START_M, START_RAD, START_M
    sigma[SPACING] = SPACING_SIGMA_M if width is None else width_sigma_m(config)
    sigma[ANGLE] = config.angle_sigma_rad
    sigma[DRIFT] = motion.drift_m_s if motion.ship_velocity_m_s is None else min(motion.drift_m_s, KNOWN_DRIFT_M_S)
    sigma[ROLL:] = error_sigmas(config)
    covariance = np.diag(sigma**2)
    for (place, period_s), size in zip(SWINGS, swing_sigmas(config), strict=True):
        covariance[place : place + 2, place : place + 2] = size**2 * stationary(period_s)
    state = State(time_s, line.point_m, line.azimuth_rad, mean, covariance)
    if ramp_m is None:
        return state
    beyond = np.eye(SIZE)
    beyond[SPACING, ANGLE] = -float(state.local(ramp_m)[0])
    return replace(state, mean=beyond @ mean, covariance=beyond @ state.covariance @ beyond.T)


def predict(state: State, time_s: float, aircraft_m: Array | None, config: TrackConfig) -> State:
    """The state at a later time.

    Args:
        aircraft_m: (3,) world; a drifting heading turns the line about it. None: not known, about the line's point.
    """
    dt = time_s - state.time_s
    motion, errors = config.motion, config.errors
    move, noise = np.eye(SIZE), np.zeros((SIZE, SIZE))
    move[OFFSET, DRIFT] = dt
    drift = motion.drift_m_s15**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    noise[np.ix_([OFFSET, DRIFT], [OFFSET, DRIFT])] = drift
    for (place, period_s), size in zip(SWINGS, swing_sigmas(config), strict=True):
        both = slice(place, place + 2)
        move[both, both], driven = swing(dt, period_s)
        noise[both, both] = size**2 * driven
    keep = float(np.exp(-dt / errors.drift_s))
    move[[ROLL, PITCH], [ROLL, PITCH]] = keep
    noise[[ROLL, PITCH], [ROLL, PITCH]] = errors.attitude_rad**2 * (1 - keep**2)
    noise[SPACING, SPACING] = motion.spacing_m_s05**2 * dt
    noise[AZIMUTH, AZIMUTH] = motion.turn_rad_s05**2 * dt
    fresh = 2 * dt / errors.drift_s  # of a drifting error's variance
    noise[[OFFSET, HEIGHT], [OFFSET, HEIGHT]] += errors.position_m**2 * fresh
    x = 0.0 if aircraft_m is None else float(state.local(aircraft_m)[0])
    turned = np.zeros(SIZE)
    turned[[OFFSET, AZIMUTH]] = -x, 1.0
    noise += errors.attitude_rad**2 * fresh * np.outer(turned, turned)
    point = state.point_m + dt * np.array([*(motion.ship_velocity_m_s or (0.0, 0.0)), 0.0])
    moved = replace(state, time_s=time_s, point_m=point, mean=move @ state.mean)
    return folded(replace(moved, covariance=move @ state.covariance @ move.T + noise))


def folded(state: State) -> State:
    """The same belief with the mean's offset, azimuth and height moved into point and azimuth."""
    mean = state.mean.copy()
    point = state.point_m + mean[OFFSET] * state.right + np.array([0.0, 0.0, mean[HEIGHT]])
    azimuth = float(wrap_angle(state.azimuth_rad + mean[AZIMUTH]))
    mean[[OFFSET, AZIMUTH, HEIGHT]] = 0.0
    return replace(state, point_m=point, azimuth_rad=azimuth, mean=mean)


def shifted(state: State, x_m: float) -> State:
    """The same belief, told at a point `x_m` farther along the line."""
    move = np.eye(SIZE)
    for place, rate in ((OFFSET, AZIMUTH), (SPACING, ANGLE), (RISE, TILT), (RISE_RATE, TILT_RATE)):
        move[place, rate] = x_m
    covariance = move @ state.covariance @ move.T
    return replace(state, point_m=state.point_m + x_m * state.along, mean=move @ state.mean, covariance=covariance)


def updated(state: State, values: Array, design: Array, noise: Array) -> State:
    """Kalman's update in Joseph's form, which keeps the covariance symmetric and positive.

    Args:
        values: (m,) measured minus predicted.
        design: (m, 20) what a state's component does to a measurement.
        noise: (m, m).
    """
    spread = design @ state.covariance @ design.T + noise
    gain = np.linalg.solve(spread, design @ state.covariance).T
    rest = np.eye(SIZE) - gain @ design
    covariance = rest @ state.covariance @ rest.T + gain @ noise @ gain.T
    mean = state.mean + gain @ values
    return folded(replace(state, mean=mean, covariance=(covariance + covariance.T) / 2))
