import numpy as np
import pytest
from scipy.stats import binom

from deckline.report.bands import RANGE_M, by_band
from deckline_lab.statistics import (
    consistency,
    difference_of_trainings,
    median_and_p95,
    paired_difference,
    share_interval,
    share_interval_of_runs,
)


def test_the_interval_of_normal_differences_is_that_of_the_mean():
    values = np.random.default_rng(1).normal(0.3, 2.0, 400)
    found = paired_difference(values, np.random.default_rng(2))
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert found.value == pytest.approx(values.mean())
    assert found.low == pytest.approx(values.mean() - half, abs=0.15 * half)
    assert found.high == pytest.approx(values.mean() + half, abs=0.15 * half)
    assert found.images == 400


def test_equal_differences_are_known_exactly():
    found = paired_difference([-0.5] * 8, np.random.default_rng(0))
    assert (found.value, found.low, found.high) == (-0.5, -0.5, -0.5)
    assert found.text("+.1f") == "-0.5 [-0.5, -0.5]"


def test_a_median_is_not_moved_by_one_wild_image():
    calm = [0.1, 0.2, 0.3, 0.2, 0.1, 0.3, 0.2, 0.2, 0.1, 0.3, 0.2]
    found = paired_difference([*calm, 500.0], np.random.default_rng(0), "median")
    assert found.value == pytest.approx(0.2)
    assert 0 < found.low < found.high < 1.0
    assert paired_difference([*calm, 500.0], np.random.default_rng(0)).value > 40.0


def test_one_image_has_no_interval_and_none_is_refused():
    found = paired_difference([1.5], np.random.default_rng(0))
    assert found.value == 1.5 and np.isnan(found.low) and np.isnan(found.high)
    assert found.text("+.0f", 100) == "+150"
    with pytest.raises(ValueError, match=r"\(0,\)"):
        paired_difference([], np.random.default_rng(0))


def test_bands_hold_every_item_that_has_the_value_once():
    values = [50.0, 150.0, 900.0, np.inf, np.nan, -1.0]
    found = by_band(values, lambda value: value, RANGE_M)
    assert found == {"0 to 100 m": [50.0], "100 to 200 m": [150.0], "800 m and more": [900.0, np.inf]}
    assert list(by_band(values, lambda value: value, RANGE_M, short=True)) == ["0-100 m", "100-200 m", "800+ m"]
    assert by_band([20.0], lambda value: value, (0.0, 10.0, 30.0), "%") == {"10 to 30 %": [20.0]}


def test_median_and_95_percent():
    assert median_and_p95(np.arange(101.0), "px") == {"px.median": 50.0, "px.p95": 95.0}
    assert median_and_p95([], "px") == {}


def test_intervals_of_shares_hold_what_they_promise():
    """The ends are where so many hits, or so few, have 2.5 %."""
    low, high = share_interval(3, 100)
    assert binom.sf(2, 100, low) == pytest.approx(0.025, rel=1e-3)
    assert binom.cdf(3, 100, high) == pytest.approx(0.025, rel=1e-3)
    assert share_interval(0, 300) == pytest.approx((0.0, 1 - 0.025 ** (1 / 300)))
    assert np.all(np.diff([share_interval(k, 10)[0] for k in range(11)]) > 0)
    for hits, trials in ((1, 0), (3, 2), (-1, 2)):
        with pytest.raises(ValueError, match=f"{hits} of {trials}"):
            share_interval(hits, trials)


def test_a_share_of_runs_that_agree_within_is_as_well_known_as_that_of_the_runs():
    low, high = share_interval_of_runs([45] * 20 + [0] * 10, [45] * 30, np.random.default_rng(0))
    half = 1.96 * np.sqrt(20 / 30 * 10 / 30 / 30)
    assert (low, high) == pytest.approx((20 / 30 - half, 20 / 30 + half), abs=0.1 * half)


def test_a_share_of_runs_is_never_better_known_than_that_of_independent_trials():
    assert share_interval_of_runs([9] * 30, [45] * 30, np.random.default_rng(0)) == share_interval(270, 1350)
    _, high = share_interval_of_runs([1] + [0] * 89, [45] * 90, np.random.default_rng(0))
    assert high == share_interval(1, 4050)[1]  # the bootstrap alone: 0.0007


@pytest.mark.parametrize("share", [0, 1])
def test_where_all_trials_agree_the_runs_count(share):
    hits, trials = [45 * share] * 90 + [0], [45] * 90 + [0]  # the last run has no trial
    assert share_interval_of_runs(hits, trials, np.random.default_rng(0)) == share_interval(90 * share, 90)


def test_a_share_of_no_trial_is_refused():
    with pytest.raises(ValueError, match="0 of 0"):
        share_interval_of_runs([0, 0], [0, 0], np.random.default_rng(0))


def test_consistent_covariances_give_three_and_ninety_five_percent():
    rng = np.random.default_rng(0)
    found = consistency(rng.chisquare(3, (20, 200)).tolist(), 3, rng)
    assert found.low < 3.0 < found.high
    assert found.high - found.low < 0.4
    assert found.inside == pytest.approx(0.95, abs=0.012)
    too_small = consistency([[12.0]] * 3, 3, rng)
    assert (too_small.mean, too_small.low, too_small.inside) == (12.0, 12.0, 0.0)
    assert consistency([], 3, rng).frames == 0


def test_frames_of_one_run_do_not_narrow_the_interval():
    shared = np.random.default_rng(1).chisquare(3, 10)
    few, many = (consistency([[float(v)] * count for v in shared], 3, np.random.default_rng(2)) for count in (1, 50))
    assert many.high - many.low == pytest.approx(few.high - few.low, rel=1e-9)
    assert np.isnan(consistency([[1.0] * 9], 3, np.random.default_rng(0)).low)


def test_the_interval_of_trainings_holds_the_spread_of_images_and_trainings():
    # The images are the same for both methods, so the trainings alone differ: var = 2 sigma_training^2 / T.
    rng = np.random.default_rng(3)
    covered, widths = 0, []
    for _ in range(200):
        images = rng.normal(30, 5, 40)
        ours, theirs = (images + rng.normal(0, 0.5, (6, 1)) for _ in range(2))
        difference = difference_of_trainings(ours, theirs, rng)
        assert difference.value == pytest.approx(ours.mean() - theirs.mean())
        covered += difference.low <= 0 <= difference.high
        widths.append(difference.high - difference.low)
    assert 0.88 <= covered / 200 <= 0.98
    assert np.mean(widths) == pytest.approx(2 * 1.96 * np.sqrt(2 * 0.5**2 / 6), rel=0.12)


def test_a_single_training_has_the_interval_of_its_images():
    rng = np.random.default_rng(4)
    theirs = rng.normal(30, 5, 60)
    ours = theirs + rng.normal(0.4, 0.3, 60)
    alone = difference_of_trainings(ours[None], theirs[None], np.random.default_rng(0))
    paired = paired_difference(ours - theirs, np.random.default_rng(0))
    assert [alone.value, alone.low, alone.high] == pytest.approx([paired.value, paired.low, paired.high], abs=0.01)
    with pytest.raises(ValueError, match=r"\(1, 60\).*\(1, 59\)"):
        difference_of_trainings(ours[None], theirs[None, 1:], rng)
