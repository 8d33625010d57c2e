"""OpenGL without a screen: the context, programs from the shader files, textures of arrays."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

try:
    import moderngl
except ImportError as error:
    raise ImportError('the simulator needs moderngl: pip install "deckline[sim]"') from error

SHADERS = Path(__file__).parent / "shaders"
INCLUDES = ("light.glsl", "sky.glsl", "backdrop.glsl")
NO_EGL = (
    "cannot create an OpenGL context through EGL ({error}); on Debian or Ubuntu without a GPU driver: "
    "apt-get install libegl1 libgl1-mesa-dri libegl-mesa0"
)
__all__ = ["RendererError", "fullscreen", "image_texture", "link", "moderngl", "open_context"]


class RendererError(OSError):
    """No OpenGL context can be had on this machine."""


def open_context() -> moderngl.Context:
    """Standalone OpenGL context through EGL.

    Raises:
        RendererError: one line that names the Debian packages.
    """
    settings: dict = {"backend": "egl"}
    try:
        return moderngl.create_context(standalone=True, **settings)
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
