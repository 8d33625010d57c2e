"""While the shutter is open: motion blur, rain before the lens, drops on it; drawn as numbers, exposed on the GPU."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.haze import Triple, triple
from deckline_sim.config import ExposureConfig
from deckline_sim.scene.gl import fullscreen, image_texture, link, moderngl
from deckline_sim.scene.view import Rendering

BLUR_CHANCE, RAIN_CHANCE, SPRAY_CHANCE = 0.22, 0.08, 0.03  # of a frame of preset train
EXPOSURE_S = (1 / 1000, 1 / 25)  # drawn, lowest and highest
FALL_M_S = 9.0  # of large raindrops: Gunn and Kinzer 1949
RAIN_MM_H = (2.0, 60.0)  # drawn: light to torrential
SHAKE_DEG_S = 5.0  # 1-sigma of the camera's turning in flight in training
BLUR_LIMIT = 0.02  # of the picture's width: more turning is not drawn
DROP_ZOOM = 7.0  # radii of the picture that a drop on the lens shows in one of its own
MOST_OPAQUE = 0.8  # of a streak
BRIGHT_SHARE = 0.3  # of the pixels, the brightest, whose light falling drops throw into the camera
# Marshall and Palmer 1948: N(D) = N0 exp(-L D), N0 = 8000 / (m^3 mm), L = 4.1 R^-0.21 / mm, R in mm/h.
DROPS_M3_MM, SLOPE_MM, SLOPE_EXPONENT = 8000.0, 4.1, -0.21
LEAST_MM, LARGE_MM = 0.5, 2.0  # smaller drops are not drawn; a large one decides how far away drops are drawn
LEAST_PX = 0.35  # apparent width of a large drop at that distance
NEAREST_M = 0.25
MOST_STREAKS = 4000  # of a picture, about: where there would be more, those nearest to the camera
SHORT_S = 1 / 1000  # exposure of the rain where no motion is to be seen
SIDES = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
RADIUS_SHARE = (0.006, 0.045)  # of the picture's width, drops on the lens, smallest and largest


@dataclass(frozen=True)
class Exposure:
    """One frame's exposure: plain numbers, recorded with it."""

    exposure_s: float = 0.0
    """Time that the shutter is open, s."""
    moved_m: Triple = (0.0, 0.0, 0.0)
    """(3,) of the camera while the shutter is open, in its optical frame, m."""
    turned_rad: Triple = (0.0, 0.0, 0.0)
    """(3,) rotation vector of the same, rad."""
    rain_mm_h: float = 0.0
    """Rainfall, mm/h."""
    rain_m_s: Triple = (0.0, FALL_M_S, 0.0)
    """(3,) velocity of the falling drops, optical frame, m/s."""
    streak_contrast: float = 1.0
    """1: physical; more: as rain drawn by games."""
    lens_drops: int = 0
    """Number of drops on the lens."""
    lens_seed: int = 0
    """Seed of the drops on the lens."""
    seed: int = 0
    """Seed of the falling drops."""

    @property
    def still(self) -> bool:
        """Whether the picture is what the renderer drew."""
        return not (any(self.moved_m) or any(self.turned_rad) or self.rain_mm_h > 0 or self.lens_drops > 0)


def draw_exposure(
    config: ExposureConfig,
    camera: Camera,
    world_from_camera: RigidTransform,
    velocity_m_s: ArrayLike,
    turning_rad_s: ArrayLike,
    recording: np.random.Generator,
    frame: np.random.Generator,
    wide: bool,
) -> Exposure:
    """Exposure of a camera that flies with a velocity (3,) relative to the ship and turns at a rate (3,), both world.

    `recording` draws the shutter, the rain and the drops on the lens, `frame` the values of one frame.
    """
    kinds = recording.random(3)
    drawn_s = float(np.exp(recording.uniform(*np.log(EXPOSURE_S)))) if kinds[0] < BLUR_CHANCE else 0.0
    drawn_rain = float(np.exp(recording.uniform(*np.log(RAIN_MM_H)))) if kinds[1] < RAIN_CHANCE else 0.0
    contrast, lens_seed = float(np.exp(recording.uniform(0.0, np.log(8.0)))), int(recording.integers(2**31))
    exposure_s = _setting(config.exposure_s, drawn_s, wide)
    rain = _setting(config.rain_mm_h, drawn_rain, wide)
    wet = wide and (rain > 0 or kinds[2] < SPRAY_CHANCE)
    drops = int(recording.poisson(recording.uniform(0.0, 25.0))) if wet else 0
    turned = np.deg2rad(_setting(config.shake_deg_s, SHAKE_DEG_S, wide)) * frame.normal(size=3) * exposure_s
    optical = world_from_camera.rotation.inv()
    turned = turned + optical.apply(np.asarray(turning_rad_s, dtype=np.float64)) * exposure_s
    limit = BLUR_LIMIT * camera.width / camera.fx
    if config.shake_deg_s is None:
        turned = turned * min(1.0, limit / max(float(np.linalg.norm(turned)), 1e-12))
    flown = optical.apply(np.asarray(velocity_m_s, dtype=np.float64))
    return Exposure(
        exposure_s=exposure_s,
        moved_m=triple(flown * exposure_s),
        turned_rad=triple(turned),
        rain_mm_h=rain,
        rain_m_s=triple(optical.apply([0.0, 0.0, FALL_M_S]) - flown),
        streak_contrast=contrast if wide else 1.0,
        lens_drops=drops if config.lens_drops is None else config.lens_drops,
        lens_seed=lens_seed,
        seed=int(frame.integers(2**31)),
    )


def _setting(given: float | None, drawn: float, wide: bool) -> float:
    return given if given is not None else drawn if wide else 0.0


class ExposurePass:
    """Exposes pinhole pictures; lives on the renderer's OpenGL context."""

    def __init__(self, context: moderngl.Context) -> None:
        self.context = context
        self.blur = link(context, "fullscreen.vert", "exposure.frag")
        self.streak = link(context, "exposure_quad.vert", "rain_streak.frag")
        self.drop = link(context, "exposure_quad.vert", "lens_drop.frag")
        self.screen = fullscreen(context, self.blur)
        self.blur["radiance"], self.blur["nearness"], self.drop["radiance"] = 0, 1, 0
        self.drop["zoom"] = DROP_ZOOM

    def expose(self, view: Rendering, camera: Camera, exposure: Exposure) -> Rendering:
        """A view of the middle of the exposure with the light of all of it; itself if nothing moves and nothing falls.

        Raises:
            ValueError: a camera that is no pinhole, or a picture of another size.
        """
        if exposure.still:
            return view
        if camera.has_distortion or view.depth_m.shape != (camera.height, camera.width):
            raise ValueError(f"the exposure needs a pinhole of the picture's size {view.depth_m.shape}, got {camera}")
        textures = [self.context.texture((camera.width, camera.height), 4, dtype="f4") for _ in range(2)]
        frames = [self.context.framebuffer([texture]) for texture in textures]
        self.context.disable(moderngl.DEPTH_TEST | moderngl.BLEND)
        self._blur(frames[0], view, camera, exposure)
        shown = frames[0]
        if exposure.rain_mm_h > 0:
            falling, rng = np.array(exposure.rain_m_s), np.random.default_rng(exposure.seed)
            quads = streaks(camera, falling, exposure.exposure_s, exposure.rain_mm_h, rng)
            quads[..., 4] = np.minimum(quads[..., 4] * exposure.streak_contrast, MOST_OPAQUE)
            self.streak["light"] = tuple(mean_bright_light(view.radiance).tolist())
            self._draw(frames[0], self.streak, quads)
        if exposure.lens_drops > 0:
            shown = frames[1]
            self.context.copy_framebuffer(frames[1], frames[0])
            textures[0].repeat_x = textures[0].repeat_y = False
            textures[0].build_mipmaps()
            textures[0].use(0)
            rng = np.random.default_rng(exposure.lens_seed)
            self._draw(frames[1], self.drop, drops_on_lens(camera, exposure.lens_drops, rng))
        exposed = np.frombuffer(shown.read(components=3, dtype="f4"), np.float32).reshape(view.radiance.shape)
        for frame, texture in zip(frames, textures, strict=True):
            frame.release()
            texture.release()
        return Rendering(exposed, view.depth_m)

    def _blur(self, target: moderngl.Framebuffer, view: Rendering, camera: Camera, exposure: Exposure) -> None:
        """Every pixel's mean along its path during the exposure."""
        light, near = image_texture(self.context, view.radiance), image_texture(self.context, view.nearness)
        light.repeat_x = light.repeat_y = False
        light.use(0)
        near.use(1)
        self.blur["lens"] = (camera.fx, camera.fy, camera.cx, camera.cy)
        self.blur["moved"], self.blur["turned"] = exposure.moved_m, exposure.turned_rad
        target.use()
        self.screen.render()
        light.release()
        near.release()

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


def mean_bright_light(radiance: NDArray[np.float32]) -> NDArray[np.float64]:
    """Mean light (3,) of a picture's brightest part, mostly its sky: a drop gathers light from all around."""
    pixels = radiance[::4, ::4].reshape(-1, 3).astype(np.float64)
    level = pixels.sum(axis=1)
    return np.asarray(pixels[level >= np.quantile(level, 1.0 - BRIGHT_SHARE)].mean(axis=0))


def streaks(
    camera: Camera, drops_m_s: NDArray[np.float64], exposure_s: float, rain_mm_h: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Streaks (N, 6, 8): corners of two triangles, each pixel (2), place across and along (2), opacity, 0, 0, 0.

    Args:
        drops_m_s: (3,) velocity of the drops relative to the camera, optical frame.
    """
    slope = SLOPE_MM * rain_mm_h**SLOPE_EXPONENT
    density = DROPS_M3_MM / slope * np.exp(-slope * LEAST_MM)
    solid = camera.width / camera.fx * camera.height / camera.fy / 3.0  # volume is this times the depth's cube
    reach_m = min(
        camera.fx * LARGE_MM / 1000.0 / LEAST_PX, float(np.cbrt(NEAREST_M**3 + MOST_STREAKS / density / solid))
    )
    reach_m = max(reach_m, 2 * NEAREST_M)
    count = rng.poisson(density * solid * (reach_m**3 - NEAREST_M**3))
    distance = rng.uniform(NEAREST_M**3, reach_m**3, count) ** (1 / 3)
    pixel = rng.uniform(0.0, 1.0, (count, 2)) * [camera.width, camera.height] - 0.5
    size_m = (LEAST_MM + rng.exponential(1.0 / slope, count)) / 1000.0
    middle = camera.rays(pixel) * distance[:, None]
    half = np.asarray(drops_m_s) * (exposure_s or SHORT_S) / 2
    ends = [camera.project(np.maximum(middle + sign * half, [-np.inf, -np.inf, NEAREST_M / 2])) for sign in (-1, 1)]
    width = size_m * camera.fx / distance
    return streak_quads(ends[0], ends[1], width)


def streak_quads(
    start_px: NDArray[np.float64], end_px: NDArray[np.float64], width_px: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Quads (N, 6, 8) about segments (N, 2); opacity is the share of the exposure that a pixel is covered."""
    path = end_px - start_px
    length = np.linalg.norm(path, axis=1)
    along = path / np.maximum(length, 1e-9)[:, None]
    along[length < 1e-9] = [0.0, 1.0]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    drawn = np.maximum(width_px, 1.0)  # a thinner streak is drawn fainter instead
    opacity = width_px / drawn * width_px / (length + width_px)
    middle, half = (start_px + end_px) / 2, (length + drawn) / 2
    corners = middle[:, None] + SIDES[:, :1] * (across * drawn[:, None] / 2)[:, None]
    corners = corners + SIDES[:, 1:] * (along * half[:, None])[:, None]
    return _quads(corners, np.column_stack([opacity, np.zeros((len(opacity), 3))]))


def drops_on_lens(camera: Camera, count: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Drops (N, 6, 8): corners of two triangles, each pixel (2), place within (2), middle (2), radius, softness."""
    middle = rng.uniform(0.0, 1.0, (count, 2)) * [camera.width, camera.height]
    low, high = np.log(RADIUS_SHARE)
    radius = np.exp(low + (high - low) * rng.uniform(0.0, 1.0, count) ** 2) * camera.width
    softness = rng.uniform(0.15, 0.9) * rng.uniform(0.7, 1.1, count)  # how far the drops are out of focus
    corners = middle[:, None] + SIDES * radius[:, None, None]
    return _quads(corners, np.column_stack([middle, radius, softness]))


def _quads(corners: NDArray[np.float64], detail: NDArray[np.float64]) -> NDArray[np.float32]:
    count = len(corners)
    sides, details = np.broadcast_to(SIDES, (count, 6, 2)), np.broadcast_to(detail[:, None], (count, 6, 4))
    return np.concatenate([corners, sides, details], axis=2).astype(np.float32)
