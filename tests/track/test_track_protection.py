"""Protection levels and what they are made of, in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from steady_view import CALM, KNOWN, SWELL, measured, start

from deckline.config import Integrity
from deckline.track.filter import update
from deckline.track.motion import Pose
from deckline.track.prior_tests import UNBOUNDED_YAW, prior_tests, unverified_reasons
from deckline.track.protection import fault_gains, least_closing_speed, protection_levels, undetected_yaw
from deckline.track.states import KNOWN_DRIFT_SIGMA_M_S, States
from deckline.types import Value

QUANTILE = 5.3267  # of a normal error, two-sided, at a risk of 1e-7
MOORED = replace(CALM, deck=replace(CALM.deck, ship_velocity_m_s=(0.0, 0.0)))


def test_the_protection_level_is_that_of_noise_plus_the_worst_undetected_fault():
    state = start(KNOWN)
    covariance = np.zeros((States.SIZE, States.SIZE))
    covariance[States.HEIGHT, States.HEIGHT] = 0.3**2
    # z moves with the deck height, which is as unsure as at first
    covariance[States.HEIGHT, States.DECK] = covariance[States.DECK, States.HEIGHT] = -0.02
    covariance[States.DECK, States.DECK] = state.covariance[States.DECK, States.DECK]
    state = replace(state, covariance=covariance)
    pose = Pose(np.array([-100.0, 0.0, -10.0]), np.zeros(3), np.zeros(3))
    tests = prior_tests(state, 0.0, KNOWN)
    level = protection_levels(state, pose, None, None, tests, None, 1.0, KNOWN)
    sigma, prior = np.hypot(0.3, KNOWN.sensors.position_white_m), state.covariance[States.DECK, States.DECK]
    assert level.vertical_m == pytest.approx(QUANTILE * sigma + 0.02 / prior * KNOWN.integrity.max_deck_z_m, rel=1e-3)
    rarer = protection_levels(state, pose, None, None, tests, None, 1.0, replace(KNOWN, integrity=Integrity(risk=1e-3)))
    assert level.vertical_m - rarer.vertical_m == pytest.approx((QUANTILE - 3.2905) * sigma, rel=1e-3)


def test_the_yaw_that_stays_undetected_is_what_the_drift_of_the_lines_allows():
    """The largest drift of a ship, the measured one and its quantile; with the ship's velocity, that one's error."""
    sigma = 0.1
    unknown = (CALM.integrity.max_drift_m_s + 0.5 + QUANTILE * sigma) / 60.0
    state = measured(start(CALM), States.DRIFT, 0.5, sigma)
    assert undetected_yaw(state, 60.0, CALM) == pytest.approx(np.arcsin(unknown), rel=1e-4)
    stated = (0.5 + QUANTILE * np.hypot(KNOWN_DRIFT_SIGMA_M_S, sigma)) / 20.0
    state = measured(start(MOORED), States.DRIFT, -0.5, sigma)
    assert undetected_yaw(state, 20.0, MOORED) == pytest.approx(np.arcsin(stated), rel=1e-4)


def test_no_yaw_is_bounded_while_the_drift_is_unknown_or_the_aircraft_slow():
    assert undetected_yaw(start(CALM), 60.0, CALM) is None
    assert undetected_yaw(start(MOORED), 60.0, MOORED) is None
    state = measured(start(CALM), States.DRIFT, 0.0, 0.1)
    assert undetected_yaw(state, 20.0, CALM) is None  # 12 degrees would not show
    assert undetected_yaw(state, -5.0, CALM) is None
    tests = prior_tests(state, 0.0, CALM)
    assert unverified_reasons(state, 5.0, tests, None, CALM) == (UNBOUNDED_YAW,)
    assert unverified_reasons(state, 5.0, tests, 0.1, CALM) == ()


def test_the_closing_speed_is_the_least_that_ship_and_pictures_allow():
    state = start(CALM)
    pose = Pose(np.zeros(3), np.array([40.0, 3.0, 2.0]), np.zeros(3))
    assert least_closing_speed(state, pose, None, CALM) == pytest.approx(40.0 - CALM.integrity.max_ship_m_s)
    assert least_closing_speed(state, pose, Value(38.0, 1.0), CALM) == pytest.approx(38.0 - QUANTILE, rel=1e-4)
    assert least_closing_speed(state, pose, Value(38.0, 9.0), CALM) == pytest.approx(40.0 - CALM.integrity.max_ship_m_s)
    sailing = replace(CALM, deck=replace(CALM.deck, ship_velocity_m_s=(8.0, 2.0)))
    assert least_closing_speed(state, pose, Value(38.0, 1.0), sailing) == pytest.approx(32.0)


def test_a_wrong_stated_width_moves_the_estimates_by_the_posterior_of_a_wrong_prior_mean():
    """Two priors a metre apart, the same measurement of spacing and height: the difference of the means."""
    means = []
    for width_m in (15.0, 16.0):
        config = replace(SWELL, deck=replace(SWELL.deck, width_m=width_m))
        state = start(config)
        design = np.zeros((1, States.SIZE))
        design[0, [States.SPACING, States.HEAVE]] = 1.0, -0.7
        state = update(state, np.array([15.2 - width_m]), design, np.array([[0.2**2]]))
        means.append(state.mean)
    gain = fault_gains(state, 0.0, config)[:, -1]
    assert abs(gain[States.HEAVE]) > 0.5
    np.testing.assert_allclose(means[1] - means[0], gain, atol=1e-12)
