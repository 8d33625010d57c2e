"""A linear map of a picture, found at one size and applied at another."""

import numpy as np
import pytest

from deckline.dehaze.pixel_map import PixelMap, display_levels, linear_levels, luma


def plane(value: float) -> np.ndarray:
    return np.full((4, 6), value, np.float32)


def test_a_larger_image_gets_the_same_map() -> None:
    same = PixelMap(plane(1), plane(1), np.zeros((3, 4, 6), np.float32))
    image = np.random.default_rng(2).integers(0, 256, (31, 47, 3), dtype=np.uint8)
    before = image.copy()
    np.testing.assert_array_equal(same(image), image)
    brighter = same.add(np.full((2, 3, 3), 300, np.float32))
    assert (brighter(image) == 255).all()
    np.testing.assert_array_equal(brighter.fade(1.0)(image), image)
    assert (same.add(np.full((2, 3, 3), -300, np.float32))(image) == 0).all()
    np.testing.assert_array_equal(image, before)


def test_grey_and_what_differs_from_it_have_gains_of_their_own() -> None:
    image = np.random.default_rng(3).integers(60, 120, (40, 60, 3), dtype=np.uint8)
    grey = luma(np.moveaxis(image, 2, 0))[..., None]
    shift = np.array([10.0, 0.0, -5.0])
    offset = np.broadcast_to(shift[:, None, None], (3, 4, 6)).astype(np.float32)
    parts = PixelMap(plane(1.6), plane(0.5), offset)
    expected = 1.6 * grey + 0.5 * (image - grey) + shift
    np.testing.assert_allclose(parts(image), expected, atol=1.1)  # the grey is rounded
    np.testing.assert_allclose(parts.fade(0.25)(image), 0.25 * image + 0.75 * expected, atol=1.1)


def test_two_maps_are_mixed_pixel_by_pixel() -> None:
    image = np.random.default_rng(5).integers(60, 120, (4, 6, 3), dtype=np.uint8)
    first = PixelMap(plane(1), plane(1), np.full((3, 4, 6), 20, np.float32), noise=2.0)
    second = PixelMap(plane(1.8), plane(0.6), np.full((3, 4, 6), -30, np.float32))
    share = np.random.default_rng(6).uniform(0, 1, (4, 6)).astype(np.float32)
    mixed = first.mix(second, share)
    assert mixed.noise == first.noise
    part = share[..., None]
    expected = (1 - part) * (image + 20.0) + part * second(image)
    np.testing.assert_allclose(PixelMap(mixed.gain, mixed.chroma, mixed.offset)(image), expected, atol=1.1)


def test_light_is_srgb() -> None:
    np.testing.assert_allclose(linear_levels(np.array([0, 10, 128, 255])), [0, 0.774, 55.045, 255], atol=1e-3)
    np.testing.assert_allclose(display_levels(linear_levels(np.arange(256))), np.arange(256), atol=1e-3)


def test_noise_is_not_amplified_and_edges_are() -> None:
    rng = np.random.default_rng(4)
    image = np.full((180, 240, 3), 100.0)
    image[:, 120:] = 140.0
    grains = rng.normal(0, 2.0, (180, 240, 1))
    noisy = np.rint(image + grains).astype(np.uint8)
    every = PixelMap(plane(4), plane(4), np.full((3, 4, 6), -360, np.float32))
    plain = np.s_[20:160, 20:100]
    assert every(noisy)[plain].std() == pytest.approx(4 * 2.0, rel=0.1)
    quiet = PixelMap(every.gain, every.chroma, every.offset, noise=2.0)(noisy).astype(float)
    assert quiet[plain].std() < 0.65 * 4 * 2.0
    step = quiet[20:160, 122:126].mean() - quiet[20:160, 114:118].mean()
    assert step == pytest.approx(4 * 40, rel=0.1)
    assert abs(quiet[plain].mean() - every(noisy)[plain].mean()) < 0.5
