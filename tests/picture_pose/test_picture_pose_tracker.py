"""The pose from the picture over the frames of a flight."""

from dataclasses import replace

import numpy as np
import pytest
from runway_picture import (
    CAMERA,
    IN_WIDTHS,
    LEVEL,
    RATE_HZ,
    Follower,
    Runway,
    errors_of,
    fly,
    frame_at,
    horizon_of,
    horizon_sight,
    reasons,
    seconds,
    see,
    sights_of,
)
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from deckline.dehaze.horizon_search import ANSWER_S
from deckline.geometry import attitude, camera_mount
from deckline.picture_pose.memory import CORRELATION_TIME_S
from deckline.picture_pose.model import Mount, horizon_innovation, lines_innovation, update
from deckline.picture_pose.states import States, predict, shared_sigmas
from deckline.types import Detection, Diagnostic, LinePoints, PoseSource, Reason, TrackState

FLIGHT = fly()
NOTHING = Detection(LinePoints.empty(), LinePoints.empty())


def with_horizon(config=LEVEL, patch=None, flight=FLIGHT, seed=None):
    """A follower whose pictures show the horizon of a flight."""
    rng = None if seed is None else np.random.default_rng([seed, 8])
    return Follower(config, patch, lambda time_s: horizon_of(flight(time_s), rng=rng))


@pytest.fixture
def follower(monkeypatch):
    return with_horizon(patch=monkeypatch)


@pytest.fixture
def blind(monkeypatch):
    """A follower that finds no horizon."""
    return Follower(LEVEL, monkeypatch)


def belief_in(follower):
    return follower.tracker._memory.belief


def test_the_pose_is_followed_and_labelled(follower):
    answers = follower.follow(FLIGHT, seconds(0.0, 3.0), np.random.default_rng(1))
    last, place = answers[-1], FLIGHT(2.9)
    assert last.frame.pose_source is PoseSource.PICTURE
    assert not last.frame.in_widths
    assert last.track.state is TrackState.TRACKING
    assert last.track.age_s == pytest.approx(2.9)
    assert (last.track.flags, last.track.doubts) == ((), ())
    off, sigma = errors_of(belief_in(follower), place)
    assert np.all(np.abs(off) < 3.5 * sigma)
    levels = last.track.protection
    assert abs(off[0]) < levels.lateral_m
    assert abs(off[1]) < levels.vertical_m
    assert levels.heading_rad is None  # nothing shows a camera that is turned in yaw
    assert abs(belief_in(follower).mean[States.DISTANCE] - place.distance_m) < levels.distance_m
    assert last.track.closing_m_s.value == pytest.approx(40.0, abs=4 * last.track.closing_m_s.sigma)


def test_one_horizon_is_not_enough(follower):
    """Searches begin at 0 and 1 s, and answer 0.3 s later."""
    doubts = {
        round(found.track.time_s, 2): reasons(found.track.doubts)
        for found in follower.follow(FLIGHT, seconds(0.0, 2.0))
    }
    assert Reason.NO_HORIZON in doubts[1.2]
    assert Reason.NO_HORIZON not in doubts[1.4]


def test_an_attitude_in_place_of_a_horizon(blind):
    """A sensor's roll and pitch confirm the lines, and a sensor that contradicts them is flagged."""
    place = FLIGHT(0.0)
    for time_s in seconds(0.0, 2.0):
        place = FLIGHT(time_s)
        tilted = replace(frame_at(time_s), level_from_body=attitude(place.roll, place.pitch, 0.7))
        found = blind(tilted, see(place))
    assert (found.track.flags, found.track.doubts) == ((), ())
    off, sigma = errors_of(belief_in(blind), place)
    assert np.all(np.abs(off) < 3.5 * sigma)
    wrong = replace(frame_at(2.0), level_from_body=attitude(place.roll + 0.1, place.pitch, 0.7))
    assert Reason.ATTITUDE in reasons(blind(wrong, see(FLIGHT(2.0))).track.flags)


def test_errors_agree_with_the_covariance(monkeypatch):
    scores = []
    for seed in range(8):
        flight = fly(lateral_m=4.0, seed=seed)
        follower = with_horizon(LEVEL, monkeypatch, flight, seed)
        rng = np.random.default_rng([seed, 3])
        for time_s in seconds(0.0, 3.0):
            follower(frame_at(time_s), see(flight(time_s), rng=rng))
            if time_s % 1.0 == 0.5 and time_s > 1.0:
                off, sigma = errors_of(belief_in(follower), flight(time_s))
                scores.append(off / sigma)
    # Exact camera, width and paint: less than stated. Errors of one flight hang together.
    squares = np.mean(np.square(scores), axis=0)
    assert np.all(squares < chi2.ppf(0.9995, 8) / 8)
    assert np.mean(np.abs(scores) < 1.96) > 0.93
    assert squares.mean() > 0.05


def test_a_reset_forgets_all_frames(follower):
    first = follower.follow(FLIGHT, seconds(0.0, 1.5))
    follower.tracker.reset()
    assert follower.tracker.forecast() is None
    again = follower.follow(FLIGHT, seconds(0.0, 1.5))
    for one, other in zip(first, again, strict=True):
        assert one.track.age_s == other.track.age_s
        np.testing.assert_array_equal(one.frame.world_from_body.as_matrix(), other.frame.world_from_body.as_matrix())


@pytest.mark.parametrize("time_s", [np.nan, np.inf, 0.9, 0.45])
def test_a_frame_whose_time_cannot_be_used_changes_nothing(follower, time_s):
    follower.follow(FLIGHT, seconds(0.0, 1.0))
    before = belief_in(follower)
    odd = follower(replace(frame_at(0.9), time_s=time_s), see(FLIGHT(1.0)))
    assert odd.track.state is TrackState.LOST
    assert odd.frame.world_from_body is None
    assert reasons(odd.track.diagnostics) == [Reason.BAD_TIME]
    assert belief_in(follower) is before


def test_a_time_far_back_begins_another_flight(follower):
    follower.follow(FLIGHT, seconds(3.0, 4.0))
    (answer,) = follower.follow(FLIGHT, [0.0])
    assert (answer.track.state, answer.track.age_s) == (TrackState.TRACKING, 0.0)


def test_a_gap_is_bridged_with_growing_uncertainty_and_then_lost(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0), np.random.default_rng(2))
    states, sigmas, misses = [], [], []
    for time_s in seconds(2.0, 4.5):
        answer = follower(frame_at(time_s), NOTHING)
        states.append(answer.track.state)
        if answer.track.state is TrackState.COASTING:
            off, sigma = errors_of(belief_in(follower), FLIGHT(time_s))
            sigmas.append(sigma)
            misses.append(np.abs(off / sigma))
    assert states == [TrackState.COASTING] * 20 + [TrackState.LOST] * 5  # lines were last seen at 1.9 s
    assert np.all(np.diff(np.array(sigmas)[:, :2], axis=0) > 0)
    assert np.max(misses) < 4.0
    (again,) = follower.follow(FLIGHT, [4.5])
    assert (again.track.state, again.track.age_s) == (TrackState.TRACKING, 0.0)


def test_a_line_that_contradicts_the_track_is_left_out_and_later_flagged(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0), np.random.default_rng(3))
    foul = Runway(painted_m=(-6.0, 0.0))
    answers = follower.follow(FLIGHT, seconds(2.0, 2.6), np.random.default_rng(4), foul)
    for age, answer in enumerate(answers):
        assert answer.track.state is TrackState.TRACKING
        assert reasons(answer.track.excluded) == [Reason.LEFT]
        assert reasons(answer.track.flags) == [Reason.LEFT] * (age / RATE_HZ > LEVEL.integrity.persist_s)
    off, sigma = errors_of(belief_in(follower), FLIGHT(2.5))
    assert np.all(np.abs(off) < 4 * sigma)
    (well,) = follower.follow(FLIGHT, [2.6])
    assert (well.track.excluded, well.track.flags) == ((), ())


def test_a_line_that_is_another_marking_for_long_stays_within_the_levels(follower):
    """The height by one line grows unsure until the foul line agrees: the levels hold its 6 m."""
    follower.follow(FLIGHT, seconds(0.0, 2.0), np.random.default_rng(3))
    for time_s in seconds(2.0, 4.0):
        (answer,) = follower.follow(FLIGHT, [time_s], np.random.default_rng(4), Runway(painted_m=(-6.0, 0.0)))
        off, _ = errors_of(belief_in(follower), FLIGHT(time_s))
        assert abs(off[0]) < answer.track.protection.lateral_m
        assert abs(off[1]) < answer.track.protection.vertical_m


def test_lines_that_contradict_the_track_for_long_begin_a_new_one(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    states = {}
    for time_s in seconds(2.0, 3.5):
        place = FLIGHT(time_s)
        answer = follower(frame_at(time_s), see(replace(place, lateral_m=place.lateral_m + 30.0)))
        states[round(time_s, 1)] = answer.track.state, reasons(answer.track.diagnostics), answer.track.age_s
    assert all(state is TrackState.COASTING for state, _, _ in list(states.values())[:9])
    (began,) = [time_s for time_s, (_, why, _) in states.items() if Reason.RESTARTED in why]
    assert began == pytest.approx(1.9 + LEVEL.tracking.reacquire_s, abs=1.5 / RATE_HZ)
    assert states[began][2] == 0.0
    off, sigma = errors_of(belief_in(follower), replace(FLIGHT(3.4), lateral_m=FLIGHT(3.4).lateral_m + 30.0))
    assert np.all(np.abs(off) < 4 * sigma)


def test_a_horizon_that_arrives_late_counts_as_if_it_were_used_at_its_own_frame(follower):
    """The first frame's horizon, put in by hand in order, against the tracker that gets it three frames later.

    The camera turns on a gimbal meanwhile, as the poses of its mount state.
    """
    times, shared = seconds(0.0, 0.4), shared_sigmas(CAMERA, LEVEL)
    mounts = [camera_mount([0.4, 0.1, 0.2], Rotation.from_euler("y", -0.05 - 0.1 * t)) for t in times]
    follower(frame_at(times[0], mount=mounts[0]), gimballed(times[0], mounts[0]))
    first = belief_in(follower)
    horizon = horizon_sight(FLIGHT(0.0), mount=mounts[0])
    expected = update(first, horizon_innovation(first, horizon, Mount.of(mounts[0])))
    for time_s, mount in zip(times[1:], mounts[1:], strict=True):
        assert not np.allclose(belief_in(follower).mean, expected.mean, atol=1e-4)
        expected = predict(expected, float(time_s), shared)
        lines = lines_innovation(expected, sights_of(gimballed(time_s, mount)), Mount.of(mount))
        expected = update(expected, lines.inflate(CORRELATION_TIME_S * RATE_HZ))
        follower(frame_at(time_s, mount=mount), gimballed(time_s, mount))
    sigma = np.sqrt(np.diag(expected.covariance))
    np.testing.assert_allclose((belief_in(follower).mean - expected.mean) / sigma, 0.0, atol=1e-6)
    np.testing.assert_allclose(belief_in(follower).rotation, expected.rotation, atol=1e-9)
    difference = (belief_in(follower).covariance - expected.covariance) / np.outer(sigma, sigma)
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


def test_a_horizon_that_contradicts_the_track_is_flagged_and_not_used(monkeypatch):
    def tilts(time_s):
        found = horizon_of(FLIGHT(time_s))
        return replace(found, slope=found.slope + 0.35) if time_s > 0.5 else found

    follower = Follower(LEVEL, monkeypatch, tilts)
    answers = follower.follow(FLIGHT, seconds(0.0, 2.0))
    assert answers[9].track.flags == ()
    assert reasons(answers[-1].track.flags) == [Reason.ATTITUDE]
    off, sigma = errors_of(belief_in(follower), FLIGHT(1.9))
    assert np.all(np.abs(off) < 3 * sigma)


def test_one_frame_that_contradicts_the_track_is_no_doubt_and_many_are(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    doubts = []
    for time_s in seconds(2.0, 2.8):
        place = FLIGHT(time_s)
        other = replace(place, lateral_m=place.lateral_m + 30.0)
        answer = follower(frame_at(time_s), see(other if round(10 * time_s) % 3 != 2 else place))
        doubts.append(Reason.OTHER_LINES in reasons(answer.track.doubts))
    assert not doubts[1]
    assert doubts[-1]


def test_a_picture_that_turns_faster_than_an_aircraft_is_in_doubt_for_a_while(follower):
    def place(time_s):
        return replace(FLIGHT(time_s), heading=float(np.deg2rad(8.0) * np.clip(time_s - 2.0, 0.0, 1.0)))

    answers = {time_s: follower.follow(place, [time_s])[0] for time_s in seconds(0.0, 5.0)}
    turning = [time_s for time_s, answer in answers.items() if Reason.BORESIGHT in reasons(answer.track.doubts)]
    assert 2.1 <= turning[0] <= 2.4
    assert 3.5 <= turning[-1] <= 4.2
    assert turning == [time_s for time_s in answers if turning[0] <= time_s <= turning[-1]]


def test_another_camera_begins_another_track(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    same = replace(CAMERA)
    answer = follower(frame_at(2.0, same), see(FLIGHT(2.0)))
    assert answer.track.age_s == pytest.approx(2.0)
    zoomed = replace(CAMERA, fx=2 * CAMERA.fx, fy=2 * CAMERA.fy)
    answer = follower(frame_at(2.1, zoomed), see(FLIGHT(2.1), camera=zoomed))
    assert (answer.track.age_s, answer.track.state) == (0.0, TrackState.TRACKING)


def test_points_that_are_no_numbers_are_left_out(follower):
    follower.follow(FLIGHT, seconds(0.0, 1.0))
    seen = see(FLIGHT(1.0))
    pixels = seen.left.points_px.copy()
    pixels[::3] = np.nan
    answer = follower(frame_at(1.0), replace(seen, left=replace(seen.left, points_px=pixels)))
    assert answer.track.state is TrackState.TRACKING
    assert np.isfinite(belief_in(follower).covariance).all()
    gone = replace(seen.left, points_px=np.full_like(pixels, np.nan))
    answer = follower(frame_at(1.1), Detection(gone, gone))
    assert answer.track.state is TrackState.COASTING


def test_one_line_does_not_begin_a_track_but_carries_one(follower):
    one_line = replace(see(FLIGHT(0.0)), right=LinePoints.empty())
    answer = follower(frame_at(0.0), one_line)
    assert answer.track.state is TrackState.LOST
    assert reasons(answer.track.diagnostics) == [Reason.NO_VANISHING_POINT]
    assert answer.frame.world_from_body is None
    follower.follow(FLIGHT, seconds(0.1, 2.0))
    for time_s in seconds(2.0, 3.0):
        answer = follower(frame_at(time_s), replace(see(FLIGHT(time_s)), right=LinePoints.empty()))
        assert answer.track.state is TrackState.TRACKING
    off, sigma = errors_of(belief_in(follower), FLIGHT(2.9))
    assert np.all(np.abs(off) < 3 * sigma)


def test_no_lines_give_nothing(follower):
    answer = follower(frame_at(0.0), NOTHING)
    assert (answer.track.state, answer.frame.world_from_body) == (TrackState.LOST, None)


def test_a_frozen_picture_does_not_update_the_track(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    frozen = Diagnostic(Reason.FROZEN, "the same picture")
    answer = follower(frame_at(2.0), see(FLIGHT(1.9)), (frozen,))
    assert answer.track.state is TrackState.COASTING
    assert answer.track.flags == (frozen,)


@pytest.mark.parametrize("width", [10.0, 40.0])
def test_without_a_stated_width_lengths_are_widths(monkeypatch, width):
    """The same pictures of a runway twice as wide from twice as far."""
    scale = width / 20.0
    flight = FLIGHT

    def scaled(time_s):
        at = flight(time_s)
        distance_m, lateral_m, height_m = scale * at.position_m
        return replace(at, distance_m=distance_m, lateral_m=lateral_m, height_m=height_m)

    config = replace(LEVEL, deck=replace(LEVEL.deck, width_m=width, width_sigma_m=1e-6))
    runway = Runway(width, length_m=220.0 * scale)
    unit, stated = (with_horizon(one, monkeypatch) for one in (IN_WIDTHS, config))
    for time_s in seconds(0.0, 2.0):
        frame, seen = bare(time_s), see(scaled(time_s), runway, mount=bare(time_s).body_from_camera)
        one, other = unit(frame, seen), stated(frame, seen)
    assert one.frame.in_widths
    assert not other.frame.in_widths
    assert one.track.protection is None
    assert one.track.closing_m_s is None
    assert Reason.NO_WIDTH in reasons(one.track.doubts)
    at, other_at = (a.frame.world_from_body.translation for a in (one, other))
    np.testing.assert_allclose(at[1:] * width, other_at[1:], atol=0.003 * width)
    lines = (one.track.lines["right"], other.track.lines["right"])
    assert lines[0].point_m[1] == pytest.approx(0.5, abs=1e-3)
    assert lines[1].point_m[1] == pytest.approx(width / 2, rel=1e-3)
    assert unit.tracker.forecast() is None


def bare(time_s):
    """A frame of a camera without an arm, which is known in metres."""
    frame = frame_at(time_s)
    return replace(frame, body_from_camera=frame.body_from_camera.from_rotation(frame.body_from_camera.rotation))


def test_the_forecast_is_the_prediction_of_the_belief(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    forecast = follower.tracker.forecast()
    track, pose, heading_sigma = forecast.at(2.5)
    expected = predict(belief_in(follower), 2.5, follower.tracker._shared)
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
    follower = with_horizon(config, monkeypatch)
    for time_s in (1.0, 0.5):  # in no order
        answer = follower(frame_at(time_s), see(FLIGHT(time_s)))
        assert answer.track is None
        assert answer.frame.pose_source is PoseSource.PICTURE
        place = answer.frame.world_from_body.translation
        np.testing.assert_allclose(place[1:], [FLIGHT(time_s).lateral_m, -FLIGHT(time_s).height_m], atol=0.5)
    refused = follower(frame_at(2.0), NOTHING)
    assert refused.frame.world_from_body is None
    assert Reason.NO_VANISHING_POINT in reasons(refused.estimate.diagnostics)


@pytest.mark.parametrize("painted_m", [(0.0, 4.0), (0.0, 8.0), (6.0, 6.0)])
def test_lines_that_come_back_elsewhere_stay_in_doubt(follower, painted_m):
    """The covariance of a line that is left out grows until it passes the gate again: it is not right for that."""
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    answers = follower.follow(FLIGHT, seconds(2.0, 4.0), runway=Runway(painted_m=painted_m))
    unused = [found.track.state is not TrackState.TRACKING or found.track.excluded for found in answers]
    doubted = [bool(found.track.doubts or found.track.flags) for found in answers]
    assert all(one or other for one, other in zip(unused, doubted, strict=True))
    assert Reason.OTHER_LINES in reasons(answers[-1].track.doubts)


def test_a_contradiction_is_remembered_where_no_track_can_begin(follower):
    """The frame at which the track ends shows one line alone; the track that begins later is in doubt all the same."""
    follower.follow(FLIGHT, seconds(0.0, 2.0))
    moved = Runway(painted_m=(12.0, 12.0))
    follower.follow(FLIGHT, seconds(2.0, 2.9), runway=moved)
    for time_s in seconds(2.9, 3.4):
        shown = see(FLIGHT(time_s), moved)
        follower(frame_at(time_s), replace(shown, left=LinePoints.empty()))
    answers = follower.follow(FLIGHT, seconds(3.4, 6.5))
    assert answers[-1].track.age_s > 1.0
    assert Reason.OTHER_LINES in reasons(answers[-1].track.doubts)
