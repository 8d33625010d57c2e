import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.detect.anchors import DecodeConfig, RowGrid, decode, encode

GRID = RowGrid()


def logits_of(cell: np.ndarray) -> np.ndarray:
    """Logits whose softmax is the two-cell target of every row."""
    shares = np.full((GRID.rows, GRID.cells + 1), 1e-9)
    for row, position in enumerate(cell):
        if np.isnan(position):
            shares[row, -1] = 1.0
        else:
            low = min(int(np.floor(np.clip(position, 0, GRID.cells - 1))), GRID.cells - 2)
            shares[row, low] += 1 - (position - low)
            shares[row, low + 1] += position - low
    return np.log(shares).astype(np.float32)


def test_grid_cells_and_rows_are_centred_on_four_pixel_bands():
    assert GRID.row_y[0] == 1.5
    assert GRID.row_y[-1] == 285.5
    assert GRID.x_from_cell(0) == 1.5
    assert GRID.cell_from_x(509.5) == 127.0


def test_encode_is_the_line_at_every_row_anchor():
    points = np.array([[100.0, 20.0], [300.0, 220.0]])
    cell = encode(points, [True, True], GRID)
    inside = (GRID.row_y >= 20) & (GRID.row_y <= 220)
    np.testing.assert_array_equal(np.isfinite(cell), inside)
    np.testing.assert_allclose(GRID.x_from_cell(cell[inside]), GRID.row_y[inside] + 80, atol=1e-4)


def test_encode_does_not_mind_the_order_of_points():
    points = np.array([[100.0, 20.0], [180.0, 100.0], [300.0, 220.0]])
    np.testing.assert_array_equal(encode(points, np.ones(3), GRID), encode(points[::-1], np.ones(3), GRID))


def test_encode_leaves_out_what_is_outside_or_not_seen():
    cell = encode([[-50.0, 0.0], [50.0, 100.0]], [True, True], GRID)
    assert np.isnan(cell[GRID.row_y < 49]).all()
    assert np.isfinite(cell[(GRID.row_y > 50) & (GRID.row_y < 100)]).all()
    half = encode([[10.0, 0.0], [10.0, 100.0], [10.0, 200.0]], [False, True, True], GRID)
    assert np.isnan(half[GRID.row_y < 100]).all()
    assert np.isfinite(half[(GRID.row_y > 100) & (GRID.row_y < 200)]).all()
    assert np.isnan(encode(np.zeros((0, 2)), np.zeros(0), GRID)).all()


@settings(deadline=None)
@given(x0=st.floats(20, 490), x1=st.floats(20, 490), y0=st.floats(5, 100), y1=st.floats(150, 280))
def test_decode_inverts_encode_to_a_hundredth_of_a_pixel(x0, x1, y0, y1):
    cell = encode([[x0, y0], [x1, y1]], [True, True], GRID)
    rows = decode(logits_of(cell), GRID)
    line = np.isfinite(cell)
    np.testing.assert_array_equal(np.isfinite(rows.x_px), line)
    expected = x0 + (GRID.row_y[line] - y0) * (x1 - x0) / (y1 - y0)
    np.testing.assert_allclose(rows.x_px[line], expected, atol=0.01)
    assert (rows.confidence[line] > 0.999).all()
    assert (rows.confidence[~line] < 0.001).all()
    floor = DecodeConfig().sigma_floor_cells * GRID.cell_px
    np.testing.assert_allclose(rows.sigma_px[line], floor, rtol=0.01)


def test_decode_is_not_dragged_by_a_far_tail():
    shares = np.full((GRID.rows, GRID.cells + 1), 1e-9)
    shares[:, 10], shares[:, 11], shares[:, 110] = 0.45, 0.45, 0.1
    rows = decode(np.log(shares), GRID)
    np.testing.assert_allclose(rows.x_px, GRID.x_from_cell(10.5), atol=1e-3)
    np.testing.assert_allclose(rows.confidence, 0.9, atol=1e-3)  # the tail is another place


def test_sigma_grows_with_the_spread():
    cells = np.arange(GRID.cells + 1)
    sigmas = [
        decode(np.tile(-((cells - 60.0) ** 2) / (2 * width**2), (GRID.rows, 1)), GRID).sigma_px[0]
        for width in (0.4, 0.8, 1.2)
    ]
    assert sigmas[0] < sigmas[1] < sigmas[2]
    assert sigmas[1] == pytest.approx(0.8 * GRID.cell_px, rel=0.1)


def test_a_row_between_two_cells_has_a_line_by_its_share_or_by_its_best_class():
    shares = np.full((GRID.rows, GRID.cells + 1), 1e-9)
    shares[:, 40], shares[:, 41], shares[:, -1] = 0.3, 0.3, 0.4
    assert np.isnan(decode(np.log(shares), GRID).x_px).all()  # the best class is "no line"
    by_share = decode(np.log(shares), GRID, DecodeConfig(min_line_share=0.5))
    np.testing.assert_allclose(by_share.x_px, GRID.x_from_cell(40.5), atol=1e-6)
    np.testing.assert_allclose(by_share.confidence, 0.6, atol=1e-6)
    assert np.isnan(decode(np.log(shares), GRID, DecodeConfig(min_line_share=0.7)).x_px).all()


def test_the_width_of_a_taught_stripe_is_no_uncertainty():
    shares = np.full((GRID.rows, GRID.cells + 1), 1e-9)
    shares[:, 39:42] = 1 / 3  # three cells, alike: variance 2/3; a stripe of 2 sqrt(2) cells has as much
    narrow = decode(np.log(shares), GRID, DecodeConfig(stripe_cells=2 * 2**0.5))
    np.testing.assert_allclose(narrow.sigma_px, DecodeConfig().sigma_floor_cells * GRID.cell_px, rtol=1e-3)
    np.testing.assert_allclose(
        decode(np.log(shares), GRID).sigma_px, (2 / 3 + 0.12**2) ** 0.5 * GRID.cell_px, rtol=1e-3
    )


def test_columns_are_the_rows_of_the_turned_image():
    turned = GRID.transposed
    assert (turned.width, turned.height, turned.cells, turned.rows) == (288, 512, 72, 128)
    assert turned.transposed == GRID


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match=r"expected logits of shape \(72, 129\), got \(72, 128\)"):
        decode(np.zeros((72, 128)), GRID)
    with pytest.raises(ValueError, match=r"expected points \(N, 2\) and seen \(N,\), got \(3, 2\) and \(2,\)"):
        encode(np.zeros((3, 2)), np.zeros(2), GRID)
    with pytest.raises(ValueError, match="2 <= cells <= pixels, got 600 cells over 512 px"):
        RowGrid(cells=600)
