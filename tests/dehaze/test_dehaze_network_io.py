"""Images to tensors and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline.dehaze.network_io import (
    MIN_SIDE_PX,
    averaged_down,
    brought_up,
    image_to_tensor,
    padded,
    reduction_factor,
    tensor_to_image,
)


def test_every_level_survives_the_round_trip() -> None:
    image = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    tensor = image_to_tensor(image)
    assert tensor.shape == (1, 3, 16, 16)
    assert tensor.dtype == np.float32
    assert (tensor.min(), tensor.max()) == (0.0, 1.0)
    np.testing.assert_array_equal(tensor_to_image(tensor), image)


def test_values_outside_the_range_are_clipped() -> None:
    values = np.array([-np.inf, -0.4, 1.2, 300.0, np.inf, np.nan], dtype=np.float32)
    image = tensor_to_image(np.broadcast_to(values, (1, 3, 1, 6)))
    np.testing.assert_array_equal(image[0, :, 0], [0, 0, 255, 255, 255, 0])


@pytest.mark.parametrize(
    ("size", "factor"), [((720, 1280), 2), ((360, 640), 1), ((1080, 1920), 3), ((100, 100), 1), ((640, 480), 1)]
)
def test_reduction_factor(size: tuple[int, int], factor: int) -> None:
    assert reduction_factor(*size, working_long_side_px=640) == factor


def test_averaging_is_the_mean_of_blocks() -> None:
    tensor = np.arange(24, dtype=np.float32).reshape(1, 1, 4, 6)
    np.testing.assert_allclose(averaged_down(tensor, 2)[0, 0], [[3.5, 5.5, 7.5], [15.5, 17.5, 19.5]])


@given(st.integers(1, 150), st.integers(1, 150), st.integers(1, 12))
def test_padding_reaches_the_multiple_and_keeps_the_image(height: int, width: int, multiple: int) -> None:
    image = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    for least in (MIN_SIDE_PX, 70):
        out = padded(image, multiple, least)
        assert out.shape[0] % multiple == out.shape[1] % multiple == 0
        assert least <= out.shape[0] < max(height, least) + multiple
    np.testing.assert_array_equal(out[:height, :width], image)
    np.testing.assert_array_equal(out[-1, :width], out[height - 1, :width])


def test_errors() -> None:
    with pytest.raises(ValueError, match="5x4 px is no multiple of 2"):
        averaged_down(np.zeros((1, 3, 4, 5), dtype=np.float32), 2)
    with pytest.raises(ValueError, match="working_long_side_px must be at least 32, got 3"):
        reduction_factor(10, 10, 3)
    with pytest.raises(ValueError, match="must be uint8"):
        image_to_tensor(np.zeros((2, 2, 3)))


def test_a_linear_change_is_brought_up_exactly() -> None:
    """Where the result is a brightness times the picture plus an offset, full size shows it at every pixel."""
    blocks = np.random.default_rng(0).random((1, 3, 16, 24), dtype=np.float32)
    image = np.kron(blocks, np.ones((1, 1, 4, 4), np.float32))
    small = averaged_down(image, 4)
    # The ridge, 1e-4 on a variance of 1 / 12, takes 0.12 % off the slope.
    np.testing.assert_allclose(brought_up(image, small, 1.7 * small - 0.3, 4), 1.7 * image - 0.3, atol=0.003)
    assert brought_up(small, small, small, 1) is small
