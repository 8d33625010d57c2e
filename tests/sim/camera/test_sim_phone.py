"""Effects of phones and video: what each does, and that nothing moves."""

import cv2
import numpy as np
import pytest

from deckline_sim.camera import phone

EFFECTS = [effect for effect, _ in phone.EFFECTS]


def texture(height=96, width=128):
    """Smooth coloured blobs, uint8."""
    noise = np.random.default_rng(0).normal(110, 400, (height, width, 3))
    return np.clip(cv2.GaussianBlur(noise, (0, 0), 3), 0, 255).astype(np.uint8)


def find_shift(image, shown):
    """Columns and rows by which a picture moved: a fit of its brightness by the image's, its slopes and a constant."""
    grey, brightness = (one.mean(axis=2) for one in (image, shown))
    down, across = np.gradient(grey)
    terms = np.column_stack([part.ravel() for part in (across, down, grey, np.ones_like(grey))])
    fit = np.linalg.lstsq(terms, brightness.ravel())[0]
    return -fit[:2] / fit[2]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.__name__)
def test_effects_keep_size_input_and_place(effect):
    for image in (texture(), texture(61, 35), texture(1, 2)):
        kept = image.copy()
        one, same = (effect(image, np.random.default_rng(5)) for _ in range(2))
        assert one.shape == image.shape and one.dtype == np.uint8
        np.testing.assert_array_equal(image, kept)
        np.testing.assert_array_equal(one, same)
    image = texture()
    for seed in range(6):
        shown = effect(image, np.random.default_rng(seed))
        assert (shown != image).any()
        assert np.abs(find_shift(image, shown)).max() < (0.55 if effect is phone._comb else 0.15)


def test_phone_picture_is_a_picture_that_the_seed_decides():
    image = texture().astype(np.float32)
    shown = [phone.phone_picture(image, np.random.default_rng(seed)) for seed in range(12)]
    assert all(one.shape == image.shape and one.dtype == np.float32 for one in shown)
    assert all(one.min() >= 0 and one.max() <= 255 for one in shown)
    np.testing.assert_array_equal(phone.phone_picture(image, np.random.default_rng(4)), shown[4])
    assert len({one.tobytes() for one in shown}) >= 10
    np.testing.assert_array_equal(image, texture())


def test_sharpening_overshoots_and_coarse_colour_keeps_brightness():
    image = np.full((40, 60, 3), (80, 90, 120), np.uint8)
    image[:, 30:] = (160, 150, 130)
    sharp = phone._sharpen(image, np.random.default_rng(0))
    assert sharp.max() > image.max() + 3 and sharp.min() < image.min() - 3
    coarse = phone._bleed_colour(image, np.random.default_rng(0))
    brightness = [cv2.cvtColor(one, cv2.COLOR_RGB2GRAY).astype(int) for one in (image, coarse)]
    assert np.abs(brightness[1] - brightness[0]).max() <= 3 and np.abs(coarse.astype(int) - image).max() > 5
