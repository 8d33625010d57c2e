"""The track against truth on approaches without pictures."""

from dataclasses import replace

import numpy as np
import pytest
from point_flight import Flight, approach, deviations, draw_errors, one_frame, true_lines
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2
from steady_view import CALM, KNOWN, NOTHING, advance, advance_all, numbers_in, reasons, seen, settled, view

from deckline.config import Deck, RunConfig
from deckline.track import Tracker
from deckline.trackers import CORRELATION_TIME_S, noise_inflation
from deckline.types import Diagnostic, LineVisibility, Reason, Track, TrackState


def errors_of(flight, frame, truth, line, side="centre"):
    """Errors (3,) of the deviations, and their covariance (3, 3) as the track states it."""
    exact = deviations(truth, true_lines(flight, frame.time_s)[side])
    behind = float((frame.world_from_body.translation - line.point_m) @ line.direction)
    carry = np.array([[-1.0, -behind, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    return deviations(frame.world_from_body, line) - exact, carry @ line.relative_covariance @ carry.T


def follow(flight, config, without=()):
    """Every frame with its track; frames of the times `without` (from, to) show nothing."""
    tracker = Tracker(config)
    for frame, estimate, truth in approach(flight):
        hidden = any(low <= frame.time_s < high for low, high in without)
        yield frame, truth, advance(tracker, frame, NOTHING if hidden else estimate)


@pytest.mark.parametrize("modes", ["coarse", "both"])
def test_errors_agree_with_the_tracks_covariance(modes):
    squares = []
    for seed in range(10):
        flight = Flight(modes=modes, seed=seed, rate_hz=4.0)
        for frame, truth, track in follow(flight, KNOWN):
            if frame.time_s > 1.0 and frame.time_s % 2.0 < 0.2:
                error, covariance = errors_of(flight, frame, truth, track.lines["centre"])
                squares.append(error @ np.linalg.solve(covariance, error))
    # Errors of one flight hang together: ten flights are worth about ten independent frames and more.
    low, high = chi2.ppf([0.0005, 0.9995], 3 * 10) / 10
    assert low < np.mean(squares) < high
    assert np.mean(np.array(squares) < chi2.ppf(0.95, 3)) > 0.9


def test_two_seconds_without_lines_are_bridged_with_growing_and_honest_uncertainty():
    flight = Flight(start_m=600.0, seed=3)
    sigmas, states, misses = [], [], []
    config = RunConfig(deck=Deck(sea_state=3.0, width_m=15.0))
    for frame, truth, track in follow(flight, config, without=[(3.0, 4.95)]):
        if 2.5 < frame.time_s < 5.5:
            states.append(track.state)
            error, covariance = errors_of(flight, frame, truth, track.lines["centre"])
            sigmas.append(np.sqrt(np.diag(covariance)))
            misses.append(np.abs(error) / sigmas[-1])
    hidden = [state is TrackState.COASTING for state in states]
    gone = np.array(sigmas)[hidden]
    assert len(gone) == 20
    assert np.all(np.diff(gone[:, 0]) > 0)
    assert gone[-1, 2] > 1.1 * gone[0, 2]  # of a deck that swings, not all the way
    assert np.max(misses) < 4.0
    after = states[hidden.index(True) + 20 :]
    assert set(after) == {TrackState.TRACKING}
    assert sigmas[-1][0] < 1.2 * sigmas[0][0]


def test_after_two_seconds_the_track_is_lost_and_begins_anew_when_lines_are_seen():
    flight = Flight(start_m=600.0, seed=4)
    states = {}
    for frame, _, track in follow(flight, CALM, without=[(2.0, 5.0)]):
        states[round(frame.time_s, 2)] = track.state
        assert bool(track.lines) == (track.state is not TrackState.LOST)
    assert states[1.9] is TrackState.TRACKING
    assert states[2.0] is TrackState.COASTING
    assert states[3.9] is TrackState.COASTING
    assert states[4.1] is TrackState.LOST
    assert states[5.0] is TrackState.TRACKING


@pytest.mark.parametrize(("seen_frames", "then"), [(1, TrackState.LOST), (2, TrackState.COASTING)])
def test_what_one_frame_saw_does_not_coast(seen_frames, then):
    tracker, states = Tracker(CALM), []
    for number, (frame, estimate) in enumerate(frames_of(Flight(start_m=600.0, seed=4), 4)):
        states.append(advance(tracker, frame, estimate if number < seen_frames else NOTHING).state)
    assert states == [TrackState.TRACKING] * seen_frames + [then] * (4 - seen_frames)


def frames_of(flight, count, rate_hz=10.0):
    errors, rng = draw_errors(flight), np.random.default_rng(9)
    return [one_frame(flight, i / rate_hz, errors, rng)[:2] for i in range(count)]


def same(one: Track, other: Track) -> bool:
    if set(one.lines) != set(other.lines):
        return False
    return all(np.array_equal(one.lines[side].point_m, other.lines[side].point_m) for side in one.lines)


@pytest.fixture
def shown():
    """40 frames with estimates of one flight, ten a second."""
    return frames_of(Flight(seed=5), 40)


@pytest.mark.parametrize(("time_s", "numbers"), [(np.nan, []), (np.inf, []), (0.9, [0.9]), (0.55, [0.35])])
def test_a_frame_whose_time_cannot_be_used_changes_nothing_and_is_reported(shown, time_s, numbers):
    tracker, disturbed = Tracker(CALM), Tracker(CALM)
    advance_all(tracker, shown[:10])
    advance_all(disturbed, shown[:10])
    odd = advance(disturbed, replace(shown[10][0], time_s=time_s), shown[10][1])
    assert reasons(odd.diagnostics) == [Reason.BAD_TIME]
    assert numbers_in(odd.diagnostics[0].message) == pytest.approx(numbers)
    assert (odd.state, odd.lines, odd.protection) == (TrackState.LOST, {}, None)
    assert same(advance(disturbed, *shown[11]), advance(tracker, *shown[11]))


def test_a_first_frame_without_a_time_is_lost_and_harmless(shown):
    frame, estimate = shown[0]
    tracker = Tracker(CALM)
    assert advance(tracker, replace(frame, time_s=np.nan), estimate).state is TrackState.LOST
    assert advance(tracker, frame, estimate).state is TrackState.TRACKING


def test_frames_without_a_pose_are_bridged(shown):
    tracker = Tracker(CALM)
    advance_all(tracker, shown[:10])
    for frame, _ in shown[10:13]:
        track = advance(tracker, replace(frame, world_from_body=None), replace(NOTHING, seen=LineVisibility.BOTH))
        assert track.state is TrackState.COASTING
        assert Reason.NO_POSE in reasons(track.diagnostics)
        assert track.protection is None
    assert advance(tracker, *shown[14]).state is TrackState.TRACKING


JUMP = RigidTransform.from_translation([0.0, 30.0, 0.0])


@pytest.mark.parametrize(
    ("at", "change", "numbers"),
    [
        (11, lambda frame: {"world_from_body": JUMP * frame.world_from_body}, [30.0]),
        (39, lambda frame: {}, [3.0]),
        (0, lambda frame: {"time_s": -5.0}, []),
    ],
    ids=["jump of the pose", "gap", "new flight"],
)
def test_what_breaks_a_flight_starts_a_new_track(shown, at, change, numbers):
    tracker = Tracker(CALM)
    advance_all(tracker, shown[:10])
    frame, estimate = shown[at]
    track = advance(tracker, replace(frame, **change(frame)), estimate)
    assert reasons(track.diagnostics) == [Reason.RESTARTED]
    assert numbers_in(track.diagnostics[0].message) == pytest.approx(numbers)
    assert track.state is TrackState.TRACKING
    right = np.array([-np.sin(track.lines["left"].azimuth_rad), np.cos(track.lines["left"].azimuth_rad), 0.0])
    assert abs((track.lines["left"].point_m - estimate.lines["left"].point_m) @ right) < 0.5


def test_a_prediction_changes_nothing_and_a_reset_forgets_everything(shown):
    tracker, fresh = Tracker(CALM), Tracker(CALM)
    advance_all(tracker, shown[:10])
    for frame, _ in shown[10:13]:
        assert tracker.predict(frame).memory.state.time_s == frame.time_s
    assert tracker.predict(shown[10][0]).step_s == pytest.approx(0.1)
    tracker.reset()
    assert tracker.predict(shown[0][0]).memory is None and tracker.forecast() is None
    for one, other in zip(advance_all(tracker, shown[:3]), advance_all(fresh, shown[:3]), strict=True):
        assert same(one, other) and one.age_s == other.age_s


FROZEN, PAINT = Diagnostic(Reason.FROZEN, "same picture"), Diagnostic(Reason.PAINT, "no paint")


def test_flags_of_monitors_join_the_tracks_and_a_frozen_picture_updates_nothing():
    tracker, rng = settled()
    before = advance(tracker, view(2.0), seen(rng), (PAINT,))
    assert (before.state, before.flags, tracker.is_flagged) == (TrackState.TRACKING, (PAINT,), True)
    assert reasons(before.diagnostics) == []
    frozen = advance(tracker, view(2.1), seen(rng, aside_m=4.0), (PAINT, FROZEN))
    assert (frozen.state, frozen.flags) == (TrackState.COASTING, (FROZEN, PAINT))
    assert (frozen.diagnostics, frozen.excluded) == ((FROZEN,), ())
    assert advance(tracker, view(2.2), seen(rng)).flags == ()
    assert not tracker.is_flagged


def test_lines_of_joined_frames_count_by_what_is_new_in_them():
    assert noise_inflation(1.0, np.inf, 8) == 1.0  # nothing was used before
    assert [noise_inflation(1.0, since_s, 8) for since_s in (1.0, 4.0, 8.0, 20.0)] == [8.0, 2.0, 1.0, 1.0]
    assert noise_inflation(0.1, 0.1, 1) == noise_inflation(0.1, 0.1, 2) == pytest.approx(CORRELATION_TIME_S / 0.1)
    assert noise_inflation(0.0, np.inf, 8) == 1.0


def test_a_track_of_joined_frames_is_no_surer_than_their_number_allows():
    sigmas = {}
    for frames in (1, 8):
        tracker, flight = Tracker(KNOWN), Flight(seed=0, rate_hz=2.0)
        for frame, estimate, _ in approach(flight):
            track = tracker.update(tracker.predict(frame), estimate, frames=frames)
            if frame.time_s > 3.0:
                break
        sigmas[frames] = np.sqrt(track.lines["centre"].aircraft_covariance[0, 0])
    assert 1.1 < sigmas[8] / sigmas[1] < np.sqrt(8)
