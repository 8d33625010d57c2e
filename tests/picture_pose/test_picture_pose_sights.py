"""Lines and horizon of one picture against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from runway_picture import CAMERA, CAMERA_MOUNT, SIGMA_PX, Place, belief_of, pixel_lines, see, sights_of

from deckline.dehaze.horizon import Horizon
from deckline.localize.observations import ROW_SIGMA_PX
from deckline.picture_pose.model import horizon_innovation
from deckline.picture_pose.sights import sight_horizon, sight_lines
from deckline.picture_pose.states import DIP_RAD
from deckline.types import SIDES, Detection, LinePoints, PixelLine

ROWS = np.linspace(400.0, 700.0, 31)


def upright(offsets_px: np.ndarray, sigma_px: float | np.ndarray = SIGMA_PX) -> Detection:
    """A left line along a column of the image, its points off by these distances; no right line."""
    points = np.column_stack([500.0 + offsets_px, ROWS])
    return Detection(LinePoints(points, np.ones(31), np.full(31, sigma_px)), LinePoints.empty())


def left_sight(detection: Detection, camera=CAMERA):
    return sight_lines(camera, detection, pixel_lines(detection))["left"]


def test_a_turned_line_counts_the_error_of_its_rows():
    for angle in np.deg2rad([0.0, 40.0, 70.0]):
        along = np.linspace(-150.0, 150.0, 31)
        points = np.array([600.0, 500.0]) + along[:, None] * [np.sin(angle), np.cos(angle)]
        line = Detection(LinePoints(points, np.ones(31), np.full(31, SIGMA_PX)), LinePoints.empty())
        sigma_px = np.hypot(SIGMA_PX * np.cos(angle), ROW_SIGMA_PX * np.sin(angle))
        np.testing.assert_allclose(left_sight(line).sigma * CAMERA.fx, sigma_px * np.sqrt(2 / 31), rtol=1e-6)


def test_both_points_lie_on_the_line_of_the_weighted_least_squares():
    rng = np.random.default_rng(1)
    sigma_px = rng.uniform(0.3, 3.0, 31)
    offsets = rng.normal(0, sigma_px)
    sight = left_sight(upright(offsets, sigma_px))
    slope, constant = np.polyfit(ROWS, 500.0 + offsets, 1, w=1 / sigma_px)
    u, v = (sight.rays[:, :2] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]).T
    np.testing.assert_allclose(u, slope * v + constant, atol=1e-3)


def test_the_stated_errors_are_those_of_many_pictures():
    rng, off = np.random.default_rng(2), []
    truth = left_sight(upright(np.zeros(31)))
    for _ in range(400):
        sight = left_sight(upright(rng.normal(0, SIGMA_PX, 31)))
        turn, height = np.diff(sight.rays[:, 0])[0] / np.diff(sight.rays[:, 1])[0], truth.rays[:, 1]
        at = sight.rays[0, 0] + turn * (height - sight.rays[0, 1])
        off.append((at - truth.rays[:, 0]) / truth.sigma)
    assert np.mean(np.square(off)) == pytest.approx(1.0, abs=0.12)
    assert np.corrcoef(np.array(off).T)[0, 1] == pytest.approx(0.0, abs=0.12)


@pytest.mark.parametrize(
    "offsets", [3.0 * (-1.0) ** np.arange(31), 2.0 * np.sin(np.linspace(0, 2 * np.pi, 31))], ids=["scatter", "bent"]
)
def test_points_that_scatter_or_bend_more_than_stated_count_less(offsets):
    assert left_sight(upright(offsets)).sigma.min() > 2 * left_sight(upright(np.zeros(31))).sigma.max()


def test_a_lens_is_undone():
    lens = replace(CAMERA, distortion=(-0.28, 0.08, 0.001, -0.0005, -0.01))
    plain, bent = sights_of(see()), sights_of(see(camera=lens), lens)
    for side in SIDES:
        normals = [np.cross(*sights[side].rays) for sights in (plain, bent)]
        one, other = (normal / np.linalg.norm(normal) for normal in normals)
        assert abs(one @ other) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("odd", [lambda px: px[:2], lambda px: 0 * px + px[0], lambda px: np.nan * px])
def test_a_line_without_a_direction_is_left_out(odd):
    """Of two points, of points at one place, and of points that are no numbers."""
    whole = see()
    points_px = odd(whole.left.points_px)
    left = LinePoints(points_px, np.ones(len(points_px)), np.ones(len(points_px)))
    line = PixelLine(np.array([1.0, 0.0, -1.0]), np.ones(len(left), bool), whole.left.points_px[[0, -1]], SIGMA_PX)
    lines = {"left": line, "right": pixel_lines(whole)["right"]}
    with np.errstate(invalid="ignore"):
        assert set(sight_lines(CAMERA, replace(whole, left=left), lines)) == {"right"}
    assert sight_lines(CAMERA, whole, {}) == {}


def test_a_horizon_keeps_its_angle_and_sigma_with_pixels_that_are_not_square():
    tall = replace(CAMERA, fy=2 * CAMERA.fy)
    sight = sight_horizon(tall, Horizon(CAMERA.width, tall.cy + 0.1 * tall.fy, 2.0, 0.02, 0.004))
    np.testing.assert_allclose(sight.middle, [0.0, 0.1, 1.0])
    assert (sight.slope, sight.slope_sigma) == pytest.approx((0.01, 0.002))
    assert sight.sigma == pytest.approx(2.0 / tall.fy)


def test_a_horizon_of_the_middle_row_is_that_of_a_level_camera():
    level = Place(roll=0.0, pitch=0.0, heading=0.0)
    sight = sight_horizon(CAMERA, Horizon(CAMERA.width, CAMERA.cy, 1.0, 0.0, 0.001))
    down = 0.05  # of the mount
    off = horizon_innovation(belief_of(level), sight, CAMERA_MOUNT).residuals[0]
    assert off == pytest.approx(-np.sin(down) + DIP_RAD)
