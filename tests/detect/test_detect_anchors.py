"""Anchors, line maps and boxes: encoding and decoding by hand and as inverses of each other."""

import numpy as np
import pytest
from anchor_logits import GRID, logits_of
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.detect.anchors import DecodeConfig, RowGrid, decode, decode_places, decode_region, rows_from_map
from deckline_lab.train.line_targets import encode, encode_region

SMALL = RowGrid(width=8, height=4, cells=4, rows=2)
REGIONS = (32, 18)


def test_grid_cells_and_rows_are_centred_on_four_pixel_bands():
    assert GRID.row_y[0] == 1.5
    assert GRID.row_y[-1] == 285.5
    assert GRID.x_from_cell(0) == 1.5
    assert GRID.cell_from_x(509.5) == 127.0
    assert GRID.transposed == RowGrid(width=288, height=512, cells=72, rows=128)
    assert GRID.transposed.transposed == GRID


def test_encode_leaves_out_what_is_outside_or_not_seen():
    cell = encode([[-50.0, 0.0], [50.0, 100.0]], [True, True], GRID)
    assert np.isnan(cell[GRID.row_y < 49]).all()
    assert np.isfinite(cell[(GRID.row_y > 50) & (GRID.row_y < 100)]).all()
    half = encode([[10.0, 0.0], [10.0, 100.0], [10.0, 200.0]], [False, True, True], GRID)
    assert np.isnan(half[GRID.row_y < 100]).all()
    assert np.isfinite(half[(GRID.row_y > 100) & (GRID.row_y < 200)]).all()
    assert np.isnan(encode(np.zeros((0, 2)), np.zeros(0), GRID)).all()


@settings(deadline=None)
@given(x0=st.floats(2, 509), x1=st.floats(2, 509), y0=st.floats(5, 100), y1=st.floats(150, 280))
def test_encode_is_the_line_at_every_row_and_decode_inverts_it_to_a_hundredth_of_a_pixel(x0, x1, y0, y1):
    points = np.array([[x0, y0], [x1, y1]])
    cell = encode(points, [True, True], GRID)
    np.testing.assert_array_equal(encode(points[::-1], [True, True], GRID), cell)  # in any order
    rows = decode(logits_of(cell), GRID)
    line = (GRID.row_y >= y0) & (GRID.row_y <= y1)
    np.testing.assert_array_equal([np.isfinite(cell), np.isfinite(rows.x_px)], [line, line])
    expected = x0 + (GRID.row_y[line] - y0) * (x1 - x0) / (y1 - y0)
    np.testing.assert_allclose(GRID.x_from_cell(cell[line]), expected, atol=1e-4)
    np.testing.assert_allclose(rows.x_px[line], expected, atol=0.01)
    assert (rows.confidence[line] > 0.999).all()
    assert (rows.confidence[~line] < 0.001).all()
    floor = DecodeConfig().sigma_floor_cells * GRID.cell_px
    np.testing.assert_allclose(rows.sigma_px[line], floor, rtol=0.01)


def row_logits(shares_by_cell):
    """Logits of rows that all have these shares on some cells; cell -1 is "no line"."""
    shares = np.full((GRID.rows, GRID.cells + 1), 1e-9)
    for cell, share in shares_by_cell.items():
        shares[:, cell] = share
    return np.log(shares)


def test_decode_is_not_dragged_by_a_far_tail():
    rows = decode(row_logits({10: 0.45, 11: 0.45, 110: 0.1}), GRID)
    np.testing.assert_allclose(rows.x_px, GRID.x_from_cell(10.5), atol=1e-3)
    np.testing.assert_allclose(rows.confidence, 0.9, atol=1e-3)  # the tail is another place


def test_a_row_between_two_cells_has_a_line_by_its_share_or_by_its_best_class():
    logits = row_logits({40: 0.3, 41: 0.3, -1: 0.4})
    assert np.isnan(decode(logits, GRID).x_px).all()  # the best class is "no line"
    by_share = decode(logits, GRID, DecodeConfig(min_line_share=0.5))
    np.testing.assert_allclose(by_share.x_px, GRID.x_from_cell(40.5), atol=1e-6)
    np.testing.assert_allclose(by_share.confidence, 0.6, atol=1e-6)
    assert np.isnan(decode(logits, GRID, DecodeConfig(min_line_share=0.7)).x_px).all()


def test_the_width_of_a_taught_stripe_is_no_uncertainty():
    # Three cells, alike: variance 2/3; a stripe of 2 sqrt(2) cells has as much.
    logits = row_logits(dict.fromkeys((39, 40, 41), 1 / 3))
    narrow = decode(logits, GRID, DecodeConfig(stripe_cells=2 * 2**0.5))
    np.testing.assert_allclose(narrow.sigma_px, DecodeConfig().sigma_floor_cells * GRID.cell_px, rtol=1e-3)
    np.testing.assert_allclose(decode(logits, GRID).sigma_px, (2 / 3 + 0.12**2) ** 0.5 * GRID.cell_px, rtol=1e-3)


def test_shares_are_the_cells_means() -> None:
    """By hand: probability 0.9 on one pixel of a 2x2 cell, 0.6 on all four of another, line sure to be there."""
    p = np.full((4, 8), 1e-12)
    p[0, 0] = 0.9
    p[0:2, 4:6] = 0.6
    logits = np.log(np.stack([1 - p, p])).astype(np.float32)
    shares = np.exp(rows_from_map(logits, np.array([50.0], np.float32), SMALL))[0]
    np.testing.assert_allclose(shares[0], np.array([0.225, 0, 0.6, 0, 0]) / 0.825, atol=1e-6)
    np.testing.assert_allclose(shares[1], [0, 0, 0, 0, 1], atol=1e-6)


def test_a_line_is_on_the_rows_where_it_exceeds_the_published_thresholds() -> None:
    p = np.full((2, 4, 8), 0.01)
    p[:, 0:2], p[:, 2:4] = 0.32, 0.28  # the first row of anchors and the second
    logits = np.log(np.concatenate([1 - p.sum(axis=0, keepdims=True), p])).astype(np.float32)
    shares = np.exp(rows_from_map(logits, np.array([0.1, -0.1], np.float32), SMALL))
    np.testing.assert_allclose(shares[:, :, -1], [[0, 1], [1, 1]], atol=1e-6)


@settings(deadline=None)
@given(st.floats(0, 505), st.floats(0, 280), st.floats(3, 500), st.floats(1, 280))
def test_decode_inverts_encode(x0, y0, width, height):
    box = np.array([x0, y0, min(x0 + width, 511), min(y0 + height, 287)])
    classes, offsets, weight = encode_region(box, REGIONS)
    assert classes.sum() == pytest.approx(1.0, abs=1e-5)
    assert weight.sum() == pytest.approx(1.0, abs=1e-5)
    region = decode_region(np.log(classes + 1e-12), offsets)
    np.testing.assert_allclose(region.box, box, atol=0.02)
    assert region.probability > 0.95


def test_no_runway_is_the_last_class_and_no_division_by_zero():
    classes, offsets, weight = encode_region(None, REGIONS)
    assert classes[-1] == 1.0 and classes[:-1].sum() == 0.0 and weight.sum() == 0.0
    assert decode_region(np.log(classes + 1e-12), offsets).probability < 1e-6
    certain = decode_region(2000.0 * (classes - 1), offsets)
    assert certain.probability == 0.0
    assert np.isfinite(certain.box).all()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: decode(np.zeros((72, 128)), GRID), r"\(72, 129\).*\(72, 128\)"),
        (lambda: encode(np.zeros((3, 2)), np.zeros(2), GRID), r"\(3, 2\) and \(2,\)"),
        (lambda: RowGrid(cells=600), "cells.*600"),
        (lambda: rows_from_map(np.zeros((3, 5, 8)), np.zeros(2), SMALL), r"\(3, 5, 8\)"),
        (lambda: rows_from_map(np.zeros((3, 4, 9)), np.zeros(2), SMALL), r"\(3, 4, 9\)"),
        (lambda: rows_from_map(np.zeros((3, 4, 8)), np.zeros(3), SMALL), r"\(3,\)"),
        (lambda: encode_region([3, 3, 3, 5], REGIONS), r"box .*\(3\.0, 3\.0, 3\.0, 5\.0\)"),
        (lambda: decode_region(np.zeros(576), np.zeros((4, 18, 32))), r"\(577,\).*\(576,\)"),
    ],
)
def test_wrong_shapes_are_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_places_are_apart_and_the_likeliest_comes_first():
    boxes = ([40.0, 40.0, 80.0, 60.0], [300.0, 200.0, 420.0, 260.0])
    (one, at_one, _), (other, at_other, _) = (encode_region(box, REGIONS) for box in boxes)
    logits = np.log(0.3 * one + 0.6 * other + 0.1 * encode_region(None, REGIONS)[0] + 1e-12)
    offsets = np.where(np.arange(REGIONS[0]) < 12, at_one, at_other)
    likely, less = decode_places(logits, offsets, 2)
    np.testing.assert_allclose([likely.box, less.box], boxes[::-1], atol=0.01)
    np.testing.assert_allclose([likely.probability, less.probability], [0.6, 0.3], atol=0.03)
    assert len(decode_places(logits[-10:], offsets[:, :3, :3], 5)) == 1
