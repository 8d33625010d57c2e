"""Scenes that are hard, and knowledge of the deck, through the whole joint method."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import wrap_angle
from deckline.localize import AgreementConfig, DeckConfig, LocalizeConfig, localize
from deckline.types import DepthMode, Detection, LinePoints, Segment, Status
from runway_scene import (
    DECK_Z_M,
    LEFT,
    PARALLEL_CENTRE,
    PARALLEL_RIGHT,
    RIGHT,
    approach,
    azimuth,
    beside,
    detection,
    line_points,
    with_depth,
)

CONFIG = LocalizeConfig()
WIDTH_M = float(np.linalg.norm((PARALLEL_RIGHT.p0_m - LEFT.p0_m) @ [np.sin(azimuth(LEFT)), -np.cos(azimuth(LEFT)), 0]))


def rng():
    return np.random.default_rng(0)


def shaken(points, generator, sigma_px=None):
    """Points whose u errs by their sigma."""
    sigma = points.sigma_px if sigma_px is None else np.full(len(points), sigma_px)
    moved = points.points_px + np.column_stack([generator.normal(0, sigma), np.zeros(len(points))])
    return LinePoints(moved, points.confidence, points.sigma_px)


def error_at_ramp(line, truth):
    error, _ = beside(line.point_m, line.azimuth_rad, line.covariance, truth, truth.p0_m)
    return error


def test_a_third_of_outliers_is_shrugged_off():
    frame = approach(120.0, 10.0, right=PARALLEL_RIGHT)
    generator = np.random.default_rng(2)
    exact = detection(frame, PARALLEL_RIGHT, 40, 0.3)
    errors = []
    for _ in range(20):
        lines = []
        for points in (exact.left, exact.right):
            noisy = shaken(points, generator)
            wrong = generator.choice(40, 12, replace=False)
            px = noisy.points_px.copy()
            px[wrong, 0] += generator.uniform(-60, 60, 12)
            lines.append(LinePoints(px, noisy.confidence, noisy.sigma_px))
        estimate = localize(frame, Detection(*lines), CONFIG, generator)
        assert estimate.status is Status.OK
        line = estimate.lines["left"]
        error, covariance = beside(line.point_m, line.azimuth_rad, line.covariance, LEFT, LEFT.p0_m)
        errors.append(error[:2] / np.sqrt(np.diag(covariance)[:2]))
    assert np.abs(errors).max() < 3
    assert np.abs(error_at_ramp(line, LEFT)[0]) < 0.3


def test_outliers_that_pass_as_inliers_do_not_pull():
    """A tenth of the points 3 px aside, within RANSAC's reach: ten times their sigma, so they count for nothing."""
    frame = approach(120.0, 10.0, right=PARALLEL_RIGHT)
    exact = detection(frame, PARALLEL_RIGHT, 40, 0.3)
    px = exact.left.points_px.copy()
    px[::10, 0] += 3.0
    pulled = localize(frame, Detection(replace(exact.left, points_px=px), exact.right), CONFIG, rng())
    np.testing.assert_allclose(error_at_ramp(pulled.lines["left"], LEFT)[:2], 0, atol=1e-4)


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_line_alone_is_where_it_is(side):
    frame = approach(120.0, 10.0, right=PARALLEL_RIGHT)
    found = detection(frame, PARALLEL_RIGHT)
    empty = LinePoints.empty()
    only = Detection(found.left, empty) if side == "left" else Detection(empty, found.right)
    estimate = localize(frame, only, CONFIG, rng())
    assert estimate.status is Status.ONE_LINE
    truth = {"left": LEFT, "right": PARALLEL_RIGHT}[side]
    np.testing.assert_allclose(error_at_ramp(estimate.lines[side], truth), 0, atol=1e-6)


@pytest.mark.parametrize("roll_deg", [-20.0, 20.0, 75.0])
def test_a_rolled_camera_changes_nothing(roll_deg):
    """At 75 degrees the lines run nearly along the image's rows."""
    frame = approach(90.0, 9.0, roll=np.deg2rad(roll_deg), pitch=-0.08, right=PARALLEL_RIGHT)
    exact = detection(frame, PARALLEL_RIGHT)
    estimate = localize(frame, exact, CONFIG, rng())
    assert estimate.status is Status.OK
    for side, truth in (("left", LEFT), ("right", PARALLEL_RIGHT)):
        np.testing.assert_allclose(error_at_ramp(estimate.lines[side], truth), 0, atol=1e-5)


def test_a_camera_upside_down_in_the_settings_makes_no_runway():
    frame = approach(90.0, 9.0, right=PARALLEL_RIGHT)
    exact = detection(frame, PARALLEL_RIGHT)
    turned = frame.body_from_camera.rotation * Rotation.from_euler("z", np.pi)
    wrong = replace(frame, body_from_camera=RigidTransform.from_components(frame.body_from_camera.translation, turned))
    estimate = localize(wrong, exact, CONFIG, rng())
    assert (estimate.status, estimate.lines) == (Status.NOT_SEEN, {})
    assert "the left line lies 3.8 m right of the right line" in estimate.reason


def test_a_deck_above_the_camera_is_no_deck():
    frame = replace(approach(90.0, 9.0), deck_z_m=-40.0)
    estimate = localize(frame, detection(approach(90.0, 9.0)), CONFIG, rng())
    assert estimate.status is Status.NOT_SEEN
    assert estimate.reason == "the deck is not below the camera"


def test_a_tiny_runway_is_found_with_an_uncertainty_to_match():
    """2 km away: both lines within 8 px of height."""
    frame = approach(2000.0, 130.0, right=PARALLEL_RIGHT)
    generator = np.random.default_rng(1)
    exact = detection(frame, PARALLEL_RIGHT, 12, 0.2)
    scores = []
    for _ in range(20):
        found = Detection(shaken(exact.left, generator), shaken(exact.right, generator))
        estimate = localize(frame, found, CONFIG, generator)
        assert estimate.status is Status.OK
        centre = estimate.lines["centre"]
        scores.append(wrap_angle(centre.azimuth_rad - azimuth(LEFT)) / np.sqrt(centre.covariance[1, 1]))
        assert np.rad2deg(np.sqrt(centre.covariance[1, 1])) > 0.1
    assert np.abs(scores).max() < 3


def test_gaps_in_the_depth_and_bad_far_samples_do_no_harm():
    frame = with_depth(approach(60.0, 7.0, right=PARALLEL_RIGHT))
    generator = np.random.default_rng(3)
    depth = frame.depth_m.copy()
    far = depth > 120
    depth[far] *= 1 + 0.03 * generator.standard_normal(int(far.sum())).astype(np.float32)
    depth[generator.random(depth.shape) < 0.1] = np.nan
    depth[:, 640:660] = 3000.0  # something else altogether
    estimate = localize(replace(frame, depth_m=depth), detection(frame, PARALLEL_RIGHT), CONFIG, rng())
    assert estimate.mode is DepthMode.FINE
    assert estimate.lines["centre"].height_m == pytest.approx(DECK_Z_M, abs=0.05)
    assert abs(error_at_ramp(estimate.lines["left"], LEFT)[0]) < 0.05


def test_auto_weighs_depth_and_deck_height_by_their_noise():
    frame = with_depth(approach(100.0, 9.0, right=PARALLEL_RIGHT))
    off = replace(frame, deck_z_m=DECK_Z_M + 0.2)
    found = detection(frame, PARALLEL_RIGHT)
    heights, sigmas = {}, {}
    for mode in ("fine", "coarse", "auto"):
        centre = localize(off, found, LocalizeConfig(mode=mode), rng()).lines["centre"]
        heights[mode], sigmas[mode] = centre.height_m, np.sqrt(centre.relative_covariance[2, 2])
    assert heights["fine"] == pytest.approx(DECK_Z_M, abs=1e-3)
    assert heights["coarse"] == pytest.approx(DECK_Z_M + 0.2, abs=1e-3)
    share = sigmas["fine"] ** 2 / (sigmas["fine"] ** 2 + sigmas["coarse"] ** 2)
    assert heights["auto"] == pytest.approx(DECK_Z_M + 0.2 * share, abs=0.01)
    assert sigmas["auto"] ** -2 == pytest.approx(sigmas["fine"] ** -2 + sigmas["coarse"] ** -2, rel=0.02)


def test_a_few_depths_contradicting_the_deck_are_not_believed_in_coarse():
    frame = with_depth(approach(60.0, 7.0, right=PARALLEL_RIGHT), 75.0)
    estimate = localize(
        replace(frame, depth_m=frame.depth_m * np.float32(1.3)), detection(frame, PARALLEL_RIGHT), CONFIG, rng()
    )
    assert estimate.mode is DepthMode.COARSE
    assert "contradict each other: the deck height is believed" in estimate.reason
    assert estimate.lines["centre"].height_m == pytest.approx(DECK_Z_M, abs=1e-3)


def test_known_parallels_lend_a_short_line_its_direction():
    frame = approach(90.0, 9.0, right=PARALLEL_RIGHT)
    found = detection(frame, PARALLEL_RIGHT)
    near = np.argsort(-found.left.points_px[:, 1])[:8]
    left = LinePoints(found.left.points_px[near], found.left.confidence[near], np.full(8, 2.0))
    sigmas = []
    for parallel_rad in (np.inf, 0.0):
        config = LocalizeConfig(agreement=AgreementConfig(parallel_rad=parallel_rad, max_azimuth_sigma_rad=1.0))
        line = localize(frame, Detection(left, found.right), config, rng()).lines["left"]
        sigmas.append(np.sqrt(line.covariance[1, 1]))
    assert sigmas[1] < 0.3 * sigmas[0]


def test_a_known_angle_between_the_lines_is_kept_to():
    frame = approach(60.0, 8.0)
    angle = float(wrap_angle(azimuth(RIGHT) - azimuth(LEFT)))
    known = LocalizeConfig(deck=DeckConfig(angle_rad=angle), agreement=AgreementConfig(parallel_rad=1e-4))
    lines = localize(frame, detection(frame), known, rng()).lines
    np.testing.assert_allclose(error_at_ramp(lines["left"], LEFT), 0, atol=1e-5)
    np.testing.assert_allclose(error_at_ramp(lines["right"], RIGHT), 0, atol=1e-5)


def test_a_known_width_tells_the_height():
    frame = approach(60.0, 8.0, right=PARALLEL_RIGHT)
    off = replace(frame, deck_z_m=DECK_Z_M + 0.3)
    parallel = AgreementConfig(parallel_rad=0.0)
    config = LocalizeConfig(runway_width_m=WIDTH_M, agreement=parallel, deck=DeckConfig(width_sigma_m=0.02))
    estimate = localize(off, detection(frame, PARALLEL_RIGHT), config, rng())
    assert estimate.lines["centre"].height_m == pytest.approx(DECK_Z_M, abs=0.05)
    free = localize(off, detection(frame, PARALLEL_RIGHT), CONFIG, rng())
    assert free.lines["centre"].height_m == pytest.approx(DECK_Z_M + 0.3, abs=1e-3)


def test_a_sloped_deck_needs_to_be_allowed_for():
    """One degree down along the runway, seen by a depth camera."""
    frame = with_depth(approach(60.0, 8.0, right=PARALLEL_RIGHT))
    slope = float(np.tan(np.deg2rad(1.0)))
    along = np.array([np.cos(azimuth(LEFT)), np.sin(azimuth(LEFT))])
    sloped = [
        Segment(*(p + np.array([0.0, 0.0, slope * (p - LEFT.p0_m)[:2] @ along]) for p in (line.p0_m, line.p1_m)))
        for line in (LEFT, PARALLEL_RIGHT)
    ]
    v, u = np.mgrid[0 : frame.camera.height, 0 : frame.camera.width]
    pose = frame.world_from_camera
    rays = pose.rotation.apply(frame.camera.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float)))
    way = pose.translation - LEFT.p0_m
    fall = rays[:, 2] - slope * rays[:, :2] @ along
    with np.errstate(divide="ignore"):
        depth = (slope * way[:2] @ along - way[2]) / fall
    depth = np.where((depth > 0) & (depth < 400), depth, np.nan).reshape(v.shape).astype(np.float32)
    scene = replace(frame, depth_m=depth)
    found = Detection(line_points(frame, sloped[0]), line_points(frame, sloped[1]))
    level, tilted = (
        localize(scene, found, LocalizeConfig(mode="fine", deck=DeckConfig(tilt_rad=tilt)), rng()).lines["left"]
        for tilt in (0.0, 0.02)
    )

    def off(line):
        truth = sloped[0].p0_m[2] + slope * (line.point_m - LEFT.p0_m)[:2] @ along
        return abs(line.point_m[2] - truth), abs(wrap_angle(line.azimuth_rad - azimuth(LEFT)))

    assert off(tilted)[0] < 0.02 < off(level)[0]
    assert off(tilted)[1] < 1e-3


def test_a_painted_centre_line_sharpens_the_middle_and_stands_in_for_a_line():
    frame = approach(120.0, 10.0, right=PARALLEL_RIGHT)
    exact = detection(frame, PARALLEL_RIGHT, 20, 1.0)
    centre = line_points(frame, PARALLEL_CENTRE, 20, 1.0)
    plain = localize(frame, exact, CONFIG, rng()).lines["centre"]
    painted = localize(frame, replace(exact, centre=centre), CONFIG, rng()).lines["centre"]
    assert painted.relative_covariance[1, 1] < 0.9 * plain.relative_covariance[1, 1]
    np.testing.assert_allclose(error_at_ramp(painted, PARALLEL_CENTRE), 0, atol=1e-5)
    alone = localize(frame, Detection(exact.left, LinePoints.empty(), centre=centre), CONFIG, rng())
    assert alone.status is Status.ONE_LINE
    assert set(alone.lines) == {"left", "centre"}
    np.testing.assert_allclose(error_at_ramp(alone.lines["centre"], PARALLEL_CENTRE), 0, atol=1e-5)


@pytest.mark.parametrize(("aside_m", "believed"), [(1.0, True), (-1.5, True), (4.0, False), (-4.0, False)])
def test_a_centre_line_off_the_middle_is_left_out_and_far_off_it_the_edges_are_not_believed(aside_m, believed):
    frame = approach(120.0, 10.0, right=PARALLEL_RIGHT)
    exact = detection(frame, PARALLEL_RIGHT, 20, 0.5)
    aside = Segment(*(p + np.array([0.0, aside_m, 0.0]) for p in (PARALLEL_CENTRE.p0_m, PARALLEL_CENTRE.p1_m)))
    wrong = replace(exact, centre=line_points(frame, aside, 20, 0.5))
    one, other = (localize(frame, found, CONFIG, rng()) for found in (exact, wrong))
    assert other.status is (Status.OK if believed else Status.NOT_SEEN)
    assert "m off where the lines are 14.7 m apart, turned by 0.0 degrees" in other.reason
    if believed:
        np.testing.assert_allclose(one.lines["centre"].point_m, other.lines["centre"].point_m, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.integers(0, 2**31))
def test_the_estimate_turns_and_moves_with_the_world(turn, north, east, seed):
    frame = approach(100.0, 9.0)
    generator = np.random.default_rng(seed)
    exact = detection(frame, count=20)
    found = Detection(shaken(exact.left, generator), shaken(exact.right, generator))
    move = RigidTransform.from_components([north, east, 0.0], Rotation.from_euler("z", turn))
    other_frame = replace(frame, world_from_body=move * frame.world_from_body)
    one, other = (localize(f, found, CONFIG, rng()).lines for f in (frame, other_frame))
    for name in ("left", "right", "centre"):
        np.testing.assert_allclose(other[name].point_m, move.apply(one[name].point_m), atol=2e-4)
        assert abs(wrap_angle(other[name].azimuth_rad - one[name].azimuth_rad - turn)) < 1e-5
        # Roll and pitch errors about world axes are alike, so are position's.
        np.testing.assert_allclose(other[name].covariance, one[name].covariance, rtol=1e-2, atol=1e-7)
