"""Lines of a state: their covariance, that the state expects them, and how the ship moves along them."""

from dataclasses import replace

import numpy as np
import pytest
from point_flight import ALONG, Flight, approach
from steady_view import CALM, KNOWN, advance, view

from deckline.track import Tracker, ship_velocity
from deckline.track.filter import track_lines
from deckline.track.measurement import measure
from deckline.track.motion import Pose
from deckline.track.states import States, initial_state
from deckline.types import SIDES, DepthMode, RunwayLine

POSE = Pose(view(0.0).world_from_camera.translation, np.zeros(3), np.zeros(3))
AT_M = 50.0


@pytest.fixture
def state():
    """Of lines 14 m apart at the state's point, which open by 0.02 rad."""
    start = initial_state(0.0, RunwayLine(np.array([10.0, 20.0, -5.0]), 0.3, np.eye(3)), None, KNOWN)
    mean = np.zeros(States.SIZE)
    mean[[States.SPACING, States.ANGLE]] = 14.0, 0.02
    return replace(start, mean=mean)


def test_a_states_own_lines_leave_no_innovation(state):
    lines = track_lines(state, None, AT_M, KNOWN)
    found = measure(state, {side: lines[side] for side in SIDES}, DepthMode.COARSE, POSE, KNOWN)
    np.testing.assert_allclose(found.innovation, 0.0, atol=1e-12)


def test_the_world_adds_the_errors_of_the_aircrafts_own_heading_and_position(state):
    ahead_m = AT_M - state.local(POSE.position_m)[0]
    heading, sensors = KNOWN.sensors.attitude_rad * np.array([ahead_m, 1.0, 0.0]), KNOWN.sensors
    own = np.outer(heading, heading) + sensors.position_m**2 * np.diag([1.0, 0.0, 1.0])
    for line in track_lines(state, POSE, AT_M, KNOWN).values():
        np.testing.assert_allclose(line.covariance - line.aircraft_covariance, own)


def test_a_ship_whose_velocity_is_not_stated_moves_along_its_lines_as_the_track_has_it():
    flight, tracker = (
        Flight(start_m=300.0, seed=8, rate_hz=5.0, modes="both", ship_m_s=tuple(8.0 * ALONG[:2])),
        Tracker(CALM),
    )
    assert ship_velocity(None, CALM).tolist() == [0.0, 0.0]
    for frame, estimate, _ in approach(flight, end_m=60.0):
        velocity = ship_velocity(tracker.predict(frame), CALM)
        advance(tracker, frame, estimate)
    np.testing.assert_allclose(velocity, 8.0 * ALONG[:2], atol=1.0)
