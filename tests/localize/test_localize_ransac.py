import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.geometry import undistort
from deckline.localize.ransac import fit_pixel_line, least_squares_line
from deckline.types import LinePoints
from runway_scene import CAMERA, LEFT, LENS, approach, line_points


def points_on(line, u, noise=0.0, rng=None, sigma=0.5):
    a, b, c = line
    v = -(a * u + c) / b
    u = u if rng is None else u + rng.normal(0, noise, len(u))
    return LinePoints(np.column_stack([u, v]), np.full(len(u), 0.9), np.full(len(u), sigma))


def test_outliers_up_to_forty_percent_are_left_out():
    rng = np.random.default_rng(1)
    line = np.array([0.6, -0.8, 20.0])
    good = points_on(line, np.linspace(50, 700, 60), 0.5, rng)
    wrong = good.points_px[:24] + rng.uniform(30, 200, (24, 2)) * [1, -1]
    points = LinePoints(np.concatenate([wrong, good.points_px[24:]]), good.confidence, good.sigma_px)
    found = fit_pixel_line(points, CAMERA, rng)
    assert not found.inliers[:24].any()
    assert found.inliers[24:].all()
    assert abs(found.sigma_px - 0.5 * 0.6) < 0.12  # noise in u alone, seen normal to the line
    np.testing.assert_allclose(np.abs(found.coefficients[:2]), [0.6, 0.8], atol=2e-3)


def test_points_of_small_sigma_have_more_weight():
    u = np.linspace(0, 900, 40)
    points = points_on(np.array([0.0, 1.0, -300.0]), u)
    pixels = points.points_px.copy()
    pixels[::2, 1] += 3.0
    sigma = np.where(np.arange(40) % 2 == 0, 10.0, 0.1)
    found = fit_pixel_line(LinePoints(pixels, points.confidence, sigma), CAMERA, np.random.default_rng(0))
    assert abs(abs(found.coefficients[2]) - 300) < 0.01


@pytest.mark.parametrize(("sigma_px", "limit_px"), [(0.5, 4.0), (2.0, 6.0), (4.0, 12.0), (10.0, 16.0)])
def test_an_unsure_point_is_an_inlier_up_to_three_sigma_within_bounds(sigma_px, limit_px):
    """The limit is three 1-sigma, at least 4 px and at most 16 px, off a line that surer points determine."""
    sure = points_on(np.array([0.0, 1.0, -300.0]), np.linspace(0, 900, 40), sigma=0.01)
    offsets = np.array([-limit_px - 0.1, -limit_px + 0.1, limit_px - 0.1, limit_px + 0.1])
    unsure = np.column_stack([np.linspace(300, 600, 4), 300 + offsets])
    points = LinePoints(
        np.concatenate([sure.points_px, unsure]), np.full(44, 0.9), np.append(sure.sigma_px, np.full(4, sigma_px))
    )
    found = fit_pixel_line(points, CAMERA, np.random.default_rng(0))
    assert found.inliers[:40].all()
    np.testing.assert_array_equal(found.inliers[40:], [False, True, True, False])


def test_lens_distortion_does_not_change_the_line():
    frame = approach(8.0, 4.0, camera=LENS)
    points = line_points(frame, LEFT)
    bend_px = np.abs(np.column_stack([points.points_px, np.ones(40)]) @ least_squares_line(points.points_px)).max()
    found = fit_pixel_line(points, LENS, np.random.default_rng(0))
    assert bend_px > 2.0
    assert found.inliers.all()
    assert found.sigma_px < 1e-6
    near = points.points_px[np.argmax(points.points_px[:, 1])]
    np.testing.assert_allclose(found.ends_px[0], near, atol=1e-6)
    ideal = undistort(points.points_px, LENS)
    np.testing.assert_allclose(ideal @ found.coefficients[:2] + found.coefficients[2], 0, atol=1e-6)


@pytest.mark.parametrize(
    "points",
    [
        LinePoints.empty(),
        LinePoints(np.full((30, 2), 100.0), np.ones(30), np.ones(30)),  # all the same
        LinePoints(np.random.default_rng(0).uniform(0, 700, (60, 2)), np.ones(60), np.ones(60)),  # no line
        LinePoints(np.column_stack([np.arange(30.0), np.arange(30.0)]), np.zeros(30), np.ones(30)),  # no confidence
        LinePoints(np.full((30, 2), np.nan), np.ones(30), np.ones(30)),
        LinePoints(np.column_stack([np.linspace(0, 3, 30), np.zeros(30)]), np.ones(30), np.ones(30)),  # 3 px long
    ],
    ids=["empty", "coincident", "scattered", "no confidence", "nan", "short"],
)
def test_no_line_is_none(points):
    assert fit_pixel_line(points, CAMERA, np.random.default_rng(0)) is None


@settings(max_examples=40, deadline=None)
@given(st.floats(-1.4, 1.4), st.floats(-300, 300), st.integers(0, 2**31))
def test_lines_of_any_direction_are_found(angle, offset, seed):
    normal = np.array([np.sin(angle), np.cos(angle)])
    along = np.array([normal[1], -normal[0]])
    pixels = offset * normal + np.linspace(-200, 200, 25)[:, None] * along
    found = fit_pixel_line(LinePoints(pixels, np.ones(25), np.ones(25)), CAMERA, np.random.default_rng(seed))
    line = found.coefficients * np.sign(found.coefficients[:2] @ normal)
    np.testing.assert_allclose(line, [*normal, -offset], atol=1e-7)
    assert found.inliers.all() and found.sigma_px < 1e-7
    np.testing.assert_allclose(found.ends_px @ line[:2] + line[2], 0, atol=1e-7)
    assert found.ends_px[0, 1] >= found.ends_px[1, 1]


@pytest.mark.parametrize(
    ("points", "named"), [(np.zeros((1, 2)), "points.* 1"), (np.ones((3, 2)), r"^3.*\[1\.0, 1\.0\]")]
)
def test_least_squares_line_refuses_too_few_and_coincident_points(points, named):
    with pytest.raises(ValueError, match=named):
        least_squares_line(points)
