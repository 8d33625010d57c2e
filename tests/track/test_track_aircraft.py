"""Velocity and turning from poses, and poses that jump."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from steady_view import view

from deckline.track.aircraft import first_seen, flown

VELOCITY_M_S, TURN_RAD_S, SIGMA_M = np.array([60.0, 1.0, 4.0]), 0.2, 0.05


def at(time_s, rng=None):
    noise = 0.0 if rng is None else rng.normal(0, SIGMA_M, 3)
    turn = Rotation.from_rotvec([0.0, 0.0, TURN_RAD_S * time_s])
    pose = RigidTransform.from_components(VELOCITY_M_S * time_s + noise, turn)
    return replace(view(time_s), world_from_body=pose)


def test_velocity_and_turning_are_those_flown():
    rng = np.random.default_rng(6)
    aircraft = first_seen(at(0.0, rng), SIGMA_M)
    for index in range(1, 40):
        aircraft, jump_m = flown(aircraft, at(index / 10, rng), SIGMA_M)
        assert jump_m == 0.0
    assert np.all(np.abs(aircraft.velocity_m_s - VELOCITY_M_S) < 4 * aircraft.velocity_sigma_m_s)
    assert aircraft.velocity_sigma_m_s < 1.0
    assert aircraft.turning_rad_s == pytest.approx([0.0, 0.0, TURN_RAD_S], abs=1e-6)


def test_a_jump_is_told_by_its_size_and_begins_anew():
    aircraft = first_seen(at(0.0), SIGMA_M)
    for index in range(1, 20):
        aircraft, _ = flown(aircraft, at(index / 10), SIGMA_M)
    jumped = replace(
        at(2.0), world_from_body=RigidTransform.from_translation([0.0, 20.0, 0.0]) * at(2.0).world_from_body
    )
    after, jump_m = flown(aircraft, jumped, SIGMA_M)
    assert jump_m == pytest.approx(20.0, abs=0.1)
    assert np.array_equal(after.velocity_m_s, np.zeros(3))


def test_no_pose_no_aircraft():
    blind = replace(view(0.0), world_from_body=None)
    assert first_seen(blind, SIGMA_M) is None
    assert flown(first_seen(at(0.0), SIGMA_M), blind, SIGMA_M) == (None, 0.0)
