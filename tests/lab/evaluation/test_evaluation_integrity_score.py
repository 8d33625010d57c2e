from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline_lab.evaluation.integrity_score import (
    FrameState,
    Outcome,
    detection_delay_s,
    fault_row,
    flags_raised,
    outcome,
    settled_frames,
)


def state(time_s, error_m=0.0, flagged=False, faulty=True, level_m=1.0, height_m=0.0) -> FrameState:
    return FrameState(time_s, faulty, flagged, error_m, height_m, level_m, level_m)


def run(*errors_m, flags=(), onset=0, step_s=0.5) -> list[FrameState]:
    return [state(k * step_s, error, k in flags, k >= onset) for k, error in enumerate(errors_m)]


def test_an_error_within_its_level_is_harmless():
    assert outcome(run(0.0, 0.9, -0.9)) is Outcome.HARMLESS
    assert not state(0.0, 0.99).misleading
    assert state(0.0, -1.01).misleading
    assert state(0.0, height_m=1.01).misleading


def test_a_flag_in_time_detects():
    assert outcome(run(0.0, 2.0, 2.0, 2.0, flags=(2, 3)), alert_s=1.0) is Outcome.DETECTED
    assert outcome(run(0.0, 0.5, 0.5, flags=(1,))) is Outcome.DETECTED


def test_a_late_flag_or_none_misleads():
    assert outcome(run(2.0, 2.0, 2.0, 2.0, 2.0, flags=(4,)), alert_s=1.0) is Outcome.MISLEADING
    assert outcome(run(0.0, 0.0, 2.0), alert_s=1.0) is Outcome.MISLEADING
    assert outcome(run(0.0, 2.0, 0.0), alert_s=1.0) is Outcome.MISLEADING


def test_only_what_is_followed_can_mislead():
    gone = FrameState(0.0, True, False, None, None, None, None)
    unbounded = FrameState(0.0, True, False, 9.0, 9.0, None, None)
    assert not gone.misleading
    assert not unbounded.misleading
    assert not unbounded.protected
    assert not state(0.0, 9.0, flagged=True).misleading
    assert outcome([gone, unbounded]) is Outcome.HARMLESS


def test_what_was_before_the_fault_does_not_count():
    assert outcome(run(5.0, 5.0, 5.0, 0.0, onset=3), alert_s=0.0) is Outcome.HARMLESS
    assert outcome(run(0.0, 0.0, 0.0, 0.0, flags=(0,), onset=2)) is Outcome.HARMLESS
    assert detection_delay_s(run(0.0, 0.0, 0.0, 0.0, flags=(0, 3), onset=2)) == pytest.approx(0.5)
    assert detection_delay_s(run(0.0, 0.0)) is None


def test_rows_add_up():
    runs = [run(0.0, 2.0, 2.0, flags=(2,)), run(0.0, 0.5, 0.5), run(3.0, 3.0, 3.0, 3.0)]
    row = fault_row(runs, alert_s=1.0)
    assert (row.runs, row.detected, row.harmless, row.misleading) == (3, 1, 1, 1)
    assert (row.frames, row.misleading_frames, row.flagged_frames, row.lost_frames) == (10, 5, 1, 1)
    assert row.excluding_frames == 0
    left_out = replace(state(0.0), excluded=True)
    assert fault_row([[left_out, state(0.5), replace(left_out, faulty=False)]]).excluding_frames == 1
    assert row.delay_s == pytest.approx(1.0)
    with pytest.raises(ValueError):
        fault_row([])


def test_flags_are_counted_by_name():
    runs = [[replace(state(0.0), flags=("left", "height")), state(0.5)], [replace(state(0.0), flags=("height",))]]
    assert list(flags_raised(runs).items()) == [("height", 2), ("left", 1)]


@given(st.lists(st.tuples(st.floats(-3, 3), st.booleans()), min_size=1, max_size=12), st.floats(0, 3))
def test_more_time_to_alert_never_makes_it_worse(frames, alert_s):
    states = [state(0.5 * k, error, flagged) for k, (error, flagged) in enumerate(frames)]
    if outcome(states, alert_s + 1.0) is Outcome.MISLEADING:
        assert outcome(states, alert_s) is Outcome.MISLEADING


def test_settled_frames_come_after_the_first_guidance():
    gone = FrameState(0.0, False, False, None, None, None, None)
    flight = [gone, *(state(time_s) for time_s in (1.0, 2.0, 3.0)), replace(gone, time_s=3.5), state(4.0)]
    assert [frame.time_s for frame in settled_frames(flight)] == [3.0, 4.0]
    assert settled_frames([gone]) == []


def test_frames_that_mislead_as_ok_are_counted():
    frames = [
        replace(at, status=status) for at, status in zip(run(0.5, 2.0, 2.0), ("ok", "ok", "unverified"), strict=True)
    ]
    row = fault_row([frames])
    assert (row.ok_frames, row.misleading_ok_frames, row.misleading_frames) == (2, 1, 2)
