from contextlib import closing

import pytest
from airsim_serving import CONFIG, WORLD_SETTINGS, open_client, run_server

from deckline_sim import RendererError
from deckline_sim.airsim_server.sim_clock import SimClock
from deckline_sim.airsim_server.world import World


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    with run_server(tmp_path_factory.mktemp("recordings")) as running:
        yield running


@pytest.fixture
def client(server):
    """The published client, the world as it was at the beginning."""
    with open_client(server.port) as made:
        made.reset()
        server.ticks[0] = 0.0
        server.lines.clear()
        yield made


@pytest.fixture(scope="module")
def world():
    try:
        with closing(World(CONFIG, WORLD_SETTINGS, SimClock(lambda: 0.0, epoch_ns=0))) as made:
            yield made
    except RendererError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")
