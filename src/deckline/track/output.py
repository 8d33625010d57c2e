"""What the track says of the aircraft's motion against the runway."""

import numpy as np

from deckline.track.aircraft import Aircraft
from deckline.track.config import TrackConfig
from deckline.track.extent import Extent
from deckline.track.state import DRIFT, HEAVE, Pose, State
from deckline.types import Value

MAX_SIGMA_M_S = 20.0  # of an aircraft's velocity of which hardly anything is known yet: nothing is said


def rates_of(
    state: State, aircraft: Aircraft | None, pose: Pose | None, ramp: Extent | None, config: TrackConfig
) -> tuple[Value | None, Value | None, Value | None]:
    """Rates of the lateral deviation, of the height above deck, and the closing speed, m/s; None: not known.

    The lines' own motion - of ship and deck - is part of the rates.
    """
    if aircraft is None or pose is None or aircraft.velocity_sigma_m_s > MAX_SIGMA_M_S:
        return None, None, None
    own = aircraft.velocity_sigma_m_s
    velocity, variance = aircraft.velocity_m_s, np.diag(state.covariance)
    ship = np.array([*(config.motion.ship_velocity_m_s or (0.0, 0.0)), 0.0])
    lateral = (velocity - ship) @ state.right - state.mean[DRIFT]
    height = state.mean[HEAVE] - velocity[2]
    closing = None
    if ramp is not None:
        speed_sigma = float(np.sqrt(ramp.covariance[1, 1]))
        closing = Value(float(velocity @ state.along - ramp.speed_m_s), float(np.hypot(own, speed_sigma)))
    return (
        Value(float(lateral), float(np.sqrt(own**2 + variance[DRIFT]))),
        Value(float(height), float(np.sqrt(own**2 + variance[HEAVE]))),
        closing,
    )
