"""Foregrounds: ranges, randomness, and the box that they leave open."""

import numpy as np
import pytest

from deckline_sim.camera.foreground import KINDS, OPEN_SHARE, Foreground, draw_foreground, lay_over

SIZE = (160, 90)


def draw(seed, keep=None, size=SIZE):
    return draw_foreground(*size, np.random.default_rng(seed), keep)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.paint.__name__)
@pytest.mark.parametrize("size", [SIZE, (37, 61)])
def test_every_element_paints_something_of_its_own(kind, size):
    def paint(seed):
        layer = np.zeros((size[1], size[0], 4), np.uint8)
        kind.paint(layer, np.random.default_rng(seed))
        return layer

    layers = [paint(seed) for seed in range(8)]
    assert sum(layer.any() for layer in layers) >= 4
    assert len({layer.tobytes() for layer in layers}) >= 4
    np.testing.assert_array_equal(paint(3), layers[3])


def test_foregrounds_are_pictures_that_the_seed_decides():
    drawn = [draw(seed) for seed in range(30)]
    for foreground in drawn:
        assert foreground.rgb.shape == (90, 160, 3) and foreground.cover.shape == (90, 160)
        assert foreground.rgb.dtype == foreground.cover.dtype == np.float32
        assert foreground.rgb.min() >= 0 and foreground.rgb.max() <= 255
        assert foreground.cover.min() >= 0 and foreground.cover.max() <= 1
    np.testing.assert_array_equal(draw(7).rgb, drawn[7].rgb)
    assert len({foreground.rgb.tobytes() for foreground in drawn}) >= 25
    assert 0.1 < np.mean([foreground.cover.mean() for foreground in drawn]) < 0.6


@pytest.mark.parametrize("keep", [(60, 30, 100, 60), (0, 70, 20, 120), (-9.5, -9.5, -3, -3), (80.2, 40.2, 80.3, 40.3)])
def test_the_kept_box_stays_open(keep):
    u0, v0, u1, v1 = np.clip(np.array(keep).astype(int), 0, [159, 89, 159, 89])
    covers = [draw(seed, keep).cover[v0 : v1 + 1, u0 : u1 + 1].mean() for seed in range(40)]
    assert max(covers) <= 1 - OPEN_SHARE + 0.01
    assert any(draw(seed).cover[v0 : v1 + 1, u0 : u1 + 1].mean() > 1 - OPEN_SHARE for seed in range(40))


def test_lay_over_hides_by_the_cover_and_adds_the_light():
    image = np.full((1, 2, 3), 200, np.uint8)
    foreground = Foreground(np.array([[[10] * 3, [90] * 3]], np.float32), np.array([[0.5, 0.0]], np.float32))
    np.testing.assert_array_equal(lay_over(image, foreground)[0, :, 0], [110, 255])
    assert (image == 200).all()


def test_large_foregrounds_are_enlarged_and_keep_their_box():
    foregrounds = [draw(seed, (200, 600, 900, 900), (1800, 1000)) for seed in range(5)]
    assert all(foreground.rgb.shape == (1000, 1800, 3) for foreground in foregrounds)
    assert max(foreground.cover[600:901, 200:901].mean() for foreground in foregrounds) <= 1 - OPEN_SHARE + 0.01
    assert max(foreground.cover.mean() for foreground in foregrounds) > 0.1
