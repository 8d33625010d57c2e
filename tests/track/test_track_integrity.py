"""Faults put into flights: flagged, or within the protection level. Nothing is flagged where nothing is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from point_flight import Flight, approach, deviations, draw_errors, true_lines
from scipy.spatial.transform import RigidTransform
from steady_view import CALM, KNOWN, SWELL, advance, numbers_in, reasons, seen, settled, start, view

from deckline.probability import chi2_gate
from deckline.track import Tracker
from deckline.track.filter import update
from deckline.track.integrity import FaultMonitor, LeftOut
from deckline.track.measurement import measure, select_consistent
from deckline.track.motion import Pose
from deckline.track.stated_width import WidthTest
from deckline.track.states import initial_state
from deckline.types import DepthMode, Reason, TrackState

SLOW = Flight(modes="both", rate_hz=4.0, start_m=500.0)


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


@pytest.mark.parametrize(("pictures", "is_flagged"), [(4, False), (20, True)])
def test_only_a_track_old_enough_to_be_believed_contradicts_the_next_one(pictures, is_flagged):
    tracker, rng = Tracker(CALM), np.random.default_rng(4)
    for i in range(pictures):
        advance(tracker, view(i / 10), seen(rng, aside_m=-30.0))
    tracks = [advance(tracker, view(5.0 + i / 10), seen(rng)) for i in range(5)]
    assert (Reason.OTHER_LINES in reasons(tracks[-1].flags)) is is_flagged


def test_after_a_jump_of_the_pose_nothing_is_known_of_the_lines_before():
    tracker, rng = settled(CALM, seed=4)
    jump = RigidTransform.from_translation([0.0, 0.0, 300.0])
    jumped = [replace(view(2.0 + i / 10), world_from_body=jump * view(0.0).world_from_body) for i in range(5)]
    tracks = [advance(tracker, frame, seen(rng, aside_m=-8.0)) for frame in jumped]
    assert Reason.RESTARTED in reasons(tracks[0].diagnostics)
    assert tracks[-1].flags == ()


def test_a_line_that_comes_back_to_a_track_that_others_held_ends_its_flag():
    """The right line 4 m outside for a second: left out, flagged, then at its place again."""
    flight = replace(SLOW, seed=3)
    tracker, ages, flags, widths = Tracker(CALM), [], [], []
    for index, (frame, estimate, _) in enumerate(approach(flight, errors=draw_errors(flight))):
        if 12 <= index < 18 and "right" in estimate.lines:
            right = estimate.lines["right"]
            outside = right.point_m + 4.0 * right.right
            estimate = replace(estimate, lines=estimate.lines | {"right": replace(right, point_m=outside)})
        track = advance(tracker, frame, estimate)
        ages.append(track.age_s)
        flags.append(reasons(track.flags))
        widths.append(float(np.linalg.norm((track.lines["right"].point_m - track.lines["left"].point_m)[:2])))
    assert Reason.RIGHT in flags[17]
    assert not any(Reason.RIGHT in names for names in flags[18:])
    assert min(ages[18:]) > ages[17] > 2.0
    assert max(abs(width - widths[11]) for width in widths[18:]) < 1.0


def settled_on(lines, pose):
    """The state of a track at 1 s that has seen the lines ten times."""
    state = initial_state(1.0, lines["left"], None, CALM)
    for _ in range(10):
        measurement = measure(state, lines, DepthMode.FINE, pose, CALM)
        state = update(state, measurement.innovation, measurement.design, measurement.noise)
    return state


@pytest.mark.parametrize(("moved_m", "lasts_s", "is_out"), [(0.0, 1.0, True), (4.0, 1.0, False), (0.0, 0.1, False)])
def test_a_line_that_was_flagged_stays_out_until_it_moves_though_it_would_pass(moved_m, lasts_s, is_out):
    lines, pose = seen(np.random.default_rng(0)).lines, Pose(np.array([-100.0, 0.0, -35.0]), np.zeros(3), np.zeros(3))
    state = settled_on(lines, pose)
    measurement = measure(state, lines, DepthMode.FINE, pose, CALM)
    assert select_consistent(state, measurement, CALM.tracking.gate_sigma).excluded == ()
    before = measurement.innovation[measurement.rows("right")] + [moved_m, 0.0]
    out = {Reason.RIGHT: LeftOut(state.time_s - lasts_s, before)}
    gated = FaultMonitor(left_out=out).gate(state, measurement, CALM)
    assert [diagnostic.reason for diagnostic in gated.excluded] == ([Reason.RIGHT] if is_out else [])


@pytest.mark.parametrize(("sigma", "is_out"), [(2.5, False), (4.0, True)])
def test_a_line_that_was_flagged_and_came_nearer_returns_where_all_agrees_well(sigma, is_out):
    lines, pose = seen(np.random.default_rng(0)).lines, Pose(np.array([-100.0, 0.0, -35.0]), np.zeros(3), np.zeros(3))
    state = settled_on(lines, pose)
    measurement = measure(state, lines, DepthMode.FINE, pose, CALM)
    shift = np.eye(len(measurement.innovation))[measurement.rows("right")[0]]
    variance = measurement.design @ state.covariance @ measurement.design.T + measurement.noise
    size = np.sqrt(chi2_gate(sigma, len(shift)) / (shift @ np.linalg.solve(variance, shift)))
    near = replace(measurement, innovation=size * shift)
    assert select_consistent(state, near, CALM.tracking.gate_sigma).excluded == ()
    out = {Reason.RIGHT: LeftOut(state.time_s - 1.0, 4 * near.innovation[near.rows("right")])}
    gated = FaultMonitor(left_out=out).gate(state, near, CALM)
    assert [diagnostic.reason for diagnostic in gated.excluded] == ([Reason.RIGHT] if is_out else [])


@pytest.mark.parametrize("share", [0.25, 0.8, 0.93, 1.07, 1.2, 1.75])
def test_a_wrong_stated_width_is_flagged_or_bounded(share):
    config = replace(SWELL, deck=replace(SWELL.deck, width_m=15.0 * share))
    for seed in (21, 22):
        flight = replace(SLOW, modes="coarse", seed=seed, heave_m=0.7)
        flags, misleading = fly(flight, draw_errors(flight), config)
        assert misleading == 0
        assert (Reason.SPACING in flags) or 0.7 < share < 1.3


@pytest.mark.parametrize("ahead_m", [0.0, 60.0])
def test_a_first_frame_that_contradicts_the_stated_width_begins_no_track(ahead_m):
    """Also where the right line's point lies far ahead of the left line's."""
    config = replace(KNOWN, deck=replace(KNOWN.deck, width_m=26.0))
    estimate = seen(np.random.default_rng(2), mode=DepthMode.COARSE)
    right = estimate.lines["right"]
    right = replace(right, point_m=right.point_m + ahead_m * right.direction)
    track = advance(Tracker(config), view(0.0), replace(estimate, lines=estimate.lines | {"right": right}))
    assert track.state is TrackState.LOST
    assert reasons(track.flags) == [Reason.SPACING]
    assert numbers_in(track.flags[0].message) == pytest.approx([15.0, 26.0], abs=0.3)


def test_a_contradicted_width_is_withdrawn_by_a_test_that_would_have_shown_it():
    wrong, right, blunt = (
        WidthTest(*spacing, DepthMode.COARSE) for spacing in ((26, 15, 1), (15.5, 15, 1.2), (17, 15, 3))
    )
    contradicted = FaultMonitor().update_width(wrong, 5.0)
    assert contradicted.contradiction is wrong
    assert contradicted.update_width(blunt, 5.0).contradiction is wrong
    assert contradicted.restart(None, KNOWN).contradiction is wrong
    assert contradicted.update_width(None, 5.0).contradiction is wrong
    assert contradicted.update_width(right, 5.0).contradiction is None
    less_sharp, between = WidthTest(15.2, 15, 1.8, DepthMode.COARSE), WidthTest(21, 15, 1.3, DepthMode.COARSE)
    assert contradicted.update_width(less_sharp, 5.0).contradiction is None
    assert contradicted.update_width(between, 5.0).contradiction is wrong, "it agrees with both"
    state = start(KNOWN)
    assert reasons(contradicted.active_flags(None, state, None, None, 5.0, KNOWN)) == [Reason.SPACING]


@pytest.mark.parametrize("turn_deg", [*np.eye(3), np.array([0.0, 0.0, -3.0])])
def test_the_level_of_the_heading_holds_a_turned_camera(turn_deg):
    """1 degree about every axis, and a yaw that no test flags."""
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


@pytest.mark.parametrize(
    ("stated", "assumed", "is_doubted"),
    [(0.004, 0.001, True), (0.004, 0.004, False), (0.03, 0.04, True), (None, 0.001, False)],
)
def test_a_focal_length_less_certain_than_the_levels_assume_is_a_doubt(stated, assumed, is_doubted):
    config = replace(KNOWN, sensors=replace(KNOWN.sensors, focal_fraction=assumed))
    tracker = Tracker(config)
    for frame, estimate, _ in approach(Flight(rate_hz=4.0)):
        frame = replace(frame, camera=replace(frame.camera, focal_sigma=stated))
        track = advance(tracker, frame, estimate)
    later, *_ = tracker.forecast().at(frame.time_s + 0.1)
    for doubts in (track.doubts, later.doubts):
        assert (Reason.ASSUMED_CAMERA in reasons(doubts)) is is_doubted
