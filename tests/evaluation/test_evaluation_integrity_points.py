import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.evaluation.integrity_points import PointNoise, correlated, seen_points, sparse_depth
from deckline.geometry import BODY_FROM_OPTICAL, Camera
from deckline.types import LinePoints, Segment

CAMERA = Camera.from_fov(640, 360, np.pi / 2)
POSE = RigidTransform.from_components([-100.0, 0.0, -20.0], Rotation.from_euler("y", -0.2) * BODY_FROM_OPTICAL)
TILTED = Segment(np.array([0.0, -8.0, 0.0]), np.array([200.0, -8.0, 6.0]))
OTHER = Segment(np.array([0.0, 8.0, 0.0]), np.array([200.0, 8.0, 6.0]))
EXACT = PointNoise(sigma_px=0.0, outlier_share=0.0, missed_share=0.0)


def test_correlated_noise_has_unit_variance_everywhere():
    rng = np.random.default_rng(0)
    draws = np.array([correlated(10, 0.8, rng) for _ in range(4000)])
    np.testing.assert_allclose(draws.var(axis=0), 1.0, atol=0.1)
    assert np.mean(draws[:, 3] * draws[:, 5]) == pytest.approx(0.64, abs=0.06)


def test_points_end_where_the_line_or_the_view_does():
    rng = np.random.default_rng(0)
    seen = seen_points(TILTED, POSE, CAMERA, np.inf, EXACT, rng).points_px
    ends = CAMERA.project(POSE.inv().apply(np.stack([TILTED.p0_m, TILTED.p1_m])))
    np.testing.assert_allclose(seen[[-1, 0]], ends, atol=1e-6)
    hazy = seen_points(TILTED, POSE, CAMERA, 150.0, EXACT, rng).points_px
    assert hazy[:, 1].min() > seen[:, 1].min() + 1
    assert len(seen_points(TILTED, POSE, CAMERA, 50.0, EXACT, rng)) == 0


def test_depth_of_a_tilted_deck_is_the_deck_s():
    points = seen_points(TILTED, POSE, CAMERA, np.inf, EXACT, np.random.default_rng(0))
    seen = LinePoints(np.rint(points.points_px), points.confidence, points.sigma_px)
    depth = sparse_depth(CAMERA, POSE, (TILTED, OTHER), [seen, LinePoints.empty()], 0.0, np.random.default_rng(0))
    at = seen.points_px.astype(int)
    back = POSE.apply(depth[at[:, 1], at[:, 0], None] * CAMERA.rays(at))
    near = np.isfinite(back[:, 0])
    assert near.sum() > 10
    np.testing.assert_allclose(back[near, 2], 0.03 * back[near, 0], atol=1e-3)
    assert np.isfinite(depth).mean() < 0.01
