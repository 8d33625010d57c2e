"""The pose from the picture over the frames of a flight."""

from dataclasses import replace

import numpy as np
import pytest
from runway_picture import (
    CAMERA,
    FLIGHT,
    IN_WIDTHS,
    LEVEL,
    RATE_HZ,
    Follower,
    errors_of,
    fly,
    frame_at,
    horizon_sight,
    is_near,
    reasons,
    seconds,
    see,
    sights_of,
    with_horizon,
)
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from deckline.dehaze.horizon_search import ANSWER_S
from deckline.geometry import attitude, camera_mount
from deckline.picture_pose.model import Mount, horizon_innovation, lines_innovation, update
from deckline.picture_pose.states import States, predict, shared_sigmas
from deckline.trackers import CORRELATION_TIME_S
from deckline.types import Detection, Diagnostic, LinePoints, PoseSource, Reason, TrackState
from runway_scene import off_camera

NOTHING = Detection(LinePoints.empty(), LinePoints.empty())


def test_the_pose_is_followed_and_labelled(follower):
    answers = follower.follow(FLIGHT, seconds(0.0, 3.0), np.random.default_rng(1))
    last = answers[-1]
    assert last.frame.pose_source is PoseSource.PICTURE
    assert not last.frame.in_widths
    assert last.track.state is TrackState.TRACKING
    assert last.track.age_s == pytest.approx(2.9)
    assert (last.track.flags, last.track.doubts) == ((), ())
    assert is_near(follower.belief, FLIGHT(2.9), 3.5)
    assert last.track.closing_m_s.value == pytest.approx(40.0, abs=4 * last.track.closing_m_s.sigma)


def test_one_horizon_is_not_enough(follower):
    """Searches begin at 0 and 1 s, and answer 0.3 s later."""
    doubts = {
        round(found.track.time_s, 2): reasons(found.track.doubts)
        for found in follower.follow(FLIGHT, seconds(0.0, 2.0))
    }
    assert Reason.NO_HORIZON in doubts[1.2]
    assert Reason.NO_HORIZON not in doubts[1.4]


@pytest.mark.parametrize("white_deg", [0.02, 0.0])
def test_an_attitude_in_place_of_a_horizon(monkeypatch, white_deg):
    """A sensor's roll and pitch confirm the lines, and a sensor that contradicts them is flagged."""
    rng, sensors = np.random.default_rng(1), replace(LEVEL.sensors, attitude_white_deg=white_deg)
    blind = Follower(replace(LEVEL, sensors=sensors), monkeypatch)
    for time_s in seconds(0.0, 2.0):
        place = FLIGHT(time_s)
        tilted = replace(frame_at(time_s), level_from_body=attitude(place.roll, place.pitch, 0.7))
        found = blind(tilted, see(place, rng=rng))
    assert (found.track.flags, found.track.doubts) == ((), ())
    assert is_near(blind.belief, place, 3.5)
    wrong = replace(frame_at(2.0), level_from_body=attitude(place.roll + 0.1, place.pitch, 0.7))
    assert Reason.ATTITUDE in reasons(blind(wrong, see(FLIGHT(2.0))).track.flags)


def test_errors_agree_with_the_covariance(monkeypatch):
    scores = []
    for seed in range(8):
        flight = fly(lateral_m=4.0, seed=seed)
        follower = with_horizon(monkeypatch, LEVEL, flight, seed)
        rng = np.random.default_rng([seed, 3])
        for time_s in seconds(0.0, 3.0):
            follower(frame_at(time_s), see(flight(time_s), rng=rng))
            if time_s % 1.0 == 0.5 and time_s > 1.0:
                off, sigma = errors_of(follower.belief, flight(time_s))
                scores.append(off / sigma)
    # Exact camera, width and paint: less than stated. Errors of one flight hang together.
    squares = np.mean(np.square(scores), axis=0)
    assert np.all(squares < chi2.ppf(0.9995, 8) / 8)
    assert np.mean(np.abs(scores) < 1.96) > 0.93
    assert squares.mean() > 0.05


@pytest.mark.parametrize("height_m", [0.0, 1e-9, -3.0, np.nan])
def test_a_track_that_sinks_into_the_deck_begins_anew(follower, height_m):
    """There any picture of lines fits, and no matrix has an inverse."""
    follower.follow(FLIGHT, seconds(0.0, 1.0))
    follower.belief.mean[:3] = [1000.0, 0.0, height_m]
    found = follower(frame_at(1.0), see(FLIGHT(1.0)))
    assert reasons(found.track.diagnostics) == [Reason.RESTARTED]
    assert follower.belief.mean[States.HEIGHT] == pytest.approx(FLIGHT(1.0).height_m, rel=0.2)


def test_joined_frames_count_less_than_single_ones(monkeypatch):
    sigmas = []
    for frames in (1, 8):
        follower, rng = with_horizon(monkeypatch), np.random.default_rng(1)
        for time_s in seconds(0.0, 1.0):
            follower(frame_at(time_s), replace(see(FLIGHT(time_s), rng=rng), frames=frames))
        sigmas.append(np.sqrt(np.diag(follower.belief.covariance)[States.RATES]))
    assert np.all(sigmas[1] > sigmas[0]) and sigmas[1][2] > 1.1 * sigmas[0][2]


def test_a_reset_forgets_all_frames(follower):
    first = follower.follow(FLIGHT, seconds(0.0, 1.5))
    follower.tracker.reset()
    assert follower.tracker.forecast() is None
    again = follower.follow(FLIGHT, seconds(0.0, 1.5))
    for one, other in zip(first, again, strict=True):
        assert one.track.age_s == other.track.age_s
        np.testing.assert_array_equal(one.frame.world_from_body.as_matrix(), other.frame.world_from_body.as_matrix())


def test_a_gap_is_bridged_with_growing_uncertainty_and_then_lost(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0), np.random.default_rng(2))
    states, sigmas, misses = [], [], []
    for time_s in seconds(2.0, 4.5):
        answer = follower(frame_at(time_s), NOTHING)
        states.append(answer.track.state)
        if answer.track.state is TrackState.COASTING:
            off, sigma = errors_of(follower.belief, FLIGHT(time_s))
            sigmas.append(sigma)
            misses.append(np.abs(off / sigma))
    assert states == [TrackState.COASTING] * 20 + [TrackState.LOST] * 5  # lines were last seen at 1.9 s
    assert np.all(np.diff(np.array(sigmas)[:, :2], axis=0) > 0)
    assert np.max(misses) < 4.0
    (again,) = follower.follow(FLIGHT, [4.5])
    assert (again.track.state, again.track.age_s) == (TrackState.TRACKING, 0.0)


def test_a_horizon_that_arrives_late_counts_as_if_it_were_used_at_its_own_frame(follower):
    """The first frame's horizon, put in by hand in order, against the tracker that gets it three frames later.

    The camera turns on a gimbal meanwhile, as the poses of its mount state.
    """
    times, shared = seconds(0.0, 0.4), shared_sigmas(CAMERA, LEVEL)
    mounts = [camera_mount([0.4, 0.1, 0.2], Rotation.from_euler("y", -0.05 - 0.1 * t)) for t in times]
    follower(frame_at(times[0], mount=mounts[0]), gimballed(times[0], mounts[0]))
    first = follower.belief
    horizon = horizon_sight(FLIGHT(0.0), mount=mounts[0])
    expected = update(first, horizon_innovation(first, horizon, Mount.of(mounts[0])))
    for time_s, mount in zip(times[1:], mounts[1:], strict=True):
        assert not np.allclose(follower.belief.mean, expected.mean, atol=1e-4)
        expected = predict(expected, float(time_s), shared, LEVEL.sensors.drift_s)
        lines = lines_innovation(expected, sights_of(gimballed(time_s, mount)), Mount.of(mount))
        expected = update(expected, lines.inflate(CORRELATION_TIME_S * RATE_HZ))
        follower(frame_at(time_s, mount=mount), gimballed(time_s, mount))
    sigma = np.sqrt(np.diag(expected.covariance))
    np.testing.assert_allclose((follower.belief.mean - expected.mean) / sigma, 0.0, atol=1e-6)
    np.testing.assert_allclose(follower.belief.rotation, expected.rotation, atol=1e-9)
    difference = (follower.belief.covariance - expected.covariance) / np.outer(sigma, sigma)
    np.testing.assert_allclose(difference, 0.0, atol=1e-6)


def gimballed(time_s, mount):
    """What is detected at a time by a camera with this mount, without the ramp."""
    return without_ramp(see(FLIGHT(time_s), mount=mount, rng=np.random.default_rng(round(time_s * 10))))


def without_ramp(detection):
    """The detection of a searched part that ends where the lines do."""
    bottom = detection.left.points_px[:, 1].max() + 1.0
    return replace(detection, region_px=(0.0, 0.0, CAMERA.width - 1.0, bottom))


def test_what_is_kept_is_bounded_even_if_no_horizon_is_ever_found(blind):
    kept = []
    for time_s in seconds(0.0, 6.0):
        blind(frame_at(time_s), see(FLIGHT(time_s)))
        kept.append(len(blind.tracker._memory.since))
    assert max(kept) <= ANSWER_S * RATE_HZ
    assert Reason.NO_HORIZON in reasons(blind.tracker.forecast().track.doubts)


def test_another_camera_begins_another_track(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    same = replace(CAMERA)
    answer = follower(frame_at(2.0, same), see(FLIGHT(2.0)))
    assert answer.track.age_s == pytest.approx(2.0)
    zoomed = off_camera(CAMERA, focal=1.0)
    answer = follower(frame_at(2.1, zoomed), see(FLIGHT(2.1), camera=zoomed))
    assert (answer.track.age_s, answer.track.state) == (0.0, TrackState.TRACKING)


def test_points_that_are_no_numbers_are_left_out(follower):
    follower.follow(FLIGHT, seconds(0.0, 1.0))
    seen = see(FLIGHT(1.0))
    pixels = seen.left.points_px.copy()
    pixels[::3] = np.nan
    answer = follower(frame_at(1.0), replace(seen, left=replace(seen.left, points_px=pixels)))
    assert answer.track.state is TrackState.TRACKING
    assert np.isfinite(follower.belief.covariance).all()
    gone = replace(seen.left, points_px=np.full_like(pixels, np.nan))
    answer = follower(frame_at(1.1), Detection(gone, gone))
    assert answer.track.state is TrackState.COASTING


def test_one_line_does_not_begin_a_track_but_carries_one(follower):
    one_line = replace(see(FLIGHT(0.0)), right=LinePoints.empty())
    for detection, why in ((NOTHING, []), (one_line, [Reason.NO_VANISHING_POINT])):
        follower.tracker.reset()
        answer = follower(frame_at(0.0), detection)
        assert (answer.track.state, answer.frame.world_from_body) == (TrackState.LOST, None)
        assert reasons(answer.track.diagnostics) == why
    follower.follow(FLIGHT, seconds(0.1, 2.0))
    for time_s in seconds(2.0, 3.0):
        answer = follower(frame_at(time_s), replace(see(FLIGHT(time_s)), right=LinePoints.empty()))
        assert answer.track.state is TrackState.TRACKING
    assert is_near(follower.belief, FLIGHT(2.9), 3)


def test_a_frozen_picture_does_not_update_the_track(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    frozen = Diagnostic(Reason.FROZEN, "the same picture")
    answer = follower(frame_at(2.0), see(FLIGHT(1.9)), (frozen,))
    assert answer.track.state is TrackState.COASTING
    assert answer.track.flags == (frozen,)


@pytest.mark.parametrize("config", [LEVEL, IN_WIDTHS])
def test_without_a_stated_width_lengths_are_widths(monkeypatch, config):
    follower, mount = with_horizon(monkeypatch, config), camera_mount()  # without an arm, which is known in metres
    for time_s in seconds(0.0, 2.0):
        answer = follower(frame_at(time_s, mount=mount), see(FLIGHT(time_s), mount=mount))
    is_stated, width, place = config is LEVEL, 20.0, FLIGHT(1.9)
    unit_m = 1.0 if is_stated else width
    for what in (answer.track.protection, answer.track.closing_m_s, follower.tracker.forecast()):
        assert (what is not None) is is_stated
    assert (not answer.frame.in_widths, Reason.NO_WIDTH not in reasons(answer.track.doubts)) == (is_stated, is_stated)
    at_m = answer.frame.world_from_body.translation * unit_m
    np.testing.assert_allclose(at_m[1:], [place.lateral_m, -place.height_m], atol=0.6)
    assert answer.track.lines["right"].point_m[1] == pytest.approx(width / 2 / unit_m, rel=2e-3)


def test_the_forecast_is_the_prediction_of_the_belief(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    forecast = follower.tracker.forecast()
    track, pose, heading_sigma = forecast.at(2.5)
    expected = predict(follower.belief, 2.5, follower.tracker._shared, LEVEL.sensors.drift_s)
    np.testing.assert_allclose(pose.as_matrix(), expected.world_from_body.as_matrix())
    assert heading_sigma == 0.0
    assert track.age_s == pytest.approx(2.5)
    assert track.closing_m_s.value == pytest.approx(40.0, abs=3.0)
    assert track.protection.lateral_m > forecast.track.protection.lateral_m
    assert forecast.at(1.8) is None
    assert forecast.at(1.9 + LEVEL.tracking.coast_s + 0.1) is None
    place = FLIGHT(2.5)
    np.testing.assert_allclose(pose.translation[1], place.lateral_m, atol=1.5)


def test_without_tracking_every_frame_is_for_itself(monkeypatch):
    config = replace(LEVEL, tracking=replace(LEVEL.tracking, enabled=False))
    follower = with_horizon(monkeypatch, config)
    for time_s in (1.0, 0.5):  # in no order
        answer = follower(frame_at(time_s), see(FLIGHT(time_s)))
        assert answer.track is None
        assert answer.frame.pose_source is PoseSource.PICTURE
        place = answer.frame.world_from_body.translation
        np.testing.assert_allclose(place[1:], [FLIGHT(time_s).lateral_m, -FLIGHT(time_s).height_m], atol=0.5)
    refused = follower(frame_at(2.0), NOTHING)
    assert refused.frame.world_from_body is None
    assert Reason.NO_VANISHING_POINT in reasons(refused.estimate.diagnostics)
