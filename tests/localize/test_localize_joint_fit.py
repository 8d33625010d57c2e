"""Accuracy and covariance of the joint fit: against the Cramer-Rao bound, Monte Carlo and finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from deckline.config import Deck, Sensors
from deckline.geometry import wrap_angle
from deckline.localize import solver
from deckline.localize.joint_fit import _is_between
from deckline.localize.line_fit import LineFit
from deckline.localize.model import NUISANCES, FitState, linearize_deck_prior
from deckline.localize.observations import initial_height, initial_line, observe
from deckline.localize.ransac import fit_pixel_line
from deckline.types import SIDES, DepthMode, LineVisibility, Reason
from deckline_lab.evaluation.cramer_rao import cramer_rao
from runway_scene import (
    CAMERA,
    DECK_Z_M,
    LATERAL,
    LEFT,
    PARALLEL,
    PARALLEL_CENTRE,
    PARALLEL_RIGHT,
    STILL,
    WIDTH_M,
    add_noise,
    approach,
    azimuth,
    detection,
    error_at,
    locate,
    observe_lines,
    off_camera,
    remove_own_errors,
    slope_deck,
    still_deck,
    with_depth,
)

DRAWS = 400
TRUTHS = {"left": LEFT, "right": PARALLEL_RIGHT, "centre": PARALLEL_CENTRE}
# Mode, range and height, m, 1-sigma of a point, px, and how many: three rows apart, as depth is sampled over three.
CASES = {
    "haze fine": ("fine", 60.0, 7.0, 1.0, 14),
    "clear fine": ("fine", 90.0, 14.0, 0.3, 22),
    "haze coarse": ("coarse", 300.0, 22.0, 0.8, 14),
    "clear coarse": ("coarse", 800.0, 55.0, 0.3, 24),
}
AT_M = PARALLEL_CENTRE.p0_m
HEADING = np.array([np.cos(azimuth(LEFT)), np.sin(azimuth(LEFT)), 0.0])


def bounds(frame, exact, mode, config, relative):
    points = {side: getattr(exact, side).points_px for side in SIDES}
    sigmas = {side: getattr(exact, side).sigma_px for side in SIDES}
    bound = cramer_rao(frame, points, sigmas, mode, config, AT_M, relative)
    return {"left": bound.lines[:3, :3], "right": bound.lines[3:, 3:], "centre": bound.centre}


@pytest.mark.parametrize("case", CASES)
def test_errors_reach_the_bound_and_match_the_covariance(case, monkeypatch):
    """400 measurements of one scene: NEES in its 99.8 % band, 24 of which are tested; efficiency at least 0.8."""
    monkeypatch.setattr(solver, "CORRELATION", 0.0)
    monkeypatch.setattr(solver, "CORRELATION_SIGMA", 0.0)
    mode, range_m, height_m, sigma_px, count = CASES[case]
    frame = approach(range_m, height_m, right=PARALLEL_RIGHT)
    frame = with_depth(frame) if mode == "fine" else frame
    exact = detection(frame, PARALLEL_RIGHT, count, sigma_px)
    config, rng = still_deck(mode, **PARALLEL), np.random.default_rng(5)
    errors = {(name, kind): [] for name in TRUTHS for kind in ("world", "relative")}
    nees = {key: [] for key in errors}
    for _ in range(DRAWS):
        noisy_frame, found = add_noise(frame, exact, config.noise, rng)
        estimate = locate(noisy_frame, found, config)
        assert estimate.seen is LineVisibility.BOTH
        for name, truth in TRUTHS.items():
            line = estimate.lines[name]
            poses = {
                "world": (line.point_m, line.azimuth_rad, line.covariance),
                "relative": (*remove_own_errors(line, noisy_frame, frame), line.relative_covariance),
            }
            for kind, pose in poses.items():
                error, covariance = error_at(*pose, truth, AT_M)
                errors[name, kind].append(error)
                nees[name, kind].append(error @ np.linalg.solve(covariance, error))
    low, high = chi2.ppf([0.001, 0.999], 3 * DRAWS) / DRAWS
    assert {key: low < np.mean(values) < high for key, values in nees.items()} == dict.fromkeys(nees, True)
    for kind in ("world", "relative"):
        for name, bound in bounds(frame, exact, mode, config, kind == "relative").items():
            efficiency = np.diag(bound) / np.mean(np.square(errors[name, kind]), axis=0)
            assert (efficiency > 0.8).all(), (name, kind, efficiency)
            # 400 draws give the mean square to 7 % (1-sigma); an estimator that beats the bound by more is wrong.
            assert (efficiency < 1.25).all(), (name, kind, efficiency)


@pytest.mark.parametrize("mode", ["coarse", "fine", "auto"])
def test_covariance_equals_the_bound(mode):
    """Two independent computations: analytic derivatives, and finite differences of a forward projection."""
    frame = with_depth(approach(100.0, 9.0, right=PARALLEL_RIGHT, roll=0.2))
    exact = detection(frame, PARALLEL_RIGHT, 20)
    config = still_deck(mode)
    lines = locate(frame, exact, config).lines
    least = bounds(frame, exact, mode, config, relative=True)
    for name in ("left", "centre"):
        line = lines[name]
        _, covariance = error_at(line.point_m, line.azimuth_rad, line.relative_covariance, TRUTHS[name], AT_M)
        np.testing.assert_allclose(covariance, least[name], rtol=2e-3, atol=1e-9)


TURN_X, TURN_Y, REPORTED, FOCAL, SCALE, ALONG, ACROSS = range(7)  # columns of LineErrors.effects
STEPS = np.array([1e-4, 1e-4, 1e-2, 1e-4, 1e-3, 1e-4, 1e-4])


def locate_with_error(index, step, config, fine, origin_m=LEFT.p0_m):
    """Lines with one error, and the rise of the deck, which slopes about `origin_m`, at each line's point."""
    exact = approach(90.0, 11.0, right=PARALLEL_RIGHT)
    slopes = step * np.array([index == ALONG, index == ACROSS])
    gradient = slopes[0] * HEADING + slopes[1] * LATERAL
    exact, found = slope_deck(exact, origin_m, gradient)
    turn = Rotation.from_rotvec(step * np.array([index == TURN_X, index == TURN_Y, 0.0]))
    pose = exact.world_from_body
    frame = replace(
        exact,
        world_from_body=RigidTransform.from_components(pose.translation, turn * pose.rotation),
        deck_z_m=DECK_Z_M + step * (index == REPORTED),
        camera=off_camera(CAMERA, step * (index == FOCAL)),
        depth_m=exact.depth_m * np.float32(1 + step * (index == SCALE)) if fine else None,
    )
    estimate = locate(frame, found, config)
    assert estimate.mode is (DepthMode.FINE if fine else DepthMode.COARSE)
    return estimate.lines, {side: (line.point_m - origin_m) @ gradient for side, line in estimate.lines.items()}


@pytest.mark.parametrize("fine", [True, False])
@pytest.mark.parametrize("index", range(7))
@pytest.mark.parametrize(
    "config",
    [
        STILL,
        still_deck(sensors=Sensors(deck_z_m=1.5), slope_deg=float(np.rad2deg(0.01))),
        still_deck(width_m=WIDTH_M, width_sigma_m=0.3),
    ],
    ids=["level", "sloped", "known width"],
)
def test_effects_equal_finite_differences_of_the_estimate(index, fine, config):
    step = STEPS[index]
    level, _ = locate_with_error(index, 0.0, config, fine)
    origin_m = (level["left"].point_m + level["right"].point_m) / 2
    (low, low_rise), (high, high_rise) = (locate_with_error(index, s, config, fine, origin_m) for s in (-step, step))
    for side in SIDES:
        shift = high[side].point_m - low[side].point_m
        turned = float(wrap_angle(high[side].azimuth_rad - low[side].azimuth_rad))
        right = np.array([-np.sin(low[side].azimuth_rad), np.cos(low[side].azimuth_rad), 0.0])
        slopes = high[side].errors.slopes_rad - low[side].errors.slopes_rad
        slopes = slopes - 2 * step * np.array([index == ALONG, index == ACROSS])
        z = shift[2] - high_rise[side] + low_rise[side]
        found = np.array([shift @ right, turned, z, *slopes]) / (2 * step)
        stated = (high[side].errors.effects + low[side].errors.effects)[:, index] / 2
        limit = 0.02 * np.abs(stated) + [0.05, 3e-3, 0.05, 3e-3, 3e-3]
        assert np.all(np.abs(found - stated) <= limit), (side, found, stated)


@pytest.mark.parametrize(
    "names", [("left", "right"), ("left", "right", "centre"), ("left", "centre"), ("right", "centre")]
)
def test_deck_prior_holds_at_the_truth_and_its_jacobian_equals_finite_differences(names):
    deck = Deck(width_m=14.7, width_sigma_m=0.3, angle_deg=float(np.rad2deg(0.01)))
    offsets = {"left": -7.35, "centre": 0.0, "right": 7.35}
    turns = {"left": -0.005, "centre": 0.0, "right": 0.005}
    azimuths = np.array([azimuth(LEFT) + turns[name] for name in names])
    state = FitState(np.stack([offsets[name] * LATERAL[:2] for name in names]), azimuths, 6.0, np.zeros(NUISANCES))
    terms = linearize_deck_prior(names, state, deck)
    assert len(terms.residuals) == (4 if len(names) == 3 else 2)
    np.testing.assert_allclose(terms.residuals, 0, atol=0.02)  # widths are exact across the mean direction only
    for k in range(2 * len(names)):
        step = np.zeros(terms.jacobian.shape[1])
        step[k] = 1e-4
        low, high = (linearize_deck_prior(names, state.step(sign * step), deck).residuals for sign in (-1, 1))
        np.testing.assert_allclose(terms.jacobian[:, k], (low - high) / 2e-4, rtol=1e-3, atol=0.2)


FAR = approach(80.0, 8.0)


def test_points_above_the_horizon_are_left_out():
    level = replace(FAR, world_from_body=type(FAR.world_from_body).identity())
    left = detection(FAR).left
    lines = {"left": fit_pixel_line(left, FAR.camera, np.random.default_rng(0))}
    high = replace(left, points_px=left.points_px - [0.0, 400.0])
    observations, diagnostics = observe(level, {"left": high}, lines, "auto")
    assert observations.names == ()
    assert [diagnostic.reason for diagnostic in diagnostics] == [Reason.NO_POINTS]
    assert "left" in diagnostics[0].message


def test_a_deck_of_unknown_height_and_a_line_along_the_horizon_give_no_start():
    observations = observe_lines(FAR, detection(FAR, count=20))[0]
    assert initial_height(observations, None, fine=False) is None
    assert initial_line(observations, 0, np.array([0.0, 0.0, 1.0]), DECK_Z_M) is None


@pytest.mark.parametrize(
    ("reported_m", "fine", "start_m"), [(None, False, DECK_Z_M), (9.0, True, DECK_Z_M), (9.0, False, 9.0)]
)
def test_the_start_is_the_depth_cameras_in_fine_mode_or_without_a_reported_height(reported_m, fine, start_m):
    observations = observe_lines(with_depth(FAR), detection(FAR, count=20))[0]
    assert initial_height(observations, reported_m, fine) == pytest.approx(start_m, abs=1e-3)


def test_a_centre_line_is_compared_with_the_edges_where_it_lies():
    """Their offsets are unsure at their own points, 100 m before it, and sure there: 2 m off the middle is too much."""

    def fit(x_m, y_m, offset_m=0.0, azimuth_rad=0.0):
        own = np.array([[offset_m], [azimuth_rad], [0.0]])
        return LineFit(np.array([x_m, y_m, 0.0]), 0.0, own, *np.zeros((2, 3, 1)))

    for azimuth_rad, is_between in ((0.0, True), (-0.03, False)):
        fits = {side: fit(-100.0, y_m, 3.0, azimuth_rad) for side, y_m in (("left", -8.0), ("right", 8.0))}
        assert _is_between(fits | {"centre": fit(0.0, 2.0)}, Deck()) is is_between


def test_frame_without_a_pose_is_refused():
    with pytest.raises(ValueError, match=r"exact\.png.*pose"):
        observe(replace(FAR, world_from_body=None), {}, {}, "auto")
