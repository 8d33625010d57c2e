"""What happens while the shutter is open: motion blur, rain before the lens, drops on it. On the GPU."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import Camera
from deckline.sim.camera.exposure import Exposure
from deckline.sim.camera.rain import drops_on_lens, streaks
from deckline.sim.scene.gl import moderngl

SHADERS = Path(__file__).parents[1] / "scene" / "shaders"
DROP_ZOOM = 7.0  # radii of the picture that a drop on the lens shows in one of its own
MOST_OPAQUE = 0.8  # of a streak
BRIGHT_SHARE = 0.3  # of the pixels, the brightest, whose light falling drops throw into the camera


class Film:
    """Exposes pinhole pictures; lives on the renderer's OpenGL context."""

    def __init__(self, context: moderngl.Context) -> None:
        self.context = context
        self.blur = self._program("fullscreen.vert", "film.frag")
        self.streak = self._program("film_quad.vert", "film_streak.frag")
        self.drop = self._program("film_quad.vert", "film_drop.frag")
        corners = context.buffer(np.array([[-1, -1], [3, -1], [-1, 3]], dtype=np.float32).tobytes())
        self.screen = context.vertex_array(self.blur, [(corners, "2f", "corner")])
        self.blur["radiance"], self.blur["nearness"], self.drop["radiance"] = 0, 1, 0
        self.drop["zoom"] = DROP_ZOOM

    def expose(
        self, radiance: NDArray[np.float32], depth_m: NDArray[np.float32], camera: Camera, exposure: Exposure
    ) -> NDArray[np.float32]:
        """Linear light (H, W, 3) after the exposure; the picture itself if nothing moves and nothing falls.

        Args:
            radiance: (H, W, 3) linear light in the middle of the exposure.
            depth_m: (H, W) along the optical axis, NaN in the sky.

        Raises:
            ValueError: a camera that is no pinhole, or a picture of another size.
        """
        if exposure.still:
            return radiance
        if camera.has_distortion or depth_m.shape != (camera.height, camera.width):
            raise ValueError(f"film needs a pinhole of the picture's size {depth_m.shape}, got {camera}")
        textures = [self.context.texture((camera.width, camera.height), 4, dtype="f4") for _ in range(2)]
        frames = [self.context.framebuffer([texture]) for texture in textures]
        self.context.disable(moderngl.DEPTH_TEST | moderngl.BLEND)
        self._blur(frames[0], radiance, depth_m, camera, exposure)
        shown = frames[0]
        if exposure.rain_mm_h > 0:
            self._rain(frames[0], radiance, camera, exposure)
        if exposure.lens_drops > 0:
            shown = frames[1]
            self.context.copy_framebuffer(frames[1], frames[0])
            textures[0].repeat_x = textures[0].repeat_y = False
            textures[0].build_mipmaps()
            textures[0].use(0)
            rng = np.random.default_rng(exposure.lens_seed)
            self._draw(frames[1], self.drop, drops_on_lens(camera, exposure.lens_drops, rng))
        exposed = np.frombuffer(shown.read(components=3, dtype="f4"), np.float32).reshape(radiance.shape)
        for frame, texture in zip(frames, textures, strict=True):
            frame.release()
            texture.release()
        return exposed

    def _blur(
        self,
        target: moderngl.Framebuffer,
        radiance: NDArray[np.float32],
        depth_m: NDArray[np.float32],
        camera: Camera,
        exposure: Exposure,
    ) -> None:
        """Every pixel's mean along its path during the exposure."""
        nearness = 1.0 / np.where(np.isnan(depth_m), np.float32(np.inf), depth_m)
        size = (camera.width, camera.height)
        light = self.context.texture(size, 3, np.ascontiguousarray(radiance, np.float32).tobytes(), dtype="f4")
        near = self.context.texture(size, 1, nearness.astype(np.float32).tobytes(), dtype="f4")
        light.repeat_x = light.repeat_y = False
        light.use(0)
        near.use(1)
        self.blur["lens"] = (camera.fx, camera.fy, camera.cx, camera.cy)
        self.blur["moved"], self.blur["turned"] = exposure.moved_m, exposure.turned_rad
        target.use()
        self.screen.render()
        light.release()
        near.release()

    def _rain(
        self, target: moderngl.Framebuffer, radiance: NDArray[np.float32], camera: Camera, exposure: Exposure
    ) -> None:
        falling, rng = np.array(exposure.rain_m_s), np.random.default_rng(exposure.seed)
        quads = streaks(camera, falling, exposure.exposure_s, exposure.rain_mm_h, rng)
        quads[..., 4] = np.minimum(quads[..., 4] * exposure.streak_contrast, MOST_OPAQUE)
        self.streak["light"] = tuple(bright(radiance).tolist())
        self._draw(target, self.streak, quads)

    def _draw(self, target: moderngl.Framebuffer, program: moderngl.Program, quads: NDArray[np.float32]) -> None:
        """Blend quads (N, 6, 8) over what is there."""
        if not len(quads):
            return
        program["size"] = target.size
        buffer = self.context.buffer(quads.tobytes())
        array = self.context.vertex_array(
            program, [(buffer, "2f 2f 4f", "pixel", "within", "detail")], skip_errors=True
        )
        target.use()
        self.context.enable(moderngl.BLEND)
        self.context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        array.render()
        self.context.disable(moderngl.BLEND)
        array.release()
        buffer.release()

    def _program(self, vertex: str, fragment: str) -> moderngl.Program:
        sources = [(SHADERS / name).read_text(encoding="utf-8") for name in (vertex, fragment)]
        return self.context.program(vertex_shader=sources[0], fragment_shader=sources[1])


def bright(radiance: NDArray[np.float32]) -> NDArray[np.float64]:
    """Mean light (3,) of a picture's brightest part, mostly its sky: a drop gathers light from all around."""
    pixels = radiance[::4, ::4].reshape(-1, 3).astype(np.float64)
    level = pixels.sum(axis=1)
    return np.asarray(pixels[level >= np.quantile(level, 1.0 - BRIGHT_SHARE)].mean(axis=0))
