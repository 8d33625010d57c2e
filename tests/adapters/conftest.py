import asyncio

import pytest
from airsim_serving import running_server


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    with running_server(tmp_path_factory.mktemp("recordings")) as running:
        yield running


@pytest.fixture
def client(server):
    """The published client. It leaves its event loop and tasks to whoever made it."""
    airsim = pytest.importorskip("cosysairsim")
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    made = airsim.MultirotorClient(port=server.port)
    made.reset()
    server.ticks[0] = 0.0
    server.lines.clear()
    yield made
    for transport in made.client._transport._sockets:
        transport._stream.set_close_callback(None)
    made.client.close()
    tasks = asyncio.all_tasks(loop)
    for task in tasks:
        task.cancel()
    loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
    made.client._loop.dettach_periodic_callback()
    made.client._loop._ioloop.close()
    asyncio.set_event_loop(None)
