import numpy as np
import pytest

from deckline.sim.camera.depth_camera import DepthConfig, at_edges, measure_depth


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
    edge = at_edges(depth) & ~np.isnan(depth)
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


def test_the_same_generator_gives_the_same_depth():
    settings = {"noise_per_m": 1e-3, "dropout": 0.2, "edge_dropout": 0.3}
    np.testing.assert_array_equal(measured(FLAT, 4, **settings), measured(FLAT, 4, **settings))
    assert np.any(measured(FLAT, 4, **settings) != measured(FLAT, 5, **settings))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"range_m": 0.0}, "range_m must be positive, got 0.0"),
        ({"noise_m": -1.0}, "noise_m must not be negative, got -1.0"),
        ({"dropout": 1.5}, "dropout must lie between 0 and 1, got 1.5"),
    ],
)
def test_wrong_settings_are_named(settings, message):
    with pytest.raises(ValueError, match=message):
        DepthConfig(**settings)
