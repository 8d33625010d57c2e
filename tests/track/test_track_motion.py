"""The aircraft's velocity from poses that may jump; the deck's oscillation against its differential equation."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import RigidTransform, Rotation
from steady_view import view

from deckline.track.motion import (
    DAMPING,
    advance_aircraft,
    oscillate,
    start_aircraft,
)

VELOCITY_M_S, TURN_RAD_S, SIGMA_M = np.array([60.0, 1.0, 4.0]), 0.2, 0.05


def at(time_s, rng=None):
    noise = 0.0 if rng is None else rng.normal(0, SIGMA_M, 3)
    turn = Rotation.from_rotvec([0.0, 0.0, TURN_RAD_S * time_s])
    pose = RigidTransform.from_components(VELOCITY_M_S * time_s + noise, turn)
    return replace(view(time_s), world_from_body=pose)


def test_velocity_and_turn_rate_are_estimated():
    rng = np.random.default_rng(6)
    aircraft = start_aircraft(at(0.0, rng), SIGMA_M)
    for index in range(1, 40):
        aircraft, jump_m = advance_aircraft(aircraft, at(index / 10, rng), SIGMA_M)
        assert jump_m == 0.0
    assert np.all(np.abs(aircraft.velocity_m_s - VELOCITY_M_S) < 4 * aircraft.velocity_sigma_m_s)
    assert aircraft.velocity_sigma_m_s < 1.0
    assert aircraft.turn_rate_rad_s == pytest.approx([0.0, 0.0, TURN_RAD_S], abs=1e-6)


def test_a_jump_is_measured_and_restarts_the_aircraft():
    aircraft = start_aircraft(at(0.0), SIGMA_M)
    for index in range(1, 20):
        aircraft, _ = advance_aircraft(aircraft, at(index / 10), SIGMA_M)
    jumped = replace(
        at(2.0), world_from_body=RigidTransform.from_translation([0.0, 20.0, 0.0]) * at(2.0).world_from_body
    )
    after, jump_m = advance_aircraft(aircraft, jumped, SIGMA_M)
    assert jump_m == pytest.approx(20.0, abs=0.1)
    assert np.array_equal(after.velocity_m_s, np.zeros(3))


OMEGA = 2 * np.pi / 12.0
DRIFT = np.array([[0.0, 1.0], [-(OMEGA**2), -2 * DAMPING * OMEGA]])


@pytest.mark.parametrize("dt_s", [0.01, 0.3, 2.0, 30.0])
def test_transition_and_noise_solve_the_oscillators_equations(dt_s):
    transition, noise = oscillate(dt_s, 12.0)
    np.testing.assert_allclose(transition, expm(DRIFT * dt_s), atol=1e-12)
    push = 4 * DAMPING * OMEGA**3  # of white noise that keeps the deflection at 1-sigma 1

    def grow(_, flat):
        covariance = flat.reshape(2, 2)
        return (DRIFT @ covariance + covariance @ DRIFT.T + [[0.0, 0.0], [0.0, push]]).ravel()

    grown = solve_ivp(grow, (0.0, dt_s), np.zeros(4), rtol=1e-9, atol=1e-12).y[:, -1].reshape(2, 2)
    np.testing.assert_allclose(noise, grown, atol=1e-7)
