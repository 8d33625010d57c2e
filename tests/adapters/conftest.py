import pytest
from airsim_serving import published_client, running_server


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    with running_server(tmp_path_factory.mktemp("recordings")) as running:
        yield running


@pytest.fixture
def client(server):
    """The published client, the world as it was at the beginning."""
    with published_client(server.port) as made:
        made.reset()
        server.ticks[0] = 0.0
        server.lines.clear()
        yield made
