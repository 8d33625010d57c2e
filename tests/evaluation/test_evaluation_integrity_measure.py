from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from deckline.evaluation.integrity_measure import (
    Moment,
    Outcome,
    detection_delay_s,
    fault_row,
    flags_raised,
    outcome,
    share_interval,
)


def moment(time_s, error_m=0.0, flagged=False, faulty=True, level_m=1.0, height_m=0.0) -> Moment:
    return Moment(time_s, faulty, flagged, error_m, height_m, level_m, level_m)


def run(*errors_m, flags=(), onset=0, step_s=0.5) -> list[Moment]:
    return [moment(k * step_s, error, k in flags, k >= onset) for k, error in enumerate(errors_m)]


def test_an_error_within_its_level_is_harmless():
    assert outcome(run(0.0, 0.9, -0.9)) is Outcome.HARMLESS
    assert not moment(0.0, 0.99).misleading
    assert moment(0.0, -1.01).misleading
    assert moment(0.0, height_m=1.01).misleading


def test_a_flag_in_time_detects():
    assert outcome(run(0.0, 2.0, 2.0, 2.0, flags=(2, 3)), alert_s=1.0) is Outcome.DETECTED
    assert outcome(run(0.0, 0.5, 0.5, flags=(1,))) is Outcome.DETECTED


def test_a_late_flag_or_none_misleads():
    assert outcome(run(2.0, 2.0, 2.0, 2.0, 2.0, flags=(4,)), alert_s=1.0) is Outcome.MISLEADING
    assert outcome(run(0.0, 0.0, 2.0), alert_s=1.0) is Outcome.MISLEADING
    assert outcome(run(0.0, 2.0, 0.0), alert_s=1.0) is Outcome.MISLEADING


def test_only_what_is_followed_can_mislead():
    gone = Moment(0.0, True, False, None, None, None, None)
    unbounded = Moment(0.0, True, False, 9.0, 9.0, None, None)
    assert not gone.misleading
    assert not unbounded.misleading
    assert not unbounded.protected
    assert not moment(0.0, 9.0, flagged=True).misleading
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
    left_out = replace(moment(0.0), excluded=True)
    assert fault_row([[left_out, moment(0.5), replace(left_out, faulty=False)]]).excluding_frames == 1
    assert row.good_share == pytest.approx(2 / 3)
    assert row.delay_s == pytest.approx(1.0)
    with pytest.raises(ValueError, match="no run"):
        fault_row([])


def test_flags_are_counted_by_name():
    runs = [[replace(moment(0.0), flags=("left", "height")), moment(0.5)], [replace(moment(0.0), flags=("height",))]]
    assert list(flags_raised(runs).items()) == [("height", 2), ("left", 1)]


@given(st.lists(st.tuples(st.floats(-3, 3), st.booleans()), min_size=1, max_size=12), st.floats(0, 3))
def test_more_time_to_alert_never_makes_it_worse(frames, alert_s):
    moments = [moment(0.5 * k, error, flagged) for k, (error, flagged) in enumerate(frames)]
    if outcome(moments, alert_s + 1.0) is Outcome.MISLEADING:
        assert outcome(moments, alert_s) is Outcome.MISLEADING


def test_intervals_hold_what_they_promise():
    """The ends are where so many hits, or so few, have 2.5 %."""
    low, high = share_interval(3, 100)
    assert binom.sf(2, 100, low) == pytest.approx(0.025, rel=1e-3)
    assert binom.cdf(3, 100, high) == pytest.approx(0.025, rel=1e-3)
    assert share_interval(0, 300) == pytest.approx((0.0, 1 - 0.025 ** (1 / 300)))
    with pytest.raises(ValueError, match="got 1 of 0"):
        share_interval(1, 0)
    assert np.all(np.diff([share_interval(k, 10)[0] for k in range(11)]) > 0)
