"""A server on a thread of its own, and the real published client against it."""

import asyncio
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

import pytest

from deckline.adapters.airsim.protocol import Decoder, encode_request
from deckline_sim import RendererError
from deckline_sim.airsim_server.rpc_server import serving
from deckline_sim.airsim_server.settings import CaptureSetting, parse_settings
from deckline_sim.airsim_server.sim_clock import SimClock
from deckline_sim.config import DepthConfig, SensorConfig, SimConfig

WIDTH, HEIGHT, FOV_DEG = 96, 54, 90.0
EPOCH_NS = 1_700_000_000_000_000_000
# Nothing random in the picture's last steps, so that two pictures of one view are equal.
CONFIG = SimConfig(
    width=WIDTH,
    height=HEIGHT,
    fov_deg=FOV_DEG,
    keep_clear=False,
    depth=DepthConfig(range_m=float("inf")),
    sensor=SensorConfig(noise=0.0, electrons=0.0),
)
WORLD_SETTINGS = parse_settings({}, CaptureSetting(WIDTH, HEIGHT, FOV_DEG))


@dataclass
class Running:
    """What a test needs of a server. Its time is `ticks[0]`, or runs with the wall clock."""

    port: int
    lines: list[str]
    out: Path
    ticks: list[float]


@contextmanager
def serve_in_thread(config, settings, **options):
    """`serving` with its options on a thread of its own; yields the port."""
    ports = Queue()
    stop = asyncio.Event()

    async def serve_until_stopped():
        async with serving(config, settings, **options) as port:
            ports.put((port, asyncio.get_running_loop()))
            await stop.wait()

    with ThreadPoolExecutor(1, thread_name_prefix="airsim-server") as thread:
        done = thread.submit(lambda: asyncio.run(serve_until_stopped()))
        done.add_done_callback(lambda _: ports.put(None))
        if started := ports.get():
            try:
                yield started[0]
            finally:
                if not done.done():
                    started[1].call_soon_threadsafe(stop.set)
        done.result()


@contextmanager
def run_server(out, config=CONFIG, speed=None, **options):
    """A server until the block ends; an error in it is raised here. `speed`: of its time over the wall clock's."""
    running = Running(0, [], out, [0.0])
    ticks = (lambda: running.ticks[0]) if speed is None else (lambda: speed * time.monotonic())
    clock = SimClock(ticks, epoch_ns=EPOCH_NS)
    settings = parse_settings({}, CaptureSetting(config.width, config.height, config.fov_deg))
    options |= {"port": 0, "out": out, "log": running.lines.append, "clock": clock}
    try:
        with serve_in_thread(config, settings, **options) as running.port:
            yield running
    except RendererError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")


@contextmanager
def open_client(port):
    """The real client of PyPI, on an event loop of its own; it leaves loop and tasks to whoever made it."""
    airsim = pytest.importorskip("cosysairsim")
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    made = airsim.MultirotorClient(port=port)
    try:
        yield made
    finally:
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


def connect(port):
    """A plain socket to the server."""
    peer = socket.create_connection(("127.0.0.1", port), timeout=30.0)
    peer.settimeout(30.0)
    return peer


def ask(peer, method, *params):
    """(error, result) of a call over a plain socket."""
    peer.sendall(encode_request(7, method, params))
    decoder = Decoder(limit=1 << 28)
    while data := peer.recv(1 << 16):
        for answer in decoder.feed(data):
            return answer.error, answer.result
    raise ConnectionError("closed without an answer")


def is_closed(peer):
    """Whether the server closes the connection."""
    try:
        while peer.recv(1 << 16):
            pass
    except ConnectionResetError:
        pass
    return True
