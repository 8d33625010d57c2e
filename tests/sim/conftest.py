import pytest

from deckline.sim.scene.gl import RendererError
from deckline.sim.scene.render import Renderer


@pytest.fixture(scope="session")
def renderer():
    try:
        with Renderer() as made:
            yield made
    except RendererError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")
