"""What a display or an editor lays over a picture, painted at random on an empty layer (see `brushes`)."""

import cv2
import numpy as np

from deckline_sim.camera.brushes import (
    Layer,
    Rng,
    draw_tone,
    ellipse,
    fill,
    log_uniform,
    placer,
    rectangle,
    stroke,
    write,
)
from deckline_sim.camera.cockpit import paint_nose, paint_panel, paint_pillars, paint_pilot, paint_rails

WORDS = ("FINAL", "RWY 27L", "CLEARED TO LAND", "REC", "300ft", "GPS", "KT", "minimums", "www.", ".com", "-60 fps")


def paint_hud(layer: Layer, rng: Rng) -> None:
    """Head-up display: pitch ladder, flight path marker, heading scale, speed and height."""
    tall, width = layer.shape[:2]
    ink = np.array([[30, 255, 60], [90, 255, 160], [255, 255, 255], [255, 200, 0]])[rng.integers(4)]
    wide, size = tall * rng.uniform(0.001, 0.005), tall * rng.uniform(0.25, 0.6)
    place = placer(rng.uniform(0.3, 0.7, 2) * [width, tall], size, rng.normal(0, 0.1))
    step, gap, long = rng.uniform([0.15, 0.05, 0.2], [0.4, 0.2, 0.5])
    for v in step * np.arange(-3, 4):
        for side in (-1, 1):
            reach = side * (long if v else 1.2)
            stroke(layer, place([[side * gap, v], [reach, v], [reach, v * 0.9]]), ink, wide)
    marker = rng.normal(0, 0.15, 2)
    stroke(layer, place(ellipse(marker, (0.05, 0.05))), ink, wide)
    for end in ([0.15, 0], [-0.15, 0], [0, -0.1]):
        stroke(layer, place(np.add(marker, np.outer([0.4, 1], end))), ink, wide)
    for u in np.arange(-0.6, 0.61, 0.1):
        stroke(layer, place([[u, -0.9], [u, -0.86]]), ink, wide)
    for u in (-0.9, 0.75):
        stroke(layer, place(rectangle(u, -0.06, u + 0.22, 0.06)), ink, wide, closed=True)
        write(layer, str(rng.integers(60, 4000)), place([u + 0.02, 0.04]), 0.08 * size, ink, 0, 1)


def paint_captions(layer: Layer, rng: Rng) -> None:
    """Subtitles, watermarks, dates: plain, with a shadow or in a box."""
    tall, width = layer.shape[:2]
    for _ in range(rng.integers(1, 4)):
        size, kind = tall * log_uniform(0.025, 0.1, rng), rng.random()
        u, v = rng.uniform(0, 0.7) * width, tall * rng.uniform(*((0.75, 0.98) if rng.random() < 0.6 else (0.05, 0.75)))
        ink = 255 if rng.random() < 0.5 else rng.uniform(0, 255, 3)
        letters = "".join(map(chr, rng.integers(97, 123, rng.integers(2, 10)).tolist()))
        pool = [letters, letters.upper(), f"{rng.integers(24)}:{rng.integers(10, 60)}", *rng.choice(WORDS, 4)]
        words = " ".join(rng.choice(pool, rng.integers(1, 6)))
        style = int(rng.integers(8)), max(1, round(size * rng.uniform(0.05, 0.16)))
        if kind < 0.3:
            box = rectangle(u - 0.4 * size, v - 1.3 * size, u + 0.7 * size * len(words), v + 0.5 * size)
            fill(layer, box, rng.uniform(0, 255, 3) * (rng.random() < 0.4))
        elif kind < 0.6:
            write(layer, words, np.add([u, v], max(1, 0.06 * size)), size, 0, *style)
        write(layer, words, (u, v), size, ink, *style)


def paint_inset(layer: Layer, rng: Rng) -> None:
    """A picture in the picture: a second camera, a map."""
    tall, width = layer.shape[:2]
    size = np.rint(rng.uniform(0.15, 0.4, 2) * [width, tall]).astype(int) + 2
    u, v = ((np.array([width, tall]) - size) * rng.choice([0.03, 0.97], 2)).astype(int).clip(0)
    greys = rng.uniform(20, 235, (int(rng.integers(2, 5)), 3, 1)) * rng.uniform(0.7, 1.1, (1, 1, 3))
    inner = np.full((size[1], size[0], 4), 255, np.uint8)
    inner[..., :3] = cv2.resize(np.clip(greys, 0, 255).astype(np.uint8), size.tolist())
    for k in rng.integers(5, size=2):
        (paint_panel, paint_pillars, paint_pilot, paint_nose, paint_rails)[k](inner, rng)
    part = layer[v : v + size[1], u : u + size[0]]
    part[:] = inner[: part.shape[0], : part.shape[1]]
    if rng.random() < 0.6:
        stroke(layer, rectangle(u, v, u + size[0], v + size[1]), draw_tone(rng), 0.008 * tall, closed=True)


def paint_bars(layer: Layer, rng: Rng) -> None:
    """Letterbox or pillarbox."""
    side = layer if rng.random() < 0.5 else layer.swapaxes(0, 1)
    wide = int(len(side) * rng.uniform(0.02, 0.16))
    tone = float(rng.integers(0, 255)) if rng.random() < 0.25 else 0.0
    side[:wide] = side[len(side) - wide :] = (tone, tone, tone, 255)
