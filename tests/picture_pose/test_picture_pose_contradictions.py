"""Lines, horizons and turns that contradict the track by pictures: left out, flagged, in doubt, or a new track."""

from dataclasses import replace

import numpy as np
import pytest
from runway_picture import (
    FLIGHT,
    LEVEL,
    RATE_HZ,
    Follower,
    Runway,
    errors_of,
    frame_at,
    horizon_of,
    is_near,
    reasons,
    seconds,
    see,
)

from deckline.types import LinePoints, Reason, TrackState


def test_a_line_that_contradicts_the_track_is_left_out_and_later_flagged(follower):
    follower.follow(FLIGHT, seconds(0.0, 2.0), np.random.default_rng(3))
    foul = Runway(painted_m=(-6.0, 0.0))
    answers = follower.follow(FLIGHT, seconds(2.0, 2.6), np.random.default_rng(4), foul)
    for age, answer in enumerate(answers):
        assert answer.track.state is TrackState.TRACKING
        assert reasons(answer.track.excluded) == [Reason.LEFT]
        assert reasons(answer.track.flags) == [Reason.LEFT] * (age / RATE_HZ > LEVEL.integrity.persist_s)
    assert is_near(follower.belief, FLIGHT(2.5), 4)
    (well,) = follower.follow(FLIGHT, [2.6])
    assert (well.track.excluded, well.track.flags) == ((), ())


def test_a_line_that_is_another_marking_for_long_stays_within_the_levels(follower):
    """The height by one line grows unsure until the foul line agrees: the levels hold its 6 m."""
    follower.follow(FLIGHT, seconds(0.0, 2.0), np.random.default_rng(3))
    for time_s in seconds(2.0, 4.0):
        (answer,) = follower.follow(FLIGHT, [time_s], np.random.default_rng(4), Runway(painted_m=(-6.0, 0.0)))
        off, _ = errors_of(follower.belief, FLIGHT(time_s))
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
    assert is_near(follower.belief, replace(place, lateral_m=place.lateral_m + 30.0), 4)


def test_a_horizon_that_contradicts_the_track_is_flagged_and_not_used(monkeypatch):
    def tilts(time_s):
        found = horizon_of(FLIGHT(time_s))
        return replace(found, slope=found.slope + 0.35) if time_s > 0.5 else found

    follower = Follower(LEVEL, monkeypatch, tilts)
    answers = follower.follow(FLIGHT, seconds(0.0, 2.0))
    assert answers[9].track.flags == ()
    assert reasons(answers[-1].track.flags) == [Reason.ATTITUDE]
    assert is_near(follower.belief, FLIGHT(1.9), 3)


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
