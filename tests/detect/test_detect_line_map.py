"""From painted lines to row anchors. That what is taught is decoded is tested where the painting is, in tests/train."""

import numpy as np
import pytest

from deckline.detect.anchors import RowGrid, rows_from_map

GRID = RowGrid(width=8, height=4, cells=4, rows=2)


def test_shares_are_the_cells_means() -> None:
    """By hand: probability 0.9 on one pixel of a 2x2 cell, 0.6 on all four of another, line sure to be there."""
    p = np.full((4, 8), 1e-12)
    p[0, 0] = 0.9
    p[0:2, 4:6] = 0.6
    logits = np.log(np.stack([1 - p, p])).astype(np.float32)
    shares = np.exp(rows_from_map(logits, np.array([50.0], np.float32), GRID))[0]
    expected = 0.6 * np.array([0.225, 0, 0.6, 0]) / 0.825
    np.testing.assert_allclose(shares[0], [*expected, 0.4], atol=1e-6)
    np.testing.assert_allclose(shares[1], [0, 0, 0, 0, 1], atol=1e-6)


def test_a_line_that_is_not_there_is_on_no_row() -> None:
    logits = np.zeros((3, 4, 8), np.float32)
    shares = np.exp(rows_from_map(logits, np.array([0.0, -30.0], np.float32), GRID))
    np.testing.assert_allclose(shares[0, :, -1], 1 - 1 / 3 * 0.5, atol=1e-6)
    np.testing.assert_allclose(shares[1, :, -1], 1.0, atol=1e-6)


def test_shares_of_a_row_sum_to_one() -> None:
    rng = np.random.default_rng(0)
    rows = rows_from_map(rng.normal(0, 3, (3, 4, 8)).astype(np.float32), rng.normal(0, 3, 2).astype(np.float32), GRID)
    assert rows.shape == (2, 2, 5) and rows.dtype == np.float32
    np.testing.assert_allclose(np.exp(rows).sum(axis=2), 1.0, atol=1e-6)


@pytest.mark.parametrize(("shape", "lines"), [((3, 5, 8), 2), ((3, 4, 9), 2), ((3, 4, 8), 3)])
def test_shapes_that_do_not_agree_are_refused(shape: tuple[int, int, int], lines: int) -> None:
    with pytest.raises(ValueError, match=r"expected logits \(lines \+ 1, H, W\) whose sides 2 rows and 4 cells divide"):
        rows_from_map(np.zeros(shape, np.float32), np.zeros(lines, np.float32), GRID)
