"""Tests of what is stated against the pictures, and protection levels, for a pose that the picture gives.

An estimate of a shared error that is farther from zero than its variance allows is a fault; a level covers the largest
fault that no test shows, as for flights with a navigation unit (`deckline.track.protection`). What no picture shows is
taken as stated: the width, and the camera within its 1-sigma.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.picture_pose.states import Belief, States, line_rows
from deckline.probability import chi2_tail, two_sided_quantile
from deckline.trackers import OBSERVED_SHARE, YOUNG
from deckline.types import ASSUMED_CAMERA, MAX_FOCAL_SIGMA, Diagnostic, Diagnostics, Protection, Reason

Array = NDArray[np.float64]
MIN_AGE_S = 1.0  # of a track, before it counts as able to show contradictions
CHANGED_S = 10.0  # after lines that contradicted the track came back: an approach's last part; our choice
MAX_CONTRADICTED = 0.2  # share of the frames whose lines all contradict the track, beyond which it is in doubt
MESSAGES = {
    States.HORIZON_UP: (
        Reason.ATTITUDE,
        float(np.rad2deg(1.0)),
        "the horizon lies {:+.1f} degrees above where the lines meet",
    ),
    States.HORIZON_TILT: (Reason.ATTITUDE, float(np.rad2deg(1.0)), "the horizon is tilted by {:+.1f} degrees"),
    States.LEVEL_X: (Reason.ATTITUDE, float(np.rad2deg(1.0)), "the sensor's roll seems {:+.1f} degrees off"),
    States.LEVEL_Y: (Reason.ATTITUDE, float(np.rad2deg(1.0)), "the sensor's pitch seems {:+.1f} degrees off"),
    States.WIDTH: (Reason.SPACING, 1.0, "the lines' spacing seems {:+.1f} m off what was stated"),
    States.ANGLE: (Reason.ANGLE, float(np.rad2deg(1.0)), "the angle between the lines seems {:+.1f} degrees off"),
    States.SLOPE: (Reason.HEIGHT, float(np.rad2deg(1.0)), "the deck seems to slope by {:+.1f} degrees along the lines"),
    States.CANT: (Reason.HEIGHT, float(np.rad2deg(1.0)), "the deck seems to slope by {:+.1f} degrees across the lines"),
    States.LEFT: (Reason.LEFT, 1.0, "the left line seems to be another marking, {:+.1f} m beside it"),
    States.RIGHT: (Reason.RIGHT, 1.0, "the right line seems to be another marking, {:+.1f} m beside it"),
}
UNLIKELY = Diagnostic(Reason.UNLIKELY_ERRORS, "the errors of camera, horizon and paint are unlikely together")
NO_HORIZON = Diagnostic(Reason.NO_HORIZON, "neither a horizon nor an attitude confirms the roll that the lines suggest")
NO_RAMP = Diagnostic(Reason.NO_RAMP, "the ramp was not seen: nothing shows that the lines are a runway's")
UNSTEADY = Diagnostic(Reason.BORESIGHT, "the picture turns as no aircraft on approach does: a stabilised video?")
OTHER_LINES = Diagnostic(Reason.OTHER_LINES, "lines contradict the track, or did lately: which are right is not known")
NO_WIDTH = Diagnostic(
    Reason.NO_WIDTH, "the picture gives lengths in runway widths: state --runway-width-m to have metres"
)


@dataclass(frozen=True)
class Evidence:
    """What a track has seen that confirms its pose."""

    age_s: float  # of the track
    has_level: bool  # a horizon or an attitude agreed lately
    has_ramp: bool  # the ramp was seen
    is_steady: bool  # the picture turns no faster than an aircraft does
    contradicted: float  # share of the last frames with lines whose lines all contradict the track
    changed_s: float  # since lines came back that contradicted the track


@dataclass(frozen=True, eq=False)
class PriorTest:
    """A shared error's estimate against what was stated of it."""

    index: int  # of the state
    bias: float  # estimated minus stated
    sigma: float  # of that, if what was stated is true


def prior_tests(belief: Belief, shared_sigma: Array, config: RunConfig) -> Iterator[PriorTest]:
    """The tests of all shared errors that pictures have observed well enough."""
    stated = {States.WIDTH: config.deck.width_m, States.ANGLE: config.deck.angle_rad}
    for index, sigma in zip(range(States.SIZE)[States.SHARED], shared_sigma, strict=True):
        observed = float(sigma**2 - belief.covariance[index, index])
        expected = stated.get(index, 0.0)
        if observed > OBSERVED_SHARE * sigma**2 and expected is not None:
            yield PriorTest(index, float(belief.mean[index]) - expected, float(np.sqrt(observed)))


def bias_flag(belief: Belief, shared_sigma: Array, config: RunConfig) -> Diagnostic | None:
    """The shared error that is most significantly off what was stated, if any is."""
    tests = list(prior_tests(belief, shared_sigma, config))
    worst = max(tests, key=lambda test: abs(test.bias) / test.sigma, default=None)
    if worst is None or abs(worst.bias) <= config.integrity.alarm_sigma * worst.sigma:
        return None
    reason, scale, message = MESSAGES[worst.index]
    return Diagnostic(reason, message.format(scale * worst.bias))


def unverified_reasons(belief: Belief, evidence: Evidence, shared_sigma: Array, config: RunConfig) -> Diagnostics:
    """Why a pose that no test flags is not verified.

    Args:
        shared_sigma: (13,) as stated.
    """
    squares = [(test.bias / test.sigma) ** 2 for test in prior_tests(belief, shared_sigma, config)]
    focal_sigma = float(shared_sigma[States.FOCAL - States.SHARED.start])
    doubts = (
        (NO_WIDTH, config.deck.width_m is None),
        (ASSUMED_CAMERA, focal_sigma > MAX_FOCAL_SIGMA),
        (NO_HORIZON, not evidence.has_level),
        (NO_RAMP, not evidence.has_ramp),
        (UNSTEADY, not evidence.is_steady),
        (YOUNG, evidence.age_s < MIN_AGE_S),
        (OTHER_LINES, evidence.contradicted > MAX_CONTRADICTED or evidence.changed_s < CHANGED_S),
        (UNLIKELY, bool(squares) and chi2_tail(sum(squares), len(squares)) < config.integrity.doubt_risk),
    )
    return tuple(doubt for doubt, holds in doubts if holds)


def protection_levels(
    belief: Belief, at_m: float, has_ramp: bool, shared_sigma: Array, config: RunConfig
) -> Protection:
    """Bounds on the errors for the stated width.

    Nothing shows a camera that is turned in yaw, which turns the nose alone: the heading has a bound only where
    `mount_yaw_deg` is stated. Other faults are those of `Integrity` that a picture can have: focal length, another turn
    of the camera, another marking.

    Args:
        at_m: where the height is given, m along the runway.
        shared_sigma: (13,) as stated.
    """
    test, size = config.integrity, len(shared_sigma)
    turned = float(np.deg2rad(test.max_boresight_deg))
    undetected = np.zeros(States.SIZE)
    undetected[[States.FOCAL, States.CX, States.CY]] = test.max_focal_fraction, turned, turned
    undetected[[States.LEVEL_X, States.LEVEL_Y]] = turned
    undetected[[States.LEFT, States.RIGHT]] = test.max_line_m
    undetected = undetected[States.SHARED]
    responses = belief.covariance[:, States.SHARED] / shared_sigma**2  # of every state to a fault
    for one in prior_tests(belief, shared_sigma, config):
        own = np.eye(size)[one.index - States.SHARED.start]
        surely = (test.alarm_sigma + test.missed_sigma) * one.sigma
        undetected = np.minimum(undetected, surely / np.maximum(np.abs(responses[one.index] - own), 1e-12))
    quantile = two_sided_quantile(test.risk)

    def bound(row: Array, white: float = 0.0) -> float:
        sigma = float(np.sqrt(row @ belief.covariance @ row + white**2))
        return quantile * sigma + float(np.max(np.abs(row @ responses) * undetected))

    rows, place, yaw_deg = line_rows(belief, at_m), np.eye(States.SIZE), test.mount_yaw_deg
    heading = None if yaw_deg is None else bound(rows[1], config.sensors.attitude_rad) + float(np.deg2rad(yaw_deg))
    return Protection(
        lateral_m=bound(place[States.LATERAL]),
        vertical_m=bound(rows[2]),
        heading_rad=heading,
        distance_m=bound(place[States.DISTANCE]) if has_ramp else None,
        risk=test.risk,
    )
