"""Serves the simulator to AirSim's clients: sockets on one thread, the renderer on its own, calls in their order."""

import asyncio
import inspect
import socket
import sys
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deckline.adapters.airsim import HOST, PORT
from deckline.adapters.airsim.clock import Clock
from deckline.adapters.airsim.methods import METHODS, Service, unknown
from deckline.adapters.airsim.protocol import (
    MESSAGE_LIMIT,
    Decoder,
    ProtocolError,
    Request,
    encode_response,
)
from deckline.adapters.airsim.recorder import Recorder
from deckline.adapters.airsim.settings import Settings
from deckline.adapters.airsim.world import World
from deckline.sim.config import SimConfig

READ_BYTES = 1 << 16
MOST_CONNECTIONS = 256
MOST_HELD = 256 * 1024 * 1024  # bytes of messages that all connections together may hold
PATIENCE_S = 60.0  # with a peer that does not take its answer
SIGNATURES = {name: inspect.signature(handler) for name, handler in METHODS.items()}


def to_stderr(line: str) -> None:
    """One line for whoever runs the server."""
    print(f"deckline: {line}", file=sys.stderr, flush=True)


@dataclass(frozen=True, eq=False)
class ServerConfig:
    """How the server is reached and where it records.

    Args:
        host: address to listen on; other machines reach all but loopback addresses.
        port: 0 takes a free one.
        out: recordings become folders in it.
        message_limit: bytes from which on a message is refused.
        scene: free keys of a recording's scene.json.
        log: gets a line for everything unusual.
    """

    host: str = HOST
    port: int = PORT
    out: Path = Path("recordings")
    message_limit: int = MESSAGE_LIMIT
    scene: Mapping[str, Any] = field(default_factory=dict)
    log: Callable[[str], None] = to_stderr


class Connections:
    """Answers every client's calls; one client's trouble is nobody else's."""

    def __init__(self, service: Service, limit: int) -> None:
        self._service, self._limit = service, limit
        self._tasks: set[asyncio.Task[None]] = set()
        self._decoders: set[Decoder] = set()

    def accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take a connection, unless there are too many."""
        peer = "{}:{}".format(*writer.get_extra_info("peername", ("?", "?"))[:2])
        if len(self._tasks) >= MOST_CONNECTIONS:
            self._service.log(f"{peer}: refused, {MOST_CONNECTIONS} connections are open")
            writer.close()
            return
        writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        task = asyncio.create_task(self._converse(reader, writer, peer))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def close(self) -> None:
        """End all connections."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, peer: str) -> None:
        decoder = Decoder(self._limit)
        self._decoders.add(decoder)
        try:
            while data := await reader.read(READ_BYTES):
                if len(data) + sum(other.held for other in self._decoders) > MOST_HELD:
                    raise ProtocolError("all connections together hold too much")
                for message in decoder.feed(data):
                    if not isinstance(message, Request):
                        raise ProtocolError("an answer, though nothing was asked")
                    await self._handle(message, writer, peer)
            if decoder.midway:
                self._service.log(f"{peer}: left in the middle of a message")
        except ProtocolError as error:
            self._service.log(f"{peer}: {error}; connection closed")
        except TimeoutError:
            self._service.log(f"{peer}: took no answer for {PATIENCE_S:g} s; connection closed")
            writer.transport.abort()
        except OSError as error:
            self._service.log(f"{peer}: lost: {error.strerror or type(error).__name__}")
        finally:
            self._decoders.discard(decoder)
            writer.close()

    async def _handle(self, request: Request, writer: asyncio.StreamWriter, peer: str) -> None:
        error, result = await self._call(request, peer)
        if request.id is not None:
            writer.write(encode_response(request.id, error, result))
            await asyncio.wait_for(writer.drain(), PATIENCE_S)
        await asyncio.sleep(0)  # a peer that sends many calls at once shall not hold up the others

    async def _call(self, request: Request, peer: str) -> tuple[str | None, Any]:
        """Error and result of a call."""
        handler = METHODS.get(request.method)
        if handler is None:
            self._service.log(f"{peer}: {unknown(request.method).partition(';')[0]}")
            return unknown(request.method), None
        try:
            SIGNATURES[request.method].bind(self._service, *request.params)
        except TypeError as error:
            return f"{request.method}: {len(request.params)} parameters: {error}", None
        try:
            result = handler(self._service, *request.params)
            return None, await result if inspect.isawaitable(result) else result
        except ValueError as error:
            return f"{request.method}: {' '.join(str(error).split())}", None
        except Exception as error:  # a mistake of ours in one call shall not end the others' connections
            self._service.log(f"{peer}: {request.method} failed: {type(error).__name__}: {error}")
            return f"{request.method}: failed in the server", None


@asynccontextmanager
async def serving(
    config: SimConfig, settings: Settings, server: ServerConfig, clock: Clock | None = None
) -> AsyncIterator[int]:
    """Serve while the context is open; gives the port.

    Args:
        clock: the simulated time; None: it begins now.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
        OSError: the address cannot be listened on.
    """
    loop = asyncio.get_running_loop()
    with ThreadPoolExecutor(1, thread_name_prefix="renderer") as renderer:
        world = await loop.run_in_executor(renderer, World, config, settings, clock or Clock())
        recorder = Recorder(server.out, settings, lambda: service.frame(), dict(server.scene), server.log)
        service = Service(world, renderer, recorder, server.log)
        connections = Connections(service, server.message_limit)
        try:
            listening = await asyncio.start_server(connections.accept, server.host, server.port)
            try:
                yield int(listening.sockets[0].getsockname()[1])
            finally:
                listening.close()
        finally:
            await connections.close()
            await recorder.stop()
            await loop.run_in_executor(renderer, world.__exit__, None, None, None)


def serve(config: SimConfig, settings: Settings, server: ServerConfig) -> None:
    """Serve until interrupted.

    Raises:
        RendererError: no OpenGL through EGL on this machine.
        ValueError: the address cannot be listened on.
    """

    async def forever() -> None:
        async with serving(config, settings, server) as port:
            server.log(f"AirSim server on {server.host}:{port}, vehicle {settings.vehicle}; Ctrl-C ends it")
            await asyncio.Event().wait()

    try:
        asyncio.run(forever())
    except OSError as error:
        said = error.strerror or str(error)
        raise ValueError(f"cannot listen on {server.host}:{server.port} ({said}): choose --host or --port") from None
