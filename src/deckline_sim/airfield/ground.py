"""The ground around an airfield and the sky above it, as seen by a pinhole camera above a plane.

Ground frame: x along the landing direction, y to its right, metres; see `land_runway`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
TILE = 512  # px of a texture, which repeats without a seam, and of a map of the ground, each way
NOISE_SLOPES = (0.6, 0.9, 1.2, 1.4, 1.6, 2.0, 2.2)  # of the last textures, which are noise
ROUGH, WOOLLY = -4, -2  # where its smoother and its smoothest ones begin
FAR_M = 30_000.0  # ground that is farther is drawn as being there
# Mean colours of what grows or lies around airfields, 0..255: meadow, dry grass, field, sand, rock, snow, heath, sea.
PALETTES = np.array(
    [
        [[78, 98, 52], [62, 84, 46], [96, 112, 60], [110, 108, 66], [50, 66, 40]],
        [[134, 122, 82], [150, 136, 96], [116, 108, 72], [98, 96, 62], [160, 146, 110]],
        [[120, 98, 72], [96, 104, 58], [150, 130, 88], [84, 100, 54], [170, 156, 110]],
        [[176, 152, 116], [160, 132, 100], [190, 168, 134], [140, 112, 84], [150, 140, 120]],
        [[120, 92, 72], [140, 108, 86], [100, 82, 68], [158, 126, 100], [90, 84, 66]],
        [[220, 224, 230], [206, 212, 222], [190, 198, 208], [150, 150, 146], [110, 112, 104]],
        [[92, 84, 60], [76, 76, 52], [106, 96, 66], [64, 70, 46], [120, 108, 80]],
        [[40, 72, 92], [50, 88, 104], [60, 110, 120], [36, 60, 80], [70, 130, 136]],
    ],
    dtype=np.float64,
)
PALETTE_SHARES = (0.3, 0.14, 0.16, 0.08, 0.08, 0.06, 0.12, 0.06)
SEA = len(PALETTES) - 1


@dataclass(frozen=True, eq=False)
class GroundCamera:
    """A pinhole camera above the ground."""

    width: int
    height: int
    focal_px: float
    position_m: Float64  # (3,) x, y, height above the ground
    axes: Float64  # (3, 3) rows: the camera's right, down and forward in the ground frame (x, y, up)

    def project(self, points_m: Float64) -> tuple[Float64, Float64]:
        """Pixels (N, 2) and depths (N,) of points (N, 3) x, y, height; pixels hold where the depth is positive."""
        seen = (points_m - self.position_m) @ self.axes.T
        depth = np.where(np.abs(seen[:, 2]) < 1e-6, 1e-6, seen[:, 2])
        middle = [(self.width - 1) / 2, (self.height - 1) / 2]
        return seen[:, :2] / depth[:, None] * self.focal_px + middle, seen[:, 2]

    def rays(self) -> Float32:
        """(H, W, 3) in the ground frame, one along the optical axis."""
        x = (np.arange(self.width, dtype=np.float32) - (self.width - 1) / 2) / self.focal_px
        y = (np.arange(self.height, dtype=np.float32) - (self.height - 1) / 2) / self.focal_px
        right, down, forward = self.axes.astype(np.float32)
        return x[None, :, None] * right + y[:, None, None] * down + forward


def fractal_noise(rng: Generator, size: int = TILE, slope: float = 1.0) -> Float32:
    """(size, size) of mean 0 and spread 1 that repeats without a seam; its amplitude falls as frequency^-slope."""
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.rfftfreq(size), indexing="ij"))
    k[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((size, size), dtype=np.float32)) * k**-slope
    noise = np.fft.irfft2(spectrum, s=(size, size))
    return (noise / noise.std()).astype(np.float32)


def draw_ground(
    viewer: GroundCamera,
    points: Float32,
    footprint_m: Float32,
    textures: Sequence[Float32],
    rng: Generator,
    at_sea: bool = False,
) -> tuple[Float32, Float64]:
    """Colours (H, W, 3), 0..255, of the ground at points (H, W, 2) m; the mean colour of what grows there.

    Args:
        footprint_m: (H, W) extent of a pixel on the ground.
        textures: (TILE, TILE) tiles of mean 0 and spread 1.
        at_sea: nothing but water.
    """
    if at_sea:
        water = PALETTES[SEA, 0] + (PALETTES[SEA, 0].mean() - PALETTES[SEA, 0]) * rng.random()
        mean = water * rng.uniform(0.4, 1.8)
        colour = np.tile(mean.astype(np.float32), (*points.shape[:2], 1))
    else:
        palette = PALETTES[rng.choice(len(PALETTES), p=PALETTE_SHARES)]
        mean = palette[0]
        colour = _map_colours(points, np.array([4000.0, 0.0]), 9000.0, palette, textures, rng)[0]
        near, inside = _map_colours(
            points, viewer.position_m[:2] + np.array([670.0, 0.0]), 1600.0, palette, textures, rng
        )
        colour = colour + (near - colour) * inside[..., None] * np.float32(rng.uniform(0.2, 0.9))
    strength = rng.uniform(0.03, 0.22)
    for texel_m in (0.15, 1.1, 8.0, 60.0):
        value = sample_tile(textures[int(rng.integers(len(textures)))], points, texel_m)
        fade = np.clip(2 * texel_m / footprint_m, 0, 1)
        detail = np.float32(strength * rng.uniform(0.4, 1.6)) * (value * fade).astype(np.float32)
        colour = colour * (1 + detail[..., None])
    return colour, mean


def sample_tile(tile: Float32, points: Float32, texel_m: float) -> Float32:
    """Values (H, W) at points (H, W, 2) m of a tile (TILE, TILE) that repeats."""
    at = (points / np.float32(texel_m)) % TILE
    return np.asarray(cv2.remap(tile, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))


def _map_colours(
    points: Float32, middle_m: Float64, extent_m: float, palette: Float64, textures: Sequence[Float32], rng: Generator
) -> tuple[Float32, Float32]:
    """Colours (H, W, 3) from a map of the ground, and how far (H, W) each point lies inside it, 0 (outside) to 1."""
    atlas = _draw_atlas(palette, extent_m, textures, rng)
    at = ((points - middle_m.astype(np.float32)) / np.float32(extent_m) + np.float32(0.5)) * np.float32(TILE)
    drawn = cv2.remap(atlas, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(drawn), np.clip((1 - np.abs(at / TILE - 0.5).max(axis=2) * 2) * 6, 0, 1)


def _draw_atlas(palette: Float64, extent_m: float, textures: Sequence[Float32], rng: Generator) -> Float32:
    """A map (TILE, TILE, 3): fields, woods, roads, houses, water. Its rows run along y, its columns along x."""
    base = palette[0] * (1 + rng.normal(0, 0.06, 3))
    atlas = np.tile(base.astype(np.float32), (TILE, TILE, 1))
    scale = TILE / extent_m
    if rng.random() < 0.75:
        _draw_fields(atlas, palette, scale, rng)
    broad = _shift(textures[ROUGH:], rng)
    atlas *= 1 + np.float32(rng.uniform(0.02, 0.15)) * broad[..., None]
    if rng.random() < 0.6:
        woods = _shift(textures[ROUGH:], rng) > rng.uniform(0.6, 2.0)
        atlas[woods] = np.array([34, 48, 30]) * rng.uniform(0.7, 1.5)
    if rng.random() < 0.3:
        water = _shift(textures[WOOLLY:], rng) > rng.uniform(0.8, 1.8)
        atlas[water] = PALETTES[SEA, rng.integers(5)] * rng.uniform(0.8, 1.6)
    for _ in range(rng.integers(0, 6)):
        _draw_path(atlas, scale, rng)
    for _ in range(rng.integers(0, 5)):
        _draw_town(atlas, scale, rng)
    return atlas


def _shift(textures: Sequence[Float32], rng: Generator) -> Float32:
    """One of the textures, begun elsewhere."""
    return np.roll(textures[int(rng.integers(len(textures)))], rng.integers(0, TILE, 2).tolist(), axis=(0, 1))


def _draw_fields(atlas: Float32, palette: Float64, scale: float, rng: Generator) -> None:
    angle, wide = rng.uniform(0, 180), rng.uniform(60, 500) * scale
    for _ in range(int(min(rng.uniform(0.3, 1.2) * (TILE / wide) ** 2, 160))):
        middle, size = rng.uniform(0, TILE, 2), wide * rng.uniform(0.4, 2.0, 2)
        corners = cv2.boxPoints((middle.tolist(), size.tolist(), angle + rng.normal(0, 3) + 90 * rng.integers(2)))
        colour = palette[rng.integers(len(palette))] * rng.uniform(0.75, 1.25) * (1 + rng.normal(0, 0.04, 3))
        cv2.fillPoly(atlas, [np.rint(corners).astype(np.int32)], colour.tolist())


def _draw_path(atlas: Float32, scale: float, rng: Generator) -> None:
    """A road, a track or a river."""
    steps = rng.normal(0, 0.3, 12).cumsum() + rng.uniform(0, 2 * np.pi)
    walk = np.cumsum(np.stack([np.cos(steps), np.sin(steps)], 1), axis=0) * TILE / 8
    points = np.rint((walk + rng.uniform(-0.2, 1.0, 2) * TILE) * 8).astype(np.int32)
    river = rng.random() < 0.15
    colour = PALETTES[SEA, 2] * rng.uniform(0.7, 1.4) if river else rng.uniform(80, 190) * (1 + rng.normal(0, 0.04, 3))
    wide = max(1, round((rng.uniform(30, 120) if river else rng.uniform(5, 24)) * scale))
    cv2.polylines(atlas, [points], False, np.asarray(colour).tolist(), wide, cv2.LINE_AA, shift=3)


def _draw_town(atlas: Float32, scale: float, rng: Generator) -> None:
    middle, angle = rng.uniform(0, TILE, 2), rng.uniform(0, 90)
    for _ in range(int(rng.integers(10, 160))):
        at = middle + rng.normal(0, rng.uniform(80, 400) * scale, 2)
        size = np.maximum(rng.uniform(8, 60, 2) * scale, 1.0)
        colour = rng.uniform(60, 235) * (1 + rng.normal(0, 0.12, 3))
        corners = cv2.boxPoints((at.tolist(), size.tolist(), angle))
        cv2.fillPoly(atlas, [np.rint(corners * 8).astype(np.int32)], colour.tolist(), cv2.LINE_AA, shift=3)


def draw_sky(rays: Float32, textures: Sequence[Float32], rng: Generator) -> Float32:
    """Colours (H, W, 3), 0..255, of the sky: a gradient, and clouds on a plane above."""
    up = rays[..., 2] / np.linalg.norm(rays, axis=2)
    horizon = rng.uniform(120, 250) * np.array([1 + rng.normal(0.0, 0.04), 1.0, 1 + rng.normal(0.03, 0.04)])
    zenith = horizon * rng.choice([0.35, 0.6, 0.9, 1.0]) * [rng.uniform(0.5, 1.0), rng.uniform(0.75, 1.0), 1.05]
    share = np.clip(up, 0, 1)[..., None] ** np.float32(rng.uniform(0.4, 1.0))
    sky = horizon + (zenith - horizon) * share
    cover = rng.uniform(-1.5, 1.5)
    if rng.random() < 0.75:
        scale = float(rng.uniform(20, 160))
        height = np.maximum(up, 0.02) + 0.02
        above = rays[..., :2] / height[..., None] + np.float32(rng.uniform(0, TILE))
        cloud = sample_tile(textures[int(rng.integers(len(textures)))], above, 1 / scale)
        opacity = np.clip((cloud + cover) * rng.uniform(0.2, 0.8), 0, 1) * np.clip(up * 12, 0, 1)
        tint = rng.uniform(90, 255) * (1 + rng.normal(0, 0.02, 3))
        sky = sky + (tint * (1 - 0.12 * cloud[..., None]) - sky) * opacity[..., None]
    return np.clip(sky, 0, 255).astype(np.float32)
