"""The state vector of the tracker's Kalman filter, and all its noise: initial, process and measurement.

Coordinates: x along the centre line in the direction of landing, y to its right, z down, from a point on the centre
line. The line's world coordinates are those of the aircraft's own navigation: an error of its position or heading moves
line and aircraft together, and their relative position stays right.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.track.motion import PITCH_PERIOD_S, ROLL_PERIOD_S, oscillate, stationary_covariance
from deckline.types import RunwayLine

Array = NDArray[np.float64]


class States:
    """Where each quantity is in the state vector: an index each, and slices of what belongs together."""

    OFFSET = 0  # y of the centre line at the point, m
    AZIMUTH = 1  # of the centre line, rad
    SPACING = 2  # of the edge lines at the point, m
    ANGLE = 3  # right line's azimuth minus left line's, rad
    HEIGHT = 4  # z of the deck at rest, m
    DRIFT = 5  # speed of the centre line to the right, m/s

    HEAVE, HEAVE_RATE = 6, 7  # z of the deck at the point about its rest, m; m/s
    PITCH, PITCH_RATE = 8, 9  # slope of the deck along the line, rad; rad/s
    ROLL, ROLL_RATE = 10, 11  # slope of the deck to the right, rad; rad/s
    HEAVE_MOTION, PITCH_MOTION, ROLL_MOTION = slice(6, 8), slice(8, 10), slice(10, 12)

    ATTITUDE_X, ATTITUDE_Y = 12, 13  # error of the pose's attitude about world x and y, rad
    DECK = 14  # error of the stated z of the deck at rest, m
    SCALE = 15  # error of the depths, as a share
    FOCAL = 16  # error of the focal length, as a share
    DELAY = 17  # of the pose behind the picture, s
    LEFT, RIGHT = 18, 19  # lateral error of the painted line, m
    SHARED_ERRORS = slice(12, 20)  # of all frames
    DISTURBANCES = slice(6, 20)  # motion of the deck and shared errors

    SIZE = 20


FAULTS = States.SHARED_ERRORS.stop - States.SHARED_ERRORS.start + 1  # possible faults: each shared error, stated width

# Initial state and its 1-sigma, P.
INITIAL_SIGMA_M, INITIAL_SIGMA_RAD = 1000.0, 1.0  # of an unknown line
SPACING_SIGMA_M = 20.0  # of a runway whose width is not stated, about the usual one
RAMP_SIGMA_M = 20.0  # of the ramp's place at first, far away
DRIFT_SIGMA_M_S = 2.0  # of the lines' unknown sideways speed: 25 knots along a ship whose lines are angled
KNOWN_DRIFT_SIGMA_M_S = 0.3  # the same when the ship's velocity is known

# Process noise, Q: densities. The sensors' drift and the deck's motion are in the configuration.
DRIFT_M_S15 = 0.05  # of the lines' sideways speed
TURN_RAD_S05 = float(np.deg2rad(0.08))  # random walk of the lines' direction: yaw, and pitch seen from far
SPACING_M_S05 = 0.005  # random walk of the spacing, so that a wrong one is unlearned
DECK_PERIODS_S = (  # of the deck's damped oscillations
    (States.HEAVE_MOTION, PITCH_PERIOD_S),
    (States.PITCH_MOTION, PITCH_PERIOD_S),
    (States.ROLL_MOTION, ROLL_PERIOD_S),
)

# Measurement noise, R: floors, so that exact sensors and perfect lines leave it invertible.
SENSOR_FLOOR = 1e-5, 1e-3, 1e-4  # of the stated sensors: rad, m, share
MIN_OWN_SIGMA = 1e-5  # m, rad; of a line's own noise
MIN_OWN_SHARE = 0.02  # of a measurement's variance that is its own and not shared by all frames


@dataclass(frozen=True, eq=False)
class FilterState:
    """Mean and covariance. OFFSET, AZIMUTH and HEIGHT of the mean are folded into point and azimuth, so they are 0."""

    time_s: float
    point_m: Array  # (3,) world, on the centre line; z of the deck at rest
    azimuth_rad: float
    mean: Array  # (20,)
    covariance: Array  # (20, 20)

    @cached_property
    def along(self) -> Array:
        """(3,) unit vector along the line."""
        return np.array([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad), 0.0])

    @cached_property
    def right(self) -> Array:
        """(3,) unit vector to the right of the line."""
        return np.array([-np.sin(self.azimuth_rad), np.cos(self.azimuth_rad), 0.0])

    @property
    def deck_z_m(self) -> float:
        """World z of the deck at the point at the moment."""
        return float(self.point_m[2] + self.mean[States.HEAVE])

    def local(self, point_m: Array) -> Array:
        """World point (3,) -> x, y, z from the state's point."""
        offset = point_m - self.point_m
        return np.array([offset @ self.along, offset @ self.right, offset[2]])


def width_sigma_m(config: RunConfig) -> float:
    """1-sigma of the width: where stated, of itself and of the place along not quite parallel lines where it holds."""
    if config.deck.width_m is None:
        return SPACING_SIGMA_M
    return float(np.hypot(config.deck.width_sigma_m, config.deck.angle_sigma_rad * RAMP_SIGMA_M))


def drift_sigma(config: RunConfig) -> float:
    """1-sigma of the lines' sideways speed, m/s."""
    return DRIFT_SIGMA_M_S if config.deck.ship_velocity_m_s is None else KNOWN_DRIFT_SIGMA_M_S


def error_sigmas(config: RunConfig) -> Array:
    """1-sigma (8,) of `States.SHARED_ERRORS`."""
    s = config.sensors
    deck = float(np.hypot(config.deck_rest_sigma_m, s.position_m))  # the pose's own height errs like the deck's
    return np.array(
        [s.attitude_rad, s.attitude_rad, deck, s.depth_scale, s.focal_fraction, s.delay_s, s.line_bias_m, s.line_bias_m]
    )


def deck_motion_sigmas(config: RunConfig) -> Array:
    """1-sigma (3,) of heave, pitch and roll."""
    motion = config.deck.motion
    return np.array([motion.heave_m, motion.pitch_rad, motion.roll_rad])


def initial_state(time_s: float, line: RunwayLine, ramp_m: Array | None, config: RunConfig) -> FilterState:
    """Nothing is known but that there is a runway near a measured line, whose point and direction are the reference.

    Args:
        line: measured, world.
        ramp_m: (3,) world, about where the runway begins and has its stated spacing; None: at the line's point.
    """
    mean = np.zeros(States.SIZE)
    mean[States.SPACING] = config.deck.expected_width_m
    mean[States.ANGLE] = config.deck.angle_rad
    sigma = np.zeros(States.SIZE)
    sigma[[States.OFFSET, States.HEIGHT]] = INITIAL_SIGMA_M
    sigma[States.AZIMUTH] = INITIAL_SIGMA_RAD
    sigma[States.SPACING] = width_sigma_m(config)
    sigma[States.ANGLE] = config.deck.angle_sigma_rad
    sigma[States.DRIFT] = drift_sigma(config)
    sigma[States.SHARED_ERRORS] = error_sigmas(config)
    covariance = np.diag(sigma**2)
    for (motion, period_s), size in zip(DECK_PERIODS_S, deck_motion_sigmas(config), strict=True):
        covariance[motion, motion] = size**2 * stationary_covariance(period_s)
    state = FilterState(time_s, line.point_m, line.azimuth_rad, mean, covariance)
    if ramp_m is None:
        return state
    transfer = np.eye(States.SIZE)
    transfer[States.SPACING, States.ANGLE] = -float(state.local(ramp_m)[0])
    return replace(state, mean=transfer @ mean, covariance=transfer @ state.covariance @ transfer.T)


def transition_and_noise(dt_s: float, aircraft_x_m: float, config: RunConfig) -> tuple[Array, Array]:
    """Transition matrix F (20, 20) over a time, and its process noise Q (20, 20).

    Args:
        aircraft_x_m: of the aircraft from the state's point: a drifting heading turns the line about it.
    """
    sensors = config.sensors
    transition, noise = np.eye(States.SIZE), np.zeros((States.SIZE, States.SIZE))
    transition[States.OFFSET, States.DRIFT] = dt_s
    lateral = [States.OFFSET, States.DRIFT]
    noise[np.ix_(lateral, lateral)] = DRIFT_M_S15**2 * np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
    for (motion, period_s), size in zip(DECK_PERIODS_S, deck_motion_sigmas(config), strict=True):
        transition[motion, motion], process = oscillate(dt_s, period_s)
        noise[motion, motion] = size**2 * process
    retained = float(np.exp(-dt_s / sensors.drift_s))
    attitude = [States.ATTITUDE_X, States.ATTITUDE_Y]
    transition[attitude, attitude] = retained
    noise[attitude, attitude] = sensors.attitude_rad**2 * (1 - retained**2)
    noise[States.SPACING, States.SPACING] = SPACING_M_S05**2 * dt_s
    noise[States.AZIMUTH, States.AZIMUTH] = TURN_RAD_S05**2 * dt_s
    renewed = 2 * dt_s / sensors.drift_s  # share of a drifting error's variance
    place = [States.OFFSET, States.HEIGHT]
    noise[place, place] += sensors.position_m**2 * renewed
    heading = np.zeros(States.SIZE)
    heading[[States.OFFSET, States.AZIMUTH]] = -aircraft_x_m, 1.0
    noise += sensors.attitude_rad**2 * renewed * np.outer(heading, heading)
    return transition, noise
