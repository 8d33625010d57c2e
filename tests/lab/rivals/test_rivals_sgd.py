import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.localize.depth import DeckPoints
from deckline.localize.ransac import least_squares_line
from deckline_lab.rivals import sgd
from runway_scene import DECK_Z_M, LEFT, azimuth

CAMERA_M = np.array([100.0, 20.0, -10.0])
ALONG = np.linspace(0, 1, 50)[:, None] * (LEFT.p1_m - LEFT.p0_m)
ON_LEFT = LEFT.p0_m + ALONG


def fit(camera_m=CAMERA_M, pixel_m=None, **points_m):
    """Fits of exact points, or of points that the detector's noise displaces by `pixel_m`."""
    located = {}
    for side, points in points_m.items():
        zero, common = np.zeros_like(points), np.zeros((9, *points.shape))
        located[side] = DeckPoints(
            np.arange(len(points)), points, zero if pixel_m is None else pixel_m, zero, common, common
        )
    return sgd.fit_alone(located, camera_m, np.random.default_rng(0))


@pytest.fixture
def white(monkeypatch):
    monkeypatch.setattr(sgd, "CORRELATION", 0.0)
    monkeypatch.setattr(sgd, "CORRELATION_SIGMA", 0.0)


def test_exact_points_give_the_papers_line_in_the_direction_of_landing():
    line = fit(left=ON_LEFT)["left"]
    assert np.tan(line.azimuth_rad) == pytest.approx(-0.16300, abs=1e-6)
    assert line.point_m[1] - np.tan(line.azimuth_rad) * line.point_m[0] == pytest.approx(35.788523, abs=1e-4)
    assert line.point_m[2] == pytest.approx(DECK_Z_M)
    assert line.azimuth_rad == pytest.approx(azimuth(LEFT), abs=1e-6)  # towards -x: away from the camera
    behind = fit(CAMERA_M - [500, 0, 0], left=ON_LEFT)["left"]
    assert np.cos(line.azimuth_rad - behind.azimuth_rad) == pytest.approx(-1, abs=1e-12)
    w0, w1, w2, _ = sgd.fit_sgd(ON_LEFT[:30], np.random.default_rng(0))
    np.testing.assert_allclose([w0 / w2, w1 / w2], [-35.788523, 0.16300], rtol=1e-6)


def test_covariance_equals_that_of_an_unweighted_regression(white):
    x = np.linspace(0, 100, 20)
    sigma = 0.01 * (1 + x)
    pixel_m = np.column_stack([np.zeros(20), sigma, np.zeros(20)])
    line = fit(np.array([-50.0, 0, -10]), pixel_m, left=np.column_stack([x, np.zeros(20), np.zeros(20)]))["left"]
    solver = np.linalg.pinv(np.column_stack([np.ones(20), x - x.mean()]))
    np.testing.assert_allclose(line.covariance[:2, :2], (solver * sigma**2) @ solver.T, rtol=1e-6, atol=1e-12)


def test_each_line_is_fitted_alone():
    both = fit(left=ON_LEFT[:30], right=ON_LEFT[:30] + np.array([0.0, -15.0, 0.5]))
    assert both["left"].point_m[2] == pytest.approx(DECK_Z_M)
    assert both["right"].point_m[2] == pytest.approx(DECK_Z_M + 0.5)
    assert not (both["left"].own[:, 60:90].any() or both["right"].own[:, :30].any())


def test_lines_with_too_few_points_are_left_out():
    assert set(fit(left=ON_LEFT, right=ON_LEFT[:4])) == {"left"}
    assert fit(left=ON_LEFT[:5], right=ON_LEFT[:0]) == {}
    with pytest.raises(ValueError, match=r"points.* 1$"):
        sgd.fit_sgd(ON_LEFT[:1], np.random.default_rng(0))


def test_descent_agrees_with_the_closed_form():
    points = ON_LEFT + np.random.default_rng(0).normal(0, [0, 0.3, 0], (50, 3))
    w0, w1, w2, w3 = sgd.fit_sgd(points, np.random.default_rng(1))
    a, b, c = least_squares_line(points[:, :2], None)
    assert np.hypot(w1, w2) == pytest.approx(1.0)
    assert np.arctan(-w1 / w2) == pytest.approx(np.arctan(-a / b), abs=np.deg2rad(0.01))
    assert -w0 / w2 == pytest.approx(-c / b, abs=0.02)
    assert w3 == pytest.approx(DECK_Z_M)


@settings(max_examples=4, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.integers(0, 2**31))
def test_fit_is_invariant_under_motions_of_the_world(turn, north, east, seed):
    rng = np.random.default_rng(seed)
    points = ON_LEFT + rng.normal(0, [0.3, 0.3, 0], (50, 3))
    pixel_m = rng.normal(0, [0.2, 0.2, 0], (50, 3))
    c, s = np.cos(turn), np.sin(turn)
    rotation, shift = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([north, east, 0.0])
    one = fit(CAMERA_M, pixel_m, left=points)["left"]
    other = fit(rotation @ CAMERA_M + shift, pixel_m @ rotation.T, left=points @ rotation.T + shift)["left"]
    np.testing.assert_allclose(other.point_m, rotation @ one.point_m + shift, atol=1e-2)  # where the descent ends
    assert abs(np.angle(np.exp(1j * (other.azimuth_rad - one.azimuth_rad - turn)))) < 1e-4
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-2, atol=1e-9)
