from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from deckline.localize.model import NUISANCES, FitState
from deckline.localize.solver import noise_inflation, solve
from runway_scene import LEFT, NOISE, PARALLEL_RIGHT, STILL, approach, azimuth, detection, observe_lines, with_depth

FRAME = with_depth(approach(80.0, 8.0, right=PARALLEL_RIGHT))


def solve_from_offset(frame, found, mode="auto"):
    """The solution from a start that is off by 0.3 m, 0.01 rad and 0.4 m of height."""
    observations, *_ = observe_lines(frame, found, mode)
    middles = np.stack([(line.p0_m + line.p1_m)[:2] / 2 for line in (LEFT, PARALLEL_RIGHT)])
    start = FitState(middles + 0.3, np.full(2, azimuth(LEFT) + 0.01), LEFT.p0_m[2] + 0.4, np.zeros(NUISANCES))
    return solve(observations, start, NOISE, STILL.deck, LEFT.p0_m[2])


def test_iteration_converges_to_the_truth():
    solution = solve_from_offset(FRAME, detection(FRAME, PARALLEL_RIGHT))
    np.testing.assert_allclose(solution.state.azimuths_rad, azimuth(LEFT), atol=1e-6)
    assert solution.state.z_m == pytest.approx(LEFT.p0_m[2], abs=1e-5)


def test_depth_noise_larger_than_stated_inflates_the_depths_alone():
    frame = replace(FRAME, depth_m=FRAME.depth_m.copy())
    found = detection(frame, PARALLEL_RIGHT, 16)
    rng = np.random.default_rng(1)
    for u, v in np.rint(np.concatenate([found.left.points_px, found.right.points_px])).astype(int):
        frame.depth_m[v - 1 : v + 2, u - 1 : u + 2] *= 1 + rng.normal(0, 0.05)  # 1 % is stated
    solution = solve_from_offset(frame, found, "fine")
    assert (solution.inflation["left"], solution.inflation["right"]) == (1.0, 1.0)
    assert 3.5 < solution.inflation["depth"] < 6.5


SIGMA = 0.3


@cache
def regression(count, correlation):
    """Design of a straight line (N, 2), its pseudo-inverse, and a root of the errors' covariance (N, N)."""
    design = np.column_stack([np.ones(count), np.linspace(-1, 1, count)])
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    return design, np.linalg.pinv(design), np.linalg.cholesky(correlation**lag)


def residuals(count, correlation, rng, dispersion=1.0):
    """Residuals of a straight line fitted to autoregressive errors, and the errors of the fit (2,)."""
    design, inverse, root = regression(count, correlation)
    errors = dispersion * root @ rng.normal(size=count)
    return errors - design @ (inverse @ errors), inverse @ errors


def error_ratio(count, correlation, prior, sigma=SIGMA, tries=300):
    """Mean squared error over the stated variance, per fitted number, of two lines."""
    rng = np.random.default_rng(4)
    design = regression(count, correlation)[0]
    information = design.T @ design
    found = []
    for _ in range(tries):
        (first, one), (second, other) = (residuals(count, correlation, rng) for _ in range(2))
        factor = noise_inflation([first, second], prior, sigma)[0]
        found += [error @ information @ error / 2 / factor**2 for error in (one, other)]
    return float(np.mean(found))


def test_large_residuals_inflate_the_noise_and_small_ones_do_not_shrink_it():
    noise = np.random.default_rng(3).normal(0, 1, 200)
    np.testing.assert_allclose(noise_inflation([5.0 * noise, noise], 0.0, SIGMA), [5.0, 1.0], rtol=0.15)
    np.testing.assert_allclose(noise_inflation([noise, 0.01 * noise], 0.0, SIGMA), [1.0, 1.0], atol=0.05)
    assert noise_inflation([np.full(200, 0.1)], 0.2, SIGMA).tolist() == [1.0]  # correlated, but small
    assert noise_inflation([np.zeros(0)], 0.2, SIGMA).tolist() == [1.0]
    assert noise_inflation([np.zeros(6), np.zeros(6)], 0.2, SIGMA).tolist() == [1.0, 1.0]


@pytest.mark.parametrize(("correlation", "count"), [(0.0, 40), (0.3, 40), (0.5, 40), (0.5, 16), (0.7, 40), (0.7, 16)])
def test_stated_variance_is_right_for_any_correlation(correlation, count):
    assert 0.75 < error_ratio(count, correlation, 0.2) < 1.25


def test_prior_of_the_correlation_is_needed_for_few_points():
    """A straight line explains most of the correlated errors of 8 points: the residuals look independent."""
    assert error_ratio(8, 0.5, 0.2) < 1.35
    assert error_ratio(8, 0.5, -0.5) > 1.7


def test_errors_far_smaller_than_stated_do_not_look_correlated():
    rng = np.random.default_rng(5)
    factors = [noise_inflation([residuals(40, 0.3, rng, 0.4)[0] for _ in range(2)], 0.2, SIGMA)[0] for _ in range(100)]
    assert np.mean(factors) < 1.05


@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_known_correlation_gives_the_effective_sample_size(correlation):
    """N (1 - r) / (1 + r) is exact for many points, and a tenth too small for 40."""
    assert 0.85 < error_ratio(40, correlation, correlation, 0.0) < 1.1
    rng = np.random.default_rng(6)
    factors = [noise_inflation([residuals(200, correlation, rng)[0]], correlation, 0.0)[0] for _ in range(20)]
    expected = np.sqrt((1 + correlation) / (1 - correlation))
    np.testing.assert_allclose(np.median(factors), expected, rtol=0.05)


def test_few_residuals_leave_the_prior_and_many_overrule_it():
    rng = np.random.default_rng(7)

    def mean_factor(count, prior):
        return np.mean([noise_inflation([residuals(count, 0.0, rng)[0]], prior, SIGMA)[0] for _ in range(50)])

    assert mean_factor(4, 0.7) > 1.5 * mean_factor(4, -0.5)
    assert mean_factor(200, 0.7) < 1.15 * mean_factor(200, -0.5)
    assert noise_inflation([np.ones(3)], 0.5, SIGMA)[0] == 1.0  # too few for any estimate
