"""The parts of a foreground, each painted at random on an empty layer.

A layer is (H, W, 4) red, green, blue and cover, 0..255, its colours weighted by the cover. `tall` is the picture's
height, by which everything scales.
"""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

SHIFT = 3  # fractional bits of OpenCV's coordinates
WORDS = ("FINAL", "RWY 27L", "CLEARED TO LAND", "REC", "300ft", "GPS", "KT", "minimums", "www.", ".com", "-60 fps")
SKIN = np.array([[224, 172, 140], [190, 130, 95], [120, 78, 55], [70, 45, 35]])
INKS = np.array([[0, 230, 80], [235, 235, 235], [230, 60, 220], [0, 220, 230], [240, 170, 30]])  # of screens

Layer = NDArray[Any]  # uint8
Points = NDArray[np.float64]
Place = Callable[[ArrayLike], Points]
Rng = np.random.Generator


def _fill(layer: Layer, points: ArrayLike, colour: ArrayLike, cover: float = 255) -> None:
    corners = np.rint(np.asarray(points) * (1 << SHIFT)).astype(np.int32)
    cv2.fillPoly(layer, [corners], (*_ink(colour), cover), cv2.LINE_AA, SHIFT)


def _stroke(layer: Layer, points: ArrayLike, colour: ArrayLike, width_px: float = 1, closed: bool = False) -> None:
    corners = np.rint(np.asarray(points) * (1 << SHIFT)).astype(np.int32)
    cv2.polylines(layer, [corners], closed, (*_ink(colour), 255), max(1, round(width_px)), cv2.LINE_AA, SHIFT)


def _ink(colour: ArrayLike) -> list[float]:
    values: list[float] = np.add(colour, np.zeros(3)).tolist()  # OpenCV clips them
    return values


def _round(points: ArrayLike, first: float = 0.25) -> Points:
    """A closed polygon with its corners cut three times. Source: Chaikin 1974."""
    corners = np.asarray(points, dtype=np.float64)
    for share in (first, 0.25, 0.25):
        after = np.roll(corners, -1, axis=0)
        pair = np.stack([corners + share * (after - corners), after + share * (corners - after)], axis=1)
        corners = pair.reshape(-1, 2)
    return corners


def _ellipse(centre: ArrayLike, radii: ArrayLike, start: float = 0.0, end: float = 2 * np.pi) -> Points:
    angle = np.linspace(start, end, 28)
    return np.add(centre, np.column_stack([np.cos(angle), np.sin(angle)]) * np.asarray(radii, dtype=np.float64))


def _rectangle(u0: float, v0: float, u1: float, v1: float) -> Points:
    return np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]], dtype=np.float64)


def _bar(start: ArrayLike, end: ArrayLike, widths_px: ArrayLike, bend_px: float = 0.0, aside_px: float = 0.0) -> Points:
    """Outline of a bent bar, moved across by `aside_px`."""
    first, step = np.asarray(start, dtype=np.float64), np.subtract(end, start)
    wide, along = np.broadcast_to(widths_px, 2), np.linspace(0.0, 1.0, 9)[:, None]
    across = np.array([-step[1], step[0]]) / max(float(np.hypot(*step)), 1e-6)
    half = (wide[0] + (wide[1] - wide[0]) * along) / 2
    middle = first + step * along + across * (4 * along * (1 - along) * bend_px + aside_px)
    return np.vstack([middle - across * half, (middle + across * half)[::-1]])


def _fill_below(layer: Layer, v: NDArray[np.float64], colour: ArrayLike) -> Points:
    """Fill what lies below rows `v`, equally spaced past both sides; returns that edge."""
    tall, width = layer.shape[:2]
    edge = np.column_stack([np.linspace(-0.1, 1.1, len(v)) * width, v])
    _fill(layer, np.vstack([edge, [[1.2 * width, 2 * tall], [-0.2 * width, 2 * tall]]]), colour)
    return edge


def _placer(centre: ArrayLike, size_px: float, turn_rad: float = 0.0, shear: float = 0.0) -> Place:
    """Maps a part's own coordinates to the picture."""
    axes = size_px * np.array([[np.cos(turn_rad), np.sin(turn_rad)], [shear - np.sin(turn_rad), np.cos(turn_rad)]])
    return lambda points: np.asarray(centre) + np.asarray(points) @ axes


def _draw_tone(rng: Rng) -> NDArray[np.float64]:
    """Colour of a part: mostly dark, now and then grey, light or painted."""
    level = rng.choice([rng.uniform(4, 45), rng.uniform(40, 130), rng.uniform(140, 235)], p=[0.6, 0.27, 0.13])
    tint = 1 + (0.4 if rng.random() < 0.08 else 0.06) * rng.standard_normal(3)
    return np.asarray(np.clip(level * tint, 0, 250))


def _between(low: float, high: float, rng: Rng) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def paint_pillars(layer: Layer, rng: Rng) -> None:
    """Window posts with seals, trims and rails along them."""
    tall, width = layer.shape[:2]
    for _ in range(rng.integers(1, 4)):
        foot = np.array([rng.uniform(-0.1, 1.1) * width, tall * rng.uniform(0.95, 1.3)])
        head = np.array([foot[0] + rng.normal(0, 0.45) * tall, rng.uniform(-0.3, 0.05) * tall])
        wide, bend = tall * _between(0.03, 0.3, rng), rng.normal(0, 0.06) * tall
        _fill(layer, _bar(head, foot, wide * rng.uniform(0.6, 1.6, 2), bend), _draw_tone(rng))
        for _ in range(rng.integers(0, 4)):
            trim = _bar(head, foot, wide * rng.uniform(0.02, 0.2), bend, wide * rng.uniform(-0.4, 0.4))
            _fill(layer, trim, _draw_tone(rng))


def paint_windows(layer: Layer, rng: Rng) -> None:
    """A wall with one to three rounded panes, and seals around them."""
    tall, width = layer.shape[:2]
    layer[:] = (*_ink(_draw_tone(rng)), 255)
    count = int(rng.integers(1, 4))
    edges = np.linspace(rng.uniform(-0.3, 0.2), rng.uniform(0.8, 1.3), count + 1) * width
    edges[1:-1] += rng.normal(0, 0.1 * width, count - 1)
    top, bottom = tall * rng.uniform(-0.2, 0.2), tall * rng.uniform(0.6, 1.25)
    gap, slant = tall * rng.uniform(0.03, 0.2), rng.normal(0, 0.15, count + 1) * tall
    seal, wide = _draw_tone(rng), tall * rng.uniform(-0.01, 0.03)
    for k in range(count):
        corners = _rectangle(edges[k] + gap / 2, top, edges[k + 1] - gap / 2, bottom)
        corners += np.column_stack([[slant[k], slant[k + 1], -slant[k + 1], -slant[k]], rng.normal(0, 0.05, 4) * tall])
        pane = _round(corners, rng.uniform(0.04, 0.25))
        _fill(layer, pane, 0, 0)
        if wide > 0:
            _stroke(layer, pane, seal, wide, closed=True)


def paint_panel(layer: Layer, rng: Rng) -> None:
    """Glareshield, and mostly instruments under it."""
    tall, width = layer.shape[:2]
    u, top = np.linspace(-0.1, 1.1, 13), tall * rng.uniform(0.55, 0.97)
    ends = np.array([rng.uniform(-0.4, 0.15), rng.uniform(0.85, 1.4)])
    past = np.clip(np.maximum(ends[0] - u, u - ends[1]) / 0.15, 0, None) ** 2
    sag = (2 * u - 1) ** 2 * rng.uniform(-0.1, 0.3) + (u - 0.5) * 0.12 * rng.standard_t(3) + past * rng.uniform(0, 0.5)
    edge = _fill_below(layer, top + (sag - sag.min()) * tall, _draw_tone(rng) * 0.7)
    _stroke(layer, np.add(edge, [0, tall * 0.01]), _draw_tone(rng), tall * rng.uniform(0.0, 0.04))
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
    _fill(layer, _round(outline, rng.uniform(0.03, 0.15)), _draw_tone(rng))
    _stroke(layer, _round(outline, 0.1), _draw_tone(rng), tall * rng.uniform(0.0, 0.01), closed=True)
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
                place = _placer((u, v + np.sin(turn) * (u - u0)), 0.85 * half, turn, shear)
                paints[rng.choice(3, p=mix)](layer, place, light, rng)


def _paint_dial(layer: Layer, place: Place, light: float, rng: Rng) -> None:
    ink, face = light * rng.uniform(120, 255), place(_ellipse((0, 0), (0.95, 0.95)))
    _fill(layer, face, light * rng.uniform(5, 50))
    _stroke(layer, face, ink * rng.uniform(0.2, 0.8), closed=True)
    for angle in np.arange(0, 2 * np.pi, np.pi / rng.integers(3, 7)):
        _stroke(layer, place(np.outer([0.7, 0.85], [np.cos(angle), np.sin(angle)])), ink)
    angle = rng.uniform(0, 2 * np.pi)
    _stroke(layer, place(np.outer([0.0, 0.7], [np.cos(angle), np.sin(angle)])), ink, 2)


def _paint_screen(layer: Layer, place: Place, light: float, rng: Rng) -> None:
    """Artificial horizon, or a map or engine page."""
    _fill(layer, place(_rectangle(-1, -1, 1, 1)), 9)
    level, roll = rng.uniform(-0.4, 0.4), rng.normal(0, 0.2)
    if rng.random() < 0.55:
        sky, earth = rng.uniform([20, 90, 170], [70, 170, 255]), rng.uniform([90, 50, 10], [170, 100, 50])
        _fill(layer, place(_rectangle(-0.85, -0.9, 0.85, 0.9)), light * sky)
        _fill(layer, place([[-0.85, level - roll], [0.85, level + roll], [0.85, 0.9], [-0.85, 0.9]]), light * earth)
        for v in (-0.4, -0.2, 0.2, 0.4):
            _stroke(layer, place([[-0.2, level + v], [0.2, level + v]]), light * INKS[1])
        _stroke(layer, place([[-0.5, 0], [-0.15, 0], [0, 0.12], [0.15, 0], [0.5, 0]]), light * INKS[4])
        for u in (-0.85, 0.6):
            _fill(layer, place(_rectangle(u, -0.8, u + 0.25, 0.8)), light * 62)
        return
    for _ in range(rng.integers(2, 6)):
        ink, (u, v) = light * INKS[rng.integers(len(INKS))], rng.uniform(-0.7, 0.7, 2)
        line = [[u, v], [u + rng.normal(0, 0.3), rng.uniform(-0.8, 0.8)]]
        arc = _ellipse((u * 0.4, v * 0.4), (0.5, 0.5), 3.3, rng.uniform(4, 9))
        _stroke(layer, place(arc if rng.random() < 0.4 else line), ink)


def _paint_keys(layer: Layer, place: Place, light: float, rng: Rng) -> None:
    tone = rng.uniform(20, 110)
    for u in (-0.6, 0.0, 0.6):
        for v in (-0.5, 0.2):
            ink = light * INKS[rng.integers(len(INKS))] if rng.random() < 0.15 else tone
            _fill(layer, place(_rectangle(u - 0.2, v - 0.2, u + 0.2, v + 0.2)), ink)


def paint_pilot(layer: Layer, rng: Rng) -> None:
    """Head, headset, shoulders and an arm at one side."""
    tall, width = layer.shape[:2]
    size = tall * rng.uniform(0.08, 0.22)
    place = _placer(rng.uniform([-0.1, 0.25], [0.3, 0.9]) * [width, tall], size, rng.normal(0, 0.15))
    skin: Points = SKIN[rng.integers(len(SKIN))] * rng.uniform(0.15, 1.0)
    cloth = rng.choice([rng.uniform(190, 245), rng.uniform(10, 70)]) * rng.normal(1, 0.04, 3)
    hair, headset = rng.uniform(5, 70) * np.array([1.0, 0.85, 0.7]), rng.uniform(5, 90)
    body = [[-0.8, 1.2], [0.8, 1.2], [2.0, 1.9], [2.4, 9.0], [-3.0, 9.0], [-2.2, 1.8]]
    neck = place([[0.0, 0.5], [0.0, 1.8]])
    _fill(layer, _bar(neck[0], neck[1], size), skin * 0.8)
    _fill(layer, _round(place(body), 0.15), cloth)
    _fill(layer, place(_ellipse((0, 0), (0.8, 1.05))), skin)
    _fill(layer, place(_ellipse((-0.08, -0.15), (0.86, 1.0), np.pi * rng.uniform(0.6, 0.95), 2 * np.pi)), hair)
    if rng.random() < 0.6:
        _stroke(layer, place(_ellipse((0, -0.05), (0.85, 1.1), 3.3, 6.2)), headset, 0.18 * size)
        _fill(layer, place(_ellipse((rng.uniform(-0.3, 0.4), 0.1), (0.35, 0.45))), headset * 0.7)
    if rng.random() < 0.5:
        shoulder, hand = place([[1.2, 2.4], [rng.uniform(2, 5), rng.uniform(1.5, 5)]])
        _fill(layer, _bar(shoulder, hand, (1.2 * size, 0.6 * size), rng.normal(0, 0.5) * size), cloth * 0.9)
        _fill(layer, _ellipse(hand, (0.55 * size, 0.4 * size)), skin)
    if rng.random() < 0.5:
        layer[:] = layer[:, ::-1].copy()


def paint_nose(layer: Layer, rng: Rng) -> None:
    """Nose or cowling: a shaded curve at the bottom with seams and reflections, often behind a dark sill."""
    tall, width = layer.shape[:2]
    top, middle = tall * rng.uniform(0.6, 0.97), width * rng.uniform(0.1, 0.9)
    radii = rng.uniform([0.15, 0.15], [1.0, 1.2]) * [width, tall]
    tone = _draw_tone(rng) if rng.random() < 0.4 else rng.uniform(120, 245) * rng.normal(1, 0.05, 3)
    squareness, shade = rng.uniform(0.6, 1.0), rng.uniform(-0.5, 0.3)
    curve = _ellipse((0, 0), (1, 1), np.pi, 2 * np.pi)
    curve = np.sign(curve) * np.abs(curve) ** squareness * radii
    for share in np.linspace(0, 1, 7):
        ring = curve * [1 - 0.6 * share, 1] + [middle, top + radii[1] + share * tall * 0.05]
        _fill(layer, ring, tone * (1 + shade * share))
    for _ in range(rng.integers(0, 4)):
        start = [middle, top] + rng.uniform([-0.7, 0.1], [0.7, 0.5]) * radii
        _fill(layer, _bar(start, start + rng.normal(0, 0.2, 2) * tall, 0.004 * tall), _draw_tone(rng))
    if rng.random() < 0.5:
        _fill_below(layer, top + tall * (rng.uniform(0.02, 0.2) + rng.normal(0, 0.01, 9)), rng.uniform(5, 50))


def paint_propeller(layer: Layer, rng: Rng) -> None:
    """Blades, bent by a rolling shutter, and their disc."""
    tall, width = layer.shape[:2]
    hub, reach = rng.uniform([0.1, 0.6], [0.9, 1.2]) * [width, tall], tall * rng.uniform(0.4, 1.1)
    count, tone = int(rng.integers(2, 5)), _draw_tone(rng)
    _fill(layer, _ellipse(hub, reach), tone * 0.15, rng.uniform(0, 40))
    for angle in rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count:
        arm = reach * np.array([np.cos(angle), np.sin(angle)])
        _fill(layer, _bar(hub, hub + arm, np.array([0.1, 0.06]) * reach, rng.normal(0, 0.15) * reach), tone)
        _fill(layer, _bar(hub + 0.93 * arm, hub + arm, 0.06 * reach), rng.uniform(0, 255, 3))


def paint_strut(layer: Layer, rng: Rng) -> None:
    """Wing, strut or landing gear from a side, or a wiper or aerial from below."""
    tall, width = layer.shape[:2]
    thin = rng.random() < 0.5
    start = (rng.uniform(-0.1, 1.1), 1.1) if thin else (rng.choice([-0.1, 1.1]), rng.uniform(-0.2, 1.1))
    root, tip = np.multiply(start, [width, tall]), rng.uniform(0, 1, 2) * [width, tall]
    wide = tall * (_between(0.004, 0.03, rng) if thin else _between(0.02, 0.25, rng))
    tone = rng.uniform(5, 60) if thin or rng.random() < 0.3 else rng.uniform(100, 250) * rng.normal(1, 0.06, 3)
    _fill(layer, _bar(root, tip, wide * rng.uniform(0.4, 1.0, 2), rng.normal(0, 0.03) * tall * thin), tone)
    blade = (tip - root) * rng.uniform(0.0, 0.5) * thin
    _fill(layer, _bar(tip - blade, tip + 0.6 * blade, wide, rng.normal(0, 0.03) * tall), tone)
    if not thin:
        _fill(layer, _bar(root, tip, 0.2 * wide, 0, rng.uniform(-0.2, 0.2) * wide), _draw_tone(rng))
    if not thin and rng.random() < 0.4:
        _fill(layer, _ellipse(tip, wide * rng.uniform(0.5, 1.5, 2)), rng.uniform(5, 60))


def paint_legs(layer: Layer, rng: Rng) -> None:
    """A drone's landing legs, or its propellers' guards, on both sides."""
    tall, width = layer.shape[:2]
    tone, wide, guards = _draw_tone(rng), tall * rng.uniform(0.01, 0.08), rng.random() < 0.5
    lean, v, radii = rng.uniform(-0.15, 0.25) * width, rng.uniform(-0.2, 0.15), rng.uniform([0.15, 0.03], [0.4, 0.15])
    for side in (-1, 1):
        u = width * (0.5 + side * rng.uniform(0.38, 0.52))
        foot = (u - side * lean, tall * rng.uniform(0.6, 1.1))
        if guards:
            _stroke(layer, _ellipse((u, v * tall), radii * tall), tone, wide / 2, closed=True)
        else:
            _fill(layer, _bar((u, -0.1 * tall), foot, (wide, wide * 0.7)), tone)
            _fill(layer, _ellipse(foot, (tall * rng.uniform(0.02, 0.15), wide / 2)), tone * 0.7)


def paint_rails(layer: Layer, rng: Rng) -> None:
    """Long straight light edges, alone or converging: seals, rails, aerials. They are no runway's lines."""
    tall, width = layer.shape[:2]
    far, near = (rng.uniform(*limits) * [width, tall] for limits in (([0, -0.2], [1, 0.6]), ([-0.3, 0.7], [1.3, 1.3])))
    apart, wide, pinch = rng.normal(0, 0.3) * tall, tall * _between(0.002, 0.02, rng), rng.uniform(0, 0.3)
    tone, backed = rng.uniform(120, 255) * rng.uniform(0.85, 1, 3), rng.random() < 0.6
    for k in range(int(rng.integers(1, 4))):
        start, end = np.add(far, [k * apart * pinch, 0]), np.add(near, [k * apart, 0])
        if backed:
            _fill(layer, _bar(start, end, (2 * wide, 5 * wide)), tone * 0.15)
        _fill(layer, _bar(start, end, (wide * 0.5, wide)), tone)


def paint_specks(layer: Layer, rng: Rng) -> None:
    """Dirt and insects on the glass, or rain: drops, bright below, and the streaks that they run along."""
    size = np.array(layer.shape[1::-1])
    wet, lean, most = rng.random() < 0.4, rng.normal(0, 0.6), size[1] * _between(0.004, 0.03, rng)
    for spot in rng.uniform(0, 1, (rng.integers(5, 30) * (1 + wet), 2)) * size:
        r, tone = most * rng.uniform(0.1, 1.0), rng.choice([rng.uniform(10, 140), rng.uniform(140, 240)])
        if rng.random() < 0.2:
            _fill(layer, _bar(spot, np.add(spot, [lean * 8 * r, -8 * r]), (r, 0.2 * r)), tone)
        _fill(layer, _ellipse(spot, (r, r * 1.2)) if wet else _round(spot + rng.normal(0, r, (6, 2))), tone)
        if wet:
            _fill(layer, _ellipse(np.add(spot, [0, 0.3 * r]), 0.6 * r), rng.uniform(150, 250))


def paint_reflection(layer: Layer, rng: Rng) -> None:
    """The panel, a shirt or a chart in the glass: light that hides next to nothing."""
    tall, width = layer.shape[:2]
    if rng.random() < 0.4:
        _paint_instruments(layer, (0, width), rng.uniform(0.0, 0.6) * tall, tall * rng.uniform(0.05, 0.15), rng)
    for _ in range(rng.integers(1, 5)):
        corners = rng.uniform(-0.1, 1.1, 2) * [width, tall] + rng.normal(0, 0.3, (5, 2)) * tall
        _fill(layer, _round(corners), rng.uniform(80, 255) * rng.uniform(0.8, 1, 3))
    layer[..., 3] //= 16


def paint_flare(layer: Layer, rng: Rng) -> None:
    """The sun's glare, and the lens's ghosts on the line through the picture's middle."""
    size = np.array(layer.shape[1::-1])
    sun, reach = rng.uniform([-0.1, -0.2], [1.1, 0.6]) * size, size[1] * rng.uniform(0.1, 0.7)
    tint = np.array([1.0, rng.uniform(0.85, 1), rng.uniform(0.6, 1)])
    for _ in range(rng.integers(0, 6)):
        ghost = size / 2 + (size / 2 - sun) * rng.uniform(-0.6, 1.2)
        _fill(layer, _ellipse(ghost, size[1] * rng.uniform(0.01, 0.1)), rng.uniform(20, 90, 3), 20)
    for share in np.linspace(1, 0, 14):
        glare = 255 * (1 - share) ** 1.5
        _fill(layer, _ellipse(sun, reach * share + 0.02 * size[1]), tint * glare, glare)


def paint_hud(layer: Layer, rng: Rng) -> None:
    """Head-up display: pitch ladder, flight path marker, heading scale, speed and height."""
    tall, width = layer.shape[:2]
    ink = np.array([[30, 255, 60], [90, 255, 160], [255, 255, 255], [255, 200, 0]])[rng.integers(4)]
    wide, size = tall * rng.uniform(0.001, 0.005), tall * rng.uniform(0.25, 0.6)
    place = _placer(rng.uniform(0.3, 0.7, 2) * [width, tall], size, rng.normal(0, 0.1))
    step, gap, long = rng.uniform([0.15, 0.05, 0.2], [0.4, 0.2, 0.5])
    for v in step * np.arange(-3, 4):
        for side in (-1, 1):
            reach = side * (long if v else 1.2)
            _stroke(layer, place([[side * gap, v], [reach, v], [reach, v * 0.9]]), ink, wide)
    marker = rng.normal(0, 0.15, 2)
    _stroke(layer, place(_ellipse(marker, (0.05, 0.05))), ink, wide)
    for end in ([0.15, 0], [-0.15, 0], [0, -0.1]):
        _stroke(layer, place(np.add(marker, np.outer([0.4, 1], end))), ink, wide)
    for u in np.arange(-0.6, 0.61, 0.1):
        _stroke(layer, place([[u, -0.9], [u, -0.86]]), ink, wide)
    for u in (-0.9, 0.75):
        _stroke(layer, place(_rectangle(u, -0.06, u + 0.22, 0.06)), ink, wide, closed=True)
        _write(layer, str(rng.integers(60, 4000)), place([u + 0.02, 0.04]), 0.08 * size, ink, 0, 1)


def _write(
    layer: Layer, words: str, origin: ArrayLike, size_px: float, colour: ArrayLike, font: int, stroke_px: int
) -> None:
    u, v = np.rint(np.asarray(origin)).astype(int).tolist()
    cv2.putText(layer, words, (u, v), font, size_px / 21, (*_ink(colour), 255), stroke_px, cv2.LINE_AA)


def paint_captions(layer: Layer, rng: Rng) -> None:
    """Subtitles, watermarks, dates: plain, with a shadow or in a box."""
    tall, width = layer.shape[:2]
    for _ in range(rng.integers(1, 4)):
        size, kind = tall * _between(0.025, 0.1, rng), rng.random()
        u, v = rng.uniform(0, 0.7) * width, tall * rng.uniform(*((0.75, 0.98) if rng.random() < 0.6 else (0.05, 0.75)))
        ink = 255 if rng.random() < 0.5 else rng.uniform(0, 255, 3)
        letters = "".join(map(chr, rng.integers(97, 123, rng.integers(2, 10)).tolist()))
        pool = [letters, letters.upper(), f"{rng.integers(24)}:{rng.integers(10, 60)}", *rng.choice(WORDS, 4)]
        words = " ".join(rng.choice(pool, rng.integers(1, 6)))
        style = int(rng.integers(8)), max(1, round(size * rng.uniform(0.05, 0.16)))
        if kind < 0.3:
            box = _rectangle(u - 0.4 * size, v - 1.3 * size, u + 0.7 * size * len(words), v + 0.5 * size)
            _fill(layer, box, rng.uniform(0, 255, 3) * (rng.random() < 0.4))
        elif kind < 0.6:
            _write(layer, words, np.add([u, v], max(1, 0.06 * size)), size, 0, *style)
        _write(layer, words, (u, v), size, ink, *style)


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
        _stroke(layer, _rectangle(u, v, u + size[0], v + size[1]), _draw_tone(rng), 0.008 * tall, closed=True)


def paint_bars(layer: Layer, rng: Rng) -> None:
    """Letterbox or pillarbox."""
    side = layer if rng.random() < 0.5 else layer.swapaxes(0, 1)
    wide = int(len(side) * rng.uniform(0.02, 0.16))
    tone = float(rng.integers(0, 255)) if rng.random() < 0.25 else 0.0
    side[:wide] = side[len(side) - wide :] = (tone, tone, tone, 255)
