"""The tracker's Kalman filter: prediction, update, and the lines and rates of a state."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.geometry import wrap_angle
from deckline.track.motion import PITCH_PERIOD_S, Aircraft, Pose, expected_acceleration
from deckline.track.states import FilterState, States, deck_motion_sigmas, transition_and_noise
from deckline.trackers import MAX_SPEED_SIGMA_M_S
from deckline.types import RunwayLine, Value

Array = NDArray[np.float64]
SIGN = {"left": -1.0, "right": 1.0, "centre": 0.0}


def predict(state: FilterState, time_s: float, aircraft_m: Array | None, config: RunConfig) -> FilterState:
    """The state at a later time.

    Args:
        aircraft_m: (3,) world; a drifting heading turns the line about it. None: not known, about the line's point.
        config: process noise of sensors and deck.
    """
    dt_s = time_s - state.time_s
    x = 0.0 if aircraft_m is None else float(state.local(aircraft_m)[0])
    transition, noise = transition_and_noise(dt_s, x, config)
    point = state.point_m + dt_s * np.array([*(config.deck.ship_velocity_m_s or (0.0, 0.0)), 0.0])
    covariance = transition @ state.covariance @ transition.T + noise
    return _fold(replace(state, time_s=time_s, point_m=point, mean=transition @ state.mean, covariance=covariance))


def _fold(state: FilterState) -> FilterState:
    """The same belief with the mean's offset, azimuth and height moved into point and azimuth."""
    mean = state.mean.copy()
    point = state.point_m + mean[States.OFFSET] * state.right + np.array([0.0, 0.0, mean[States.HEIGHT]])
    azimuth = float(wrap_angle(state.azimuth_rad + mean[States.AZIMUTH]))
    mean[[States.OFFSET, States.AZIMUTH, States.HEIGHT]] = 0.0
    return replace(state, point_m=point, azimuth_rad=azimuth, mean=mean)


def shift_reference(state: FilterState, x_m: float) -> FilterState:
    """The same belief, referred to a point `x_m` farther along the line."""
    transfer = np.eye(States.SIZE)
    changed = [States.OFFSET, States.SPACING, States.HEAVE, States.HEAVE_RATE]
    transfer[changed, [States.AZIMUTH, States.ANGLE, States.PITCH, States.PITCH_RATE]] = x_m
    covariance = transfer @ state.covariance @ transfer.T
    point = state.point_m + x_m * state.along
    return replace(state, point_m=point, mean=transfer @ state.mean, covariance=covariance)


def update(state: FilterState, innovation: Array, design: Array, noise: Array) -> FilterState:
    """Kalman update in Joseph's form, with which the covariance stays symmetric and positive.

    Args:
        innovation: (m,) measured minus predicted.
        design: (m, 20) what a state's component does to a measurement.
        noise: (m, m).
    """
    variance = design @ state.covariance @ design.T + noise
    gain = np.linalg.solve(variance, design @ state.covariance).T
    rest = np.eye(States.SIZE) - gain @ design
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
    rows = np.zeros((3, States.SIZE))
    rows[0, [States.OFFSET, States.AZIMUTH, States.SPACING, States.ANGLE]] = 1.0, at_m, sign / 2, sign / 2 * at_m
    rows[1, [States.AZIMUTH, States.ANGLE]] = 1.0, sign / 2
    y = sign / 2 * state.mean[States.SPACING]
    rows[2, [States.HEIGHT, States.HEAVE, States.PITCH, States.ROLL]] = 1.0, 1.0, at_m, y
    rows[:, States.DELAY] = delay
    return rows


def delay_effect(state: FilterState, pose: Pose, ahead_m: float) -> Array:
    """Change (3,) of offset, azimuth and z at a point `ahead_m` of the aircraft by a second of delay of the pose."""
    turn_rate = float(pose.turn_rate_rad_s[2])
    return -np.array([pose.velocity_m_s @ state.right + ahead_m * turn_rate, turn_rate, pose.velocity_m_s[2]])


def deck_acceleration(state: FilterState, at_m: float, config: RunConfig) -> Value:
    """Expected upward acceleration of the deck, m/s2; what its damping leaves out is part of the sigma.

    Args:
        at_m: where along the line, from the state's point.
        config: the size of the deck's motion.
    """
    row, sinking = np.zeros(States.SIZE), expected_acceleration(PITCH_PERIOD_S)
    row[States.HEAVE_MOTION], row[States.PITCH_MOTION] = -sinking, -at_m * sinking
    heave_m, pitch_rad, _ = deck_motion_sigmas(config)
    damped = sinking[1] * 2 * np.pi / PITCH_PERIOD_S * np.hypot(heave_m, at_m * pitch_rad)
    return Value(float(row @ state.mean), float(np.sqrt(row @ state.covariance @ row + damped**2)))


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
    lateral = (velocity - ship) @ state.right - state.mean[States.DRIFT]
    climb = np.zeros(States.SIZE)
    climb[[States.HEAVE_RATE, States.PITCH_RATE]] = 1.0, at_m
    height = climb @ state.mean - velocity[2]
    closing = None
    if ramp_speed is not None:
        closing = Value(float(velocity @ state.along - ramp_speed.value), float(np.hypot(own, ramp_speed.sigma)))
    return (
        Value(float(lateral), float(np.sqrt(own**2 + state.covariance[States.DRIFT, States.DRIFT]))),
        Value(float(height), float(np.sqrt(own**2 + climb @ state.covariance @ climb))),
        closing,
    )
