"""One frame from detected points to lines, with errors of detection, scene and settings."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import Localization
from deckline.geometry import wrap_angle
from deckline.localize import line_fit
from deckline.types import SIDES, DepthMode, Detection, LinePoints, LineVisibility, Reason, Segment
from deckline_lab.rivals.sgd import localize_by_descent
from runway_scene import (
    ANY_ANGLE,
    CAMERA,
    DECK_Z_M,
    LATERAL,
    LEFT,
    LENS,
    PARALLEL,
    PARALLEL_CENTRE,
    PARALLEL_RIGHT,
    RIGHT,
    STILL,
    WIDTH_M,
    approach,
    azimuth,
    detection,
    error_at,
    line_points,
    locate,
    nearest,
    reasons,
    shift_points,
    slope_deck,
    still_deck,
    with_depth,
)

EMPTY = LinePoints.empty()
localize = import_module("deckline.localize.localizer")  # the package's own name is the function
NEAR = approach(60.0, 8.0)
MIDDLE = approach(90.0, 9.0, right=PARALLEL_RIGHT)
FAR = approach(120.0, 10.0, right=PARALLEL_RIGHT)


def ramp_error(line, truth):
    return error_at(line.point_m, line.azimuth_rad, line.covariance, truth, truth.p0_m)[0]


@pytest.mark.parametrize(("paper", "camera"), [(False, CAMERA), (False, LENS), (True, CAMERA)])
@pytest.mark.parametrize("mode", ["coarse", "fine"])
def test_exact_points_give_the_papers_lines(paper, camera, mode):
    frame = approach(40.0, 6.0, camera=camera)
    frame = with_depth(frame) if mode == "fine" else frame
    # These lines are 0.37 degrees apart: the prior of their angle is left out.
    config, rng = still_deck(mode, **ANY_ANGLE), np.random.default_rng(0)
    estimate = (localize_by_descent if paper else locate)(frame, detection(frame), config, rng)
    # The depth image is float32 and, behind a lens, inverse depth is not exactly linear between its pixels.
    tolerance = 1e-6 if mode == "coarse" else 1e-3
    assert (estimate.seen, estimate.mode, estimate.flags) == (LineVisibility.BOTH, DepthMode(mode), ())
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


def test_one_line_has_a_centre_only_with_a_known_width():
    found = Detection(EMPTY, detection(NEAR).right)
    estimate = locate(NEAR, found)
    assert (estimate.seen, set(estimate.lines)) == (LineVisibility.ONE, {"right"})
    assert reasons(estimate) == [Reason.NO_CENTRE_LINE]
    known = locate(NEAR, found, still_deck(width_m=14.0))
    assert set(known.lines) == {"right", "centre"}
    line, centre = known.lines["right"], known.lines["centre"]
    right = np.array([-np.sin(line.azimuth_rad), np.cos(line.azimuth_rad), 0.0])
    np.testing.assert_allclose(centre.point_m - line.point_m, -7 * right, atol=1e-9)


def test_a_line_none_of_whose_points_lies_on_its_plane_is_dropped(monkeypatch):
    """The picture is older than its depth: the fit lies so high that its own rays miss it."""
    place = localize.locate_inliers

    def miss(frame, points, line, *rest):
        is_left = np.array_equal(points.points_px, detection(NEAR).left.points_px)
        return place(frame, points, replace(line, inliers=line.inliers & (not is_left)), *rest)

    monkeypatch.setattr(localize, "locate_inliers", miss)
    estimate = locate(NEAR, detection(NEAR))
    assert (estimate.seen, set(estimate.lines)) == (LineVisibility.ONE, {"right"})
    assert Reason.NO_POINTS in reasons(estimate)


UPSIDE_DOWN = MIDDLE.body_from_camera * RigidTransform.from_rotation(Rotation.from_euler("z", np.pi))


@pytest.mark.parametrize(
    ("changes", "reason", "seen"),
    [
        ({"body_from_camera": UPSIDE_DOWN}, Reason.CROSSED, LineVisibility.NONE),  # in the settings alone
        ({"deck_z_m": -40.0}, Reason.ABOVE_CAMERA, LineVisibility.NONE),
        ({"world_from_body": None}, Reason.NO_POSE, LineVisibility.BOTH),  # in the image
    ],
)
def test_an_impossible_or_missing_pose_gives_no_runway(changes, reason, seen):
    estimate = locate(replace(MIDDLE, **changes), detection(MIDDLE, PARALLEL_RIGHT))
    assert (estimate.seen, estimate.mode, estimate.lines) == (seen, DepthMode.NONE, {})
    assert (len(estimate.pixel_lines) == 2) == (seen is LineVisibility.BOTH)
    assert reasons(estimate) == [reason]


def test_outliers_within_the_reach_of_ransac_have_no_weight():
    """A tenth of the points is off by 3 px, ten times their sigma."""
    exact = detection(FAR, PARALLEL_RIGHT, 40, 0.3)
    exact.left.points_px[::10, 0] += 3.0
    np.testing.assert_allclose(ramp_error(locate(FAR, exact).lines["left"], LEFT)[:2], 0, atol=1e-4)


@pytest.mark.parametrize(
    ("roll_deg", "sides"), [(-20.0, SIDES), (20.0, SIDES), (75.0, SIDES), (1.0, ("left",)), (1.0, ("right",))]
)
def test_both_lines_and_each_alone_are_located_exactly_by_a_rolled_camera(roll_deg, sides):
    """At 75 degrees the lines run nearly along the image's rows."""
    frame = approach(90.0, 9.0, roll=np.deg2rad(roll_deg), pitch=-0.08, right=PARALLEL_RIGHT)
    hidden = {side: EMPTY for side in SIDES if side not in sides}
    estimate = locate(frame, replace(detection(frame, PARALLEL_RIGHT), **hidden))
    assert estimate.seen is (LineVisibility.ONE if hidden else LineVisibility.BOTH)
    for side in sides:
        truth = {"left": LEFT, "right": PARALLEL_RIGHT}[side]
        np.testing.assert_allclose(ramp_error(estimate.lines[side], truth), 0, atol=1e-5)


def test_tiny_runway_is_found_with_a_large_sigma():
    """2 km away both lines are within 8 px of height."""
    frame = approach(2000.0, 130.0, right=PARALLEL_RIGHT)
    generator = np.random.default_rng(1)
    exact = detection(frame, PARALLEL_RIGHT, 12, 0.2)
    scores = []
    for _ in range(20):
        found = Detection(shift_points(exact.left, generator), shift_points(exact.right, generator))
        estimate = locate(frame, found, STILL, generator)
        assert estimate.seen is LineVisibility.BOTH
        centre = estimate.lines["centre"]
        sigma = np.sqrt(centre.covariance[1, 1])
        scores.append(wrap_angle(centre.azimuth_rad - azimuth(LEFT)) / sigma)
        assert np.rad2deg(sigma) > 0.1
    assert np.abs(scores).max() < 3


def test_gaps_and_bad_far_samples_of_depth_do_no_harm():
    frame = with_depth(approach(60.0, 7.0, right=PARALLEL_RIGHT))
    generator = np.random.default_rng(3)
    depth = frame.depth_m.copy()
    far = depth > 120
    depth[far] *= 1 + 0.03 * generator.standard_normal(int(far.sum())).astype(np.float32)
    depth[generator.random(depth.shape) < 0.1] = np.nan
    depth[:, 640:660] = 3000.0
    estimate = locate(replace(frame, depth_m=depth), detection(frame, PARALLEL_RIGHT))
    assert estimate.mode is DepthMode.FINE
    assert estimate.lines["centre"].height_m == pytest.approx(DECK_Z_M, abs=0.05)
    assert abs(ramp_error(estimate.lines["left"], LEFT)[0]) < 0.05


def test_auto_weighs_depth_and_deck_height_by_their_noise():
    frame = with_depth(approach(100.0, 9.0, right=PARALLEL_RIGHT))
    off = replace(frame, deck_z_m=DECK_Z_M + 0.2)
    heights, variances = {}, {}
    for mode in ("fine", "coarse", "auto"):
        centre = locate(off, detection(frame, PARALLEL_RIGHT), still_deck(mode)).lines["centre"]
        heights[mode], variances[mode] = centre.height_m, centre.relative_covariance[2, 2]
    assert heights["fine"] == pytest.approx(DECK_Z_M, abs=1e-3)
    assert heights["coarse"] == pytest.approx(DECK_Z_M + 0.2, abs=1e-3)
    share = variances["fine"] / (variances["fine"] + variances["coarse"])
    assert heights["auto"] == pytest.approx(DECK_Z_M + 0.2 * share, abs=0.01)
    assert 1 / variances["auto"] == pytest.approx(1 / variances["fine"] + 1 / variances["coarse"], rel=0.02)


@pytest.mark.parametrize(
    ("range_m", "scale", "deck_off_m", "mode"), [(75.0, 1.3, 0.0, DepthMode.COARSE), (400.0, 1.0, 1.0, DepthMode.FINE)]
)
def test_source_of_the_mode_is_believed_when_depth_and_deck_height_contradict(range_m, scale, deck_off_m, mode):
    """A few depths that are 30 % too large, then a deck height that is 1 m off."""
    frame = with_depth(approach(60.0, 6.0, right=PARALLEL_RIGHT), range_m)
    wrong = replace(frame, depth_m=frame.depth_m * np.float32(scale), deck_z_m=DECK_Z_M + deck_off_m)
    estimate = locate(wrong, detection(frame, PARALLEL_RIGHT))
    assert (estimate.mode, reasons(estimate)) == (mode, [Reason.DEPTH_HEIGHT])
    assert estimate.lines["centre"].height_m == pytest.approx(DECK_Z_M, abs=1e-3)


@pytest.mark.parametrize(
    ("range_m", "deck_off_m", "asked", "agrees"),
    [(75.0, 0.0, "auto", True), (75.0, 5.0, "auto", False), (75.0, 0.0, "coarse", False), (62.0, 0.0, "auto", False)],
)
def test_a_depth_camera_that_sees_a_part_of_the_lines_confirms_the_height(range_m, deck_off_m, asked, agrees):
    frame = with_depth(approach(60.0, 6.0, right=PARALLEL_RIGHT), range_m)
    reported = replace(frame, deck_z_m=DECK_Z_M + deck_off_m)
    config = replace(STILL, localization=Localization(asked))
    estimate = locate(reported, detection(frame, PARALLEL_RIGHT), config)
    assert estimate.mode is DepthMode.COARSE and set(estimate.lines) == {"left", "right", "centre"}
    assert estimate.depth_confirms_height is agrees


def test_known_angle_gives_a_short_line_its_direction(monkeypatch):
    monkeypatch.setattr(line_fit, "MAX_AZIMUTH_SIGMA_RAD", 1.0)
    found = detection(MIDDLE, PARALLEL_RIGHT)
    found = Detection(nearest(found.left, 8, 2.0), found.right)
    lines = [locate(MIDDLE, found, still_deck(**angle)).lines["left"] for angle in (ANY_ANGLE, PARALLEL)]
    assert lines[1].covariance[1, 1] < 0.3**2 * lines[0].covariance[1, 1]


def test_known_width_corrects_the_height():
    frame = approach(60.0, 8.0, right=PARALLEL_RIGHT)
    off, found = replace(frame, deck_z_m=DECK_Z_M + 0.3), detection(frame, PARALLEL_RIGHT)
    known = still_deck(width_m=WIDTH_M, width_sigma_m=0.02, **PARALLEL)
    assert locate(off, found, known).lines["centre"].height_m == pytest.approx(DECK_Z_M, abs=0.05)
    assert locate(off, found).lines["centre"].height_m == pytest.approx(DECK_Z_M + 0.3, abs=1e-3)


def test_sloped_deck_needs_a_slope_sigma():
    """One degree down along the runway, seen by a depth camera."""
    frame = approach(60.0, 8.0, right=PARALLEL_RIGHT)
    along = np.array([np.cos(azimuth(LEFT)), np.sin(azimuth(LEFT)), 0.0])
    gradient = float(np.tan(np.deg2rad(1.0))) * along
    frame, found = slope_deck(frame, LEFT.p0_m, gradient)
    level, sloped = (
        locate(frame, found, still_deck("fine", slope_deg=slope)).lines["left"] for slope in (0.0, np.rad2deg(0.02))
    )
    level_error, sloped_error = (abs((line.point_m - LEFT.p0_m) @ ([0, 0, 1] - gradient)) for line in (level, sloped))
    assert sloped_error < 0.02 < level_error
    assert abs(wrap_angle(sloped.azimuth_rad - azimuth(LEFT))) < 1e-3


def test_painted_centre_line_sharpens_the_middle_and_replaces_a_line():
    exact = detection(FAR, PARALLEL_RIGHT, 20, 1.0)
    centre = line_points(FAR, PARALLEL_CENTRE, 20, 1.0)
    plain = locate(FAR, exact).lines["centre"]
    painted = locate(FAR, replace(exact, centre=centre)).lines["centre"]
    assert painted.relative_covariance[1, 1] < 0.9 * plain.relative_covariance[1, 1]
    np.testing.assert_allclose(ramp_error(painted, PARALLEL_CENTRE), 0, atol=1e-5)
    alone = locate(FAR, Detection(exact.left, EMPTY, centre=centre))
    assert (alone.seen, set(alone.lines)) == (LineVisibility.ONE, {"left", "centre"})
    np.testing.assert_allclose(ramp_error(alone.lines["centre"], PARALLEL_CENTRE), 0, atol=1e-5)


@pytest.mark.parametrize(("off_m", "believed"), [(1.0, True), (-1.5, True), (4.0, False), (-4.0, False)])
def test_centre_line_off_the_middle_is_left_out_and_far_off_rejects_the_edges(off_m, believed):
    exact = detection(FAR, PARALLEL_RIGHT, 20, 0.5)
    shift = np.array([0.0, off_m, 0.0])
    wrong = line_points(FAR, Segment(PARALLEL_CENTRE.p0_m + shift, PARALLEL_CENTRE.p1_m + shift), 20, 0.5)
    plain, estimate = locate(FAR, exact), locate(FAR, replace(exact, centre=wrong))
    assert estimate.seen is (LineVisibility.BOTH if believed else LineVisibility.NONE)
    assert Reason.CENTRE_LINE in reasons(estimate)
    assert "14.7 m" in estimate.reason
    if believed:
        np.testing.assert_allclose(plain.lines["centre"].point_m, estimate.lines["centre"].point_m, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.integers(0, 2**31))
def test_estimate_is_invariant_under_motions_of_the_world(turn, north, east, seed):
    frame = approach(100.0, 9.0)
    generator = np.random.default_rng(seed)
    exact = detection(frame, count=20)
    found = Detection(shift_points(exact.left, generator), shift_points(exact.right, generator))
    motion = RigidTransform.from_components([north, east, 0.0], Rotation.from_euler("z", turn))
    moved = replace(frame, world_from_body=motion * frame.world_from_body)
    one, other = (locate(f, found).lines for f in (frame, moved))
    for name in ("left", "right", "centre"):
        np.testing.assert_allclose(other[name].point_m, motion.apply(one[name].point_m), atol=2e-4)
        assert abs(wrap_angle(other[name].azimuth_rad - one[name].azimuth_rad - turn)) < 1e-5
        # Roll and pitch errors about the world axes have the same sigma; so have those of position.
        np.testing.assert_allclose(other[name].covariance, one[name].covariance, rtol=1e-2, atol=1e-7)


def raise_deck(frame, reported_z_m=-20.0):
    """The frame over a deck 20 m above the world's origin: z is down, so its height is -20 m."""
    raised = RigidTransform.from_translation([0.0, 0.0, -20.0 - DECK_Z_M]) * frame.world_from_body
    return replace(frame, world_from_body=raised, deck_z_m=reported_z_m)


@pytest.mark.parametrize(
    ("width_m", "reported_z_m", "known_width_m", "flagged"),
    [
        (WIDTH_M, 20.0, None, True),  # the lines come out 55 m apart, with the right sign 14.7 m
        (WIDTH_M, -20.0, None, False),
        (30.0, -20.0, None, False),
        (45.0, -20.0, None, False),  # unusual, but no better with the other sign
        (WIDTH_M, 20.0, 54.0, False),  # the stated width agrees
    ],
)
def test_deck_height_of_the_wrong_sign_is_flagged(width_m, reported_z_m, known_width_m, flagged):
    right = Segment(LEFT.p0_m + width_m * LATERAL, LEFT.p1_m + width_m * LATERAL)
    frame = approach(90.0, 15.0, right=right)
    estimate = locate(raise_deck(frame, reported_z_m), detection(frame, right), still_deck(width_m=known_width_m))
    assert estimate.seen is LineVisibility.BOTH
    assert [flag.reason for flag in estimate.flags] == [Reason.DECK_SIGN] * flagged
    assert not flagged or ("20 m" in estimate.flags[0].message and "55 m" in estimate.flags[0].message)


@pytest.mark.parametrize(("sea_z_m", "flagged"), [(None, False), (0.0, False), (-20.0, True), (-25.0, True)])
def test_a_deck_at_the_water_or_below_is_flagged_whatever_the_width(sea_z_m, flagged):
    seen = approach(90.0, 15.0)
    estimate = locate(replace(raise_deck(seen), sea_z_m=sea_z_m), detection(seen), still_deck(width_m=16.0))
    assert [flag.reason for flag in estimate.flags] == [Reason.DECK_SIGN] * flagged
