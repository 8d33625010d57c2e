"""Lens distortion and principal point: a pinhole's picture seen through a distorting lens, on the GPU."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from deckline.geometry import Camera
from deckline_sim.config import LensConfig
from deckline_sim.scene.gl import fullscreen, image_texture, link, moderngl
from deckline_sim.scene.view import Rendering

GRID_CELLS = 48  # each way; rays are solved at their corners and interpolated by cubics, to better than 0.001 px
MARGIN_PX = 2  # of the pinhole's picture around what the lens sees
LARGEST = 2.0  # times the lens' picture that its pinhole may grow, each way
AGREE = 1.1  # largest ratio of neighbouring depths that are taken for one surface
CHANCE = 0.35  # of a drawn lens that it distorts
CORNER_SHIFT = (-0.1, 0.05)  # of a drawn lens, barrel to pincushion, relative to the corner's distance
KEPT_MAPS = 4  # per Lens, of the last cameras


def random_lens(config: LensConfig, camera: Camera, rng: np.random.Generator, wide: bool) -> Camera:
    """A pinhole camera with the configured lens, or one drawn from `rng` if `wide`.

    Raises:
        ValueError: a configured distortion that bends the corners' rays back over others.
    """
    distorts, shift = rng.random() < CHANCE, rng.uniform(*CORNER_SHIFT)
    corner2 = (camera.width / camera.fx / 2) ** 2 + (camera.height / camera.fy / 2) ** 2
    share, tangential = rng.uniform(-0.3, 0.3), rng.normal(0.0, 0.002, 2) / np.sqrt(corner2)
    offset = np.clip(rng.normal(0.0, 0.015, 2), -0.04, 0.04) * camera.width
    distortion = (0.0, 0.0, 0.0, 0.0, 0.0)
    if config.distortion is not None:
        distortion = config.distortion
    elif wide and distorts:
        k1, k2 = shift * (1 - share) / corner2, shift * share / corner2**2
        distortion = (float(k1), float(k2), float(tangential[0]), float(tangential[1]), 0.0)
    right, down = config.principal_offset_px or ((float(offset[0]), float(offset[1])) if wide else (0.0, 0.0))
    lens = replace(camera, distortion=distortion, cx=camera.cx + right, cy=camera.cy + down)
    try:
        pinhole_for(lens)
    except ValueError:
        if config.distortion is not None:
            raise
        return replace(lens, distortion=(0.0, 0.0, 0.0, 0.0, 0.0))  # its principal point lies too far off for it
    return lens


def pinhole_for(camera: Camera) -> Camera:
    """The smallest pinhole of the same focal lengths that sees every ray of a camera.

    Raises:
        ValueError: a lens with pixels that no ray reaches, or that sees too wide for a pinhole.
    """
    if not camera.has_distortion:
        return camera
    u, v = np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float)
    border = [np.column_stack([u, np.full(len(u), row)]) for row in (0.0, v[-1])]
    border += [np.column_stack([np.full(len(v), column), v]) for column in (0.0, u[-1])]
    pixels = camera.rays(np.concatenate(border))[:, :2] * [camera.fx, camera.fy]
    if not np.all(np.isfinite(pixels)):
        raise ValueError(f"no ray reaches some of the image's border with distortion {camera.distortion}")
    low, high = np.floor(pixels.min(axis=0)) - MARGIN_PX, np.ceil(pixels.max(axis=0)) + MARGIN_PX
    width, height = (int(size) for size in high - low + 1)
    added = 2 * MARGIN_PX + 2  # what margins and rounding add, which is much of a tiny picture
    if width - added > LARGEST * camera.width or height - added > LARGEST * camera.height:
        raise ValueError(f"distortion {camera.distortion} would need a pinhole of {width}x{height} px")
    return Camera(width, height, camera.fx, camera.fy, float(-low[0]), float(-low[1]))


@lru_cache(maxsize=8)
def pixel_rays(camera: Camera) -> NDArray[np.float32]:
    """Rays (H, W, 3) with z = 1 in the optical frame of every pixel: `Camera.rays`, faster, within 0.001 px."""
    u, v = np.arange(camera.width), np.arange(camera.height)
    rays = np.ones((camera.height, camera.width, 3), dtype=np.float32)
    if not camera.has_distortion:
        rays[..., 0], rays[..., 1] = (u - camera.cx) / camera.fx, ((v - camera.cy) / camera.fy)[:, None]
        return rays
    if min(camera.width, camera.height) < 2:  # nothing to interpolate between
        pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        return camera.rays(pixels).reshape(rays.shape).astype(np.float32)
    grid_u, grid_v = (np.linspace(0, size - 1, GRID_CELLS + 1) for size in (camera.width, camera.height))
    at = np.stack(np.meshgrid(grid_u, grid_v), axis=-1)
    solved = camera.rays(at.reshape(-1, 2)).reshape(len(grid_v), len(grid_u), 3)
    for axis in (0, 1):
        rays[..., axis] = RectBivariateSpline(grid_v, grid_u, solved[..., axis])(v, u)
    return rays


class Lens:
    """Warps pinhole pictures; lives on the renderer's OpenGL context."""

    def __init__(self, context: moderngl.Context) -> None:
        self.context, self.program = context, link(context, "fullscreen.vert", "lens.frag")
        self.array = fullscreen(context, self.program)
        for unit, name in enumerate(("radiance", "nearness", "lens_map")):
            self.program[name] = unit
        self.program["agree"] = AGREE
        self.maps: dict[tuple[Camera, Camera], moderngl.Texture] = {}

    def warp(self, view: Rendering, source: Camera, camera: Camera) -> Rendering:
        """The picture that `camera` takes of what a pinhole `source` at the same place saw.

        Colours and 1 / depth are interpolated between four pixels, depth only where these lie on one surface.

        Raises:
            ValueError: a source that is no pinhole, or a view of another size.
        """
        if source.has_distortion:
            raise ValueError(f"the source must be a pinhole, got distortion {source.distortion}")
        if view.depth_m.shape != (source.height, source.width):
            raise ValueError(f"the source is {source.width}x{source.height} px, its view {view.depth_m.shape}")
        pictures = [image_texture(self.context, values) for values in (view.radiance, view.nearness)]
        for unit, texture in enumerate((*pictures, self._map(source, camera))):
            texture.use(unit)
        return self._draw((camera.width, camera.height), pictures)

    def _draw(self, size: tuple[int, int], pictures: list[moderngl.Texture]) -> Rendering:
        targets = [self.context.renderbuffer(size, channels, dtype="f4") for channels in (4, 1)]
        frame = self.context.framebuffer(targets)
        frame.use()
        self.context.disable(moderngl.DEPTH_TEST | moderngl.BLEND)
        self.array.render()
        shape = (size[1], size[0])
        rgb = np.frombuffer(frame.read(components=3, attachment=0, dtype="f4"), np.float32).reshape(*shape, 3)
        depth = np.frombuffer(frame.read(components=1, attachment=1, dtype="f4"), np.float32).reshape(shape)
        frame.release()
        for target in targets:
            target.release()
        for picture in pictures:
            picture.release()
        return Rendering(rgb, np.where(depth > 0, depth, np.float32(np.nan)))

    def _map(self, source: Camera, camera: Camera) -> moderngl.Texture:
        """Texture with the source's pixel of each of the camera's."""
        key = (source, camera)
        if key not in self.maps:
            if len(self.maps) >= KEPT_MAPS:
                self.maps.pop(next(iter(self.maps))).release()
            scale, shift = np.array([source.fx, source.fy]), np.array([source.cx, source.cy])
            pixels = pixel_rays(camera)[..., :2] * scale + shift
            self.maps[key] = image_texture(self.context, pixels)
        return self.maps[key]
