import pytest

from deckline_sim.scene.gl import open_context
from deckline_sim.scene.render import Renderer


@pytest.fixture(scope="module")
def context(opengl):
    made = open_context()
    yield made
    made.release()


@pytest.fixture(scope="session")
def renderer(opengl):
    with Renderer() as made:
        yield made
