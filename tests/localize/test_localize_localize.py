import re
from dataclasses import replace

import numpy as np
import pytest

from deckline.geometry import wrap_angle
from deckline.localize import AgreementConfig, DeckConfig, LocalizeConfig, NoiseConfig, localize
from deckline.types import DepthMode, Detection, LinePoints, Segment, Status
from runway_scene import (
    CAMERA,
    DECK_Z_M,
    LEFT,
    LENS,
    PARALLEL_RIGHT,
    RIGHT,
    approach,
    azimuth,
    detection,
    line_points,
    with_depth,
)

CONFIG = LocalizeConfig()


def rng():
    return np.random.default_rng(0)


def shifted_left(metres, turn_rad=0.0):
    """The left line moved to its right and turned about its ramp end."""
    angle = azimuth(LEFT)
    across = np.array([-np.sin(angle), np.cos(angle), 0.0])
    along = np.array([np.cos(angle + turn_rad), np.sin(angle + turn_rad), 0.0])
    start = LEFT.p0_m + metres * across
    return Segment(start, start + 217 * along)


@pytest.mark.parametrize(
    ("method", "camera"),
    [("joint", CAMERA), ("joint", LENS), ("paper", CAMERA)],
    ids=["joint pinhole", "joint distorted", "paper pinhole"],
)
@pytest.mark.parametrize("mode", ["coarse", "fine"])
def test_without_noise_the_papers_lines_come_back(method, mode, camera):
    frame = approach(40.0, 6.0, camera=camera)
    frame = with_depth(frame) if mode == "fine" else frame
    # These lines are 0.37 degrees apart: nothing is known of that here.
    config = LocalizeConfig(method=method, mode=mode, agreement=AgreementConfig(parallel_rad=np.inf))
    estimate = localize(frame, detection(frame), config, rng())
    # The depth image is float32 and, behind a lens, inverse depth is not exactly linear between its pixels.
    tolerance = 1e-6 if mode == "coarse" else 1e-3
    assert estimate.status is Status.OK
    assert estimate.mode is DepthMode(mode)
    for side, slope, constant in (("left", 0.16300, -35.788523), ("right", 0.15632, -20.889669)):
        line = estimate.lines[side]
        assert line.slope == pytest.approx(-slope, abs=tolerance)
        assert line.intercept_m == pytest.approx(-constant, abs=20 * tolerance)
        assert line.height_m == pytest.approx(DECK_Z_M, abs=tolerance)
        assert np.cos(line.azimuth_rad) < 0
    centre = estimate.lines["centre"]
    along = (centre.point_m[0] - LEFT.p0_m[0]) / (LEFT.p1_m[0] - LEFT.p0_m[0])
    middle = (1 - along) * (LEFT.p0_m + RIGHT.p0_m) / 2 + along * (LEFT.p1_m + RIGHT.p1_m) / 2
    np.testing.assert_allclose(centre.point_m, middle, atol=0.01)  # "midway" of lines 0.37 degrees apart is not sharp
    between = sorted([abs(wrap_angle(estimate.lines[side].azimuth_rad)) for side in ("left", "right")])
    assert between[0] <= abs(centre.azimuth_rad) <= between[1]


def test_more_noise_means_larger_sigma():
    frame = approach(60.0, 8.0)

    def sigma(noise):
        estimate = localize(frame, detection(frame), LocalizeConfig(noise=noise), rng())
        return np.sqrt(np.diag(estimate.lines["centre"].covariance))

    calm, rough = sigma(NoiseConfig()), sigma(NoiseConfig(attitude_rad=0.01, position_m=1.0, deck_z_m=1.0))
    assert (rough > 3 * calm).all()


def test_the_ramp_is_found_within_its_sigma_and_only_when_in_view():
    frame = approach(60.0, 8.0)
    estimate = localize(frame, detection(frame, count=60), CONFIG, rng())
    truth = (LEFT.p0_m + RIGHT.p0_m) / 2
    assert 0.1 < estimate.ramp_sigma_m < 3
    assert np.linalg.norm(estimate.ramp_m - truth) < 2 * estimate.ramp_sigma_m
    inside = approach(-40.0, 4.0)  # over the deck: the lines run out of the image's lower border
    estimate = localize(inside, detection(inside), CONFIG, rng())
    assert estimate.status is Status.OK
    assert estimate.ramp_m is None
    assert "near end of the left line is not in view" in estimate.reason


def test_the_ramp_is_not_believed_at_the_edge_of_the_region_looked_at():
    frame = approach(60.0, 8.0)
    found = detection(frame)
    bottom = float(found.left.points_px[:, 1].max()) + 1.0
    cropped = Detection(found.left, found.right, (0.0, 0.0, 1279.0, bottom))
    estimate = localize(frame, cropped, CONFIG, rng())
    assert estimate.status is Status.OK
    assert estimate.ramp_m is None
    assert "not in view" in estimate.reason


def test_lines_that_begin_far_apart_are_no_runway():
    frame = approach(60.0, 8.0)
    found = detection(frame)
    far = found.left.points_px[:, 1] < np.percentile(found.left.points_px[:, 1], 40)
    left = LinePoints(found.left.points_px[far], found.left.confidence[far], found.left.sigma_px[far])
    estimate = localize(frame, Detection(left, found.right), CONFIG, rng())
    assert estimate.status is Status.NOT_SEEN
    assert estimate.lines == {}
    assert re.fullmatch(r"the lines begin \d\d m apart along the runway", estimate.reason)
    not_asked = replace(CONFIG, agreement=AgreementConfig(max_step_m=1000.0))
    assert localize(frame, Detection(left, found.right), not_asked, rng()).status is Status.OK


def test_lines_of_a_banked_deck_may_begin_apart_as_far_as_banking_is_expected():
    """5 degrees of bank, projected onto a level deck from 6 m above it, move the near ends 16 m apart."""
    frame = approach(60.0, 6.0, right=PARALLEL_RIGHT)
    rise = np.array([0.0, 0.0, 7.45 * np.sin(np.deg2rad(5.0))])
    lines = [Segment(line.p0_m + up, line.p1_m + up) for line, up in ((LEFT, -rise), (PARALLEL_RIGHT, rise))]
    banked = Detection(*(line_points(frame, line) for line in lines))
    level = localize(frame, banked, CONFIG, rng())
    assert (level.status, level.reason) == (Status.NOT_SEEN, "the lines begin 16 m apart along the runway")
    expected = replace(CONFIG, deck=DeckConfig(tilt_rad=np.deg2rad(3.0)))
    assert localize(frame, banked, expected, rng()).status is Status.OK


def test_nothing_detected_is_not_seen():
    frame = approach(60.0, 8.0)
    estimate = localize(frame, Detection(LinePoints.empty(), LinePoints.empty()), CONFIG, rng())
    assert estimate.status is Status.NOT_SEEN
    assert (estimate.pixel_lines, estimate.lines) == ({}, {})
    assert estimate.reason == "no line in the image"


def test_one_line_has_no_centre_unless_the_width_is_known():
    frame = approach(60.0, 8.0)
    found = Detection(LinePoints.empty(), detection(frame).right)
    estimate = localize(frame, found, CONFIG, rng())
    assert estimate.status is Status.ONE_LINE
    assert set(estimate.lines) == {"right"}
    assert "only the right line" in estimate.reason
    known = localize(frame, found, LocalizeConfig(runway_width_m=14.0), rng())
    assert set(known.lines) == {"right", "centre"}
    line, centre = known.lines["right"], known.lines["centre"]
    right = np.array([-np.sin(line.azimuth_rad), np.cos(line.azimuth_rad), 0.0])
    np.testing.assert_allclose(centre.point_m - line.point_m, -7 * right, atol=1e-9)


def test_swapped_lines_are_rejected():
    frame = approach(60.0, 8.0)
    found = detection(frame)
    estimate = localize(frame, Detection(found.right, found.left), CONFIG, rng())
    assert estimate.status is Status.NOT_SEEN
    assert "left line passes right of the right line" in estimate.reason


def test_the_same_marking_seen_twice_is_rejected():
    frame = approach(60.0, 8.0)
    left = detection(frame).left
    twice = LinePoints(left.points_px + np.array([1.0, 0.0]), left.confidence, left.sigma_px)
    estimate = localize(frame, Detection(left, twice), CONFIG, rng())
    assert estimate.status is Status.NOT_SEEN
    assert "m apart, expected 5 to 60 m; neither is clearly the better one" in estimate.reason


def test_lines_in_different_directions_are_rejected():
    frame = approach(60.0, 8.0)
    turned = line_points(frame, shifted_left(14.0, np.deg2rad(12)))
    estimate = localize(frame, Detection(detection(frame).left, turned), CONFIG, rng())
    assert estimate.status is Status.NOT_SEEN
    assert "the lines differ by 12.0 degrees" in estimate.reason


def test_of_two_contradicting_lines_a_clearly_surer_one_is_kept():
    frame = approach(60.0, 8.0)
    vague = line_points(frame, shifted_left(14.0, np.deg2rad(12)), sigma_px=4.0)
    estimate = localize(frame, Detection(detection(frame, sigma_px=0.3).left, vague), CONFIG, rng())
    assert estimate.status is Status.ONE_LINE
    assert set(estimate.pixel_lines) == {"left"}
    assert "only the surer one, left, is kept" in estimate.reason


def test_without_a_pose_the_image_lines_are_given_with_the_reason():
    frame = replace(approach(60.0, 8.0), world_from_body=None)
    estimate = localize(frame, detection(approach(60.0, 8.0)), CONFIG, rng())
    assert estimate.status is Status.OK
    assert estimate.mode is DepthMode.NONE
    assert set(estimate.pixel_lines) == {"left", "right"}
    assert estimate.lines == {}
    assert estimate.reason == "no pose: give poses.csv"


def test_a_line_too_short_to_have_a_direction_is_dropped():
    frame = approach(60.0, 8.0)
    found = detection(frame)
    near = np.argsort(-found.left.points_px[:, 1])[:8]
    left = LinePoints(found.left.points_px[near], found.left.confidence[near], np.full(8, 8.0))
    alone = LocalizeConfig(agreement=AgreementConfig(parallel_rad=np.inf))
    estimate = localize(frame, Detection(left, found.right), alone, rng())
    assert estimate.status is Status.ONE_LINE
    assert "the direction of the left line is too uncertain" in estimate.reason


def test_config_errors_say_what_was_expected():
    with pytest.raises(ValueError, match="mode must be one of auto, fine, coarse, got 'depth'"):
        LocalizeConfig(mode="depth")
    with pytest.raises(ValueError, match="method must be one of joint, paper, got 'sgd'"):
        LocalizeConfig(method="sgd")
    with pytest.raises(ValueError, match="1-sigmas that are not negative"):
        DeckConfig(tilt_rad=-0.1)
    with pytest.raises(ValueError, match="runway_width_m must be positive, got -3"):
        LocalizeConfig(runway_width_m=-3)
    with pytest.raises(ValueError, match="min_points >= 3"):
        LocalizeConfig(min_points=2)
    with pytest.raises(ValueError, match="noise must not be negative"):
        NoiseConfig(position_m=-1)
