"""Faults put into flights: flagged, or within the protection level. Nothing is flagged where nothing is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from point_flight import Flight, approach, draw_errors, true_lines
from scipy.spatial.transform import RigidTransform
from steady_view import CALM, KNOWN, advance, numbers_in, reasons, seen, settled, view
from test_track_tracker import deviations

from deckline.config import Integrity
from deckline.track import Tracker
from deckline.track.filter import update
from deckline.track.integrity import UNLIKELY, YOUNG, bias_flag, drift_flag, protection_levels, unverified_reasons
from deckline.track.motion import Pose
from deckline.track.states import States, initial_state
from deckline.types import Reason, RunwayLine, TrackState

SLOW = Flight(modes="both", rate_hz=4.0, start_m=500.0)
LINE = RunwayLine(np.zeros(3), 0.0, np.eye(3))


def fly(flight, errors, config=KNOWN, change=lambda index, estimate: estimate):
    """Reasons of all flags, and frames that mislead: beyond a protection level without a flag."""
    tracker, names, misleading = Tracker(config), [], 0
    for index, (frame, estimate, truth) in enumerate(approach(flight, errors=errors)):
        track = advance(tracker, frame, change(index, estimate))
        names += reasons(track.flags)
        if not track.lines or track.flags:
            continue
        centre = true_lines(flight, frame.time_s)["centre"]
        away = deviations(frame.world_from_body, track.lines["centre"]) - deviations(truth, centre)
        misleading += bool(abs(away[0]) > track.protection.lateral_m or abs(away[2]) > track.protection.vertical_m)
    return names, misleading


@pytest.mark.parametrize("config", [KNOWN, CALM])
def test_nothing_is_flagged_or_misleads_where_errors_are_as_stated(config):
    for seed in range(4):
        flight = replace(SLOW, seed=seed)
        assert fly(flight, draw_errors(flight), config) == ([], 0)


FAULTS = {
    "roll": (lambda e: replace(e, turn_rad=e.turn_rad + np.deg2rad([1.0, 0.0, 0.0])), False),
    "pitch": (lambda e: replace(e, turn_rad=e.turn_rad + np.deg2rad([0.0, 1.0, 0.0])), True),
    "yaw": (lambda e: replace(e, turn_rad=e.turn_rad + np.deg2rad([0.0, 0.0, 1.0])), False),
    "depth": (lambda e: replace(e, depth_scale=0.03), False),
    "deck height": (lambda e: replace(e, deck_z_m=-2.5), True),
    "foul line": (lambda e: replace(e, line_m=e.line_m - np.array([4.0, 0.0])), True),
    "late pose": (lambda e: replace(e, delay_s=0.2), True),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_flagged_or_bounded(name):
    fault, noticed = FAULTS[name]
    for seed in (11, 12):
        flight = replace(SLOW, seed=seed)
        flags, misleading = fly(flight, fault(draw_errors(flight)))
        assert misleading == 0
        assert bool(flags) or not noticed


def test_a_foul_line_that_was_always_there_is_bounded_without_a_survey():
    flight = replace(SLOW, seed=13)
    errors = draw_errors(flight)
    flags, misleading = fly(flight, replace(errors, line_m=errors.line_m + np.array([0.0, 5.0])), CALM)
    assert (flags, misleading) == ([], 0)


def test_lines_that_change_sides_are_called_swapped():
    def swap(index, estimate):
        if index < 8 or len(estimate.lines) < 2:
            return estimate
        return replace(estimate, lines={"left": estimate.lines["right"], "right": estimate.lines["left"]})

    flight = replace(SLOW, seed=14)
    flags, misleading = fly(flight, draw_errors(flight), change=swap)
    assert set(flags) == {Reason.SWAPPED}
    assert misleading == 0


def test_one_wrong_height_is_left_out_and_a_lasting_one_is_flagged():
    tracker, rng = settled(KNOWN, seed=3)
    before = tracker.forecast().track
    once = advance(tracker, view(2.0), seen(rng, z_m=-14.0))
    assert reasons(once.excluded) == [Reason.HEIGHT]
    assert once.flags == ()
    assert once.lines["centre"].height_m == pytest.approx(before.lines["centre"].height_m, abs=0.2)
    assert advance(tracker, view(2.1), seen(rng)).excluded == ()
    names = [reasons(advance(tracker, view(2.2 + i / 10), seen(rng, z_m=-14.0)).flags) for i in range(8)]
    assert names[0] == []
    assert Reason.HEIGHT in names[5]


def test_a_lasting_contradiction_ends_the_track_and_the_next_one_compares_the_spacing():
    tracker, rng = settled(CALM, seed=4)
    tracks = [advance(tracker, view(2.0 + i / 10), seen(rng, spacing_m=24.0, aside_m=6.0)) for i in range(30)]
    assert TrackState.LOST in {track.state for track in tracks}
    assert tracks[-1].state is TrackState.TRACKING
    assert reasons(tracks[-1].flags) == [Reason.SPACING]
    assert numbers_in(tracks[-1].flags[0].message) == pytest.approx([24.0, 15.0], abs=0.3)


def lose_and_find(seconds, **found):
    """Flags after a track of 2 s, a gap, and half a second of lines like `found`."""
    tracker, rng = settled(CALM, seed=4)
    tracks = [advance(tracker, view(2.0 + seconds + i / 10), seen(rng, **found)) for i in range(5)]
    assert tracks[-1].age_s == pytest.approx(0.4), "a new track"
    return tracks[-1].flags


def test_a_new_track_beside_the_one_before_is_flagged_until_nobody_can_know():
    assert lose_and_find(3.0) == ()
    (flag,) = lose_and_find(3.0, aside_m=-8.0)
    assert flag.reason is Reason.OTHER_LINES
    assert numbers_in(flag.message) == pytest.approx([-8.0], abs=1.0)
    assert lose_and_find(60.0, aside_m=-8.0) == ()


def test_after_a_jump_of_the_pose_nothing_is_known_of_the_lines_before():
    tracker, rng = settled(CALM, seed=4)
    jump = RigidTransform.from_translation([0.0, 0.0, 300.0])
    jumped = [replace(view(2.0 + i / 10), world_from_body=jump * view(0.0).world_from_body) for i in range(5)]
    tracks = [advance(tracker, frame, seen(rng, aside_m=-8.0)) for frame in jumped]
    assert Reason.RESTARTED in reasons(tracks[0].diagnostics)
    assert tracks[-1].flags == ()


def test_errors_that_are_each_just_possible_are_doubted_together():
    state = initial_state(0.0, LINE, None, KNOWN)
    sigmas = np.sqrt(np.diag(state.covariance))

    def doubts(sizes):
        now = state
        for index, size in sizes.items():  # measured well: 0.1 sigma
            design = np.eye(1, States.SIZE, index)
            now = update(now, np.array([size * sigmas[index]]), design, np.array([[0.01 * sigmas[index] ** 2]]))
        return unverified_reasons(now, 5.0, 0.0, 0.05, KNOWN)

    assert doubts({States.DRIFT: 0.0, States.DECK: 3.2}) == ()
    assert doubts({States.DRIFT: 0.0, States.DECK: 3.2, States.FOCAL: 3.2}) == (UNLIKELY,)
    assert doubts({}) == (YOUNG,), "the drift is not known"
    assert unverified_reasons(replace(state, covariance=0.01 * state.covariance), 0.0, 0.0, 0.05, KNOWN) == (YOUNG,)


def test_a_stated_deck_height_that_lines_contradict_is_the_posterior_of_the_two():
    """One state, one measurement: the test statistic and the bound in closed form."""
    state = initial_state(0.0, LINE, None, KNOWN)
    prior, noise, found = state.covariance[States.DECK, States.DECK], 0.02**2, 1.2
    design = np.zeros((1, States.SIZE))
    design[0, States.DECK] = 1.0
    state = update(state, np.array([found]), design, np.array([[noise]]))
    assert state.mean[States.DECK] == pytest.approx(found * prior / (prior + noise))
    assert bias_flag(state, 0.0, KNOWN).reason is Reason.HEIGHT
    small = update(initial_state(0.0, LINE, None, KNOWN), np.array([0.5]), design, np.array([[noise]]))
    assert 0.5 * prior / (prior + noise) / np.sqrt(prior**2 / (prior + noise)) < 5
    assert bias_flag(small, 0.0, KNOWN) is None


def test_the_protection_level_is_that_of_noise_plus_the_worst_undetected_fault():
    state = initial_state(0.0, LINE, None, KNOWN)
    covariance = np.zeros((States.SIZE, States.SIZE))
    covariance[States.HEIGHT, States.HEIGHT] = 0.3**2
    # z moves with the deck height, which is as unsure as at first
    covariance[States.HEIGHT, States.DECK] = covariance[States.DECK, States.HEIGHT] = -0.02
    covariance[States.DECK, States.DECK] = state.covariance[States.DECK, States.DECK]
    state = replace(state, covariance=covariance)
    pose = Pose(np.array([-100.0, 0.0, -10.0]), np.zeros(3), np.zeros(3))
    level = protection_levels(state, pose, None, None, None, 1.0, KNOWN)
    sigma, prior = np.hypot(0.3, KNOWN.sensors.position_white_m), state.covariance[States.DECK, States.DECK]
    assert level.vertical_m == pytest.approx(5.3267 * sigma + 0.02 / prior * KNOWN.integrity.max_deck_z_m, rel=1e-3)
    rarer = protection_levels(state, pose, None, None, None, 1.0, replace(KNOWN, integrity=Integrity(risk=1e-3)))
    assert level.vertical_m - rarer.vertical_m == pytest.approx((5.3267 - 3.2905) * sigma, rel=1e-3)


def test_a_line_that_is_readmitted_after_a_flag_restarts_the_track():
    """The right line 4 m outside for a second: left out, flagged, then at its place again."""
    flight = replace(SLOW, seed=3)
    tracker, ages, widths = Tracker(CALM), [], []
    for index, (frame, estimate, _) in enumerate(approach(flight, errors=draw_errors(flight))):
        if 12 <= index < 18 and "right" in estimate.lines:
            right = estimate.lines["right"]
            outside = right.point_m + 4.0 * np.array([-right.direction[1], right.direction[0], 0.0])
            estimate = replace(estimate, lines=estimate.lines | {"right": replace(right, point_m=outside)})
        track = advance(tracker, frame, estimate)
        ages.append(track.age_s)
        widths.append(float(np.linalg.norm((track.lines["right"].point_m - track.lines["left"].point_m)[:2])))
    assert ages[17] > 2.0
    assert ages[18] == 0.0
    assert max(abs(width - widths[11]) for width in widths[18:]) < 1.0


def test_lines_that_drift_faster_than_a_ship_are_flagged():
    state = initial_state(0.0, LINE, None, CALM)
    assert drift_flag(state, CALM) is None
    design = np.eye(States.SIZE)[[States.DRIFT]]
    for speed, flagged in ((3.0, False), (6.0, True)):
        known = update(state, np.array([speed]), design, np.array([[0.1**2]]))
        assert (drift_flag(known, CALM) is not None) is flagged


def test_the_level_of_the_heading_holds_a_turned_camera():
    """1 degree about every axis, the largest that the configuration allows."""
    for turn_deg in np.eye(3):
        flight = replace(SLOW, seed=5)
        errors = draw_errors(flight)
        errors = replace(errors, turn_rad=errors.turn_rad + np.deg2rad(turn_deg))
        tracker, bounded = Tracker(CALM), 0
        for frame, estimate, truth in approach(flight, errors=errors):
            track = advance(tracker, frame, estimate)
            if not track.lines or track.flags or track.age_s == 0.0:
                continue
            centre = true_lines(flight, frame.time_s)["centre"]
            turned = frame.world_from_body.rotation.as_euler("ZYX")[0] - truth.rotation.as_euler("ZYX")[0]
            heading = track.lines["centre"].azimuth_rad - centre.azimuth_rad - turned
            level = track.protection.heading_rad
            assert level is not None or track.age_s < 2.0  # until the lines' drift is known
            assert level is None or abs(heading) < level
            bounded += level is not None
        assert bounded > 5
