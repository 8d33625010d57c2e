"""What the track says: its lines where aircraft touch down, and the aircraft's motion against them."""

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import wrap_angle
from deckline.track.aircraft import Aircraft
from deckline.track.config import TrackConfig
from deckline.track.extent import Extent
from deckline.track.state import (
    ANGLE,
    AZIMUTH,
    BANK,
    DELAY,
    DRIFT,
    HEIGHT,
    OFFSET,
    RISE,
    RISE_RATE,
    SIGN,
    SIZE,
    SPACING,
    TILT,
    TILT_RATE,
    Pose,
    State,
)
from deckline.types import RunwayLine, Value

Array = NDArray[np.float64]
MAX_SIGMA_M_S = 20.0  # of an aircraft's velocity of which hardly anything is known yet: nothing is said


def lines(state: State, pose: Pose | None, at_m: float, config: TrackConfig) -> dict[str, RunwayLine]:
    """The three lines in the world, as measured with the aircraft's pose.

    Args:
        pose: of the aircraft; None: not known, the line's own point is taken, which leaves the heading's part out.
        at_m: where along the line they are told, m from the state's point: the deck's height is that there.
    """
    e = config.errors
    x = 0.0 if pose is None else float(state.local(pose.position_m)[0])
    late = np.zeros(3) if pose is None else delayed(state, pose, at_m - x)
    turn, shift, rise = np.array([at_m - x, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    moves = [np.outer(turn, turn), np.outer(shift, shift) + np.outer(rise, rise)]
    white = e.attitude_white_rad**2 * moves[0] + e.position_white_m**2 * moves[1]
    whole = e.attitude_rad**2 * moves[0] + e.position_m**2 * moves[1]
    found = {}
    for side, sign in SIGN.items():
        take = line_rows(state, sign, at_m, late)
        y, turned, down = take @ state.mean
        covariance = take @ state.covariance @ take.T + white
        point = state.point_m + at_m * state.along + y * state.right + np.array([0.0, 0.0, down])
        azimuth = float(wrap_angle(state.azimuth_rad + turned))
        found[side] = RunwayLine(point, azimuth, covariance + whole, covariance)
    return found


def line_rows(state: State, sign: float, at_m: float, late: Array) -> Array:
    """Rows (3, 20) that give a line's offset, azimuth and z at a place along it.

    Args:
        sign: of the line's side.
        at_m: the place, from the state's point.
        late: (3,) what a late pose adds to them per second.
    """
    take = np.zeros((3, SIZE))
    take[0, [OFFSET, AZIMUTH, SPACING, ANGLE]] = 1.0, at_m, sign / 2, sign / 2 * at_m
    take[1, [AZIMUTH, ANGLE]] = 1.0, sign / 2
    take[2, [HEIGHT, RISE, TILT, BANK]] = 1.0, 1.0, at_m, sign / 2 * state.mean[SPACING]
    take[:, DELAY] = late
    return take


def delayed(state: State, pose: Pose, away_m: float) -> Array:
    """How a second of delay moves what the aircraft sees, `away_m` ahead of it: offset, azimuth and z."""
    turning = float(pose.turning_rad_s[2])
    return -np.array([pose.velocity_m_s @ state.right + away_m * turning, turning, pose.velocity_m_s[2]])


def rates_of(
    state: State,
    aircraft: Aircraft | None,
    pose: Pose | None,
    ramp: Extent | None,
    at_m: float,
    config: TrackConfig,
) -> tuple[Value | None, Value | None, Value | None]:
    """Rates of the lateral deviation, of the height above deck, and the closing speed, m/s; None: not known.

    The lines' own motion - of ship and deck - is part of the rates.

    Args:
        at_m: where the height is told, from the state's point.
    """
    if aircraft is None or pose is None or aircraft.velocity_sigma_m_s > MAX_SIGMA_M_S:
        return None, None, None
    own = aircraft.velocity_sigma_m_s
    velocity = aircraft.velocity_m_s
    ship = np.array([*(config.motion.ship_velocity_m_s or (0.0, 0.0)), 0.0])
    lateral = (velocity - ship) @ state.right - state.mean[DRIFT]
    sinking = np.zeros(SIZE)
    sinking[[RISE_RATE, TILT_RATE]] = 1.0, at_m
    height = sinking @ state.mean - velocity[2]
    closing = None
    if ramp is not None:
        speed_sigma = float(np.sqrt(ramp.covariance[1, 1]))
        closing = Value(float(velocity @ state.along - ramp.speed_m_s), float(np.hypot(own, speed_sigma)))
    return (
        Value(float(lateral), float(np.sqrt(own**2 + state.covariance[DRIFT, DRIFT]))),
        Value(float(height), float(np.sqrt(own**2 + sinking @ state.covariance @ sinking))),
        closing,
    )
