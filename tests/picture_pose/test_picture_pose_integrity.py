"""Tests of what is stated against the pictures, doubts, and protection levels."""

from dataclasses import replace

import numpy as np
import pytest
from runway_picture import CAMERA, IN_WIDTHS, LEVEL, belief_of, reasons
from scipy.stats import norm

from deckline.geometry import Camera
from deckline.picture_pose.integrity import (
    CHANGED_S,
    MAX_CONTRADICTED,
    MESSAGES,
    MIN_AGE_S,
    Evidence,
    bias_flag,
    prior_tests,
    protection_levels,
    unverified_reasons,
)
from deckline.picture_pose.states import States, shared_sigmas
from deckline.trackers import OBSERVED_SHARE
from deckline.types import Reason

SHARED = shared_sigmas(CAMERA, LEVEL)
LINE_SIGMA_M = SHARED[States.LEFT - States.SHARED.start]
START = States.SHARED.start


def observed(index, share=0.75, bias_sigma=0.0, config=LEVEL):
    """A belief of which one shared error is observed so well, and off what is stated by so many 1-sigma."""
    belief = belief_of(config=config)
    mean, covariance = belief.mean.copy(), belief.covariance.copy()
    covariance[index, index] *= 1 - share
    mean[index] += bias_sigma * SHARED[index - START] * np.sqrt(share)
    return replace(belief, mean=mean, covariance=covariance)


def test_what_no_picture_observed_or_nobody_stated_is_not_tested():
    assert list(prior_tests(belief_of(), SHARED, LEVEL)) == []
    assert bias_flag(belief_of(), SHARED, LEVEL) is None
    assert list(prior_tests(observed(States.ANGLE, OBSERVED_SHARE / 2), SHARED, LEVEL)) == []
    not_stated = observed(States.WIDTH, 1.0, config=IN_WIDTHS)
    assert list(prior_tests(not_stated, shared_sigmas(CAMERA, IN_WIDTHS), IN_WIDTHS)) == []


def test_a_test_compares_the_estimate_with_what_is_stated():
    (test,) = prior_tests(observed(States.WIDTH, 0.75, 2.0), SHARED, LEVEL)
    assert test.index == States.WIDTH
    assert test.bias / test.sigma == pytest.approx(2.0)
    assert test.sigma == pytest.approx(np.sqrt(0.75) * LEVEL.deck.width_sigma_m)


@pytest.mark.parametrize("index", list(MESSAGES))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_every_shared_error_has_its_flag(index, sign):
    alarm = LEVEL.integrity.alarm_sigma
    assert bias_flag(observed(index, bias_sigma=0.99 * sign * alarm), SHARED, LEVEL) is None
    flag = bias_flag(observed(index, bias_sigma=1.01 * sign * alarm), SHARED, LEVEL)
    reason, scale, _ = MESSAGES[index]
    assert flag.reason is reason
    bias = scale * 1.01 * sign * alarm * SHARED[index - START] * np.sqrt(0.75)
    assert f"{bias:+.1f}" in flag.message
    considered = range(States.SIZE)[States.CONSIDERED]  # never estimated
    assert set(MESSAGES) == set(range(States.SIZE)[States.SHARED]) - set(considered)


def doubts(belief=None, shared=SHARED, config=LEVEL, **changes):
    evidence = replace(
        Evidence(5.0, has_level=True, has_ramp=True, is_steady=True, contradicted=0.0, changed_s=np.inf), **changes
    )
    return reasons(unverified_reasons(belief or belief_of(), evidence, shared, config))


def test_a_pose_is_verified_by_horizon_ramp_width_camera_and_age():
    assert doubts() == []
    assert doubts(has_level=False) == [Reason.NO_HORIZON]
    assert doubts(has_ramp=False) == [Reason.NO_RAMP]
    assert doubts(is_steady=False) == [Reason.BORESIGHT]
    assert doubts(contradicted=0.9 * MAX_CONTRADICTED) == []
    assert doubts(contradicted=1.1 * MAX_CONTRADICTED) == [Reason.OTHER_LINES]
    assert doubts(changed_s=0.9 * CHANGED_S) == [Reason.OTHER_LINES]
    assert doubts(age_s=0.9 * MIN_AGE_S) == [Reason.YOUNG_TRACK]
    assert doubts(age_s=MIN_AGE_S) == []
    assert doubts(config=IN_WIDTHS) == [Reason.NO_WIDTH]
    assumed = shared_sigmas(Camera.assumed(1280, 720), LEVEL)
    assert doubts(shared=assumed) == [Reason.ASSUMED_CAMERA]
    stated = shared_sigmas(replace(CAMERA, focal_sigma=0.02), LEVEL)
    assert doubts(shared=stated) == []


def test_errors_that_are_unlikely_together_are_a_doubt():
    belief = observed(States.ANGLE, bias_sigma=3.5)
    assert doubts(belief) == [Reason.UNLIKELY_ERRORS]  # 3.5 sigma alone: 0.0005 of all flights, and the limit is 0.001
    assert doubts(observed(States.ANGLE, bias_sigma=2.5)) == []


def levels(belief, at_m=70.0, has_ramp=True, config=LEVEL):
    return protection_levels(belief, at_m, has_ramp, SHARED, config)


def test_a_level_is_the_quantile_of_the_covariance_and_the_largest_fault():
    belief = belief_of()
    quantile = norm.isf(LEVEL.integrity.risk / 2)
    checked = replace(LEVEL, integrity=replace(LEVEL.integrity, mount_yaw_deg=2.0))
    found = levels(belief, config=checked)
    # Nothing is observed: no state responds to a fault, but the angle of the mount.
    assert found.lateral_m == pytest.approx(quantile * belief.sigma(States.LATERAL))
    assert found.distance_m == pytest.approx(quantile * belief.sigma(States.DISTANCE))
    heading = np.hypot(np.sqrt(belief.heading_row @ belief.covariance @ belief.heading_row), LEVEL.sensors.attitude_rad)
    assert found.heading_rad == pytest.approx(quantile * heading + np.deg2rad(2.0))
    assert levels(belief).heading_rad is None
    assert found.risk == LEVEL.integrity.risk
    assert levels(belief, has_ramp=False).distance_m is None


@pytest.mark.parametrize(("share", "response"), [(0.0, 3.0), (0.75, 0.5)])
def test_a_fault_adds_its_response_up_to_where_a_test_shows_it(share, response):
    """A line whose lateral error is observed by a share, and flagged from `alarm_sigma` on; m per m of that error."""
    belief, test = observed(States.LEFT, share), LEVEL.integrity
    belief.covariance[[States.LATERAL, States.LEFT], [States.LEFT, States.LATERAL]] = response * LINE_SIGMA_M**2
    shown = (test.alarm_sigma + test.missed_sigma) * LINE_SIGMA_M / np.sqrt(share) if share else test.max_line_m
    assert share == 0.0 or shown < test.max_line_m
    assert levels(belief).lateral_m - levels(belief_of()).lateral_m == pytest.approx(response * shown)
