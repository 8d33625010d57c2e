"""Paints a deck into a texture with OpenGL, and makes the noise that every shader shares."""

import numpy as np
from numpy.typing import NDArray

from deckline.sim.scene.gl import moderngl
from deckline.sim.scene.waves import TILE_TEXELS, wave_tile
from deckline.sim.ship.paint import Coat, fill, layers
from deckline.sim.ship.ship import Ship

SRGB8_ALPHA8 = 0x8C43  # OpenGL's name: the texture unit turns display colours into linear light before it filters
SAMPLES = 4  # per pixel, against jagged edges
NOISE_SIZE = 512


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
    ground = fill([low, (high[0], low[1]), high, (low[0], high[1])], ship.surface.rgb, wear=0.0)
    _draw(context, painter, smooth, layers([ground, ship.coat]))
    context.disable(moderngl.BLEND)
    texture = context.texture(size, 4, internal_format=SRGB8_ALPHA8)
    resolved = context.framebuffer([texture])
    context.copy_framebuffer(resolved, smooth)
    for thing in (resolved, smooth, samples):
        thing.release()
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture


def texture_size(extent_m: NDArray[np.float64], texels_per_m: float) -> tuple[int, int]:
    """Powers of two near a resolution, along and across the deck.

    Halving an odd number of texels would shift far markings by decimetres.
    """
    wanted = np.log2(np.asarray(extent_m) * texels_per_m)
    return 2 ** round(wanted[0]), 2 ** int(np.ceil(wanted[1]))


def _draw(
    context: moderngl.Context,
    painter: moderngl.Program,
    target: moderngl.Framebuffer,
    coat: Coat,
) -> None:
    if not len(coat):
        return
    target.use()
    buffer = context.buffer(coat.tobytes())
    array = context.vertex_array(painter, [(buffer, "2f 4f 1f", "position", "colour", "worn")])
    array.render()
    array.release()
    buffer.release()


def noise_texture(context: moderngl.Context) -> moderngl.Texture:
    """The shaders' tileable noise, mipmapped."""
    texture = context.texture((NOISE_SIZE, NOISE_SIZE), 4, noise_field(NOISE_SIZE).tobytes())
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    return texture


def wave_texture(context: moderngl.Context) -> moderngl.Texture:
    """The sea's tile, mipmapped."""
    texture = context.texture((TILE_TEXELS, TILE_TEXELS), 4, wave_tile().tobytes())
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    return texture


def noise_field(size: int) -> NDArray[np.uint8]:
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
