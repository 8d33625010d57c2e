"""The state vector of a pose that the picture gives, and all its noise: prior, process and what errs alike.

Frame: the runway's. x along the landing from the ramp, y to the right of the centre line, z down, level; the deck is a
plane that slopes a little. The unknown attitude is a rotation beside the mean: the states are its small error.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import USUAL_WIDTH_M, RunConfig
from deckline.geometry import Camera

Array = NDArray[np.float64]


class States:
    """Where each quantity is in the state vector."""

    DISTANCE = 0  # of the ramp ahead of the aircraft, m
    LATERAL = 1  # of the aircraft, right of the centre line, m
    HEIGHT = 2  # of the aircraft above the deck's plane, m
    PLACE = slice(0, 3)
    RATES = slice(3, 6)  # of these three, m/s
    ATTITUDE = slice(6, 9)  # error of the rotation about the runway's x, y, z, rad
    TURN = slice(9, 12)  # rate of turn about these, rad/s
    MOTION = slice(0, 12)

    FOCAL = 12  # error of the focal length, as a share
    CX, CY = 13, 14  # error of the principal point, focal lengths
    CONSIDERED = slice(12, 15)  # never estimated: an approach hardly shows them, and linearization would pretend to
    HORIZON_UP = 15  # error of the horizon's height, rad; positive: it is seen too high
    HORIZON_TILT = 16  # error of its roll, rad
    WIDTH = 17  # error of the width, m
    ANGLE = 18  # right line's azimuth minus left line's, rad; its mean includes what is stated
    SLOPE, CANT = 19, 20  # of the deck's z along the lines and to their right, rad
    LEFT, RIGHT = 21, 22  # lateral error of the painted lines, m
    LEVEL_X, LEVEL_Y = 23, 24  # error of an attitude sensor about the runway's x and y, rad
    SHARED = slice(12, 25)

    SIZE = 25


# Prior 1-sigma.
PLACE_SIGMA_M = 1000.0  # across and up
# Of the ramp about the nearest visible part of the lines, until it is seen itself: what is stated of the width and of
# the angle between the lines holds there.
RAMP_SIGMA_M, RAMP_SIGMA_SHARE = 20.0, 0.3
# Of an unknown approach: hovering to 70 m/s; half as fast or thrice where width and focal length are assumed.
CLOSING_M_S, CLOSING_SIGMA_M_S = 50.0, 100.0
SIDE_SIGMA_M_S = 5.0  # of lateral and vertical speed
PITCH_SIGMA_RAD, HEADING_SIGMA_RAD = np.deg2rad([15.0, 20.0])  # of a camera that sees a runway ahead
TURN_SIGMA_RAD_S = float(np.deg2rad(3.0))  # about each axis; an approach in gusts
DIP_RAD = float(np.deg2rad(0.2))  # of the sea's horizon, from 50 m; from 10 to 150 m it is 0.1 to 0.35
HORIZON_UP_SIGMA_RAD = float(np.deg2rad(0.2))  # of all looks together: the dip, and haze that thickens with range
HORIZON_TILT_SIGMA_RAD = float(np.deg2rad(0.1))
POINT_PER_FOCAL = 0.1  # error of the principal point, focal lengths, per share of the focal length's: a cropped picture
MIN_LEVEL_RAD = 1e-5  # of an attitude sensor's noise: what is exact would contradict every picture

# Process noise.
ACCELERATION_M_S15 = np.array([2.0, 1.0, 1.0])  # density along, across and down; 2: 0.2 g for a second
TURN_TIME_S = 0.7  # over which a rate of turn is forgotten
HORIZON_TIME_S, SLOPE_TIME_S, CANT_TIME_S = 20.0, 3.0, 5.0  # over which these errors change; deck: a quarter period
FIXED = np.inf
FORGETTING_S = np.array(  # of States.SHARED but the last two, an attitude sensor's, whose time is stated
    [*3 * [FIXED], HORIZON_TIME_S, HORIZON_TIME_S, FIXED, FIXED, SLOPE_TIME_S, CANT_TIME_S, FIXED, FIXED]
)


@dataclass(frozen=True, eq=False)
class Belief:
    """Where the aircraft is relative to the runway: mean and covariance."""

    time_s: float
    rotation: Array  # (3, 3) runway_from_body
    mean: Array  # (25,); ATTITUDE of it is 0
    covariance: Array  # (25, 25)

    @property
    def width_m(self) -> float:
        """Between both lines at the ramp."""
        return float(self.mean[States.WIDTH])

    @property
    def world_from_body(self) -> RigidTransform:
        """The aircraft in the runway's frame."""
        distance, lateral, height = self.mean[States.PLACE]
        place = [-distance, lateral, -height - distance * self.mean[States.SLOPE]]
        return RigidTransform.from_components(place, Rotation.from_matrix(self.rotation))

    def sigma(self, index: int) -> float:
        """1-sigma of one state."""
        return float(np.sqrt(self.covariance[index, index]))

    @property
    def heading_row(self) -> Array:
        """(25,) change of the nose's azimuth, rad, with the states."""
        nose = self.rotation[:, 0]
        row = np.zeros(States.SIZE)
        x, y, z = nose / np.hypot(nose[0], nose[1])
        row[States.ATTITUDE] = -z * x, -z * y, 1.0
        return row

    def move(self, step: Array, covariance: Array) -> "Belief":
        """The belief after a step (25,) of its mean, with another covariance (25, 25)."""
        mean = self.mean + step
        turn = Rotation.from_rotvec(mean[States.ATTITUDE]).as_matrix()
        mean[States.ATTITUDE] = 0.0
        return replace(self, rotation=turn @ self.rotation, mean=mean, covariance=(covariance + covariance.T) / 2)


def shared_sigmas(camera: Camera, config: RunConfig) -> Array:
    """1-sigma (13,) of `States.SHARED` as stated."""
    sensors, deck = config.sensors, config.deck
    focal = sensors.focal_fraction if camera.focal_sigma is None else camera.focal_sigma
    point = max(sensors.attitude_rad, POINT_PER_FOCAL * focal)
    width = deck.width_sigma_m if deck.width_m is not None else 1e-6 * USUAL_WIDTH_M  # else it is the unit
    horizon = HORIZON_UP_SIGMA_RAD, HORIZON_TILT_SIGMA_RAD
    slopes = deck.motion.pitch_rad, deck.motion.roll_rad
    bias = sensors.line_bias_m
    level = sensors.attitude_rad
    sigmas = [focal, point, point, *horizon, width, deck.angle_sigma_rad, *slopes, bias, bias, level, level]
    return np.maximum(sigmas, 1e-6)


def initial_belief(time_s: float, rotation: Array, place_m: Array, shared_sigma: Array, config: RunConfig) -> Belief:
    """Nothing is known but what is stated; mean place (3,) and rotation (3, 3) are where the fit starts."""
    mean, sigma = np.zeros(States.SIZE), np.zeros(States.SIZE)
    mean[States.PLACE] = place_m
    mean[States.RATES.start] = -CLOSING_M_S
    mean[States.WIDTH] = config.deck.expected_width_m
    mean[States.ANGLE] = config.deck.angle_rad
    sigma[States.PLACE] = RAMP_SIGMA_M + RAMP_SIGMA_SHARE * place_m[0], PLACE_SIGMA_M, PLACE_SIGMA_M
    sigma[States.RATES] = CLOSING_SIGMA_M_S, SIDE_SIGMA_M_S, SIDE_SIGMA_M_S
    sigma[States.ATTITUDE] = config.picture.roll_sigma_rad, PITCH_SIGMA_RAD, HEADING_SIGMA_RAD
    sigma[States.TURN] = TURN_SIGMA_RAD_S
    sigma[States.SHARED] = shared_sigma
    return Belief(time_s, rotation, mean, np.diag(sigma**2))


def predict(belief: Belief, time_s: float, shared_sigma: Array, level_time_s: float) -> Belief:
    """The belief at a later time: constant speed in the runway's frame, a rate of turn that is forgotten.

    Args:
        shared_sigma: (13,) of `States.SHARED`.
        level_time_s: over which an attitude sensor's error changes, `sensors.drift_s`.
    """
    dt = time_s - belief.time_s
    transition, noise = np.eye(States.SIZE), np.zeros((States.SIZE, States.SIZE))
    place, rates = np.arange(0, 3), np.arange(3, 6)
    transition[place, rates] = dt
    density = ACCELERATION_M_S15**2
    noise[place, place], noise[rates, rates] = density * dt**3 / 3, density * dt
    noise[place, rates] = noise[rates, place] = density * dt**2 / 2
    attitude, turn = np.arange(6, 9), np.arange(9, 12)
    lost, variance = -float(np.expm1(-dt / TURN_TIME_S)), TURN_SIGMA_RAD_S**2
    transition[attitude, turn], transition[turn, turn] = TURN_TIME_S * lost, 1 - lost
    # Integrals of a first-order Gauss-Markov process.
    noise[turn, turn] = variance * lost * (2 - lost)
    noise[attitude, turn] = noise[turn, attitude] = variance * TURN_TIME_S * lost**2
    noise[attitude, attitude] = variance * TURN_TIME_S**2 * (2 * (dt / TURN_TIME_S - lost) - lost**2)
    shared = np.arange(States.SIZE)[States.SHARED]
    kept = np.exp(-dt / np.append(FORGETTING_S, 2 * [level_time_s]))
    transition[shared, shared] = kept
    noise[shared, shared] = shared_sigma**2 * (1 - kept**2)
    covariance = transition @ belief.covariance @ transition.T + noise
    step = transition @ belief.mean - belief.mean
    moved = belief.move(step, covariance)
    return replace(moved, time_s=time_s)


def line_rows(belief: Belief, at_m: float) -> Array:
    """Rows (3, 25): change of a line's offset, azimuth and z at a place, as the aircraft sees it, with the states."""
    ahead = float(belief.mean[States.DISTANCE]) + at_m
    rows = np.zeros((3, States.SIZE))
    rows[1] = -belief.heading_row
    rows[0] = ahead * rows[1]
    rows[0, States.LATERAL] -= 1.0
    rows[2, States.HEIGHT], rows[2, States.SLOPE], rows[2, States.DISTANCE] = 1.0, ahead, belief.mean[States.SLOPE]
    return rows
