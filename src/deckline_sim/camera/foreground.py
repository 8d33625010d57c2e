"""Random foregrounds between camera and scene: cockpits, airframes, drones' legs, dirty windows, captions."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.types import Frame
from deckline_sim.camera import cockpit, screen
from deckline_sim.camera.brushes import Layer, Rng
from deckline_sim.camera.phone import phone_picture
from deckline_sim.config import FLIGHTS, SimConfig
from deckline_sim.visible_line import find_visible_line

OPEN_SHARE = 0.7  # of the open box that stays uncovered
MOST_PX = 800  # on the longer side; larger foregrounds are drawn at this size and enlarged
TRIES = 3  # drawings of an element before it is left out
FOREGROUND = 9  # random stream
OPEN_BOX = (0.25, 0.25, 0.75, 0.75)  # of the picture, which stays open in a flight: u0, v0, u1, v1
SETTINGS = (0.55, 0.2, 0.25)  # shares of cockpits, of airframes and drones, of plain pictures


@dataclass(frozen=True, eq=False)
class Foreground:
    """A layer over a scene that hides it and adds light."""

    rgb: NDArray[np.float32]
    """(H, W, 3) 0..255, weighted by the cover; reflections hardly have any."""
    cover: NDArray[np.float32]
    """(H, W) 0..1, share of the scene that it hides."""


class ForegroundKind(NamedTuple):
    paint: Callable[[Layer, Rng], None]
    shares: tuple[float, float, float]  # in each of SETTINGS
    blur: tuple[float, float]  # 1-sigma, of the picture's height
    opacity: tuple[float, float] = (1.0, 1.0)
    solid: bool = True  # has a material, and edges lit from outside


KINDS = (  # from the scene to the viewer
    ForegroundKind(cockpit.paint_nose, (0.4, 0.25, 0.0), (0.0, 0.01)),
    ForegroundKind(cockpit.paint_propeller, (0.1, 0.2, 0.0), (0.002, 0.015), (0.05, 0.6)),
    ForegroundKind(cockpit.paint_strut, (0.3, 0.4, 0.05), (0.0, 0.01)),
    ForegroundKind(cockpit.paint_legs, (0.0, 0.45, 0.0), (0.002, 0.02)),
    ForegroundKind(cockpit.paint_specks, (0.5, 0.3, 0.15), (0.0, 0.01), (0.15, 0.9), solid=False),
    ForegroundKind(cockpit.paint_reflection, (0.35, 0.0, 0.15), (0.005, 0.05), (0.03, 0.25), solid=False),
    ForegroundKind(screen.paint_hud, (0.08, 0.12, 0.08), (0.0, 0.002), (0.5, 1.0), solid=False),
    ForegroundKind(cockpit.paint_overhead, (0.25, 0.0, 0.0), (0.001, 0.015), (0.6, 1.0)),
    ForegroundKind(cockpit.paint_windows, (0.3, 0.0, 0.06), (0.001, 0.015)),
    ForegroundKind(cockpit.paint_pillars, (0.45, 0.0, 0.06), (0.001, 0.015)),
    ForegroundKind(cockpit.paint_panel, (0.65, 0.0, 0.05), (0.0, 0.008)),
    ForegroundKind(cockpit.paint_pilot, (0.25, 0.0, 0.0), (0.002, 0.015)),
    ForegroundKind(cockpit.paint_rails, (0.15, 0.1, 0.1), (0.0, 0.01), (0.5, 1.0)),
    ForegroundKind(cockpit.paint_flare, (0.2, 0.2, 0.2), (0.005, 0.03), (0.2, 1.0), solid=False),
    ForegroundKind(screen.paint_inset, (0.06, 0.06, 0.1), (0.0, 0.001), solid=False),
    ForegroundKind(screen.paint_captions, (0.25, 0.25, 0.55), (0.0, 0.002), (0.4, 1.0), solid=False),
    ForegroundKind(screen.paint_bars, (0.08, 0.08, 0.2), (0.0, 0.0), solid=False),
)


def add_foreground(frame: Frame, config: SimConfig, index: int) -> Frame:
    """The frame behind a foreground that leaves its runway open; the same foreground in all frames of a flight.

    Depth and truth stay the scene's. With `keep_clear`, the scene is the clear view, also in clear air.
    """
    flight = config.trajectory in FLIGHTS
    rng = np.random.default_rng([config.seed, FOREGROUND, 0 if flight else index])
    if rng.random() >= config.foreground_share:
        return frame
    height, width = frame.image_rgb.shape[:2]
    open_box = np.multiply(OPEN_BOX, [width, height] * 2) if flight else _box_lines(frame)
    foreground = draw_foreground(width, height, rng, open_box)
    noise = np.random.default_rng([config.seed, FOREGROUND, 1, index])
    seen = phone_picture(lay_over(frame.image_rgb, foreground), noise)
    truth = frame.truth
    if truth is not None and truth.clear_rgb is None and config.keep_clear:
        truth = replace(truth, clear_rgb=frame.image_rgb)
    return replace(frame, image_rgb=np.clip(np.rint(seen), 0, 255).astype(np.uint8), truth=truth)


def _box_lines(frame: Frame) -> NDArray[np.float64] | None:
    """Box u0, v0, u1, v1 (4,) px of what the picture shows of the true lines; None: nothing."""
    truth = frame.truth
    segments = [] if truth is None else [line for line in (truth.left, truth.right) if line is not None]
    lines = [find_visible_line(frame, segment, within_visibility=False) for segment in segments]
    points = [line.points_px for line in lines if line is not None]
    if not points:
        return None
    return np.concatenate([np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)])


def lay_over(image: NDArray[Any], foreground: Foreground) -> NDArray[np.float32]:
    """The picture (H, W, 3), 0..255, behind a foreground of its size."""
    shown = image * (1 - foreground.cover[..., None])
    shown += foreground.rgb
    return np.minimum(shown, 255.0, out=shown).astype(np.float32, copy=False)


def draw_foreground(width: int, height: int, rng: Rng, open_box: ArrayLike | None = None) -> Foreground:
    """A random foreground, now and then an empty one.

    Args:
        width, height: of the picture, px.
        open_box: (4,) box u0, v0, u1, v1, px, of which `OPEN_SHARE` stays uncovered: an element that hides more is
            drawn again or left out.
    """
    scale = min(1.0, MOST_PX / max(width, height))
    wide, tall = max(1, round(width * scale)), max(1, round(height * scale))
    total: Layer = np.zeros((tall, wide, 4), np.uint8)
    texture = _draw_texture(wide, tall, rng)
    box = None if open_box is None else _clip_box(np.multiply(open_box, scale), wide, tall)
    setting = int(rng.choice(len(SETTINGS), p=SETTINGS))
    for kind in KINDS:
        if rng.random() < kind.shares[setting]:
            for _ in range(TRIES):
                layer: Layer = np.zeros_like(total)
                kind.paint(layer, rng)
                if _add_layer(total, layer, texture, kind, box, rng):
                    break
    total = cv2.resize(total, (width, height)) if scale < 1 else total
    return Foreground(total[..., :3].astype(np.float32), total[..., 3] * np.float32(1 / 255))


def _clip_box(box: ArrayLike, width: int, height: int) -> tuple[slice, slice]:
    """Rows and columns of the part of a box inside the picture, at least one pixel."""
    low, high = np.clip(np.reshape(box, (2, 2)), 0, [width - 1, height - 1]).astype(int)
    return slice(low[1], high[1] + 1), slice(low[0], high[0] + 1)


def _add_layer(
    total: Layer, layer: Layer, texture: Layer, kind: ForegroundKind, box: tuple[slice, slice] | None, rng: Rng
) -> bool:
    """Put a layer over those drawn, in place; False, and nothing put, where it would cover too much of the box."""
    sigma, opacity = len(layer) * rng.uniform(*kind.blur), rng.uniform(*kind.opacity)
    reach = round(1.5 * sigma)
    u, v, wide, tall = cv2.boundingRect(layer[..., 3])
    part = slice(max(v - reach, 0), v + tall + reach), slice(max(u - reach, 0), u + wide + reach)
    if wide == 0:
        return True
    if reach > 0:
        side = 2 * reach + 1
        layer[part] = cv2.GaussianBlur(layer[part], (side, side), sigma, borderType=cv2.BORDER_REPLICATE)
    if box is not None:
        open_before, open_layer = 1 - total[..., 3][box] / 255, 1 - opacity * layer[..., 3][box] / 255
        if np.mean(open_before * open_layer) < OPEN_SHARE:
            return False
    drawn = _light(layer[part], texture[part], rng) if kind.solid else layer[part]
    if opacity < 1:
        drawn = cv2.convertScaleAbs(drawn, alpha=opacity)
    seen = cv2.merge([255 - drawn[..., 3]] * 4)
    total[part] = cv2.add(cv2.multiply(total[part], seen, None, 1 / 255), drawn)
    return True


def _light(layer: Layer, texture: Layer, rng: Rng) -> Layer:
    """A layer with a material, unevenly lit, its edges by light from outside."""
    height, width = layer.shape[:2]
    cover = layer[..., 3]
    shade = cv2.resize(rng.integers(50, 200, (2, 3), dtype=np.uint8), (width, height))
    shade = cv2.multiply(shade, texture, None, 1 / 128)
    whole = np.full_like(cover, 128)
    lit: Layer = cv2.multiply(layer, cv2.merge([shade, shade, shade, whole]), None, 1 / 128)
    if rng.random() < 0.5:
        small = cv2.resize(cover, (max(width // 8, 1), max(height // 8, 1)), interpolation=cv2.INTER_AREA)
        soft = cv2.GaussianBlur(small, (0, 0), rng.uniform(0.5, 2.5), borderType=cv2.BORDER_REPLICATE)
        rim = cv2.multiply(255 - cv2.resize(soft, (width, height)), cover, None, rng.uniform(0.05, 0.5) / 255)
        lit = cv2.add(lit, cv2.merge([rim, rim, rim, np.zeros_like(rim)]))
    return lit


def _draw_texture(width: int, height: int, rng: Rng) -> Layer:
    """Brightness (H, W) of a material, 128 where it is even: stains and grain."""
    texture: Layer = np.full((height, width), 128, np.uint8)
    for cell, most in ((height / 6, 30), (rng.uniform(1.0, 4.0), 10)):
        size = max(2, round(height / cell)), max(2, round(width / cell))
        noise = rng.integers(0, 2 + int(most * 2 * rng.random()), size, dtype=np.uint8)
        texture = cv2.add(texture, cv2.resize(noise, (width, height)))
    return texture
