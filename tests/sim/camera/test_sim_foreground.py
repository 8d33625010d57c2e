"""Foregrounds: ranges, randomness, and the box that they leave open."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.types import Frame, Segment, Truth
from deckline_sim.camera import foreground
from deckline_sim.camera.foreground import KINDS, OPEN_SHARE, Foreground, add_foreground, draw_foreground, lay_over
from deckline_sim.config import SimConfig

SIZE = (160, 90)
CONFIG = SimConfig(preset="train", trajectory="random", foreground_share=1.0)
CAMERA = Camera(160, 90, 120.0, 120.0, 79.5, 44.5)
LINES = [Segment(np.array([20.0, y, 8.0]), np.array([60.0, y, 8.0])) for y in (-6.0, 2.0)]
GREY = np.full((90, 160, 3), 128, np.uint8)
BODY = RigidTransform.identity()
FRAME = Frame("a.png", 0.0, GREY, CAMERA, world_from_body=BODY, truth=Truth(*LINES, visibility_m=np.inf))


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
    for made in drawn:
        assert made.rgb.shape == (90, 160, 3) and made.cover.shape == (90, 160)
        assert made.rgb.dtype == made.cover.dtype == np.float32
        assert made.rgb.min() >= 0 and made.rgb.max() <= 255
        assert made.cover.min() >= 0 and made.cover.max() <= 1
    np.testing.assert_array_equal(draw(7).rgb, drawn[7].rgb)
    assert len({made.rgb.tobytes() for made in drawn}) >= 25
    assert 0.1 < np.mean([made.cover.mean() for made in drawn]) < 0.6


@pytest.mark.parametrize("keep", [(60, 30, 100, 60), (0, 70, 20, 120), (-9.5, -9.5, -3, -3), (80.2, 40.2, 80.3, 40.3)])
def test_the_kept_box_stays_open(keep):
    u0, v0, u1, v1 = np.clip(np.array(keep).astype(int), 0, [159, 89, 159, 89])
    covers = [draw(seed, keep).cover[v0 : v1 + 1, u0 : u1 + 1].mean() for seed in range(40)]
    assert max(covers) <= 1 - OPEN_SHARE + 0.01
    assert any(draw(seed).cover[v0 : v1 + 1, u0 : u1 + 1].mean() > 1 - OPEN_SHARE for seed in range(40))


def test_lay_over_hides_by_the_cover_and_adds_the_light():
    image = np.full((1, 2, 3), 200, np.uint8)
    light = Foreground(np.array([[[10] * 3, [90] * 3]], np.float32), np.array([[0.5, 0.0]], np.float32))
    np.testing.assert_array_equal(lay_over(image, light)[0, :, 0], [110, 255])
    assert (image == 200).all()


def test_large_foregrounds_are_enlarged_and_keep_their_box():
    large = [draw(seed, (200, 600, 900, 900), (1800, 1000)) for seed in range(5)]
    assert all(made.rgb.shape == (1000, 1800, 3) for made in large)
    assert max(made.cover[600:901, 200:901].mean() for made in large) <= 1 - OPEN_SHARE + 0.01
    assert max(made.cover.mean() for made in large) > 0.1


def test_the_runway_stays_open(monkeypatch):
    drawn = []
    monkeypatch.setattr(
        foreground, "draw_foreground", lambda *args: drawn.append((args, draw_foreground(*args))) or drawn[-1][1]
    )
    for index in range(40):
        add_foreground(FRAME, CONFIG, index)
    for (_, _, _, keep), made in drawn:
        assert 0 <= keep[0] < keep[2] <= 159 and 0 <= keep[1] < keep[3] <= 89
        u0, v0, u1, v1 = keep.astype(int)
        assert made.cover[v0 : v1 + 1, u0 : u1 + 1].mean() <= 1 - OPEN_SHARE + 0.01


def test_a_flight_keeps_its_foreground_and_not_its_noise(monkeypatch):
    drawn = []
    monkeypatch.setattr(foreground, "draw_foreground", lambda *args: drawn.append(draw_foreground(*args)) or drawn[-1])
    monkeypatch.setattr(foreground, "phone_picture", lambda image, rng: image + rng.normal(0, 5, image.shape))
    seen = [add_foreground(FRAME, replace(CONFIG, trajectory="approach"), index).image_rgb for index in (1, 2)]
    np.testing.assert_array_equal(drawn[0].rgb, drawn[1].rgb)
    assert not np.array_equal(*seen)


def test_the_scene_without_its_foreground_is_kept():
    np.testing.assert_array_equal(add_foreground(FRAME, CONFIG, 0).truth.clear_rgb, FRAME.image_rgb)
    assert add_foreground(FRAME, replace(CONFIG, keep_clear=False), 0).truth.clear_rgb is None
    hazy = replace(FRAME, truth=replace(FRAME.truth, clear_rgb=np.zeros_like(FRAME.image_rgb)))
    assert not add_foreground(hazy, CONFIG, 0).truth.clear_rgb.any()
