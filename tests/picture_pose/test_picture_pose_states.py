"""State vector, prior and process noise."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runway_picture import CAMERA, IN_WIDTHS, LEVEL, Runway, belief_of, draw_place

from deckline.config import Deck, PicturePose, RunConfig, Sensors
from deckline.geometry import Camera
from deckline.picture_pose.states import (
    POINT_PER_FOCAL,
    TURN_SIGMA_RAD_S,
    TURN_TIME_S,
    States,
    line_rows,
    predict,
    shared_sigmas,
)

SHARED, DRIFT_S = shared_sigmas(CAMERA, LEVEL), LEVEL.sensors.drift_s


def random_belief(seed):
    """A belief whose states all differ from zero and are correlated."""
    rng = np.random.default_rng(seed)
    start = belief_of(draw_place(rng), Runway(slope=0.01))
    scale = np.sqrt(np.diag(start.covariance)) * 0.01
    mixed = rng.normal(size=(States.SIZE, 2 * States.SIZE)) * scale[:, None]
    mean = start.mean + rng.normal(0, 1.0, States.SIZE) * scale
    mean[States.ATTITUDE] = 0.0
    return replace(start, mean=mean, covariance=mixed @ mixed.T)


@given(seed=st.integers(0, 1000))
@settings(max_examples=20)
def test_heading_and_line_rows_are_those_of_central_differences(seed):
    belief = random_belief(seed)
    at_m = 70.0

    def measure(b):
        """Azimuth of the nose, and offset, azimuth and z of the centre line at a place, from the aircraft."""
        nose = np.arctan2(b.rotation[1, 0], b.rotation[0, 0])
        distance, lateral, height = b.mean[States.PLACE]
        # The line turns about the aircraft as its nose turns the other way.
        turn = nose - np.arctan2(belief.rotation[1, 0], belief.rotation[0, 0])
        ahead = belief.mean[States.DISTANCE] + at_m
        below = height + b.mean[States.SLOPE] * (distance + at_m)
        return np.array([nose, -lateral - ahead * turn, -turn, below])

    expected = []
    for index in range(States.SIZE):
        step = 1e-6 * np.eye(States.SIZE)[index]
        ahead, behind = (measure(belief.move(sign * step, belief.covariance)) for sign in (1, -1))
        expected.append((ahead - behind) / 2e-6)
    rows = np.vstack([belief.heading_row, line_rows(belief, at_m)])
    np.testing.assert_allclose(rows, np.stack(expected, axis=1), atol=1e-4)


def test_what_is_stated_of_camera_and_deck_is_the_prior():
    sensors = Sensors(focal_fraction=0.003, attitude_deg=0.05, line_bias_m=0.2)
    config = RunConfig(sensors, Deck(sea_state=5.0, width_m=15.0, width_sigma_m=0.3, angle_sigma_deg=0.4))
    sigma = shared_sigmas(CAMERA, config)
    by_name = {name: sigma[getattr(States, name) - States.SHARED.start] for name in ("FOCAL", "CX", "CY", "WIDTH")}
    assert by_name == pytest.approx({"FOCAL": 0.003, "CX": np.deg2rad(0.05), "CY": np.deg2rad(0.05), "WIDTH": 0.3})
    assert sigma[States.ANGLE - States.SHARED.start] == pytest.approx(np.deg2rad(0.4))
    painted = slice(States.LEFT - States.SHARED.start, States.RIGHT + 1 - States.SHARED.start)
    assert sigma[painted].tolist() == [0.2, 0.2]
    assert sigma[-2:] == pytest.approx(np.deg2rad(0.05))  # of an attitude sensor
    slope, cant = sigma[[States.SLOPE - States.SHARED.start, States.CANT - States.SHARED.start]]
    assert (slope, cant) == pytest.approx((config.deck.motion.pitch_rad, config.deck.motion.roll_rad))
    rolled = belief_of(config=replace(LEVEL, picture=PicturePose(roll_sigma_deg=2.0)))
    assert rolled.sigma(States.ATTITUDE.start) == pytest.approx(np.deg2rad(2.0))


def test_what_is_not_stated_has_a_usual_prior():
    """A wide focal length and principal point of an assumed camera; the width is the unit."""
    focal, *point = shared_sigmas(Camera.assumed(1280, 720), LEVEL)[:3]
    assert (focal, point) == (pytest.approx(0.35), pytest.approx([0.35 * POINT_PER_FOCAL] * 2))
    assert shared_sigmas(CAMERA, IN_WIDTHS)[States.WIDTH - States.SHARED.start] < 1e-4


def in_steps(belief, time_s, count):
    for at in np.linspace(belief.time_s, time_s, count + 1)[1:]:
        belief = predict(belief, float(at), SHARED, DRIFT_S)
    return belief


@given(seed=st.integers(0, 1000), dt=st.floats(1e-4, 2.0))
@settings(max_examples=20)
def test_one_prediction_is_many_short_ones(seed, dt):
    belief = random_belief(seed)
    once, composed = predict(belief, dt, SHARED, DRIFT_S), in_steps(belief, dt, 20)
    assert once.time_s == dt
    np.testing.assert_allclose(once.mean, composed.mean, atol=1e-9)
    np.testing.assert_allclose(once.rotation, composed.rotation, atol=1e-4)  # turns about several axes do not commute
    sigma = np.sqrt(np.diag(composed.covariance))
    difference = (once.covariance - composed.covariance) / np.outer(sigma, sigma)
    np.testing.assert_allclose(difference, 0.0, atol=1e-7)


def test_the_predicted_covariance_is_that_of_sampled_flights():
    """Euler steps of the motion with white acceleration and a rate of turn that is forgotten."""
    rng, belief, dt, steps, flights = np.random.default_rng(0), random_belief(1), 1.0, 200, 4000
    states = rng.multivariate_normal(np.zeros(12), belief.covariance[:12, :12], flights)
    h = dt / steps
    for _ in range(steps):
        states[:, 0:3] += h * states[:, 3:6]
        states[:, 6:9] += h * states[:, 9:12]
        states[:, 3:6] += np.array([2.0, 1.0, 1.0]) * np.sqrt(h) * rng.normal(size=(flights, 3))
        renewal = TURN_SIGMA_RAD_S * np.sqrt(2 * h / TURN_TIME_S)
        states[:, 9:12] += -h / TURN_TIME_S * states[:, 9:12] + renewal * rng.normal(size=(flights, 3))
    predicted = predict(belief, dt, SHARED, DRIFT_S).covariance[:12, :12]
    sigma = np.sqrt(np.diag(predicted))
    # Chance moves a correlation by 0.016, a variance by 0.022.
    np.testing.assert_allclose(np.cov(states.T) / np.outer(sigma, sigma), predicted / np.outer(sigma, sigma), atol=0.09)


def test_the_stated_time_renews_an_attitude_sensors_error():
    """Known to a tenth, it is nearly as before after 10 s of 1000 and as stated after 10 s of 1."""
    belief = random_belief(3)
    stated = SHARED[States.LEVEL_X - States.SHARED.start]
    covariance = belief.covariance.copy()
    covariance[States.LEVEL_X], covariance[:, States.LEVEL_X] = 0.0, 0.0
    covariance[States.LEVEL_X, States.LEVEL_X] = (0.1 * stated) ** 2
    known = replace(belief, covariance=covariance)
    slow, fast = (predict(known, 10.0, SHARED, time_s).sigma(States.LEVEL_X) / stated for time_s in (1000.0, 1.0))
    assert (slow, fast) == (pytest.approx(0.17, abs=0.01), pytest.approx(1.0, abs=1e-6))


def test_what_changes_with_time_returns_to_what_is_stated():
    far = predict(random_belief(3), 600.0, SHARED, DRIFT_S)
    sigma = np.sqrt(np.diag(far.covariance))
    assert np.linalg.eigvalsh(far.covariance / np.outer(sigma, sigma)).min() > -1e-9
    for index in (States.HORIZON_UP, States.SLOPE, States.CANT):
        assert far.mean[index] == pytest.approx(0.0, abs=1e-6)
        assert far.sigma(index) == pytest.approx(SHARED[index - States.SHARED.start])
    near = random_belief(3)
    for index in (States.FOCAL, States.WIDTH, States.LEFT):
        assert far.mean[index] == near.mean[index]
        assert far.sigma(index) == pytest.approx(near.sigma(index))
