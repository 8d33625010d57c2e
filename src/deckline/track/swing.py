"""How a deck swings in the sea: damped oscillations about its rest, driven by noise."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PITCH_S, ROLL_S = 12.0, 22.0  # periods; SPEC section 7. Heave, 18 s there, is told from pitch by its size alone
DAMPING = 0.3  # share of the critical one: how little the next swing is like this one


def swing(dt_s: float, period_s: float) -> tuple[Array, Array]:
    """How deflection and rate move on in a time, (2, 2), and the noise that comes in, (2, 2), of 1-sigma deflection 1.

    The noise keeps deflection and rate at their stationary spread, 1 and the circular frequency.
    """
    omega = 2 * np.pi / period_s
    fade, turn = DAMPING * omega, omega * np.sqrt(1 - DAMPING**2)
    cos, sin = np.cos(turn * dt_s), np.sin(turn * dt_s) / turn
    move = np.exp(-fade * dt_s) * np.array([[cos + fade * sin, sin], [-(omega**2) * sin, cos - fade * sin]])
    spread = stationary(period_s)
    return move, spread - move @ spread @ move.T


def stationary(period_s: float) -> Array:
    """Covariance (2, 2) of deflection and rate of a swing of 1-sigma deflection 1."""
    return np.diag([1.0, (2 * np.pi / period_s) ** 2])
