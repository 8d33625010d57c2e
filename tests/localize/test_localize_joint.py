"""The joint fit: as good as points allow, and honest about it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from deckline.evaluation.cramer_rao import cramer_rao
from deckline.localize import AgreementConfig, LocalizeConfig, NoiseConfig, localize
from deckline.localize.joint import solve
from deckline.localize.model import NUISANCES, State
from deckline.localize.ransac import fit_pixel_line
from deckline.localize.sight import sight
from deckline.types import SIDES, DepthMode, Status
from runway_scene import (
    LEFT,
    PARALLEL_CENTRE,
    PARALLEL_RIGHT,
    approach,
    azimuth,
    beside,
    carried_back,
    detection,
    noisy,
    with_depth,
)

DRAWS = 500
TRUTHS = {"left": LEFT, "right": PARALLEL_RIGHT, "centre": PARALLEL_CENTRE}
# Mode, range and height, m, 1-sigma of a point, px, and how many: three rows apart, as depth is sampled over three.
CASES = {
    "haze fine": ("fine", 60.0, 7.0, 1.0, 14),
    "clear fine": ("fine", 90.0, 14.0, 0.3, 22),
    "haze coarse": ("coarse", 300.0, 22.0, 0.8, 14),
    "clear coarse": ("coarse", 800.0, 55.0, 0.3, 24),
}


WHITE = NoiseConfig(point_correlation=0.0, point_correlation_sigma=0.0)


@pytest.mark.parametrize("case", CASES)
def test_errors_are_as_small_as_the_bound_and_as_large_as_the_covariance_says(case):
    """500 measurements of one view: normalised errors squared in their 95 % band, efficiency at least 0.8."""
    mode, range_m, height_m, sigma_px, count = CASES[case]
    frame = approach(range_m, height_m, right=PARALLEL_RIGHT)
    frame = with_depth(frame) if mode == "fine" else frame
    exact = detection(frame, PARALLEL_RIGHT, count, sigma_px)
    config = LocalizeConfig(mode=mode, noise=WHITE, agreement=AgreementConfig(parallel_rad=0.0))
    at_m, rng = PARALLEL_CENTRE.p0_m, np.random.default_rng(5)
    errors = {(name, kind): [] for name in TRUTHS for kind in ("world", "relative")}
    nees = {key: [] for key in errors}
    for _ in range(DRAWS):
        measured_frame, measured = noisy(frame, exact, config.noise, rng)
        estimate = localize(measured_frame, measured, config, rng)
        assert estimate.status is Status.OK
        for name, truth in TRUTHS.items():
            line = estimate.lines[name]
            seen = carried_back(line, measured_frame, frame)
            for kind, (place, covariance) in {
                "world": ((line.point_m, line.azimuth_rad), line.covariance),
                "relative": (seen, line.relative_covariance),
            }.items():
                error, there = beside(*place, covariance, truth, at_m)
                errors[name, kind].append(error)
                nees[name, kind].append(error @ np.linalg.solve(there, error))
    low, high = chi2.ppf([0.025, 0.975], 3 * DRAWS) / DRAWS
    assert {key: low < np.mean(values) < high for key, values in nees.items()} == dict.fromkeys(nees, True)
    points = {side: getattr(exact, side).points_px for side in SIDES}
    sigmas = {side: getattr(exact, side).sigma_px for side in SIDES}
    for kind in ("world", "relative"):
        bound = cramer_rao(frame, points, sigmas, mode, config, at_m, kind == "relative")
        least = {"left": bound.lines[:3, :3], "right": bound.lines[3:, 3:], "centre": bound.centre}
        for name in TRUTHS:
            efficiency = np.diag(least[name]) / np.mean(np.square(errors[name, kind]), axis=0)
            assert (efficiency > 0.8).all(), (name, kind, efficiency)
            # 500 draws leave the mean square a tenth in doubt; an estimator that beats the bound by more is wrong.
            assert (efficiency < 1.25).all(), (name, kind, efficiency)


@pytest.mark.parametrize("mode", ["coarse", "fine", "auto"])
def test_its_own_covariance_is_the_bound(mode):
    """Two computations that share nothing: analytic derivatives here, a forward projection moved a little there."""
    frame = with_depth(approach(100.0, 9.0, right=PARALLEL_RIGHT, roll=0.2))
    exact = detection(frame, PARALLEL_RIGHT, 20)
    config = LocalizeConfig(mode=mode)
    lines = localize(frame, exact, config, np.random.default_rng(0)).lines
    points = {side: getattr(exact, side).points_px for side in SIDES}
    sigmas = {side: getattr(exact, side).sigma_px for side in SIDES}
    bound = cramer_rao(frame, points, sigmas, mode, config, PARALLEL_CENTRE.p0_m, relative=True)
    for name, least in (("left", bound.lines[:3, :3]), ("centre", bound.centre)):
        line = lines[name]
        _, there = beside(line.point_m, line.azimuth_rad, line.relative_covariance, TRUTHS[name], PARALLEL_CENTRE.p0_m)
        np.testing.assert_allclose(there, least, rtol=2e-3, atol=1e-9)


def solved(frame, found, config):
    points = {side: getattr(found, side) for side in SIDES}
    rng = np.random.default_rng(0)
    pixel_lines = {side: fit_pixel_line(points[side], frame.camera, config.ransac, rng) for side in SIDES}
    view, _ = sight(frame, points, pixel_lines, config)
    middles = np.stack([(line.p0_m + line.p1_m)[:2] / 2 for line in (LEFT, PARALLEL_RIGHT)])
    start = State(middles + 0.3, np.full(2, azimuth(LEFT) + 0.01), LEFT.p0_m[2] + 0.4, np.zeros(NUISANCES))
    return solve(view, start, config, frame.deck_z_m)


def test_a_start_that_is_off_ends_at_the_truth():
    frame = with_depth(approach(80.0, 8.0, right=PARALLEL_RIGHT))
    solution = solved(frame, detection(frame, PARALLEL_RIGHT), LocalizeConfig())
    np.testing.assert_allclose(solution.state.azimuths_rad, azimuth(LEFT), atol=1e-6)
    assert solution.state.z_m == pytest.approx(LEFT.p0_m[2], abs=1e-5)
    assert abs(solution.height_score) < 1e-3


def test_depth_that_scatters_more_than_assumed_is_noticed():
    frame = with_depth(approach(80.0, 8.0, right=PARALLEL_RIGHT))
    found = detection(frame, PARALLEL_RIGHT, 16)
    rng = np.random.default_rng(1)
    for u, v in np.rint(np.concatenate([found.left.points_px, found.right.points_px])).astype(int):
        frame.depth_m[v - 1 : v + 2, u - 1 : u + 2] *= 1 + rng.normal(0, 0.05)  # 1 % is assumed
    solution = solved(frame, found, LocalizeConfig(mode="fine"))
    assert (solution.spreads["left"], solution.spreads["right"]) == (1.0, 1.0)
    assert 3.5 < solution.spreads["depth"] < 6.5


def test_the_reported_height_is_scored_against_the_depth_camera():
    frame = with_depth(approach(60.0, 6.0, right=PARALLEL_RIGHT))
    off = replace(frame, deck_z_m=LEFT.p0_m[2] + 1.0)
    assert solved(off, detection(frame, PARALLEL_RIGHT), LocalizeConfig()).height_score > 5
    estimate = localize(off, detection(frame, PARALLEL_RIGHT), LocalizeConfig(), np.random.default_rng(0))
    assert estimate.mode is DepthMode.FINE
    assert "contradict each other: the depth camera is believed" in estimate.reason
    assert estimate.lines["centre"].height_m == pytest.approx(LEFT.p0_m[2], abs=1e-3)
