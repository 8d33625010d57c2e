import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays
from recording_bytes import pfm

from deckline.recording.images import read_pfm, write_pfm


@pytest.mark.parametrize("order", ["<", ">"])
def test_first_row_is_the_top_one_as_airsim_writes_it(order):
    depth = read_pfm(pfm([[1.0, 2.0], [3.0, 4.0], [5.0, 6.5]], order))
    assert depth.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.5]]
    assert depth.dtype == np.float32


def test_bottom_to_top_agrees_with_opencv():
    data = pfm([[1.5, 2.0], [3.0, 4.25], [-5.0, 6.0]])
    opencv = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read_pfm(data, "bottom-to-top"), opencv)


def test_written_bytes_are_airsims():
    assert write_pfm(np.array([[1.0, 2.0], [3.0, 4.0]], np.float32)) == pfm([[1.0, 2.0], [3.0, 4.0]])


@given(arrays(np.float32, array_shapes(min_dims=2, max_dims=2, max_side=6)))
def test_round_trip(values):
    np.testing.assert_array_equal(read_pfm(write_pfm(values)), values)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"PF\n1 1\n-1\n" + bytes(12), "PF"),
        (b"P6\n1 1\n255\nabc", "PFM"),
        (b"Pf\n1 1\n-2\n" + bytes(4), "scale.*-2"),
        (b"Pf\n1 1\n--\n" + bytes(4), "scale.*'--'"),
        (b"Pf\n2 2\n-1\n" + bytes(15), "2x2.* 15 of 16"),
        (b"Pf\n999999999 999999999\n-1\n" + bytes(15), "15 of 39999"),
        (b"Pf\n0 2\n-1\n", "0x2"),
    ],
)
def test_bad_pfm_says_what_is_wrong(data, text):
    with pytest.raises(ValueError, match=text):
        read_pfm(data)
