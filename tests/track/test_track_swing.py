"""A deck's swing against its differential equation, and against a sine."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from deckline.track.swing import DAMPING, stationary, swing

OMEGA = 2 * np.pi / 12.0
DRIFT = np.array([[0.0, 1.0], [-(OMEGA**2), -2 * DAMPING * OMEGA]])


@pytest.mark.parametrize("dt_s", [0.01, 0.3, 2.0, 30.0])
def test_the_move_is_the_oscillators_and_the_noise_the_integral_of_what_drives_it(dt_s):
    move, noise = swing(dt_s, 12.0)
    np.testing.assert_allclose(move, expm(DRIFT * dt_s), atol=1e-12)
    push = 4 * DAMPING * OMEGA**3  # of white noise that keeps the deflection at 1-sigma 1

    def grow(_, flat):
        spread = flat.reshape(2, 2)
        return (DRIFT @ spread + spread @ DRIFT.T + [[0.0, 0.0], [0.0, push]]).ravel()

    grown = solve_ivp(grow, (0.0, dt_s), np.zeros(4), rtol=1e-9, atol=1e-12).y[:, -1].reshape(2, 2)
    np.testing.assert_allclose(noise, grown, atol=1e-7)


def test_two_steps_are_one():
    (once, first), (then, second), (whole, both) = swing(0.4, 22.0), swing(0.9, 22.0), swing(1.3, 22.0)
    np.testing.assert_allclose(then @ once, whole, atol=1e-12)
    np.testing.assert_allclose(then @ first @ then.T + second, both, atol=1e-12)


def test_a_long_time_forgets_everything():
    move, noise = swing(300.0, 12.0)
    np.testing.assert_allclose(move, 0.0, atol=1e-12)
    np.testing.assert_allclose(noise, stationary(12.0), atol=1e-12)
