"""OpenGL without a screen: context, programs, and the textures of deck, noise, waves and the ship's own shadow."""

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.extras import needs_extra
from deckline_sim.scene.view import SAMPLES
from deckline_sim.ship.paint_shapes import layers, polygons
from deckline_sim.ship.ship import Ship

with needs_extra("sim"):
    import moderngl

SHADERS = Path(__file__).parent / "shaders"
INCLUDES = ("light.glsl", "sky.glsl", "backdrop.glsl")
NO_EGL = (
    "cannot create an OpenGL context through EGL ({error}); on Debian or Ubuntu without a GPU driver: "
    "apt-get install libegl1 libgl1-mesa-dri libegl-mesa0"
)
__all__ = ["RendererError", "fullscreen", "image_texture", "link", "moderngl", "open_context"]
SRGB8_ALPHA8 = 0x8C43  # OpenGL's name: the texture unit turns display colours into linear light before it filters
NOISE_SIZE = 512
SHADOW_SIZE = (2048, 1024)  # along the ship, across; about 0.2 m a texel on a large carrier
SHADOW_MARGIN_M = 2.0  # of light around the casters
SHADOW_REACH = 1.02  # of the depth range beyond the farthest caster


class RendererError(OSError):
    """No OpenGL context can be had on this machine."""


def open_context() -> moderngl.Context:
    """Standalone OpenGL context through EGL.

    Raises:
        RendererError: one line that names the Debian packages.
    """
    try:
        return moderngl.create_context(standalone=True, backend="egl")  # type: ignore[arg-type]
    except Exception as error:  # a bare Exception, an ImportError or an OSError, depending on what is missing
        raise RendererError(NO_EGL.format(error=" ".join(str(error).split()))) from error


def link(context: moderngl.Context, vertex: str, fragment: str) -> moderngl.Program:
    """The program of two shader files."""
    return context.program(vertex_shader=_source(vertex), fragment_shader=_source(fragment))


def _source(name: str) -> str:
    text = (SHADERS / name).read_text(encoding="utf-8")
    for part in INCLUDES:
        text = text.replace(f"#include {part}", (SHADERS / part).read_text(encoding="utf-8"))
    return text


def fullscreen(context: moderngl.Context, program: moderngl.Program) -> moderngl.VertexArray:
    """One triangle that covers the whole picture, drawn by a program."""
    corners = context.buffer(np.array([[-1, -1], [3, -1], [-1, 3]], dtype=np.float32).tobytes())
    return context.vertex_array(program, [(corners, "2f", "corner")])


def image_texture(context: moderngl.Context, values: ArrayLike) -> moderngl.Texture:
    """Single precision texture of an array (H, W) or (H, W, C)."""
    image: NDArray[np.float32] = np.ascontiguousarray(values, dtype=np.float32)
    channels = 1 if image.ndim == 2 else image.shape[2]
    return context.texture((image.shape[1], image.shape[0]), channels, image.tobytes(), dtype="f4")


def paint_deck(context: moderngl.Context, painter: moderngl.Program, ship: Ship) -> moderngl.Texture:
    """Mipmapped texture of a deck's colour; a shader reads it as linear reflectance.

    The noise texture must be bound to unit 0.
    """
    low, high = ship.layout.outline_m.min(axis=0), ship.layout.outline_m.max(axis=0)
    size = texture_size(high - low, ship.texels_per_m)
    painter["paint_area"] = (*low, *(high - low))
    painter["noise_offset"] = ship.surface.noise_offset
    painter["grain"], painter["wear"] = ship.surface.grain, ship.surface.wear
    samples = context.renderbuffer(size, 4, samples=SAMPLES)
    smooth = context.framebuffer([samples])
    smooth.use()
    smooth.clear(0.0, 0.0, 0.0, 1.0)
    context.disable(moderngl.DEPTH_TEST)
    context.enable(moderngl.BLEND)
    ground = polygons([low, (high[0], low[1]), high, (low[0], high[1])], ship.surface.rgb, wear=0.0)
    coats = context.buffer(layers([ground, ship.coat]).tobytes())
    array = context.vertex_array(painter, [(coats, "2f 4f 1f", "position", "colour", "worn")])
    array.render()
    context.disable(moderngl.BLEND)
    texture = context.texture(size, 4, internal_format=SRGB8_ALPHA8)
    resolved = context.framebuffer([texture])
    context.copy_framebuffer(resolved, smooth)
    for thing in (array, coats, resolved, smooth, samples):
        thing.release()
    texture.repeat_x = texture.repeat_y = False
    return _mipmapped(texture)


def texture_size(extent_m: NDArray[np.float64], texels_per_m: float) -> tuple[int, int]:
    """Powers of two near a resolution, along and across the deck.

    Halving an odd number of texels would shift far markings by decimetres.
    """
    wanted = np.log2(np.asarray(extent_m) * texels_per_m)
    return 2 ** round(wanted[0]), 2 ** int(np.ceil(wanted[1]))


def tile_texture(context: moderngl.Context, tile: NDArray[np.uint8]) -> moderngl.Texture:
    """Mipmapped texture of a tile (N, N, 4)."""
    return _mipmapped(context.texture(tile.shape[:2], 4, tile.tobytes()))


def _mipmapped(texture: moderngl.Texture) -> moderngl.Texture:
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    return texture


@cache
def noise_field(size: int = NOISE_SIZE) -> NDArray[np.uint8]:
    """Four independent tileable fractal noises (size, size, 4), mean 127.5."""
    rng = np.random.default_rng(20240614)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size))) * size
    frequency[0, 0] = np.inf
    channels = []
    for power in (1.1, 0.9, 1.6, 1.0):  # rough to smooth
        spectrum = np.fft.fft2(rng.standard_normal((size, size))) / frequency**power
        field = np.fft.ifft2(spectrum).real
        channels.append(127.5 + 50.0 * field / field.std())
    return np.clip(np.rint(np.stack(channels, axis=-1)), 0, 255).astype(np.uint8)


def light_from_ship(sun: NDArray[np.float64], points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Affine map (4, 4) of the ship frame to shadow map coordinates, every one of `points` (N, 3) inside 0..1.

    The first axis runs along the ship as seen from the sun, the third away from the sun.

    Args:
        sun: unit vector (3,) from the sun to the ground, ship frame.
        points_m: what casts shadows, ship frame.
    """
    ahead = np.array([1.0, 0.0, 0.0]) - sun[0] * sun
    if np.linalg.norm(ahead) < 1e-6:
        ahead = np.array([0.0, 1.0, 0.0])
    ahead = ahead / np.linalg.norm(ahead)
    axes = np.stack([ahead, np.cross(sun, ahead), sun])
    seen = points_m @ axes.T
    low, high = seen.min(axis=0) - SHADOW_MARGIN_M, seen.max(axis=0) + SHADOW_MARGIN_M
    scale = 1.0 / (high - low) / [1.0, 1.0, SHADOW_REACH]
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = scale[:, None] * axes, -scale * low
    return out


class ShadowMap:
    """The depth map on the card; made once, drawn for every ship and sun."""

    def __init__(self, context: moderngl.Context, program: moderngl.Program) -> None:
        self.context, self.program = context, program
        self.texture = context.depth_texture(SHADOW_SIZE)
        self.texture.compare_func = "<="
        self.texture.repeat_x = self.texture.repeat_y = False
        self.target = context.framebuffer(depth_attachment=self.texture)
        self.light_from_ship = np.eye(4)

    def draw(self, buffers: list[moderngl.Buffer], points_m: NDArray[np.float64], sun: NDArray[np.float64]) -> None:
        """Depth of meshes of vertices (x, y, z and 24 more bytes) under a sun (3,), ship frame."""
        self.light_from_ship = light_from_ship(sun, points_m)
        self.program["light_from_ship"] = tuple(self.light_from_ship.T.ravel().tolist())
        self.target.use()
        self.target.clear()
        self.context.enable(moderngl.DEPTH_TEST)
        for buffer in buffers:
            array = self.context.vertex_array(self.program, [(buffer, "3f 24x", "position")])
            array.render()
            array.release()
