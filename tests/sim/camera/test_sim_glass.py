"""Frames behind a foreground: the runway stays open, a flight keeps its foreground and not its noise."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.types import Frame, Segment, Truth
from deckline_sim.camera import glass
from deckline_sim.camera.foreground import OPEN_SHARE, draw_foreground
from deckline_sim.camera.glass import add_foreground
from deckline_sim.config import SimConfig

CONFIG = SimConfig(preset="train", trajectory="random", foreground_share=1.0)
CAMERA = Camera(160, 90, 120.0, 120.0, 79.5, 44.5)
LINES = [Segment(np.array([20.0, y, 8.0]), np.array([60.0, y, 8.0])) for y in (-6.0, 2.0)]
FRAME = Frame(
    "a.png",
    0.0,
    np.full((90, 160, 3), 128, np.uint8),
    CAMERA,
    world_from_body=RigidTransform.identity(),
    truth=Truth(*LINES, visibility_m=np.inf),
)


def test_the_runway_stays_open(monkeypatch):
    drawn = []
    monkeypatch.setattr(
        glass, "draw_foreground", lambda *args: drawn.append((args, draw_foreground(*args))) or drawn[-1][1]
    )
    for index in range(40):
        add_foreground(FRAME, CONFIG, index)
    for (_, _, _, keep), foreground in drawn:
        assert 0 <= keep[0] < keep[2] <= 159 and 0 <= keep[1] < keep[3] <= 89
        u0, v0, u1, v1 = keep.astype(int)
        assert foreground.cover[v0 : v1 + 1, u0 : u1 + 1].mean() <= 1 - OPEN_SHARE + 0.01


def test_a_flight_keeps_its_foreground_and_not_its_noise(monkeypatch):
    drawn = []
    monkeypatch.setattr(glass, "draw_foreground", lambda *args: drawn.append(draw_foreground(*args)) or drawn[-1])
    monkeypatch.setattr(glass, "phone_picture", lambda image, rng: image + rng.normal(0, 5, image.shape))
    seen = [add_foreground(FRAME, replace(CONFIG, trajectory="approach"), index).image_rgb for index in (1, 2)]
    np.testing.assert_array_equal(drawn[0].rgb, drawn[1].rgb)
    assert not np.array_equal(*seen)


def test_the_scene_without_its_foreground_is_kept():
    np.testing.assert_array_equal(add_foreground(FRAME, CONFIG, 0).truth.clear_rgb, FRAME.image_rgb)
    assert add_foreground(FRAME, replace(CONFIG, keep_clear=False), 0).truth.clear_rgb is None
    hazy = replace(FRAME, truth=replace(FRAME.truth, clear_rgb=np.zeros_like(FRAME.image_rgb)))
    assert not add_foreground(hazy, CONFIG, 0).truth.clear_rgb.any()
