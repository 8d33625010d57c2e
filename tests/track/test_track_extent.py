"""Where the runway begins and ends, and where it is expected in the next frame."""

from dataclasses import replace

import numpy as np
import pytest
from point_flight import LENGTH_M, Flight, approach, true_lines
from steady_view import CALM, advance, advance_all, seen, view

from deckline.config import Deck, RunConfig
from deckline.track import Tracker
from deckline.track.extent import Ramp, move_ramp_to_deck, update_extent
from deckline.track.states import FAULTS, States, initial_state


@pytest.mark.parametrize("ship", [(0.0, 0.0), (8.0, -3.0)])
def test_the_runway_is_expected_where_it_is_in_the_next_frame(ship):
    flight = Flight(start_m=400.0, seed=8, rate_hz=5.0, ship_m_s=ship, modes="both")
    tracker, beside, along = Tracker(RunConfig(deck=Deck(sea_state=0.0, ship_velocity_m_s=ship))), [], []
    assert tracker.predict(next(iter(approach(flight)))[0]).runway is None
    for frame, estimate, truth in approach(flight, end_m=100.0):
        expected = tracker.predict(frame).runway
        if expected is not None and frame.time_s > 1.0:
            error = frame.world_from_body.translation - truth.translation
            for side, ends in (("left", expected.left_m), ("right", expected.right_m)):
                line = true_lines(flight, frame.time_s)[side]
                away = ends[0] - error - line.point_m
                beside.append(abs(away @ line.right) / expected.sigma_m)
                along.append(away @ line.direction)
                assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(LENGTH_M, abs=40.0)
        advance(tracker, frame, estimate)
    assert len(beside) > 30
    assert np.percentile(beside, 95) < 3.0
    assert np.abs(np.median(along)) < 2.0  # of one frame, the ramp is known within 1 m


@pytest.mark.parametrize(("aside_m", "followed"), [(20.0, False), (-20.0, True)])
def test_a_ramp_that_seems_farther_ahead_is_the_nearest_part_in_view_and_left_out(aside_m, followed):
    flight, errors = Flight(start_m=400.0, seed=8, rate_hz=5.0, modes="both"), []
    tracker = Tracker(CALM)
    for frame, estimate, truth in approach(flight, end_m=60.0):
        true_m = true_lines(flight, frame.time_s)["centre"].point_m
        if true_m[0] - truth.translation[0] < 150.0:
            estimate = replace(estimate, ramp_m=estimate.ramp_m + aside_m * np.array([1.0, 0.0, 0.0]))
        track = advance(tracker, frame, estimate)
        away = track.ramp_m - (frame.world_from_body.translation - truth.translation) - true_m
        errors.append(float(away[0]))
    assert (abs(errors[-1]) > 5.0) is followed


def test_the_nearest_part_comes_nearer_as_more_is_seen_and_a_ramp_does_not():
    """Without a ramp the near end is the nearest part that was in view, and the far end stays."""
    lines = seen(np.random.default_rng(0)).lines
    state = initial_state(0.0, lines["left"], None, CALM)
    ramp = Ramp(state.point_m + 60.0 * state.along, 1.0, np.zeros(FAULTS))
    for first, near_m in ((None, 20.0), (ramp, 60.0)):
        before = update_extent(None, state, (60.0, 160.0), first, 0.1, None, 5.0)
        after = update_extent(before, state, (20.0, 160.0), None, 0.0, None, 5.0)
        assert state.local(after.near_m)[0] == pytest.approx(near_m)
        assert after.length_m == pytest.approx(160.0 - near_m)


def test_a_lost_track_expects_nothing():
    flight = Flight(start_m=400.0, seed=9, rate_hz=5.0)
    tracker, shown = Tracker(CALM), list(approach(flight, end_m=100.0))
    advance_all(tracker, shown[:5])
    assert tracker.predict(shown[5][0]).runway is not None
    assert tracker.predict(shown[2][0]).runway is None  # a frame that is older than what was seen
    assert tracker.predict(shown[20][0]).runway is None  # more than two seconds later


def test_a_ramp_is_placed_on_the_deck_that_the_track_knows():
    """A camera 15 m above the reported deck and 100 m before the ramp; the deck has risen by 3 m and slopes."""
    frame, estimate = view(0.0), seen(np.random.default_rng(0))
    line = estimate.lines["left"]
    sigma_alone, sigma_track = float(np.sqrt(line.relative_covariance[2, 2])), 0.2
    measured = np.array([0.0, 0.0, -20.0])  # on the reported deck; the camera is at (-100, 0, -35)
    estimate = replace(estimate, ramp_m=measured, ramp_sigma_m=float(np.hypot(1.5, 100.0 / 15.0 * sigma_alone)))
    state = initial_state(0.0, replace(line, point_m=np.array([50.0, 0.0, -20.0]), azimuth_rad=0.0), None, CALM)
    mean, covariance = np.zeros(States.SIZE), np.zeros((States.SIZE, States.SIZE))
    mean[[States.HEAVE, States.PITCH]] = -2.5, 0.01
    covariance[States.HEIGHT, States.HEIGHT] = sigma_track**2
    gains = np.zeros((States.SIZE, FAULTS))
    gains[States.HEIGHT, -1] = 0.5  # of a wrong stated width
    ramp = move_ramp_to_deck(frame, estimate, replace(state, mean=mean, covariance=covariance), gains)
    down = 15.0 - 2.5 - 0.01 * 50.0
    np.testing.assert_allclose(ramp.place_m, [-100.0 + 100.0 * down / 15.0, 0.0, -35.0 + down])
    assert ramp.sigma_m == pytest.approx(np.hypot(1.5, 100.0 / 15.0 * sigma_track))
    range_m = 100.0 * down / 15.0
    expected = np.zeros(States.SIZE)  # a camera pitched by a little moves the ramp by (r^2 + h^2) / h times as much
    expected[[States.ATTITUDE_Y, States.FOCAL]] = (range_m**2 + down**2) / down, range_m
    np.testing.assert_allclose(ramp.response, [*expected[States.SHARED_ERRORS], 0.5 * 100.0 / 15.0])
    assert move_ramp_to_deck(frame, replace(estimate, ramp_m=None), state, gains) is None
