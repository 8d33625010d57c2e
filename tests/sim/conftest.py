import pytest

from deckline_sim.scene.gl import RendererError, open_context
from deckline_sim.scene.render import Renderer


@pytest.fixture(scope="session")
def opengl():
    """Skips on a machine without OpenGL."""
    try:
        open_context().release()
    except RendererError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")


@pytest.fixture(scope="module")
def context(opengl):
    made = open_context()
    yield made
    made.release()


@pytest.fixture(scope="session")
def renderer(opengl):
    with Renderer() as made:
        yield made
