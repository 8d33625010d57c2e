import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.localize import NoiseConfig, fit_sgd
from deckline.localize.depth import DeckPoints
from deckline.localize.line_fit import fit_alone, weighted_line
from runway_scene import LEFT, azimuth

WHITE = NoiseConfig(point_correlation=0.0, point_correlation_sigma=0.0)
CAMERA_M = np.array([100.0, 20.0, -10.0])


def deck_points(points, pixel=None, depth=None):
    n = len(points)
    zero = np.zeros((n, 3))
    return DeckPoints(
        np.arange(n),
        points,
        zero if pixel is None else pixel,
        zero if depth is None else depth,
        np.zeros((9, n, 3)),
        np.zeros((9, n, 3)),
    )


def fit_lines(points, camera_m, min_points):
    return fit_alone(points, camera_m, min_points, WHITE, np.random.default_rng(0))


def on_left(n=50):
    return LEFT.p0_m + np.linspace(0, 1, n)[:, None] * (LEFT.p1_m - LEFT.p0_m)


def test_exact_points_give_the_papers_numbers():
    fit = fit_lines({"left": deck_points(on_left())}, CAMERA_M, 6)["left"]
    assert np.tan(fit.azimuth_rad) == pytest.approx(-0.16300, abs=1e-6)
    assert fit.point_m[1] - np.tan(fit.azimuth_rad) * fit.point_m[0] == pytest.approx(35.788523, abs=1e-4)
    assert fit.point_m[2] == pytest.approx(6.08)
    assert abs(fit.azimuth_rad - azimuth(LEFT)) < 1e-6  # towards -x: away from the camera


def test_the_direction_of_landing_follows_the_camera():
    ahead = fit_lines({"left": deck_points(on_left())}, CAMERA_M, 6)["left"]
    behind = fit_lines({"left": deck_points(on_left())}, CAMERA_M - [500, 0, 0], 6)["left"]
    assert abs(np.cos(ahead.azimuth_rad - behind.azimuth_rad) + 1) < 1e-12


def test_covariance_equals_that_of_an_unweighted_regression():
    x = np.linspace(0, 100, 20)
    sigma = 0.01 * (1 + x)
    pixel = np.column_stack([np.zeros(20), sigma, np.zeros(20)])
    points = np.column_stack([x, np.zeros(20), np.zeros(20)])
    fit = fit_lines({"left": deck_points(points, pixel)}, np.array([-50.0, 0, -10]), 6)["left"]
    solver = np.linalg.pinv(np.column_stack([np.ones(20), x - x.mean()]))
    expected = (solver * sigma**2) @ solver.T
    np.testing.assert_allclose(fit.covariance[:2, :2], expected, rtol=1e-6, atol=1e-12)


def test_each_line_is_fitted_alone():
    """Points of another line, near or wrong, change nothing; nor is height shared."""
    right = on_left(30) + np.array([0.0, -15.0, 0.5])
    both = fit_lines({"left": deck_points(on_left(30)), "right": deck_points(right)}, CAMERA_M, 6)
    assert both["left"].point_m[2] == pytest.approx(6.08)
    assert both["right"].point_m[2] == pytest.approx(6.58)
    assert not (both["left"].own[:, 60:90].any() or both["right"].own[:, :30].any())


def test_a_line_with_too_few_points_is_left_out():
    fits = fit_lines({"left": deck_points(on_left()), "right": deck_points(on_left(4))}, CAMERA_M, 6)
    assert set(fits) == {"left"}
    assert fit_lines({"left": deck_points(on_left(5))}, CAMERA_M, 6) == {}
    assert fit_lines({"left": deck_points(np.zeros((0, 3)))}, CAMERA_M, 6) == {}


@pytest.mark.parametrize("weighted", [False, True])
def test_sgd_agrees_with_the_closed_form(weighted):
    rng = np.random.default_rng(0)
    points = on_left(40)
    weights = np.linspace(1, 4, 40) if weighted else np.ones(40)
    points[:, 1] += rng.normal(0, 0.3, 40)
    w0, w1, w2, w3 = fit_sgd(points, np.random.default_rng(1), weights if weighted else None)
    centre, angle = weighted_line(points[:, :2], weights)
    assert np.hypot(w1, w2) == pytest.approx(1.0)
    closed = np.tan(angle)
    assert np.arctan(-w1 / w2) == pytest.approx(np.arctan(closed), abs=np.deg2rad(0.01))
    assert -w0 / w2 == pytest.approx(centre[1] - closed * centre[0], abs=0.02)
    assert w3 == pytest.approx(6.08)


def test_sgd_on_exact_points_gives_the_papers_line():
    w0, w1, w2, _ = fit_sgd(on_left(30), np.random.default_rng(0))
    np.testing.assert_allclose([w0 / w2, w1 / w2], [-35.788523, 0.16300], rtol=1e-6)


def test_too_few_points_are_named():
    with pytest.raises(ValueError, match="at least 2 points, got 1"):
        fit_sgd(np.zeros((1, 3)), np.random.default_rng(0))
    with pytest.raises(ValueError, match="at least 2 points, got 1"):
        weighted_line(np.zeros((1, 2)), np.ones(1))


@settings(max_examples=4, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.integers(0, 2**31))
def test_the_fit_turns_and_moves_with_the_world(turn, north, east, seed):
    rng = np.random.default_rng(seed)
    points = on_left(30) + np.column_stack([rng.normal(0, 0.3, (30, 2)), np.zeros(30)])
    pixel = np.column_stack([rng.normal(0, 0.2, (30, 2)), np.zeros(30)])
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    shift = np.array([north, east, 0.0])
    one = fit_lines({"a": deck_points(points, pixel)}, CAMERA_M, 6)["a"]
    other = fit_lines(
        {"a": deck_points(points @ rotation.T + shift, pixel @ rotation.T)}, rotation @ CAMERA_M + shift, 6
    )["a"]
    np.testing.assert_allclose(other.point_m, rotation @ one.point_m + shift, atol=1e-2)  # where the descent ends
    assert abs(np.angle(np.exp(1j * (other.azimuth_rad - one.azimuth_rad - turn)))) < 1e-4
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-2, atol=1e-9)
