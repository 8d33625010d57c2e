"""OpenGL without a screen, and what to install where it is missing."""

try:
    import moderngl
except ImportError as error:
    raise ImportError('the simulator needs moderngl: pip install "deckline[sim]"') from error

NO_EGL = (
    "cannot create an OpenGL context through EGL ({error}); on Debian or Ubuntu without a GPU driver: "
    "apt-get install libegl1 libgl1-mesa-dri libegl-mesa0"
)

__all__ = ["RendererError", "moderngl", "open_context"]


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
