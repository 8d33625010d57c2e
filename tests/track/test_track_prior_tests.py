"""Errors measured well that what is stated does not allow: flagged alone, doubted together; one state at a time."""

from dataclasses import replace

import numpy as np
import pytest
from steady_view import CALM, KNOWN, SWELL, measured, numbers_in, start

from deckline.track.prior_tests import UNLIKELY, bias_flag, drift_flag, prior_tests, unverified_reasons
from deckline.track.states import States
from deckline.trackers import YOUNG
from deckline.types import Reason


def measured_well(state, sizes):
    """The state after its errors of these sizes, in their 1-sigma, are measured to a part of it."""
    now = state
    for index, size in sizes.items():
        sigma = np.sqrt(state.covariance[index, index])
        now = measured(now, index, size * sigma, 0.1 * sigma)
    return now


def doubts(state, age_s=5.0):
    return unverified_reasons(state, age_s, prior_tests(state, 0.0, KNOWN), 0.05, KNOWN)


def test_errors_that_are_each_just_possible_are_doubted_together():
    state = start(KNOWN)
    assert doubts(measured_well(state, {States.DRIFT: 0.0, States.DECK: 3.2})) == ()
    assert doubts(measured_well(state, {States.DRIFT: 0.0, States.DECK: 3.2, States.FOCAL: 3.2})) == (UNLIKELY,)
    assert doubts(state) == (YOUNG,), "the drift is not known"
    assert doubts(replace(state, covariance=0.01 * state.covariance), age_s=0.0) == (YOUNG,)


@pytest.mark.parametrize(("size", "is_doubted"), [(3.0, False), (4.4, True)])
def test_one_large_error_is_doubted_among_many_small_ones(size, is_doubted):
    small = dict.fromkeys([States.DRIFT, *range(States.SIZE)[States.SHARED_ERRORS]], 0.0)
    state = measured_well(start(KNOWN), small | {States.FOCAL: size})
    assert (UNLIKELY in doubts(state)) is is_doubted
    assert bias_flag(state, 0.0, KNOWN) is None


def test_a_stated_deck_height_that_lines_contradict_is_the_posterior_of_the_two():
    """One state, one measurement: the test statistic in closed form, the flag with the stated height."""
    state, found, sigma = start(KNOWN), 1.2, 0.02
    prior = state.covariance[States.DECK, States.DECK]
    share = prior / (prior + sigma**2)
    state = measured(state, States.DECK, found, sigma)
    assert state.mean[States.DECK] == pytest.approx(found * share)
    flag = bias_flag(state, 0.0, KNOWN)
    assert flag.reason is Reason.HEIGHT
    assert numbers_in(flag.message) == pytest.approx([0.0, found * share], abs=0.06)
    assert 0.5 * share / np.sqrt(prior * share) < 5
    assert bias_flag(measured(start(KNOWN), States.DECK, 0.5, sigma), 0.0, KNOWN) is None


def test_a_deck_that_heaves_beyond_its_sea_state_is_flagged_and_named_by_the_width():
    state = start(SWELL)
    heave_m = 6.0 * np.sqrt(state.covariance[States.HEAVE, States.HEAVE])
    raised = measured(state, States.HEAVE, heave_m, 0.05)
    flag = bias_flag(raised, 0.0, SWELL, np.array([-100.0, 0.0, -20.0]))
    assert flag.reason is Reason.SPACING
    by_height = 15.0 * 20.0 / (20.0 + raised.mean[States.HEAVE])
    assert numbers_in(flag.message) == pytest.approx([by_height, 15.0], abs=0.06)
    assert bias_flag(raised, 0.0, SWELL).reason is Reason.HEIGHT
    assert bias_flag(measured(state, States.HEAVE, 0.5 * heave_m, 0.05), 0.0, SWELL) is None


def test_lines_that_drift_faster_than_a_ship_are_flagged():
    assert drift_flag(start(CALM), CALM) is None
    for speed, flagged in ((3.0, False), (6.0, True)):
        assert (drift_flag(measured(start(CALM), States.DRIFT, speed, 0.1), CALM) is not None) is flagged
