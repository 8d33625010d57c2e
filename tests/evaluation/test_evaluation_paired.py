import numpy as np
import pytest

from deckline.evaluation.paired import paired_difference


def test_the_interval_of_normal_differences_is_that_of_the_mean():
    values = np.random.default_rng(1).normal(0.3, 2.0, 400)
    found = paired_difference(values, np.random.default_rng(2))
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert found.value == pytest.approx(values.mean())
    assert found.low == pytest.approx(values.mean() - half, abs=0.15 * half)
    assert found.high == pytest.approx(values.mean() + half, abs=0.15 * half)
    assert found.images == 400


def test_the_interval_holds_the_truth_about_19_times_in_20():
    rng = np.random.default_rng(3)
    inside = 0
    for _ in range(100):
        found = paired_difference(rng.normal(1.0, 1.0, 60), rng)
        inside += found.low <= 1.0 <= found.high
    assert 88 <= inside <= 99  # of 100: 95 +- 3 sigma, a little fewer as percentiles are narrow for 60 images


def test_equal_differences_are_known_exactly():
    found = paired_difference([-0.5] * 8, np.random.default_rng(0))
    assert (found.value, found.low, found.high) == (-0.5, -0.5, -0.5)
    assert found.below and not found.above


def test_a_median_is_not_moved_by_one_wild_image():
    calm = [0.1, 0.2, 0.3, 0.2, 0.1, 0.3, 0.2, 0.2, 0.1, 0.3, 0.2]
    found = paired_difference([*calm, 500.0], np.random.default_rng(0), "median")
    assert found.value == pytest.approx(0.2)
    assert found.above and found.high < 1.0
    assert paired_difference([*calm, 500.0], np.random.default_rng(0)).value > 40.0


def test_the_same_seed_gives_the_same_interval():
    values = np.arange(9.0)
    first, second = (paired_difference(values, np.random.default_rng(5)) for _ in range(2))
    assert first == second


def test_one_image_has_no_interval_and_none_is_refused():
    found = paired_difference([1.5], np.random.default_rng(0))
    assert found.value == 1.5 and np.isnan(found.low) and np.isnan(found.high)
    assert not found.above and not found.below
    with pytest.raises(ValueError, match="at least one image"):
        paired_difference([], np.random.default_rng(0))
