import numpy as np
import pytest

from deckline.localize.spread import inflation

SIGMA = 0.3


def residuals(count, correlation, rng, spread=1.0):
    """Of a straight line fitted to points whose errors decay along it, and the errors of the fit (2,)."""
    design = np.column_stack([np.ones(count), np.linspace(-1, 1, count)])
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    errors = spread * np.linalg.cholesky(correlation**lag) @ rng.normal(size=count)
    fitted = np.linalg.lstsq(design, errors, rcond=None)[0]
    return errors - design @ fitted, fitted


def honesty(count, correlation, expected, sigma=SIGMA, tries=300):
    """Mean squared error over the variance that is claimed, per fitted number, of two lines."""
    rng = np.random.default_rng(4)
    design = np.column_stack([np.ones(count), np.linspace(-1, 1, count)])
    information = design.T @ design
    found = []
    for _ in range(tries):
        (first, one), (second, other) = (residuals(count, correlation, rng) for _ in range(2))
        factor = inflation([first, second], expected, sigma)[0]
        found += [error @ information @ error / 2 / factor**2 for error in (one, other)]
    return float(np.mean(found))


def test_residuals_larger_than_assumed_inflate_and_smaller_do_not_shrink():
    noise = np.random.default_rng(3).normal(0, 1, 200)
    np.testing.assert_allclose(inflation([5.0 * noise, noise], 0.0, SIGMA), [5.0, 1.0], rtol=0.15)
    np.testing.assert_allclose(inflation([noise, 0.01 * noise], 0.0, SIGMA), [1.0, 1.0], atol=0.05)
    assert inflation([np.full(200, 0.1)], 0.2, SIGMA).tolist() == [1.0]  # all alike, but small
    assert inflation([np.zeros(0)], 0.2, SIGMA).tolist() == [1.0]
    assert inflation([np.zeros(6), np.zeros(6)], 0.2, SIGMA).tolist() == [1.0, 1.0]


@pytest.mark.parametrize(("correlation", "count"), [(0.0, 40), (0.3, 40), (0.5, 40), (0.5, 16), (0.7, 40), (0.7, 16)])
def test_errors_are_as_large_as_claimed_whether_or_not_neighbours_err_together(correlation, count):
    assert 0.75 < honesty(count, correlation, 0.2) < 1.25


def test_a_few_points_that_err_together_are_not_taken_at_their_word():
    """A straight line takes most of what 8 alike points show with it: without expectation they look independent."""
    assert honesty(8, 0.5, 0.2) < 1.35
    assert honesty(8, 0.5, -0.5) > 1.7


def test_errors_far_smaller_than_stated_do_not_look_alike():
    rng = np.random.default_rng(5)
    factors = [inflation([residuals(40, 0.3, rng, 0.4)[0] for _ in range(2)], 0.2, SIGMA)[0] for _ in range(100)]
    assert np.mean(factors) < 1.05


@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_a_correlation_that_is_known_is_not_learned(correlation):
    """N points are worth N (1 - r) / (1 + r); that is exact for many, and a tenth too few for 40."""
    assert 0.85 < honesty(40, correlation, correlation, 0.0) < 1.1
    rng = np.random.default_rng(6)
    factors = [inflation([residuals(200, correlation, rng)[0]], correlation, 0.0)[0] for _ in range(20)]
    expected = np.sqrt((1 + correlation) / (1 - correlation))
    np.testing.assert_allclose(np.median(factors), expected, rtol=0.05)


def test_few_residuals_leave_what_was_expected():
    rng = np.random.default_rng(7)
    alone = [
        [inflation([residuals(4, 0.0, rng)[0]], expected, SIGMA)[0] for _ in range(50)] for expected in (-0.5, 0.7)
    ]
    many = [
        [inflation([residuals(200, 0.0, rng)[0]], expected, SIGMA)[0] for _ in range(50)] for expected in (-0.5, 0.7)
    ]
    assert np.mean(alone[1]) > 1.5 * np.mean(alone[0])
    assert np.mean(many[1]) < 1.15 * np.mean(many[0])
    assert inflation([np.ones(3)], 0.5, SIGMA)[0] == 1.0  # fewer say nothing at all
