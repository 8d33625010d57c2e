"""From the filter's state to its answers: lines at the touchdown point, and rates against them."""

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.geometry import wrap_angle
from deckline.track.extent import Extent
from deckline.track.filter import (
    ANGLE,
    AZIMUTH,
    DELAY,
    DRIFT,
    HEAVE,
    HEAVE_RATE,
    HEIGHT,
    OFFSET,
    PITCH,
    PITCH_RATE,
    ROLL,
    SIGN,
    SIZE,
    SPACING,
    State,
)
from deckline.track.motion import Aircraft, Pose
from deckline.types import RunwayLine, Value

Array = NDArray[np.float64]
MAX_SPEED_SIGMA_M_S = 20.0  # of the aircraft's velocity, above which no rate is given


def track_lines(state: State, pose: Pose | None, at_m: float, config: RunConfig) -> dict[str, RunwayLine]:
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


def line_rows(state: State, sign: float, at_m: float, delay: Array) -> Array:
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


def delay_effect(state: State, pose: Pose, ahead_m: float) -> Array:
    """Change (3,) of offset, azimuth and z at a point `ahead_m` of the aircraft by a second of delay of the pose."""
    turn_rate = float(pose.turn_rate_rad_s[2])
    return -np.array([pose.velocity_m_s @ state.right + ahead_m * turn_rate, turn_rate, pose.velocity_m_s[2]])


def track_rates(
    state: State,
    aircraft: Aircraft | None,
    pose: Pose | None,
    ramp: Extent | None,
    at_m: float,
    config: RunConfig,
) -> tuple[Value | None, Value | None, Value | None]:
    """Rates of the lateral deviation, of the height above deck, and the closing speed, m/s; None: not known.

    The lines' own motion - of ship and deck - is part of the rates.

    Args:
        at_m: where the height is evaluated, from the state's point.
    """
    if aircraft is None or pose is None or aircraft.velocity_sigma_m_s > MAX_SPEED_SIGMA_M_S:
        return None, None, None
    own, velocity = aircraft.velocity_sigma_m_s, aircraft.velocity_m_s
    ship = np.array([*(config.deck.ship_velocity_m_s or (0.0, 0.0)), 0.0])
    lateral = (velocity - ship) @ state.right - state.mean[DRIFT]
    climb = np.zeros(SIZE)
    climb[[HEAVE_RATE, PITCH_RATE]] = 1.0, at_m
    height = climb @ state.mean - velocity[2]
    closing = None
    if ramp is not None:
        speed_sigma = float(np.sqrt(ramp.covariance[1, 1]))
        closing = Value(float(velocity @ state.along - ramp.speed_m_s), float(np.hypot(own, speed_sigma)))
    return (
        Value(float(lateral), float(np.sqrt(own**2 + state.covariance[DRIFT, DRIFT]))),
        Value(float(height), float(np.sqrt(own**2 + climb @ state.covariance @ climb))),
        closing,
    )
