"""Tracks predicted to later times, against the truth of approaches without pictures."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from point_flight import Flight, approach, deviations, true_lines, true_pose
from steady_view import CALM, NOTHING, advance, advance_all

from deckline.track import Tracker
from deckline.track.forecast import describe_track
from deckline.track.motion import Pose


def forecasts(flight, ahead_s):
    """Errors (N, 3) of lateral deviation, heading and height so long after each frame, and their 1-sigma (N, 3)."""
    tracker, errors, sigmas = Tracker(CALM), [], []
    for frame, estimate, _ in approach(flight):
        advance(tracker, frame, estimate)
        time_s, forecast = frame.time_s + ahead_s, tracker.forecast()
        if frame.time_s < 2.0 or forecast is None or (moment := forecast.at(time_s)) is None:
            continue
        track, body, turn_rad = moment
        line = track.lines["centre"]
        exact = deviations(true_pose(flight, time_s), true_lines(flight, time_s)["centre"])
        behind = float((body.translation - line.point_m) @ line.direction)
        carry = np.array([[-1.0, -behind, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
        variance = np.diag(carry @ line.relative_covariance @ carry.T) + np.array([0.0, turn_rad**2, 0.0])
        errors.append(deviations(body, line) - exact)
        sigmas.append(np.sqrt(variance))
    return np.array(errors), np.array(sigmas)


def test_errors_of_a_forecast_agree_with_its_covariance():
    shares = []
    for seed in range(3):
        errors, sigmas = forecasts(Flight(seed=seed, rate_hz=5.0), 0.3)
        shares.append(np.mean(np.abs(errors) < 2 * sigmas, axis=0))
    assert np.all(np.mean(shares, axis=0) > 0.9)


def test_uncertainty_grows_and_ends_with_the_track():
    tracker = Tracker(CALM)
    shown = list(islice(approach(Flight()), 31))
    advance_all(tracker, shown)
    frame, forecast = shown[-1][0], tracker.forecast()
    now, later = (forecast.at(frame.time_s + ahead_s) for ahead_s in (0.0, 0.5))
    for name in ("lateral_m", "vertical_m", "heading_rad"):
        assert getattr(later[0].protection, name) > getattr(now[0].protection, name)
    assert later[0].lines["centre"].relative_covariance[0, 0] > now[0].lines["centre"].relative_covariance[0, 0]
    assert later[2] > now[2] == 0.0
    np.testing.assert_allclose(now[1].translation, frame.world_from_body.translation, atol=0.3)
    ahead_m = np.linalg.norm(later[1].translation - now[1].translation)
    assert ahead_m == pytest.approx(0.5 * 65.0, rel=0.05)  # it flies at 65 m/s
    assert forecast.at(frame.time_s + 2.1) is None
    assert forecast.at(frame.time_s - 0.1) is None


@pytest.mark.parametrize(("range_m", "times"), [(300.0, 1.0), (675.0, 1.15), (2000.0, 1.3)])
def test_far_away_place_and_direction_are_less_sure_and_the_height_is_not(range_m, times, monkeypatch):
    tracker = Tracker(CALM)
    advance_all(tracker, approach(Flight(), end_m=770.0))
    memory = tracker.forecast().memory
    near_m = memory.extent.near_m - range_m * memory.state.along
    pose = Pose(near_m - [0.0, 0.0, 40.0], np.zeros(3), np.zeros(3))
    far = describe_track(memory, pose, CALM)
    monkeypatch.setattr("deckline.track.forecast.FAR_SIGMA_INFLATION", 1.0)
    plain = describe_track(memory, pose, CALM)
    for name in ("covariance", "relative_covariance"):
        found, usual = (np.sqrt(np.diag(getattr(track.lines["left"], name))) for track in (far, plain))
        np.testing.assert_allclose(found / usual, [times, times, 1.0], rtol=1e-3)
    assert far.protection.vertical_m == plain.protection.vertical_m
    assert (far.protection.lateral_m > plain.protection.lateral_m) == (times > 1)


def test_no_forecast_without_a_track_or_a_pose():
    tracker = Tracker(CALM)
    assert tracker.forecast() is None
    frames = list(approach(Flight(), end_m=780.0))
    advance_all(tracker, frames)
    frame = frames[-1][0]
    blind = replace(frame, time_s=frame.time_s + 0.1, world_from_body=None)
    advance(tracker, blind, NOTHING)
    assert tracker.forecast() is None or tracker.forecast().at(blind.time_s) is None
