"""Table 5's figures: means, and what each row gains over the one above on the same images."""

import numpy as np
import pytest

from deckline.evaluation.ablation_measure import summarise_rows


def test_each_row_gains_over_the_one_above() -> None:
    first = {0: {"psnr_db": 20.0, "ssim": 0.8}, 1: {"psnr_db": 22.0, "ssim": 0.9}}
    second = {0: {"psnr_db": 21.0, "ssim": 0.8}, 1: {"psnr_db": 24.0, "ssim": 0.8}}
    third = {0: {"psnr_db": 20.5, "ssim": 0.8}, 1: {"psnr_db": 23.5, "ssim": 0.8}}
    summaries = summarise_rows({"a": first, "b": second, "c": third})
    assert list(summaries) == ["a", "b", "c"]
    assert summaries["a"].means == {"psnr_db": 21.0, "ssim": pytest.approx(0.85)}
    assert summaries["a"].gains == {}
    gain = summaries["b"].gains["psnr_db"]
    assert (gain.value, gain.low, gain.high, gain.images) == (1.5, 1.0, 2.0, 2)  # resampling two images gives 1, 1.5, 2
    assert summaries["c"].gains["psnr_db"].value == -0.5  # against b, not a
    assert summaries["c"].gains["psnr_db"].high < 0


def test_gains_count_the_images_of_both_rows_alone() -> None:
    rng = np.random.default_rng(0)
    above = {k: {"psnr_db": float(rng.uniform(15, 30))} for k in range(50)}
    row = {k: {"psnr_db": figures["psnr_db"] + 0.5} for k, figures in above.items() if k % 2} | {99: {"psnr_db": 60.0}}
    gain = summarise_rows({"above": above, "row": row})["row"].gains["psnr_db"]
    assert gain.images == 25
    assert gain.value == pytest.approx(0.5)
    assert (gain.low, gain.high) == (pytest.approx(0.5), pytest.approx(0.5))


def test_a_figure_that_does_not_exist_is_left_out() -> None:
    summaries = summarise_rows({"a": {0: {"psnr_db": 20.0}}, "b": {0: {"psnr_db": 21.0, "psnr_db_surface": 22.0}}})
    assert summaries["a"].means == {"psnr_db": 20.0}
    assert list(summaries["b"].gains) == ["psnr_db"]


def test_a_row_without_images_is_refused() -> None:
    with pytest.raises(ValueError, match="no image could be evaluated for b"):
        summarise_rows({"a": {0: {"psnr_db": 20.0}}, "b": {}})
