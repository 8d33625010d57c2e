"""The parts of a foreground, each painted at random on an empty layer (see `brushes`).

`tall` is the picture's height, by which everything scales.
"""

import numpy as np
from numpy.typing import ArrayLike

from deckline_sim.camera.brushes import (
    Layer,
    Place,
    Points,
    Rng,
    bar,
    draw_tone,
    ellipse,
    fill,
    fill_below,
    log_uniform,
    placer,
    rectangle,
    round_off,
    stroke,
    to_scalar,
)

SKIN = np.array([[224, 172, 140], [190, 130, 95], [120, 78, 55], [70, 45, 35]])
INKS = np.array([[0, 230, 80], [235, 235, 235], [230, 60, 220], [0, 220, 230], [240, 170, 30]])  # of screens


def paint_pillars(layer: Layer, rng: Rng) -> None:
    """Window posts with seals, trims and rails along them."""
    tall, width = layer.shape[:2]
    for _ in range(rng.integers(1, 4)):
        foot = np.array([rng.uniform(-0.1, 1.1) * width, tall * rng.uniform(0.95, 1.3)])
        head = np.array([foot[0] + rng.normal(0, 0.45) * tall, rng.uniform(-0.3, 0.05) * tall])
        wide, bend = tall * log_uniform(0.03, 0.3, rng), rng.normal(0, 0.06) * tall
        fill(layer, bar(head, foot, wide * rng.uniform(0.6, 1.6, 2), bend), draw_tone(rng))
        for _ in range(rng.integers(0, 4)):
            trim = bar(head, foot, wide * rng.uniform(0.02, 0.2), bend, wide * rng.uniform(-0.4, 0.4))
            fill(layer, trim, draw_tone(rng))


def paint_windows(layer: Layer, rng: Rng) -> None:
    """A wall with one to three rounded panes, and seals around them."""
    tall, width = layer.shape[:2]
    layer[:] = (*to_scalar(draw_tone(rng)), 255)
    count = int(rng.integers(1, 4))
    edges = np.linspace(rng.uniform(-0.3, 0.2), rng.uniform(0.8, 1.3), count + 1) * width
    edges[1:-1] += rng.normal(0, 0.1 * width, count - 1)
    top, bottom = tall * rng.uniform(-0.2, 0.2), tall * rng.uniform(0.6, 1.25)
    gap, slant = tall * rng.uniform(0.03, 0.2), rng.normal(0, 0.15, count + 1) * tall
    seal, wide = draw_tone(rng), tall * rng.uniform(-0.01, 0.03)
    for k in range(count):
        corners = rectangle(edges[k] + gap / 2, top, edges[k + 1] - gap / 2, bottom)
        corners += np.column_stack([[slant[k], slant[k + 1], -slant[k + 1], -slant[k]], rng.normal(0, 0.05, 4) * tall])
        pane = round_off(corners, rng.uniform(0.04, 0.25))
        fill(layer, pane, 0, 0)
        if wide > 0:
            stroke(layer, pane, seal, wide, closed=True)


def paint_panel(layer: Layer, rng: Rng) -> None:
    """Glareshield, and mostly instruments under it."""
    tall, width = layer.shape[:2]
    u, top = np.linspace(-0.1, 1.1, 13), tall * rng.uniform(0.55, 0.97)
    ends = np.array([rng.uniform(-0.4, 0.15), rng.uniform(0.85, 1.4)])
    past = np.clip(np.maximum(ends[0] - u, u - ends[1]) / 0.15, 0, None) ** 2
    sag = (2 * u - 1) ** 2 * rng.uniform(-0.1, 0.3) + (u - 0.5) * 0.12 * rng.standard_t(3) + past * rng.uniform(0, 0.5)
    edge = fill_below(layer, top + (sag - sag.min()) * tall, draw_tone(rng) * 0.7)
    stroke(layer, np.add(edge, [0, tall * 0.01]), draw_tone(rng), tall * rng.uniform(0.0, 0.04))
    if rng.random() < 0.75:
        size = tall * rng.uniform(0.035, 0.13)
        limits = rng.uniform([-0.1, 0.5], [0.5, 1.1]) * width
        _paint_instruments(layer, limits, top + size * rng.uniform(1.2, 2.5), size, rng)


def paint_overhead(layer: Layer, rng: Rng) -> None:
    """Overhead panel or sun visor."""
    tall, width = layer.shape[:2]
    left, wide = rng.uniform(-0.5, 0.7) * width, rng.uniform(0.3, 2.0) * width
    drop = tall * (rng.uniform(0.03, 0.4) + rng.normal(0, 0.05, 2))
    outline = [[left, -0.5 * tall], [left + wide, -0.5 * tall], [left + wide, drop[1]], [left, drop[0]]]
    fill(layer, round_off(outline, rng.uniform(0.03, 0.15)), draw_tone(rng))
    stroke(layer, round_off(outline, 0.1), draw_tone(rng), tall * rng.uniform(0.0, 0.01), closed=True)
    if rng.random() < 0.5:
        size = tall * rng.uniform(0.02, 0.05)
        _paint_instruments(layer, (left, left + wide), drop.min() - 2 * size, -size, rng)


def _paint_instruments(layer: Layer, limits_u: ArrayLike, first_v: float, size: float, rng: Rng) -> None:
    """Rows of instruments of one half size, px, from a row down to the picture's edge; up if the size is negative."""
    tall, (u0, u1), half = len(layer), np.asarray(limits_u), abs(size)
    turn, shear, light = rng.normal(0, 0.06), rng.normal(0, 0.15), rng.uniform(0.35, 1.0)
    paints, mix = (_paint_screen, _paint_dial, _paint_keys), rng.dirichlet([0.5, 0.5, 0.4])
    for v in np.arange(first_v, tall + half if size > 0 else -half, 2.2 * size):
        for u in np.arange(u0 + 1.5 * half, u1 - half, 2 * half):
            if rng.random() < 0.75:
                place = placer((u, v + np.sin(turn) * (u - u0)), 0.85 * half, turn, shear)
                paints[rng.choice(3, p=mix)](layer, place, light, rng)


def _paint_dial(layer: Layer, place: Place, light: float, rng: Rng) -> None:
    ink, face = light * rng.uniform(120, 255), place(ellipse((0, 0), (0.95, 0.95)))
    fill(layer, face, light * rng.uniform(5, 50))
    stroke(layer, face, ink * rng.uniform(0.2, 0.8), closed=True)
    for angle in np.arange(0, 2 * np.pi, np.pi / rng.integers(3, 7)):
        stroke(layer, place(np.outer([0.7, 0.85], [np.cos(angle), np.sin(angle)])), ink)
    angle = rng.uniform(0, 2 * np.pi)
    stroke(layer, place(np.outer([0.0, 0.7], [np.cos(angle), np.sin(angle)])), ink, 2)


def _paint_screen(layer: Layer, place: Place, light: float, rng: Rng) -> None:
    """Artificial horizon, or a map or engine page."""
    fill(layer, place(rectangle(-1, -1, 1, 1)), 9)
    level, roll = rng.uniform(-0.4, 0.4), rng.normal(0, 0.2)
    if rng.random() < 0.55:
        sky, earth = rng.uniform([20, 90, 170], [70, 170, 255]), rng.uniform([90, 50, 10], [170, 100, 50])
        fill(layer, place(rectangle(-0.85, -0.9, 0.85, 0.9)), light * sky)
        fill(layer, place([[-0.85, level - roll], [0.85, level + roll], [0.85, 0.9], [-0.85, 0.9]]), light * earth)
        for v in (-0.4, -0.2, 0.2, 0.4):
            stroke(layer, place([[-0.2, level + v], [0.2, level + v]]), light * INKS[1])
        stroke(layer, place([[-0.5, 0], [-0.15, 0], [0, 0.12], [0.15, 0], [0.5, 0]]), light * INKS[4])
        for u in (-0.85, 0.6):
            fill(layer, place(rectangle(u, -0.8, u + 0.25, 0.8)), light * 62)
        return
    for _ in range(rng.integers(2, 6)):
        ink, (u, v) = light * INKS[rng.integers(len(INKS))], rng.uniform(-0.7, 0.7, 2)
        line = [[u, v], [u + rng.normal(0, 0.3), rng.uniform(-0.8, 0.8)]]
        arc = ellipse((u * 0.4, v * 0.4), (0.5, 0.5), 3.3, rng.uniform(4, 9))
        stroke(layer, place(arc if rng.random() < 0.4 else line), ink)


def _paint_keys(layer: Layer, place: Place, light: float, rng: Rng) -> None:
    tone = rng.uniform(20, 110)
    for u in (-0.6, 0.0, 0.6):
        for v in (-0.5, 0.2):
            ink = light * INKS[rng.integers(len(INKS))] if rng.random() < 0.15 else tone
            fill(layer, place(rectangle(u - 0.2, v - 0.2, u + 0.2, v + 0.2)), ink)


def paint_pilot(layer: Layer, rng: Rng) -> None:
    """Head, headset, shoulders and an arm at one side."""
    tall, width = layer.shape[:2]
    size = tall * rng.uniform(0.08, 0.22)
    place = placer(rng.uniform([-0.1, 0.25], [0.3, 0.9]) * [width, tall], size, rng.normal(0, 0.15))
    skin: Points = SKIN[rng.integers(len(SKIN))] * rng.uniform(0.15, 1.0)
    cloth = rng.choice([rng.uniform(190, 245), rng.uniform(10, 70)]) * rng.normal(1, 0.04, 3)
    hair, headset = rng.uniform(5, 70) * np.array([1.0, 0.85, 0.7]), rng.uniform(5, 90)
    body = [[-0.8, 1.2], [0.8, 1.2], [2.0, 1.9], [2.4, 9.0], [-3.0, 9.0], [-2.2, 1.8]]
    neck = place([[0.0, 0.5], [0.0, 1.8]])
    fill(layer, bar(neck[0], neck[1], size), skin * 0.8)
    fill(layer, round_off(place(body), 0.15), cloth)
    fill(layer, place(ellipse((0, 0), (0.8, 1.05))), skin)
    fill(layer, place(ellipse((-0.08, -0.15), (0.86, 1.0), np.pi * rng.uniform(0.6, 0.95), 2 * np.pi)), hair)
    if rng.random() < 0.6:
        stroke(layer, place(ellipse((0, -0.05), (0.85, 1.1), 3.3, 6.2)), headset, 0.18 * size)
        fill(layer, place(ellipse((rng.uniform(-0.3, 0.4), 0.1), (0.35, 0.45))), headset * 0.7)
    if rng.random() < 0.5:
        shoulder, hand = place([[1.2, 2.4], [rng.uniform(2, 5), rng.uniform(1.5, 5)]])
        fill(layer, bar(shoulder, hand, (1.2 * size, 0.6 * size), rng.normal(0, 0.5) * size), cloth * 0.9)
        fill(layer, ellipse(hand, (0.55 * size, 0.4 * size)), skin)
    if rng.random() < 0.5:
        layer[:] = layer[:, ::-1].copy()


def paint_nose(layer: Layer, rng: Rng) -> None:
    """Nose or cowling: a shaded curve at the bottom with seams and reflections, often behind a dark sill."""
    tall, width = layer.shape[:2]
    top, middle = tall * rng.uniform(0.6, 0.97), width * rng.uniform(0.1, 0.9)
    radii = rng.uniform([0.15, 0.15], [1.0, 1.2]) * [width, tall]
    tone = draw_tone(rng) if rng.random() < 0.4 else rng.uniform(120, 245) * rng.normal(1, 0.05, 3)
    squareness, shade = rng.uniform(0.6, 1.0), rng.uniform(-0.5, 0.3)
    curve = ellipse((0, 0), (1, 1), np.pi, 2 * np.pi)
    curve = np.sign(curve) * np.abs(curve) ** squareness * radii
    for share in np.linspace(0, 1, 7):
        ring = curve * [1 - 0.6 * share, 1] + [middle, top + radii[1] + share * tall * 0.05]
        fill(layer, ring, tone * (1 + shade * share))
    for _ in range(rng.integers(0, 4)):
        start = [middle, top] + rng.uniform([-0.7, 0.1], [0.7, 0.5]) * radii
        fill(layer, bar(start, start + rng.normal(0, 0.2, 2) * tall, 0.004 * tall), draw_tone(rng))
    if rng.random() < 0.5:
        fill_below(layer, top + tall * (rng.uniform(0.02, 0.2) + rng.normal(0, 0.01, 9)), rng.uniform(5, 50))


def paint_propeller(layer: Layer, rng: Rng) -> None:
    """Blades, bent by a rolling shutter, and their disc."""
    tall, width = layer.shape[:2]
    hub, reach = rng.uniform([0.1, 0.6], [0.9, 1.2]) * [width, tall], tall * rng.uniform(0.4, 1.1)
    count, tone = int(rng.integers(2, 5)), draw_tone(rng)
    fill(layer, ellipse(hub, reach), tone * 0.15, rng.uniform(0, 40))
    for angle in rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count:
        arm = reach * np.array([np.cos(angle), np.sin(angle)])
        fill(layer, bar(hub, hub + arm, np.array([0.1, 0.06]) * reach, rng.normal(0, 0.15) * reach), tone)
        fill(layer, bar(hub + 0.93 * arm, hub + arm, 0.06 * reach), rng.uniform(0, 255, 3))


def paint_strut(layer: Layer, rng: Rng) -> None:
    """Wing, strut or landing gear from a side, or a wiper or aerial from below."""
    tall, width = layer.shape[:2]
    thin = rng.random() < 0.5
    start = (rng.uniform(-0.1, 1.1), 1.1) if thin else (rng.choice([-0.1, 1.1]), rng.uniform(-0.2, 1.1))
    root, tip = np.multiply(start, [width, tall]), rng.uniform(0, 1, 2) * [width, tall]
    wide = tall * (log_uniform(0.004, 0.03, rng) if thin else log_uniform(0.02, 0.25, rng))
    tone = rng.uniform(5, 60) if thin or rng.random() < 0.3 else rng.uniform(100, 250) * rng.normal(1, 0.06, 3)
    fill(layer, bar(root, tip, wide * rng.uniform(0.4, 1.0, 2), rng.normal(0, 0.03) * tall * thin), tone)
    blade = (tip - root) * rng.uniform(0.0, 0.5) * thin
    fill(layer, bar(tip - blade, tip + 0.6 * blade, wide, rng.normal(0, 0.03) * tall), tone)
    if not thin:
        fill(layer, bar(root, tip, 0.2 * wide, 0, rng.uniform(-0.2, 0.2) * wide), draw_tone(rng))
    if not thin and rng.random() < 0.4:
        fill(layer, ellipse(tip, wide * rng.uniform(0.5, 1.5, 2)), rng.uniform(5, 60))


def paint_legs(layer: Layer, rng: Rng) -> None:
    """A drone's landing legs, or its propellers' guards, on both sides."""
    tall, width = layer.shape[:2]
    tone, wide, guards = draw_tone(rng), tall * rng.uniform(0.01, 0.08), rng.random() < 0.5
    lean, v, radii = rng.uniform(-0.15, 0.25) * width, rng.uniform(-0.2, 0.15), rng.uniform([0.15, 0.03], [0.4, 0.15])
    for side in (-1, 1):
        u = width * (0.5 + side * rng.uniform(0.38, 0.52))
        foot = (u - side * lean, tall * rng.uniform(0.6, 1.1))
        if guards:
            stroke(layer, ellipse((u, v * tall), radii * tall), tone, wide / 2, closed=True)
        else:
            fill(layer, bar((u, -0.1 * tall), foot, (wide, wide * 0.7)), tone)
            fill(layer, ellipse(foot, (tall * rng.uniform(0.02, 0.15), wide / 2)), tone * 0.7)


def paint_rails(layer: Layer, rng: Rng) -> None:
    """Long straight light edges, alone or converging: seals, rails, aerials. They are no runway's lines."""
    tall, width = layer.shape[:2]
    far, near = (rng.uniform(*limits) * [width, tall] for limits in (([0, -0.2], [1, 0.6]), ([-0.3, 0.7], [1.3, 1.3])))
    apart, wide, pinch = rng.normal(0, 0.3) * tall, tall * log_uniform(0.002, 0.02, rng), rng.uniform(0, 0.3)
    tone, backed = rng.uniform(120, 255) * rng.uniform(0.85, 1, 3), rng.random() < 0.6
    for k in range(int(rng.integers(1, 4))):
        start, end = np.add(far, [k * apart * pinch, 0]), np.add(near, [k * apart, 0])
        if backed:
            fill(layer, bar(start, end, (2 * wide, 5 * wide)), tone * 0.15)
        fill(layer, bar(start, end, (wide * 0.5, wide)), tone)


def paint_specks(layer: Layer, rng: Rng) -> None:
    """Dirt and insects on the window, or rain: drops, bright below, and the streaks that they run along."""
    size = np.array(layer.shape[1::-1])
    wet, lean, most = rng.random() < 0.4, rng.normal(0, 0.6), size[1] * log_uniform(0.004, 0.03, rng)
    for spot in rng.uniform(0, 1, (rng.integers(5, 30) * (1 + wet), 2)) * size:
        r, tone = most * rng.uniform(0.1, 1.0), rng.choice([rng.uniform(10, 140), rng.uniform(140, 240)])
        if rng.random() < 0.2:
            fill(layer, bar(spot, np.add(spot, [lean * 8 * r, -8 * r]), (r, 0.2 * r)), tone)
        fill(layer, ellipse(spot, (r, r * 1.2)) if wet else round_off(spot + rng.normal(0, r, (6, 2))), tone)
        if wet:
            fill(layer, ellipse(np.add(spot, [0, 0.3 * r]), 0.6 * r), rng.uniform(150, 250))


def paint_reflection(layer: Layer, rng: Rng) -> None:
    """The panel, a shirt or a chart reflected in the window: light that hides hardly anything."""
    tall, width = layer.shape[:2]
    if rng.random() < 0.4:
        _paint_instruments(layer, (0, width), rng.uniform(0.0, 0.6) * tall, tall * rng.uniform(0.05, 0.15), rng)
    for _ in range(rng.integers(1, 5)):
        corners = rng.uniform(-0.1, 1.1, 2) * [width, tall] + rng.normal(0, 0.3, (5, 2)) * tall
        fill(layer, round_off(corners), rng.uniform(80, 255) * rng.uniform(0.8, 1, 3))
    layer[..., 3] //= 16


def paint_flare(layer: Layer, rng: Rng) -> None:
    """The sun's glare, and the lens's ghosts on the line through the picture's middle."""
    size = np.array(layer.shape[1::-1])
    sun, reach = rng.uniform([-0.1, -0.2], [1.1, 0.6]) * size, size[1] * rng.uniform(0.1, 0.7)
    tint = np.array([1.0, rng.uniform(0.85, 1), rng.uniform(0.6, 1)])
    for _ in range(rng.integers(0, 6)):
        ghost = size / 2 + (size / 2 - sun) * rng.uniform(-0.6, 1.2)
        fill(layer, ellipse(ghost, size[1] * rng.uniform(0.01, 0.1)), rng.uniform(20, 90, 3), 20)
    for share in np.linspace(1, 0, 14):
        glare = 255 * (1 - share) ** 1.5
        fill(layer, ellipse(sun, reach * share + 0.02 * size[1]), tint * glare, glare)
