"""Depth camera and navigation unit: stated errors, exact defaults."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.geometry import attitude
from deckline_sim.camera.measure import drift, find_edges, measure_depth, measure_pose
from deckline_sim.config import DepthConfig, NavigationConfig


def measured(depth, seed=0, **settings):
    return measure_depth(np.asarray(depth, np.float32), DepthConfig(**settings), np.random.default_rng(seed))


FLAT = np.full((200, 300), 50.0, np.float32)


def test_the_default_is_exact_up_to_its_range():
    depth = np.array([[1.0, 199.5, 200.0, 200.5, np.nan, 1e7]], np.float32)
    kept = depth.copy()
    np.testing.assert_array_equal(measured(depth), [[1.0, 199.5, 200.0, np.nan, np.nan, np.nan]])
    np.testing.assert_array_equal(depth, kept)
    assert measured(depth).dtype == np.float32


@pytest.mark.parametrize("distance_m", [20.0, 100.0])
def test_noise_grows_with_the_square(distance_m):
    got = measured(np.full((200, 300), distance_m), noise_m=0.02, noise_per_m=0.0005, range_m=np.inf)
    sigma = 0.02 + 0.0005 * distance_m**2
    assert got.mean() == pytest.approx(distance_m, abs=5 * sigma / np.sqrt(60000))
    assert got.std() == pytest.approx(sigma, rel=0.02)


def test_dropouts_have_their_share():
    assert np.isnan(measured(FLAT, dropout=0.1)).mean() == pytest.approx(0.1, abs=0.005)


def test_edges_drop_out_and_the_rest_does_not():
    depth = FLAT.copy()
    depth[:, 150:] = 80.0
    depth[:40] = np.nan
    lost = np.isnan(measured(depth, edge_dropout=0.5)) & ~np.isnan(depth)
    edge = find_edges(depth) & ~np.isnan(depth)
    assert edge.sum() == 2 * 160 + 298  # both sides of the step, and the row below the sky
    assert not np.any(lost & ~edge)
    assert lost.sum() == pytest.approx(edge.sum() / 2, abs=60)


def test_steps_are_multiples():
    got = measured(np.linspace(1.0, 90.0, 1000)[None], step_m=0.25)
    np.testing.assert_allclose(got / 0.25, np.rint(got / 0.25), atol=1e-4)
    np.testing.assert_allclose(got, np.linspace(1.0, 90.0, 1000)[None], atol=0.1251)


def test_half_precision_rounds_and_overflows_to_nothing():
    got = measured([[100.03, 2000.7, 65504.0, 1e6]], half_precision=True, range_m=np.inf)
    np.testing.assert_array_equal(got, [[np.float32(np.float16(100.03)), 2001.0, np.nan, np.nan]])


TRUE = RigidTransform.from_components([100.0, -20.0, -30.0], attitude(0.1, -0.05, 2.0))


def errors(config, times, seed=0):
    """Position (N, 3), m, and attitude (N, 3), degrees about the body's axes."""
    poses = [measure_pose(TRUE, time, config, seed) for time in times]
    position = np.array([pose.translation - TRUE.translation for pose in poses])
    turns = [(TRUE.rotation.inv() * pose.rotation).as_rotvec() for pose in poses]
    return position, np.rad2deg(turns)


def test_the_default_is_exact():
    assert measure_pose(TRUE, 3.0, NavigationConfig(), 0) is TRUE


def test_white_noise_has_its_sigma():
    config = NavigationConfig(position_sigma_m=0.2, attitude_sigma_deg=0.05)
    position, turn = errors(config, np.arange(1500) * 0.02)
    np.testing.assert_allclose(position.std(axis=0), 0.2, rtol=0.06)
    np.testing.assert_allclose(turn.std(axis=0), 0.05, rtol=0.06)
    assert abs(np.corrcoef(position[1:, 0], position[:-1, 0])[0, 1]) < 0.08


@pytest.mark.parametrize("time_s", [0.0, 40.0])
def test_bias_has_its_sigma_at_every_time(time_s):
    config = NavigationConfig(position_bias_m=1.5, attitude_bias_deg=0.1, drift_s=30.0)
    both = [errors(config, [time_s], seed) for seed in range(600)]
    np.testing.assert_allclose(np.std([position[0] for position, _ in both], axis=0), 1.5, rtol=0.1)
    np.testing.assert_allclose(np.std([turn[0] for _, turn in both], axis=0), 0.1, rtol=0.1)


@pytest.mark.parametrize("apart_s", [6.0, 20.0, 60.0])
def test_bias_forgets_with_its_time_constant(apart_s):
    pairs = np.array([[drift(t, 20.0, [seed, 0]) for t in (50.0, 50.0 + apart_s)] for seed in range(1500)])
    correlation = np.mean(pairs[:, 0] * pairs[:, 1]) / np.mean(pairs**2)
    assert correlation == pytest.approx(np.exp(-apart_s / 20.0), abs=0.05)


def test_bias_moves_smoothly():
    values = np.array([drift(t, 60.0, [7, 0]) for t in np.arange(0.0, 60.0, 0.1)])
    assert np.abs(np.diff(values, axis=0)).max() < 0.1
    assert np.ptp(values, axis=0).max() > 0.3


def test_the_error_follows_from_time_and_seed_alone():
    config = NavigationConfig(position_sigma_m=0.1, position_bias_m=1.0, attitude_bias_deg=0.1)
    first, again = (measure_pose(TRUE, 12.3, config, 5) for _ in range(2))
    np.testing.assert_array_equal(first.as_matrix(), again.as_matrix())
    moved = measure_pose(RigidTransform.from_translation([5.0, 0.0, 0.0]), 12.3, config, 5)
    np.testing.assert_allclose(moved.translation - [5.0, 0.0, 0.0], first.translation - TRUE.translation)
    assert np.any(measure_pose(TRUE, 12.3, config, 6).translation != first.translation)


def test_time_must_not_be_negative():
    with pytest.raises(ValueError, match=r"time .*-1\.0"):
        drift(-1.0, 60.0, [0])
